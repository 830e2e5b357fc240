"""Stems with bark in relief as a tape and as a tripod have them: a plot's, from its centre.

Boles of Scots pine, with the relief and ovality of its preset, stand where a plot has its stems and hide each
other. The tape is the convex hull of the true section at breast height. Of each the tripod's points are
taken as FORTLS takes them (``fortls``), and through the slice at breast height a circle is laid.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import ConvexHull

from forest_addon.base.rows import RowTable
from forest_addon.base.trimesh import TriMesh
from forest_addon.blender.rays.casters import make_caster
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.mesh.meshing import mesh_wood
from forest_addon.growth.mesh.relief import SMALLEST, Relief
from forest_addon.growth.skeleton import Skeleton
from forest_addon.sensing.lidar.scan import scan
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import Rays

from ..stems import SCANNER, taubin
from .fortls import BREAST, HALF, breast_diameter, sections_of, taper_of

SPECIES = "scots-pine"
EYE = 1.5  # m over the ground, the tripod's
STEP = 7.67e-4  # radians, as the authors' example has it: 7.67 mm at 10 m
TRIPOD = SCANNER.changed(
    angle_step_deg=float(np.degrees(STEP)), line_step_deg=float(np.degrees(STEP))
)
WIDE, SEEN = 0.4, (0.9, 1.7)  # m about a stem's axis, and heights, that are scanned
LOW_BOLE = 2.0  # m, of boles that are looked at no higher
FEWEST = 12  # points of a circle
TALL, RINGS, TAPER = (
    8.0,
    0.5,
    0.015,
)  # m of bole, and between its rings; of the diameter lost a metre


def bole(diameter: float, seed: int, bark: bool = True, tall: float = TALL) -> TriMesh:
    """The lowest ``tall`` metres of a bole of Scots pine of this diameter at breast height, m, with its bark
    in relief or round."""
    z = np.arange(0.0, tall + RINGS / 2, RINGS)
    knots = np.column_stack([np.zeros((len(z), 2)), z])
    radius = diameter / 2 * (1 - TAPER * (z - BREAST))
    count = len(z) - 1
    skeleton = Skeleton(
        start=knots[:-1],
        end=knots[1:],
        radius=np.column_stack([radius[:-1], radius[1:]]),
        parent=np.arange(-1, count - 1),
        order=np.zeros(count, dtype=np.int64),
        generation=np.arange(count),
    )
    look = load_species(find_species(SPECIES, Path()))[0].bark
    size = max(look.size, SMALLEST)
    relief = Relief(
        look.texture, size, look.relief, look.ovality, look.upper_from * TALL / tall, seed
    )
    return mesh_wood(skeleton, 0.002, relief=relief if bark else None)


def section(mesh: TriMesh, z: float) -> np.ndarray:
    """(K, 2) where the edges of a mesh cross a height."""
    t = mesh.triangles
    edge = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    a, b = mesh.vertices[edge[:, 0]], mesh.vertices[edge[:, 1]]
    rows = (a[:, 2] - z) * (b[:, 2] - z) < 0
    share = (z - a[rows, 2]) / (b[rows, 2] - a[rows, 2])
    return np.asarray((a[rows] + share[:, None] * (b[rows] - a[rows]))[:, :2])


def by_tape(points: np.ndarray) -> float:
    """Diameter of a tape around points (N, 2): the perimeter of their convex hull over π."""
    return float(ConvexHull(points).area / np.pi)


def by_circle(points: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre (2,) and diameter of the circle with least squares of distances to points (N, 2)."""
    centre, radius = taubin(points)

    def misfit(q: np.ndarray) -> np.ndarray:
        return np.asarray(np.hypot(*(points - q[:2]).T) - q[2])

    x, y, r = least_squares(misfit, [*centre, radius]).x
    return np.array([x, y]), float(2 * r)


@dataclass(frozen=True)
class ScannedStems(RowTable):
    """(N,) of the stems of a plot, m: ``range``, diameters by ``tape``, of the same ``area``, by a
    ``circle`` and by ``fortls``, NaN where a stem was not found."""

    range: np.ndarray
    area: np.ndarray
    tape: np.ndarray
    circle: np.ndarray
    fortls: np.ndarray


def scan_plot(stems: np.ndarray, seed: int, bark: bool = True) -> ScannedStems:
    """Scan the stems (N, 3) of a plot, x, y and diameter, m, from a tripod at its origin."""
    meshes = [bole(d, seed + k, bark, LOW_BOLE) for k, d in enumerate(stems[:, 2])]
    tape = np.array([by_tape(section(mesh, BREAST + 1e-4)) for mesh in meshes])
    clouds = _clouds(meshes, stems[:, :2], seed)
    slices = [sections_of(points, EYE, STEP) for points in clouds]
    taper = taper_of(slices)
    return ScannedStems(
        np.hypot(*stems[:, :2].T),
        stems[:, 2].copy(),
        tape,
        np.array([_circle_at_breast(points) for points in clouds]),
        np.array([breast_diameter(found, taper) for found in slices]),
    )


def _circle_at_breast(points: np.ndarray) -> float:
    cut = points[np.abs(points[:, 2] - BREAST) < HALF, :2]
    return by_circle(cut)[1] if len(cut) >= FEWEST else np.nan


def scene_of(meshes: list[TriMesh], place: np.ndarray) -> SceneGeometry:
    """Return boles at places (N, 2), each a tree by its number."""
    number = np.arange(len(meshes))
    transform = np.tile(np.eye(3, 4), (len(meshes), 1, 1))
    transform[:, :2, 3] = place
    return SceneGeometry(
        meshes=tuple(meshes),
        transform=transform,
        mesh_index=number,
        object_name=("bole",) * len(meshes),
        tree=number,
        species=np.zeros(len(meshes), np.int64),
    )


def _clouds(meshes: list[TriMesh], place: np.ndarray, seed: int) -> list[np.ndarray]:
    """(P, 3) points of each bole; each is looked at where it stands, what is before it hides it."""
    caster, found = make_caster(scene_of(meshes, place), Rays()), []
    for k, (x, y) in enumerate(place.tolist()):
        away, turn = float(np.hypot(x, y)), float(np.degrees(np.arctan2(y, x)))
        half = float(np.degrees(np.arcsin(min(WIDE / away, 0.9))))
        low, high = np.degrees(np.arctan2(np.array(SEEN) - EYE, away - WIDE))
        narrow = TRIPOD.changed(
            azimuth_deg=(turn - half, turn + half), elevation_deg=(float(low), float(high))
        )
        cloud = scan(narrow, caster, seed + k)
        found.append(cloud.position[cloud.returns.tree == k])
    return found
