"""Show: results, hills and grounds as Blender objects and renders."""
