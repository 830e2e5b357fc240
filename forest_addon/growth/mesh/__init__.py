"""Skeletons and leaves to triangles."""
