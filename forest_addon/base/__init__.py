"""Base: row tables, runs within groups, triangle meshes, random streams, progress."""
