"""Slow, independent references that tests compare the product with."""
