"""What a stand does to sound besides scattering it once: losses, transport, and the noise they leave."""
