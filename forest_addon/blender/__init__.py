"""Blender: arrays to meshes and instances, the evaluated scene to arrays, ray casts."""
