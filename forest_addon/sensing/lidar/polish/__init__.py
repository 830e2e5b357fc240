"""Mirrors, glass and water: how they turn light, and what it meets then."""
