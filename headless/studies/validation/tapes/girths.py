"""Diameters of stems with bark in relief: by tape, by a circle, and as FORTLS takes them from one scan.

Boles of Scots pine, with the relief and ovality of its preset, stand at several ranges from a tripod. The
tape is the convex hull of the true section at breast height. FORTLS (Molina-Valero et al. 2022) puts the
centre where distances of the slice's points vary least, and takes as radius their mean between two quantiles,
of which the lower can be raised to leave out furrows.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import ConvexHull

from forest_addon.base.trimesh import TriMesh
from forest_addon.blender.rays.casters import make_caster
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.mesh.meshing import mesh_wood
from forest_addon.growth.mesh.relief import SMALLEST, Relief
from forest_addon.growth.skeleton import Skeleton
from forest_addon.sensing.lidar.scan import scan
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import Rays, Terrestrial

from ..clouds.circles import circle, taubin

SPECIES = "scots-pine"
DIAMETERS, RANGES, EACH = (0.22, 0.28, 0.32, 0.38), (5.0, 10.0, 15.0, 19.0), 3
TALL, STEP, TAPER = (
    8.0,
    0.5,
    0.015,
)  # m of bole, between its rings; share of the diameter lost a metre
BREAST, SLICE = 1.3, 0.05  # m
QUANTILES = (0.05, 0.99)
FURROWS = (0.25, 0.75)  # lower quantiles that leave out furrows


def bole(diameter: float, seed: int, bark: bool = True) -> TriMesh:
    """A bole of Scots pine of this diameter at breast height, m, with its bark in relief or round."""
    z = np.arange(0.0, TALL + STEP / 2, STEP)
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
    relief = Relief(look.texture, size, look.relief, look.ovality, look.upper_from, seed)
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


def by_quantiles(points: np.ndarray, low: float, high: float) -> float:
    """Diameter as FORTLS has it: the mean distance, between two quantiles, from the centre of least variance.

    That centre is the circle's of least squares, whose radius is the mean of all distances.
    """
    away = np.hypot(*(points - by_circle(points)[0]).T)
    inner, outer = np.quantile(away, (low, high))
    return float(2 * away[(away > inner) & (away < outer)].mean())


def measure_boles(scanner: Terrestrial, seed: int, bark: bool = True) -> dict[str, np.ndarray]:
    """Diameters, m, of boles by ``range``, true ``area`` and ``tape``, and from a scan as ``circle``,
    ``quantiles`` and these without the lowest ``quarter`` and ``three_quarters``; ``residual`` of circles, m.
    """
    names = ("range", "area", "tape", "circle", "quantiles", "quarter", "three_quarters")
    rows: list[list[float]] = []
    for number, diameter in enumerate(DIAMETERS):
        for k in range(EACH):
            mesh = bole(diameter, seed * 1000 + 10 * number + k, bark)
            tape = by_tape(section(mesh, BREAST + 1e-4))
            for away in RANGES:
                points = _slice(mesh, away, scanner, seed + k)
                taken = [by_quantiles(points, low, 0.99) for low in (QUANTILES[0], *FURROWS)]
                fit = circle(points)
                left = np.nan if fit is None else fit[4]
                rows.append([away, diameter, tape, by_circle(points)[1], *taken, left])
    return dict(zip((*names, "residual"), np.array(rows).T, strict=True))


def _slice(mesh: TriMesh, away: float, scanner: Terrestrial, seed: int) -> np.ndarray:
    """(P, 2) points of a bole's slice at breast height, as a tripod this far from it finds them."""
    scene = SceneGeometry(
        meshes=(mesh,),
        transform=np.array([[[1.0, 0, 0, away], [0, 1, 0, 0], [0, 0, 1, 0]]]),
        mesh_index=np.zeros(1, np.int64),
        object_name=("bole",),
        tree=np.zeros(1, np.int64),
        species=np.zeros(1, np.int64),
    )
    half = float(np.degrees(0.4 / away))
    narrow = scanner.changed(azimuth_deg=(-half, half))
    place = scan(narrow, make_caster(scene, Rays()), seed).position
    near = np.abs(place[:, 2] - BREAST) < SLICE
    return np.asarray(place[near, :2] - [away, 0.0])
