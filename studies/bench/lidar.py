"""Pulses a second of whole scans, from the trajectory to the closed file; and how many sub-rays are enough.

Time is CPU time of all threads, with growing and reading of the scene left out. The error of a beam of
few sub-rays is against the same beam of 1000: of the energy that comes back from each pulse, and of the
range of its first return.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from forest_addon.api import Beam, Rays, Skeleton, Terrestrial, Tractor, TractorScan, TriMesh

from ..inside import (
    OTHER,
    WOOD,
    Hits,
    RayCaster,
    Say,
    Scan,
    SceneGeometry,
    drive,
    find_species,
    grow,
    impacted_area,
    load_species,
    make_caster,
    mesh_wood,
    scan,
    sides_for,
    stream,
    tube,
    write_scan,
)
from ..inside import join_meshes as join
from ..papers import simlidar as orchards
from ..papers.simlidar import stand_up
from ..scenes import level_ground, scene_of, turned
from ..tables import table, timed
from .lidar_rays import say_moving, say_rays

SCENES = ((1, 200_000), (10, 200_000), (100, 20_000))  # trees, triangles of each
SUBRAYS = (1, 7, 19, 37, 100, 300)
MANY = 1000
ONE_THREAD = Rays(threads=1)
BEAM = Beam(divergence_mrad=(0.35, 0.35), exit_diameter=0.007, max_returns=5, pulse_ns=3.0)
FROM_OUTSIDE = Terrestrial(
    position=(-5.0, -5.0, 1.6),
    azimuth_deg=(20.0, 70.0),
    elevation_deg=(0.0, 40.0),
    angle_step_deg=1.0,
)
SOME_SUBRAYS, THRESHOLDS = (7, 19, 300), (0.0, 0.01, 0.05)


def say_pulses(say: Say) -> None:
    """Print both tables."""
    say("\nScans of trees, leaf-on, on the ground, written as LAS with all labels and truth:\n")
    rows = []
    for trees, triangles in SCENES:
        caster = make_caster(forest(trees, triangles), ONE_THREAD)
        for subrays in (1, 19):
            rows.append([f"{trees} x {triangles:,}", *_whole_scan(caster, subrays)])
    head = ["trees x triangles", "sub-rays", "pulses", "points", "pulses/s", "rays/s", "engine"]
    table(say, head, rows)

    say(f"\nSub-rays of a beam of 0.35 mrad in ten trees, against {MANY}:\n")
    table(
        say,
        [
            *("sub-rays", "µs a pulse", "energy, mean error", "energy, bias"),
            *("no echo for an echo", "first range, median error", "first range, 90 %"),
        ],
        _convergence(make_caster(forest(10, 200_000), ONE_THREAD)),
    )
    say(
        "\nReturns of such a beam, by the least light that its receiver tells, of a white surface that "
        "faces and fills it:\n"
    )
    head = ["threshold", "sub-rays", "pulses of one", "of three and more"]
    table(
        say,
        [*head, "gap, 5 %", "gap, 50 %"],
        _returns(make_caster(forest(10, 200_000), ONE_THREAD)),
    )


def forest(trees: int, triangles: int) -> SceneGeometry:
    """Trees of one variant on a square grid of 6 m, each turned, on a wide ground."""
    species, template = load_species(find_species("maple", Path()))
    grown = [grow(species, template, stream(1, "bench", n)).mesh for n in range(2)]
    whole = join(grown)
    order = stream(2, "bench", "triangles").permutation(len(whole.triangles))
    keep = np.zeros(len(order), dtype=bool)
    keep[order[:triangles]] = True
    side = int(np.ceil(np.sqrt(trees)))
    turn = stream(3, "bench", "turn").uniform(0, 2 * np.pi, trees)
    place = 6.0 * np.column_stack(divmod(np.arange(trees), side))
    return scene_of([whole.select(keep)], turned(place, turn), under=level_ground(300.0))


def _whole_scan(caster: RayCaster, subrays: int) -> list[str]:
    """A full turn at 0.1° or so from outside the stand, into a file."""
    scanner = Terrestrial(
        position=(-5.0, -5.0, 1.6),
        azimuth_deg=(0.0, 90.0),
        elevation_deg=(-30.0, 60.0),
        angle_step_deg=0.1 if subrays == 1 else 0.3,
        beam=replace(BEAM, subrays=subrays, max_returns=1 if subrays == 1 else 5),
    )
    work = Scan(scanner, caster)
    work.look(0, 100)  # whatever is made when it is first needed
    with tempfile.TemporaryDirectory() as folder:
        done, seconds = timed(write_scan, Path(folder) / "scan.las", work, 0)
    return [
        f"{subrays}",
        f"{done.pulses:,}",
        f"{done.points:,}",
        f"{done.pulses / seconds:,.0f}",
        f"{done.pulses * subrays / seconds:,.0f}",
        caster.engine,
    ]


def _convergence(caster: RayCaster) -> list[list[str]]:
    energy, first, _ = _beams(FROM_OUTSIDE, caster, MANY)
    rows = []
    for subrays in SUBRAYS:
        got, near, seconds = _beams(FROM_OUTSIDE, caster, subrays)
        both = np.isfinite(near) & np.isfinite(first)
        away = np.abs(near[both] - first[both])
        hit = energy > 0
        rows.append(
            [
                f"{subrays}",
                f"{1e6 * seconds / len(energy):.1f}",
                f"{np.abs(got - energy).sum() / energy.sum():.1%}",
                f"{got.sum() / energy.sum() - 1:+.2%}",
                f"{np.mean(np.isinf(near[hit])):.1%}",
                f"{1e3 * np.median(away):.2f} mm",
                f"{1e3 * np.quantile(away, 0.9):.1f} mm",
            ]
        )
    return rows


def _returns(caster: RayCaster) -> list[list[str]]:
    scanner = FROM_OUTSIDE.changed(angle_step_deg=0.3)
    clouds = [
        scan(scanner.changed(beam=replace(BEAM, subrays=subrays, max_returns=15)), caster)
        for subrays in SOME_SUBRAYS
    ]
    rows = []
    for threshold in THRESHOLDS:
        for subrays, cloud in zip(SOME_SUBRAYS, clouds, strict=True):
            told = cloud.intensity * cloud.true_range**2 >= threshold
            _, many = np.unique(cloud.pulse[told], return_counts=True)
            gap = np.diff(cloud.true_range[told])[np.diff(cloud.pulse[told]) == 0]
            shares = [f"{100 * (many == 1).mean():.1f} %", f"{100 * (many >= 3).mean():.1f} %"]
            ends = [f"{value:.2f} m" for value in np.quantile(gap, [0.05, 0.5])]
            rows.append([f"{threshold:.0%}", f"{subrays}", *shares, *ends])
    return rows


def _beams(
    scanner: Terrestrial, caster: RayCaster, subrays: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Energy (P,) and range of the first return (P,), inf where there is none; seconds."""
    cloud, seconds = timed(
        scan, replace(scanner, beam=replace(BEAM, subrays=subrays, max_returns=15)), caster
    )
    energy = np.bincount(cloud.pulse, cloud.intensity * cloud.true_range**2, cloud.pulses)
    first = np.full(cloud.pulses, np.inf)
    leading = cloud.number == 1
    first[cloud.pulse[leading]] = cloud.true_range[leading]
    return energy, first, seconds


# Scans of blocks on the ground, as surveys of HELIOS++ have them: beams on one face, against rays.
#
# CPU time of all threads from pulse to cloud; the plain way traces every ray of every beam. Error: the
# largest difference of a range between both.


BLOCK_SUBRAYS = (7, 19, 61)
STEP = 0.12  # degrees


def say_blocks(say: Say) -> None:
    """Print one table."""
    say("\nA tripod among blocks, pillars and ground:\n")
    caster = make_caster(blocks(), Rays(threads=1))
    rows = []
    for subrays in BLOCK_SUBRAYS:
        beam = Beam(divergence_mrad=(0.3, 0.3), exit_diameter=0.007, pulse_ns=5.0, subrays=subrays)
        scanner = Terrestrial(
            position=(-26.0, -31.0, 1.7),
            azimuth_deg=(0.0, 90.0),
            elevation_deg=(-40.0, 60.0),
            angle_step_deg=STEP,
            beam=beam,
        )
        work = Scan(scanner, caster)
        work.look(0, 1000)  # whatever is made when it is first needed
        start = time.process_time()
        points = sum(len(piece) for _, piece in work.chunks())
        took = time.process_time() - start
        row = [f"{subrays}", f"{work.pulses:,}", f"{points:,}", f"{took:.2f}"]
        rows.append([*row, f"{work.pulses * subrays / took:,.0f}"])
    head = ["sub-rays", "pulses", "points", "CPU s", "rays/s"]
    table(say, head, rows)


def blocks() -> SceneGeometry:
    """Four blocks and two pillars on a wide ground."""
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corners = np.concatenate([np.column_stack([square, np.full(4, z)]) for z in (0.0, 2.0)])
    sides = [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7)]
    faces = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])
    block = TriMesh.of_part(corners, faces, OTHER)
    path = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 12.0]])
    pillar = TriMesh.of_part(*tube(path, np.full(2, 2.0), 64), OTHER)
    places = [(0, 0), (15, -12), (-5, 20), (30, 18), (12, 4), (-12, 8)]
    transform = turned(np.array(places), np.zeros(6))
    transform[:4, :, :3] *= np.reshape([8.0, 4.0, 5.0, 9.0], (4, 1, 1))
    index, none = np.array([0, 0, 0, 0, 1, 1]), np.full(6, -1)
    return scene_of([block, pillar], transform, index, none, level_ground(140.0))


# First hits of rays on the exact frusta of a skeleton's segments, float64: no mesh in between.
#
# Each segment is the closed frustum of a cone (its caps included) that ``growth.truth`` sums up. A point
# at s along the axis has the radius r₁ + k·s, so with w the way from the start to the ray's origin, and ⊥
# what is at right angles to the axis, |w⊥ + t·d⊥|² = (r₁ + k·(w∥ + t·d∥))² is a quadratic equation in t.


PAIRS = 400_000  # rays x segments at a time


def first_hits(skeleton: Skeleton, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(R,) metres along unit directions (R, 3) to the first surface, inf where there is none."""
    distance = np.full(len(origins), np.inf)
    at_once = max(1, PAIRS // max(len(skeleton), 1))
    for first in range(0, len(origins), at_once):
        rows = slice(first, first + at_once)
        distance[rows] = _meet(skeleton, origins[rows], directions[rows])
    return distance


def _meet(skeleton: Skeleton, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The nearest of all segments, (R,)."""
    axis = skeleton.end - skeleton.start
    length = np.linalg.norm(axis, axis=1)
    axis = axis / length[:, None]
    r1, r2 = skeleton.radius.T
    taper = (r2 - r1) / length
    w = origins[:, None] - skeleton.start  # (R, S, 3)
    along, speed = np.einsum("rsi,si->rs", w, axis), directions @ axis.T
    ww, wd = np.einsum("rsi,rsi->rs", w, w), np.einsum("rsi,ri->rs", w, directions)
    here = r1 + taper * along  # the cone's radius beside the origin
    a = 1.0 - speed**2 * (1.0 + taper**2)
    b = wd - along * speed - taper * speed * here
    c = ww - along**2 - here**2
    nearest = np.full(len(origins), np.inf)
    with np.errstate(invalid="ignore", divide="ignore"):
        root = np.sqrt(b * b - a * c)
        for t in ((-b - root) / a, (-b + root) / a):
            s = along + t * speed
            on = (t >= 0) & (s >= 0) & (s <= length) & (r1 + taper * s >= 0)
            nearest = np.minimum(nearest, np.where(on, t, np.inf).min(axis=1, initial=np.inf))
        for end, radius in ((0.0, r1), (length, r2)):
            t = (end - along) / speed
            off = ww + 2 * t * wd + t * t - end**2  # squared distance from the axis on the cap
            on = (t >= 0) & (off <= radius**2)
            nearest = np.minimum(nearest, np.where(on, t, np.inf).min(axis=1, initial=np.inf))
    return nearest


# Accuracy of a branch's mesh: tubes of some sides against the exact cones, as the tractor sees them.
#
# One leafless apple tree of S is meshed with several tolerances and scanned; the same rays meet the exact
# cylinders of its skeleton. Ranges are compared where both meet the same wood; rays that meet another
# branch, or that only one of the two meets, are counted. What stays at the finest mesh is not the
# roundness: where an axis bends, tubes are mitred and cylinders overlap. Last, the largest orchard is
# timed as a whole.


TOLERANCES = (4.0, 1.0, 0.2, 0.05)  # mm
FINE = 1e-4  # metres
PARTS, SOLID = (0, 1, 2, 4), 8
SAME = 0.02  # metres; ranges that differ by more are of another branch
ORCHARD = orchards.Orchard(iterations=4, trees=1, smallest=0.006)
LARGEST = orchards.Orchard(iterations=7, trees=4, smallest=0.006)
EVERY = 8  # of the scans


def say_wood(say: Say) -> None:
    """Print the tables."""
    forest = orchards.plant(ORCHARD, orchards.first_internode(), seed=1)
    skeleton = forest.variants[0, 0].skeleton
    tractor = _past(skeleton)
    exact, took = timed(drive, tractor, _Cones(skeleton))
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
    caster = make_caster(scene_of([mesh_wood(skeleton, FINE)]), Rays(threads=1))
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
    caster = make_caster(scene_of([mesh]), Rays(threads=1))
    scan, took = timed(drive, tractor, caster)
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
    scan, took = timed(drive, replace(tractor, splits=parts), caster)
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
        self.scene = scene_of([TriMesh.of_part(np.eye(3), np.array([[0, 1, 2]]), WOOD)])

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


# LiDAR: rays a second of the engines, pulses a second of whole scans, tubes for cones, and all errors.


TITLE = "lidar: rays and pulses a second, and their errors"


def run(say: Say) -> None:
    """Print the tables of rays, of rays where bodies move, then those of pulses, of blocks and of wood."""
    say_rays(say)
    say_moving(say)
    say_pulses(say)
    say_blocks(say)
    say_wood(say)
