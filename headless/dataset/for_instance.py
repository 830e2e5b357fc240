"""Points with the field names and classes of FOR-instance, as networks for forests are trained on.

FOR-instance (Puliti et al. 2023, arXiv 2309.01279) has the class of a point in ``classification`` and its
tree in ``treeID``, 0 where it has none. ``organ`` and ``order`` (branching order of wood, 0 the stem, and of
what bears a leaf; -1 where it is not known) are ours: by them other classes can be made.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from pathlib import Path

import laspy
import numpy as np

from forest_addon.base.trimesh import DEAD, GROUND, LEAF, WOOD
from forest_addon.formats.atomic import replacing
from forest_addon.sensing.lidar.cloud import Cloud, Returns
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import Planting
from forest_addon.stand.forest import GrownForest
from forest_addon.stand.plan import PLANTS

CLASSES = (
    *("unclassified", "low vegetation", "terrain", "out points"),
    *("stem", "live branches", "woody branches"),
)
LOW_VEGETATION, TERRAIN, STEM, LIVE, WOODY = 1, 2, 4, 5, 6
STEP = 0.001  # metres between coordinates of the file
FIELDS = {
    "treeID": ("int32", "tree of trees.csv + 1, 0 none"),
    "organ": ("int8", "0 other wood leaf ground 4 dead"),
    "order": ("int8", "0 stem, 1 branch; -1 unknown"),
}


def orders_of(found: Returns, scene: SceneGeometry, forest: GrownForest) -> np.ndarray:
    """(P,) int8 branching order of what was met, -1 where it is no grown tree or was changed in Blender."""
    order = np.full(len(found.organ), -1, dtype=np.int8)
    stand = forest.stand
    row_of = np.full(int(stand.id.max(initial=-1)) + 2, -1)
    row_of[stand.id] = np.arange(len(stand))
    row = row_of[np.where(found.tree < len(row_of) - 1, found.tree, -1)]
    for number, mesh in enumerate(scene.meshes):
        of_mesh = np.flatnonzero((scene.mesh_index[found.instance] == number) & (row >= 0))
        if not len(of_mesh):
            continue
        standing = row[of_mesh[0]]
        key = int(stand.species[standing]), int(stand.variant[standing])
        grown = forest.variants[key].mesh if key in forest.variants else None
        if grown is None or grown.order is None or not np.array_equal(grown.part, mesh.part):
            continue
        order[of_mesh] = grown.order[found.triangle[of_mesh]]
    return order


def classes_of(
    found: Returns, order: np.ndarray, plantings: Sequence[Planting]
) -> tuple[np.ndarray, np.ndarray]:
    """(P,) uint8 classes of FOR-instance and (P,) int32 trees, 0 where there is none.

    Dead branches are woody branches; leaves and living branches are live branches, as there. Undergrowth,
    lying stems and stumps are low vegetation, young trees are trees. Wood of unknown order, of trees that
    were grafted from templates, is a live branch.
    """
    classes = np.zeros(len(found.organ), dtype=np.uint8)
    classes[found.organ == GROUND] = TERRAIN
    classes[(found.organ == LEAF) | (found.organ == WOOD)] = LIVE
    classes[found.organ == DEAD] = WOODY
    classes[((found.organ == WOOD) | (found.organ == DEAD)) & (order == 0)] = STEM
    low = np.array([*(planting.species in PLANTS for planting in plantings), False])
    is_low = low[np.where(found.species < len(plantings), found.species, -1)] & (found.species >= 0)
    classes[is_low] = LOW_VEGETATION
    tree = np.where((found.tree >= 0) & ~is_low, found.tree + 1, 0)
    return classes, tree.astype(np.int32)


def write_for_instance(
    path: Path,
    cloud: Cloud,
    order: np.ndarray,
    plantings: Sequence[Planting],
    offset: Sequence[float] = (0.0, 0.0, 0.0),
) -> None:
    """Write a cloud as LAZ (format 6 of LAS 1.4) with ``classification``, ``treeID``, ``organ``, ``order``.

    Raises
    ------
    OSError : it cannot be written.
    """
    place = cloud.position + np.asarray(offset)
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales = np.full(3, STEP)
    header.offsets = np.floor(place.min(axis=0)) if len(place) else np.zeros(3)
    header.creation_date, header.generating_software = date(1980, 1, 1), "Forest Sensing"
    header.add_extra_dims([laspy.ExtraBytesParams(n, k, d) for n, (k, d) in FIELDS.items()])
    las = laspy.LasData(header)
    las.x, las.y, las.z = place.T
    las.return_number, las.number_of_returns = cloud.number, cloud.count
    las.gps_time = cloud.time
    las.classification, las["treeID"] = classes_of(cloud.returns, order, plantings)
    las["organ"], las["order"] = cloud.returns.organ, order
    with replacing(path) as partial, open(partial, "wb") as file:
        las.write(file, do_compress=True)


IMAGE, SEGMENTS = "preview.png", "preview-segments.png"
EIGHT = 8  # a pixel's segment is its tree times so many, and its class
