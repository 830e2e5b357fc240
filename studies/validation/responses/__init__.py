"""Reverb held to recordings, to levels by distance, and to exact multiple scattering."""
