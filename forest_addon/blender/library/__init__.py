"""Library: grown variants as assets with pictures and truth."""
