"""Scene: grown forests as Blender meshes, instances and materials."""
