"""Legend of the files of a scene's folder, in words, for the data card."""

from __future__ import annotations

FILES = {
    "scene.json": "number, split, seed, what was drawn, digests of all grown trees, SHA-256 of every file",
    "scene.toml": "the settings as they were run; a scene file of Forest Sensing",
    "trees.csv": "a row a tree: species, place, DBH at 1.3 m above the ground, height, crown base and "
    "width, wood "
    "volume and area, leaf area and count",
    "leaf_angles.csv": "distribution of leaf inclinations by planting",
    "cylinders.csv": "a row a branch segment of every tree: ends, radii, parent, axis, order, in the "
    "columns of "
    "aRchi and rTwig (IDs from 1 within a tree, 0: none)",
    "voxels.npz": "leaf (one side) and wood area density in m²/m³ of cubic cells (`cell` times `edge` plus "
    "`origin` is the lowest corner), and which trees are in which cell",
    "NAME-occlusion.npz": "by cell: pulses that went in, hit, or were blocked before it",
    "NAME-hidden.npz": "every tree on the axes of some pulses, and whether the pulse saw it",
    "NAME-points.npz": "points of a scan with all labels, an array a field",
    "NAME.laz": "point clouds, LAS 1.4: tree, species, organ, leaf, normal, true range as extra bytes",
    "NAME-forinstance.laz": "point clouds in the terms of FOR-instance: `classification` 0 unclassified, "
    "1 low vegetation (lying stems and stumps, too), 2 terrain, 3 out points (none here), 4 stem, 5 live "
    "branches with their leaves, 6 woody branches, which are dead; `treeID` the tree of trees.csv + 1, 0 "
    "none; `organ` as above; `order` 0 the stem, 1 its branches and so on, -1 unknown",
    "NAME-route.csv": "poses of a sonar's route, in the scene's coordinates, without its offset",
    "coordinates.txt": "what coordinates are, of a scene with an offset",
    "NAME.wav": "echoes slowed down, or impulse responses, as sound",
    "leaves.npz": "centre, normal, axis and size of every leaf",
    "terrain.npy": "heights of the ground, first row the north edge",
    "forest.blend": "the scene in Blender",
    "forest.glb": "the scene as glTF",
    "preview.png": "a render",
    "preview-segments.png": "what each pixel of the render shows: red + 256 green + 65536 blue is tree of "
    "trees.csv + 1, times 8, plus the class of FOR-instance; black: sky, or what has no class",
}
LIMITS = (
    "Trees are models: grown by grammars or from templates, not measured ones; leaves are flat.",
    "`cylinders.csv` holds all wood of trees with `all_branches` = 1 in trees.csv; of trees that are "
    "grafted from "
    "templates only trunk and first-level branches.",
    "Wood goes on a little below the ground; its area there counts in `voxels.npz`.",
    "Occlusion takes a pulse as the axis of its beam, and counts every n-th pulse (`every`).",
    "The same bytes need the same versions of the packages above, and the same ray engine (`engine` in "
    "scene.json).",
)
