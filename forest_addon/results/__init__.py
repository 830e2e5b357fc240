"""Results: figures, labels, files and sounds that a sensor gives, as numpy arrays without Blender."""
