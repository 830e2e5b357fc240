"""Results: figures, labels, files and sounds that a sensor gives, as numpy arrays without Blender."""

POINT_FORMATS = ("laz", "las", "copc.laz", "ply", "double.ply", "pcd", "npz")  # of files of points
