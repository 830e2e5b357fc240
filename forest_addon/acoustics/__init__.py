"""Acoustics: the physics of air, leaves and trunks."""
