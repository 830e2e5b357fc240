"""Siblings by a grammar fitted to a tree."""
