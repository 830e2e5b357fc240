"""The trunks that sound meets: cut from the scene at the height of a path, and beyond its field."""
