"""Sensors: objects of a Blender scene that look and listen in it."""
