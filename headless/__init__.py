"""Forest Sensing without a screen: ``python -m headless``."""
