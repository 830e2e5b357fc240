"""Rays: the scene as sensors see it, and how it is asked."""
