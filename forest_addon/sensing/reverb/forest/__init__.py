"""Effects of a stand on sound besides scattering it once: losses, transport, and the noise they leave."""
