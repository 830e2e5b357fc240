"""Intensity functions: how many trees are expected where."""
