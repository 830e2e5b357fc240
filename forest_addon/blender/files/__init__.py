"""Files: .blend and .glb files, and tree meshes of other programs."""
