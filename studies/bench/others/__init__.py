"""The same scan by other programs."""
