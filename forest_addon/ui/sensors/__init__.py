"""Sensors: added, set, drawn where they look, run."""
