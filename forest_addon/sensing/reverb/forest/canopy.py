"""Leaves and tops of a scene, as sound on its way meets them.

The evaluated scene comes in; out goes how many square metres of leaf a cubic metre holds at the height of the
path, over the whole field, and where its trees end on average. Leaves far above or below the path do not
count: sound between source and receiver travels level (``losses``).
"""

from __future__ import annotations

import numpy as np

from ....base.trimesh import LEAF, TriMesh, is_wood
from ...rays.geometry import SceneGeometry
from .clutter import (
    Blades,
    Clutter,
    Rods,
    blades_of_mesh,
    clutter_of,
    rods_of_mesh,
    shoot_triangles,
)
from .surroundings import FoliageCanopy

BESIDE = 1.0  # m above and below the ends that count as the height of the path
FLOOR = 0.5  # m, below which leaves are of plants on the floor
MOST = 4000  # triangles of a mesh that stand for all of its leaves


def canopy_of(
    scene: SceneGeometry,
    heights: tuple[float, float],
    area: float,
    trunks: np.ndarray | None = None,
) -> FoliageCanopy:
    """heights : of the lower and the higher end. area : of the field, m².

    trunks : numbers of the trees whose trunks sound meets, which say where trunks end: shrubs and ferns
    below them do not; None: all.
    """
    low, high = min(heights) - BESIDE, max(heights) + BESIDE
    low = max(low, 0.0)
    leaves = {n: _leaves(scene.meshes[n]) for n in np.unique(scene.mesh_index).tolist()}
    wooden = {n: bool(is_wood(scene.meshes[n].part).any()) for n in leaves}
    tops, found, on_floor = [], 0.0, 0.0
    highest = scene.bounds()[1][:, 2]
    counted = (scene.tree >= 0) if trunks is None else np.isin(scene.tree, trunks[trunks >= 0])
    for instance, number in enumerate(scene.mesh_index.tolist()):
        transform = scene.transform[instance]
        if wooden[number] and counted[instance]:
            tops.append(float(highest[instance]))
        centre, size = leaves[number]
        if len(size):
            level = centre @ transform[2, :3] + transform[2, 3]
            scale = abs(float(np.linalg.det(transform[:, :3]))) ** (2.0 / 3.0)
            found += scale * float(size[(level >= low) & (level <= high)].sum())
            on_floor += scale * float(size[level <= FLOOR].sum())
    top = float(np.mean(tops)) if tops else 0.0
    clutter = clutter_of(*_pieces(scene), area) if area > 0 else Clutter()
    if area <= 0:
        return FoliageCanopy(0.0, top, clutter)
    return FoliageCanopy(found / (area * (high - low)), top, clutter, on_floor / area)


def _pieces(scene: SceneGeometry) -> tuple[list[Rods], list[Blades]]:
    """Branches and leaves of all trees, where they stand."""
    used = np.flatnonzero(scene.tree >= 0)
    number = np.unique(scene.mesh_index[used]).tolist()
    rods = {n: rods_of_mesh(scene.meshes[n]).summed() for n in number}
    blades = {n: blades_of_mesh(scene.meshes[n]).summed() for n in number}
    which = [(int(scene.mesh_index[i]), scene.transform[i]) for i in used.tolist()]
    return [rods[n].placed(at) for n, at in which], [blades[n].placed(at) for n, at in which]


def _leaves(mesh: TriMesh) -> tuple[np.ndarray, np.ndarray]:
    """(L, 3) centres of some triangles, and (L,) m² that each stands for; not of shoots of needles."""
    rows = np.flatnonzero((mesh.part == LEAF) & ~shoot_triangles(mesh))
    step = max(1, len(rows) // MOST)
    corners = mesh.vertices[mesh.triangles[rows[::step]]]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = 0.5 * np.linalg.norm(across, axis=1)
    share = len(rows) / max(1, len(size))
    finite = np.isfinite(size)
    return corners.mean(axis=1)[finite], size[finite] * share
