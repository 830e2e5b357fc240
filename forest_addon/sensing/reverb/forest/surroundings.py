"""Surroundings of a source and a receiver, for a model ``forest``: density, radii, leaves, tops.

Trunks of the field, its extent and the scene's canopy come in; the ``TrunkStand`` that losses along paths
need, and the ``Density`` that energy travels through, go out. Trunks' density is counted in cells of the
field that hold CELL_HOLDS each on average; where counts are no more uneven than random ones, it is the
same everywhere.

Leaves and tops of a scene, as sound on its way meets them.

The evaluated scene comes in; out goes how many square metres of leaf a cubic metre holds at the height of the
path, over the whole field, and where its trees end on average. Leaves far above or below the path do not
count: sound between source and receiver travels level (``losses``).

Terms of a reverb's model: what its settings put in and what they leave out, in words.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ....base.trimesh import LEAF, TriMesh, is_wood
from ....spec import Reverb
from ...rays.geometry import SceneGeometry
from ..trunks import Field, Trunks
from .clutter import (
    ALL_WAYS,
    BARE as NO_CLUTTER,
    LAYER,
    Blades,
    Clutter,
    Rods,
    blades_of_mesh,
    clutter_of,
    rods_of_mesh,
    shoot_triangles,
)
from .losses import TrunkStand, stand_of
from .transport import Density

CELL_HOLDS = 12.0  # trunks
UNEVEN = 1.6  # variance over mean of the counts, above which cells are told apart
MOST_CELLS = 200  # to a side
USUAL_TOP = 15.0  # m, of stems without tops


@dataclass(frozen=True)
class FoliageCanopy:
    """Foliage of a scene: leaf_area_density, m²/m³ at the height of the path; top, m, where trees end;
    clutter; floor_leaf_area, m²/m² of leaves of plants on the floor."""

    leaf_area_density: float = 0.0
    top: float = 0.0
    clutter: Clutter = NO_CLUTTER
    floor_leaf_area: float = 0.0


BARE = FoliageCanopy()


@dataclass(frozen=True)
class Surroundings:
    """stand : for losses along paths. density : for transport."""

    stand: TrunkStand
    density: Density


def surroundings(
    trunks: Trunks, reverb: Reverb, field: Field | None, canopy: FoliageCanopy
) -> Surroundings:
    """Surroundings of trunks. field : its corner and size, m; None: it is as large as its trunks' hull."""
    place = trunks.position
    if field is not None:
        corner, size = np.asarray(field[0], np.float64), np.asarray(field[1], np.float64)
        inside = np.all((place >= corner) & (place <= corner + size), axis=1)
        area = float(np.prod(size))
    else:
        inside = np.ones(len(place), bool)
        corner = place.min(axis=0) if len(place) else np.zeros(2)
        size = np.ptp(place, axis=0) if len(place) else np.zeros(2)
        area = _hull(place)
    leaves = reverb.leaf_area_density
    if leaves == 0 and reverb.needle_area_density == 0:
        leaves = canopy.leaf_area_density
    stand = stand_of(
        trunks.select(inside),
        area,
        leaves if reverb.foliage else 0.0,
        reverb.trunk_height or canopy.top,
        clutter_around(reverb, canopy) if reverb.branches else NO_CLUTTER,
        reverb.floor_leaf_area + canopy.floor_leaf_area if reverb.foliage else 0.0,
    )
    if stand.density == 0:
        return Surroundings(stand, Density.even(0.0))
    beyond = stand.density if reverb.continue_to > 0 else 0.0
    return Surroundings(stand, _density(place[inside], corner, size, beyond, stand.density))


def clutter_around(reverb: Reverb, canopy: FoliageCanopy) -> Clutter:
    """Branches and leaves of the scene; where settings have densities, those at all heights of the canopy."""
    clutter, top = canopy.clutter, reverb.trunk_height or canopy.top or USUAL_TOP
    if reverb.branch_area_density > 0:
        count = max(1, math.ceil(top / LAYER))
        metres = reverb.branch_area_density / (2.0 * math.pi * reverb.branch_radius)
        clutter = replace(
            clutter,
            radii=(reverb.branch_radius,),
            length=((metres,),) * count,
            across=(ALL_WAYS,),
            leaf_area=clutter.leaf_area + (0.0,) * (count - len(clutter.leaf_area)),
        )
    if not reverb.foliage:
        return clutter.without_leaves()
    clutter = replace(clutter, needle_radius=reverb.needle_radius)
    if reverb.leaf_area_density > 0 or reverb.needle_area_density > 0:
        clutter = clutter.filled(top).without_leaves()
        layers = max(clutter.layers, 1)
        leaves, needles = reverb.leaf_area_density, reverb.needle_area_density
        clutter = replace(clutter, leaf_area=(leaves,) * layers, needle_area=(needles,) * layers)
    if reverb.floor_leaf_area > 0:
        clutter = clutter.on_floor(reverb.floor_leaf_area)
    if reverb.leaf_radius > 0:
        clutter = replace(clutter, leaf_radius=reverb.leaf_radius)
    return clutter


def _density(
    place: np.ndarray, corner: np.ndarray, size: np.ndarray, beyond: float, mean: float
) -> Density:
    cell = max(math.sqrt(CELL_HOLDS / mean), float(size.max()) / MOST_CELLS)
    shape = np.maximum(1, np.round(size / cell)).astype(np.int64)
    x, y = (np.floor((place[:, n] - corner[n]) / cell).astype(np.int64) for n in range(2))
    inside = (x >= 0) & (x < shape[0]) & (y >= 0) & (y < shape[1])
    counts = np.bincount(x[inside] * shape[1] + y[inside], minlength=int(shape.prod()))
    counts = counts.reshape(shape).astype(np.float64)
    start = float(corner[0]), float(corner[1])
    if counts.var() <= UNEVEN * counts.mean():
        if beyond > 0:
            return Density.even(mean)
        return Density(np.full((1, 1), mean), start, (float(size[0]), float(size[1])), 0.0)
    share = counts.sum() / max(len(place), 1)  # cells do not cover the field to the last metre
    cells = counts / cell**2 / max(share, 1e-9)
    cells *= mean / max(float(cells.mean()), 1e-30)
    return Density(cells, start, (cell, cell), beyond)


def _hull(place: np.ndarray) -> float:
    """m² within the outermost trunks; 0 where they span none."""
    try:
        return float(ConvexHull(place).volume) if len(place) >= 3 else 0.0
    except QhullError:
        return 0.0


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
    tops, leaf_area, on_floor = [], 0.0, 0.0
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
            leaf_area += scale * float(size[(level >= low) & (level <= high)].sum())
            on_floor += scale * float(size[level <= FLOOR].sum())
    top = float(np.mean(tops)) if tops else 0.0
    clutter = clutter_of(*_pieces(scene), area) if area > 0 else Clutter()
    if area <= 0:
        return FoliageCanopy(0.0, top, clutter)
    return FoliageCanopy(leaf_area / (area * (high - low)), top, clutter, on_floor / area)


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
    corners = mesh.vertices[mesh.triangles[rows[:: max(1, len(rows) // MOST)]]]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = 0.5 * np.linalg.norm(across, axis=1)
    share = len(rows) / max(1, len(size))
    finite = np.isfinite(size)
    return corners.mean(axis=1)[finite], size[finite] * share


NEVER = (
    "diffraction around trunks and edges",
    "refraction by wind and temperature",
)


def terms_of(
    reverb: Reverb, stand: TrunkStand | None = None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Terms of the model, with their values, and those that are left out.

    stand : what the scene or the settings gave; None: values of the scene are not known.
    """
    forest = reverb.model == "forest"
    ground = forest and reverb.path_ground
    there = _there(stand)
    terms = {
        "trunks that scatter once, exactly": (True, ""),
        "absorption of the air": (True, ""),
        "the ground under the direct sound": (True, reverb.ground_kind),
        "the ground under every path by way of trunks": (ground, reverb.ground_kind),
        "what trunks scatter out of a path": (
            forest and reverb.extinction != "none",
            f"{reverb.extinction}{there['trunks']}",
        ),
        "sound scattered more than once, as energy": (forest and reverb.tail == "transport", ""),
        "turbulence": (forest and reverb.turbulence > 0, f"{reverb.turbulence:g}e-6"),
        "trunks that lean": (ground and reverb.lean_deg > 0, f"{reverb.lean_deg:g} degrees"),
        "leaves of plants on the floor": (
            ground and reverb.foliage,
            there["floor"]
            if stand
            else _or(reverb.floor_leaf_area, "m²/m² and those of the scene"),
        ),
        "bark that absorbs": (forest and reverb.bark > 0, f"{100 * reverb.bark:g} %"),
        "leaves that absorb": (
            forest and reverb.foliage and reverb.leaf_absorption > 0,
            f"G = {reverb.leaf_absorption:g}, "
            + (there["leaves"] or _or(reverb.leaf_area_density, "m²/m³")),
        ),
        "branches, twigs and leaves that scatter in space": (
            forest and reverb.branches,
            there["branches"] or _or(reverb.branch_area_density, "m²/m³ of bark"),
        ),
        "needles as thin cylinders, in phase within a shoot": (
            forest and reverb.branches and reverb.foliage,
            there["needles"] or _or(reverb.needle_area_density, "m²/m³"),
        ),
        "bark of branches that absorbs": (
            forest and reverb.branches and reverb.bark > 0,
            f"{100 * reverb.bark:g} %",
        ),
        "viscous, heat-conducting air at branches and needles": (
            forest and reverb.branches and reverb.boundary_loss,
            "",
        ),
        "litter that scatters": (
            forest and reverb.branches and reverb.litter > 0,
            f"{100 * reverb.litter:g} %",
        ),
        "trunks' ends": (forest, there["top"] or _or(reverb.trunk_height, "m")),
    }
    held = tuple(
        f"{name} ({value})" if value else name for name, (is_in, value) in terms.items() if is_in
    )
    return held, tuple(name for name, (is_in, _) in terms.items() if not is_in) + NEVER


def _there(stand: TrunkStand | None) -> dict[str, str]:
    """Words for what stands there, "" where that is not known."""
    if stand is None:
        return dict.fromkeys(("trunks", "floor", "leaves", "branches", "needles", "top"), "")
    clutter = stand.clutter
    bark = sum(
        2.0 * math.pi * radius * metres * LAYER
        for layer in clutter.length
        for radius, metres in zip(clutter.radii, layer, strict=True)
    )
    leaves, needles = LAYER * sum(clutter.leaf_area), LAYER * sum(clutter.needle_area)
    discs = f"{leaves:.2g} m² of leaves as discs of {100.0 * clutter.leaf_radius:.2g} cm"
    return {
        "trunks": f", {1e4 * stand.density:,.0f}/ha" if stand.density else ", none there",
        "floor": _some(stand.floor_leaf_area, "m²/m²"),
        "leaves": _some(stand.leaf_area_density, "m²/m³ at the path"),
        "branches": f"{_some(bark, 'm² of bark')} and {discs if leaves else 'no leaves'} a m² of ground"
        if bark or leaves
        else "none there",
        "needles": _some(needles, "m² of half their surface a m² of ground"),
        "top": f"{stand.trunk_height:.3g} m" if stand.trunk_height else "endless",
    }


def _some(value: float, unit: str) -> str:
    return f"{value:.2g} {unit}" if value > 0 else "none there"


def _or(value: float, unit: str) -> str:
    return f"{value:g} {unit}" if value > 0 else "as in the scene"
