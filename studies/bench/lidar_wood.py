"""Accuracy of a branch's mesh: tubes of some sides against the exact cones, as the tractor sees them.

One leafless apple tree of S is meshed with several tolerances and scanned; the same rays meet the exact
cylinders of its skeleton. Ranges are compared where both meet the same wood; rays that meet another branch,
or that only one of the two meets, are counted. What stays at the finest mesh is not the roundness:
where an axis bends, tubes are mitred and cylinders overlap. Last, the largest orchard is timed as a whole.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from forest_addon.base.progress import Say
from forest_addon.base.trimesh import WOOD, TriMesh
from forest_addon.blender.rays.casters import make_caster
from forest_addon.growth.mesh.meshing import mesh_wood, sides_for
from forest_addon.growth.skeleton import Skeleton
from forest_addon.sensing.lidar.tractor import TractorScan, drive
from forest_addon.sensing.lidar.wood_indices import impacted_area
from forest_addon.sensing.rays.caster import Hits, RayCaster
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import Rays, Tractor

from ..papers import orchards
from ..papers.simlidar import stand_up
from ..tables import table
from .exact_cones import first_hits

TOLERANCES = (4.0, 2.0, 1.0, 0.5, 0.2, 0.1, 0.05)  # mm
FINE = 1e-4  # metres
PARTS, SOLID = (0, 1, 2, 4), 8
SAME = 0.02  # metres; ranges that differ by more are of another branch
ORCHARD = orchards.Orchard(iterations=4, trees=1, smallest=0.006)
LARGEST = orchards.Orchard(iterations=7, trees=4, smallest=0.006)
EVERY = 8  # of the scans


def run(say: Say) -> None:
    """Print the tables."""
    forest = orchards.plant(ORCHARD, orchards.first_internode(), seed=1)
    skeleton = forest.variants[0, 0].skeleton
    tractor = _past(skeleton)
    start = time.process_time()
    exact = drive(tractor, _Cones(skeleton))
    took = time.process_time() - start
    area, met = impacted_area(exact, tractor), np.isfinite(exact.distance)
    say(
        f"\nTubes against exact cylinders: {len(skeleton)} branches, {met.size:,} beams, {met.sum():,} on "
        f"wood, A_IM = {1e4 * area:.2f} cm² (of every {EVERY}th scan); these rays took {took:.1f} CPU s:\n"
    )
    table(
        say,
        [
            *("tolerance", "sides, mean", "triangles", "range, bias", "range, rms"),
            *("range, median error", "another branch", "hit by one only", "A_IM, error", "CPU s"),
        ],
        [_row(skeleton, tractor, exact, mm / 1000) for mm in TOLERANCES],
    )
    say(f"\nS's solid beam on the mesh of {FINE * 1000:g} mm, by its P:\n")
    caster = make_caster(_scene(mesh_wood(skeleton, FINE)), Rays(threads=1))
    solid = impacted_area(drive(replace(tractor, splits=SOLID), caster), tractor)
    table(
        say,
        ["P", "rays a beam", "A_IM", "times exact rays", f"to P = {SOLID}", "CPU s"],
        [_solid_row(tractor, caster, parts, area, solid) for parts in PARTS],
    )
    say("\nThe whole of Méndez et al.'s largest row, from the L-system to A_IM, one thread:\n")
    table(
        say,
        [
            *("engine", "branches", "triangles", "beams", "grow, build, read: CPU s"),
            *("scan: CPU s", "all: CPU s", "S", "A_IM"),
        ],
        [_largest(engine) for engine in ("embree", "bvhtree")],
    )


def _largest(engine: str) -> list[str]:
    start = time.process_time()
    forest = orchards.plant(LARGEST, orchards.first_internode(), seed=1)
    tractor = orchards.tractor_for(forest, 0)
    scene = orchards.scene_of(tractor)
    observer = stand_up(forest, scene, Rays(engine=engine, threads=1))
    meshes = observer.caster.scene.meshes
    built = time.process_time()
    scan = drive(tractor, observer.caster)
    area = impacted_area(scan, tractor)
    done = time.process_time()
    return [
        *(observer.caster.engine, f"{sum(len(t.skeleton) for t in forest.variants.values()):,}"),
        *(f"{sum(len(mesh.triangles) for mesh in meshes):,}", f"{scan.distance.size:,}"),
        *(f"{built - start:.2f}", f"{done - built:.2f}", f"{done - start:.2f}"),
        *("210 minutes", f"{area:.5f} m²"),
    ]


def _past(skeleton: Skeleton) -> Tractor:
    """The experiment's scanner, driving past one tree that stands at the origin."""
    low, high = skeleton.end[:, 1].min(), skeleton.end[:, 1].max()
    return Tractor(
        position=(orchards.SCANNER[0] - orchards.ROW, float(low), orchards.SCANNER[1]),
        track=float(high - low),
        step=orchards.STEP,
        gap=EVERY - 1,
        angle_step_deg=orchards.ANGLE_STEP_DEG,
        reach=1.0,
        top=3.0,
        max_range=20.0,
    )


def _row(skeleton: Skeleton, tractor: Tractor, exact: TractorScan, tolerance: float) -> list[str]:
    mesh = mesh_wood(skeleton, tolerance)
    caster = make_caster(_scene(mesh), Rays(threads=1))
    start = time.process_time()
    scan = drive(tractor, caster)
    took = time.process_time() - start
    here, there = np.isfinite(scan.distance), np.isfinite(exact.distance)
    away = scan.distance[here & there] - exact.distance[here & there]
    near = away[np.abs(away) < SAME]
    sides = np.mean([sides_for(float(r), tolerance) for r in skeleton.radius[:, 0]])
    error = impacted_area(scan, tractor) / impacted_area(exact, tractor) - 1
    return [
        *(f"{1e3 * tolerance:g} mm", f"{sides:.1f}", f"{len(mesh.triangles):,}"),
        *(f"{1e3 * near.mean():+.3f} mm", f"{1e3 * np.sqrt((near**2).mean()):.3f} mm"),
        f"{1e3 * np.median(np.abs(near)):.4f} mm",
        f"{1 - len(near) / len(away):.2%}",
        *(f"{np.mean((here != there)[here | there]):.2%}", f"{error:+.2%}", f"{took:.2f}"),
    ]


def _solid_row(
    tractor: Tractor, caster: RayCaster, parts: int, exact: float, solid: float
) -> list[str]:
    start = time.process_time()
    scan = drive(replace(tractor, splits=parts), caster)
    took = time.process_time() - start
    area = impacted_area(scan, tractor)
    return [
        *(f"{parts}", f"{(parts + 1) ** 2}", f"{1e4 * area:.2f} cm²"),
        *(f"{area / exact:.3f}", f"{area / solid - 1:+.2%}", f"{took:.2f}"),
    ]


class _Cones:
    """A caster of the exact cones; whatever it hits is the one triangle of its scene, which is wood."""

    engine = "exact cones"

    def __init__(self, skeleton: Skeleton) -> None:
        self._skeleton = skeleton
        self.scene = _scene(TriMesh.of_part(np.eye(3), np.array([[0, 1, 2]]), WOOD))

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
    ) -> Hits:
        """The closest hits of rays that start outside of all wood."""
        assert leaving is None
        assert not np.any(min_distance)
        distance = first_hits(self._skeleton, origins, directions)
        distance[distance > max_distance] = np.inf
        what = np.where(np.isfinite(distance), 0, -1)
        return Hits(distance, what, what)

    def occluded(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
    ) -> np.ndarray:
        """Return whether anything is hit."""
        return self.cast(
            origins, directions, max_distance, min_distance=min_distance, leaving=leaving
        ).found


def _scene(mesh: TriMesh) -> SceneGeometry:
    return SceneGeometry(
        meshes=(mesh,),
        transform=np.eye(3, 4)[None],
        mesh_index=np.zeros(1, dtype=np.int64),
        object_name=("tree",),
        tree=np.zeros(1, dtype=np.int64),
        species=np.zeros(1, dtype=np.int64),
    )
