"""Settings: the dataclasses of ``spec`` as Blender properties and scene files."""
