"""Mirrors, glass, water and retro-reflectors: how they turn light, and what it meets then."""
