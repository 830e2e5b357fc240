"""LiDAR: rays a second of the engines, pulses a second of whole scans, tubes for cones, and all errors.

The error of a beam of few sub-rays is against the same beam of 1000: of the energy that comes back from
each pulse, and of the range of its first return. One leafless apple tree of S is meshed with several
tolerances; the same rays meet the exact cylinders of its skeleton. Ranges are compared where both meet the
same wood; rays that meet another branch, or that only one of the two meets, are counted. What stays at the
finest mesh is not the roundness: where an axis bends, tubes are mitred and cylinders overlap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from forest_addon.api import (
    Accuracy,
    Beam,
    Cloud,
    Forest,
    Planting,
    Rays,
    Scene,
    Skeleton,
    Terrestrial,
    Tractor,
    TractorScan,
    TriMesh,
    Wind,
    build,
)

from ..inside import (
    OTHER,
    WOOD,
    BvhCaster,
    EmbreeCaster,
    ExactCaster,
    Hits,
    Kind,
    MovingCaster,
    MovingScene,
    RayCaster,
    RigidPath,
    Scan,
    SceneGeometry,
    SceneMotion,
    Search,
    ShapePath,
    drive,
    embree_motion,
    find_species,
    grow,
    join_meshes as join,
    load_species,
    make_caster,
    mesh_wood,
    rays_of,
    scan,
    send,
    sides_for,
    stream,
    tube,
    typical_tree,
    write_scan,
)
from ..papers import simlidar as orchards
from ..scenes import level_ground, scene_of, turned
from .rows import BenchRow, Rows

TITLE = "lidar: rays and pulses a second, and their errors"
WORDS = """\
Rays are those of a tripod in the middle of closed stands of five variants, whose crowns just touch, of a
flight 200 m above, and from anywhere to anywhere (no two alike: the worst case); their errors are against
float64 brute force, as are those of rays at times of their own where bodies move by 1 m and 1 rad or bend.
How many: rays, trees, pulses, beams, branches. Scans are of trees in leaf on the ground, written as LAS with
all labels and truth; beams are of 0.35 mrad, in ten trees, their first ranges and energy beside 1,000
sub-rays'. Returns are by the least light that a receiver tells, of a white surface that faces and fills the
beam. Wood: a leafless apple tree of S, every 8th scan, ranges and A_IM beside exact cylinders', by the
tolerance of its tubes; S's solid beam by its P; the largest row of S from the L-system to A_IM (S: 210
minutes).
"""
TREES = {"20k": "whorl-8", "200k": "honda-broadleaf"}  # leaf-on, of about as many triangles
VARIANTS = 5
MEASURED = ("european-beech", "scots-pine", "norway-spruce")  # middle trees, among 1000
INSTANCES = (1, 100, 1000)
COUNTS: dict[type[Search], int] = {BvhCaster: 20_000, EmbreeCaster: 200_000}
KINDS = ("tripod", "flight", "anywhere")
CHECKED = 64  # rays of each kind against brute force


def grow_trees(size: str) -> list[TriMesh]:
    """Trees of about a size, or middle trees of a measured species, with all their leaves."""
    name = TREES.get(size, size)
    species, template = load_species(find_species(name, Path()))
    wanted = None
    if species.targets is not None and isinstance(template, Kind):
        wanted = typical_tree(species.targets, template.allometry, name)
    return [grow(species, template, stream(1, "bench", n), wanted).mesh for n in range(VARIANTS)]


def plant(meshes: list[TriMesh], count: int) -> SceneGeometry:
    """Trees on a square grid, shifted by up to a quarter of its step, each turned."""
    rng = stream(2, "bench", "stand", count)
    crown = np.mean([np.ptp(mesh.vertices[:, :2], axis=0).mean() for mesh in meshes])
    side = int(np.ceil(np.sqrt(count)))
    cell = np.stack(np.divmod(np.arange(count), side), axis=1)
    turn = rng.uniform(0, 2 * np.pi, count)
    place = crown * (cell + rng.uniform(-0.25, 0.25, (count, 2)))
    return scene_of(meshes, turned(place, turn))


def rays_through(scene: SceneGeometry, count: int, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Rays of a tripod, of a flight, or from anywhere."""
    rng = stream(3, "bench", "rays")
    foot = scene.transform[:, :2, 3]
    low, high = foot.min(0) - 3, foot.max(0) + 3
    lines = int(np.sqrt(count))
    line, number = np.divmod(np.arange(count), lines)
    if kind == "tripod":
        azimuth, elevation = 2 * np.pi * line / lines, np.deg2rad(-30 + 110 * number / lines)
        level = np.cos(elevation)
        way = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
        middle = [*(low + high) / 2 + 1.3, 1.6]
        return np.broadcast_to(middle, (count, 3)), np.stack(way, axis=1)
    across = rng.uniform(low, high, (count, 2))
    if kind == "flight":
        angle = np.deg2rad(-15 + 30 * number / lines)
        down = np.stack([np.sin(angle), np.zeros(count), -np.cos(angle)], axis=1)
        across[:, 1] = low[1] + (high[1] - low[1]) * line / lines
        return np.column_stack([across, np.zeros(count)]) - 200 * down / np.abs(down[:, 2:]), down
    start = np.column_stack([across, np.full(count, 1.6)])
    end = np.column_stack([rng.uniform(low, high, (count, 2)), rng.uniform(0, 9, count)])
    return start, end - start


def against_brute_force(caster: RayCaster, origins: np.ndarray, ways: np.ndarray) -> Callable:
    """Error of a caster's rays (R, 3) in words, when it is asked for."""
    truth = ExactCaster(caster.scene).cast(origins, ways)

    def error(_: object) -> str:
        found = caster.cast(origins, ways)
        same = (found.instance == truth.instance) & (found.triangle == truth.triangle) & truth.found
        apart = np.abs(found.distance[same] - truth.distance[same])
        median, tail = np.quantile(apart, [0.5, 0.99]) if len(apart) else (np.nan, np.nan)
        other = np.count_nonzero(found.found & truth.found & ~same)
        missed = np.count_nonzero(found.found != truth.found)
        return f"{median:.0e} m, 99 % {tail:.0e}; of {len(ways)} {other} other, {missed} missed"

    return error


def embree_alone(
    caster: EmbreeCaster,
    origins: np.ndarray,
    ways: np.ndarray,
    reach: float = np.inf,
    many: int = 0,
) -> BenchRow:
    """Rays (R, 3) sent by Embree alone, as float32 and in order, before anything is made of them."""
    rays = rays_of((origins - caster._centre).T, ways.T, np.full(len(ways), reach))
    sent = rays_of((origins - caster._centre).T, ways.T, np.full(len(ways), reach))

    def work() -> None:
        sent[:] = rays  # which Embree shortens
        send(caster._library, caster._top, sent)

    return BenchRow(work, many=many or len(ways))


def _cast(size: str, count: int, engine: type[Search], kind: str, **settings: int) -> BenchRow:
    caster = engine(plant(grow_trees(size), count), **settings)
    rays = rays_through(caster.scene, COUNTS[engine], kind)
    checked = against_brute_force(caster, *rays_through(caster.scene, CHECKED, kind))
    return BenchRow(lambda: caster.cast(*rays), checked, len(rays[0]))


def _built(size: str, count: int, engine: type[Search]) -> BenchRow:
    """The meshes that rays come to: BVHTree builds them then."""
    scene = plant(grow_trees(size), count)
    rays = [rays_through(scene, CHECKED, kind) for kind in KINDS]

    def work() -> None:
        caster = engine(scene)
        for some in rays:
            caster.cast(*some)

    return BenchRow(work, many=count)


def _alone(size: str, count: int) -> BenchRow:
    caster = EmbreeCaster(plant(grow_trees(size), count))
    return embree_alone(caster, *rays_through(caster.scene, COUNTS[EmbreeCaster], "tripod"))


# Rays where some bodies of a scene move, beside where none does, and their error against float64.
#
# 400 bumpy bodies of 7,000 triangles, some of which go 1 m and turn by 1 rad within 1 s, or are drawn out
# to 1.5 times their height meanwhile; rays from the middle into every direction, each at a time of its
# own, no two alike: the worst case.


BODIES, SIDES = 400, 60  # of a body
MOVING = ((0, 0), (1, 0), (10, 0), (40, 0), (10, 10))  # of them move, and bend as well
MOVING_CHECKED = 100  # rays towards bodies that move, each against the scene as it is at its time


def _moving(engine: type[Search], moving: int, bending: int) -> BenchRow:
    scene, count = _bodies(), COUNTS[engine]
    rng = stream(1, "bench", moving)
    ways, time = rng.normal(size=(count, 3)), rng.uniform(0, 1, count)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = np.zeros((count, 3))
    if not moving:
        still = engine(scene)
        return BenchRow(lambda: still.cast(origins, ways), many=count)
    motion = _motion(scene, moving, bending)
    parts = MovingScene(scene, motion)
    fast = embree_motion(parts) if engine is EmbreeCaster else None
    caster = fast or MovingCaster(parts, engine)
    return BenchRow(
        lambda: caster.cast(origins, ways, time=time), lambda _: _error(caster, motion), count
    )


def _error(caster: MovingCaster, motion: SceneMotion) -> str:
    """Largest error of a distance; infinite where another body is met, or none."""
    paths = motion.paths
    rng = stream(2, "bench", len(paths))
    number, time = rng.integers(len(paths), size=MOVING_CHECKED), rng.uniform(0, 1, MOVING_CHECKED)
    place = np.array([paths[n].at(t[None])[0] for n, t in zip(number, time, strict=True)])
    ways = place[:, :, 3] + rng.uniform(-0.5, 0.5, (MOVING_CHECKED, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    origins = np.zeros((MOVING_CHECKED, 3))
    found = caster.cast(origins, ways, time=time)
    worst = 0.0
    for row in range(MOVING_CHECKED):
        now = caster.scene.transform.copy()
        for part, path in paths.items():
            now[part] = path.at(time[row, None])[0]
        body = caster.scene.meshes[0]
        shape = motion.shapes.get(0)
        meshes = [body]
        if shape is not None:  # all that bend do alike
            every = np.arange(len(body.vertices))[None]
            meshes.append(replace(body, vertices=shape.at(every, time[row, None])[0]))
        there = _scene(tuple(meshes), now, len(motion.shapes))
        truth = ExactCaster(there).cast(origins[:1], ways[row, None])
        same = truth.instance[0] == found.instance[row]
        worst = max(worst, abs(truth.distance[0] - found.distance[row]) if same else np.inf)
    return f"{worst:.0e} m"


def _motion(scene: SceneGeometry, moving: int, bending: int) -> SceneMotion:
    time, body = np.linspace(0, 1, 25), scene.meshes[0].vertices.astype(np.float32)
    drawn = np.repeat(body[None], len(time), axis=0)
    drawn[:, :, 2] *= 1 + time[:, None].astype(np.float32) / 2
    shape = ShapePath(time, drawn)
    paths = {number: _path(scene.transform[number]) for number in range(moving)}
    return SceneMotion(paths, dict.fromkeys(range(bending), shape))


def _path(transform: np.ndarray) -> RigidPath:
    time = np.linspace(0, 1, 25)
    place = transform[:2, 3] + np.column_stack([time, np.zeros(len(time))])
    transforms = turned(place, time)
    transforms[:, 2, 3] = transform[2, 3]
    return RigidPath(time, transforms)


def _bodies() -> SceneGeometry:
    round_, up = np.meshgrid(
        np.linspace(0, 2 * np.pi, SIDES), np.linspace(0, np.pi, SIDES), indexing="ij"
    )
    ball = [np.cos(round_) * np.sin(up), np.sin(round_) * np.sin(up), np.cos(up)]
    bumps = 1 + 0.1 * np.sin(7 * round_) * np.sin(5 * up)
    vertices = np.stack([bumps * x for x in ball], axis=-1).reshape(-1, 3)
    i = (np.arange(SIDES - 1)[:, None] * SIDES + np.arange(SIDES - 1)).ravel()
    lower = np.stack([i, i + 1, i + SIDES], axis=1)
    upper = np.stack([i + 1, i + SIDES + 1, i + SIDES], axis=1)
    mesh = TriMesh.of_part(vertices, np.concatenate([lower, upper]), OTHER)
    transform = np.repeat(np.eye(3, 4)[None], BODIES, axis=0)
    transform[:, :, 3] = stream(3, "bench").uniform(-40, 40, (BODIES, 3))
    return _scene((mesh,), transform)


def _scene(meshes: tuple[TriMesh, ...], transform: np.ndarray, bent: int = 0) -> SceneGeometry:
    index = np.zeros(len(transform), np.int64)
    index[:bent] = len(meshes) - 1
    return scene_of(meshes, transform, index)


# Whole scans: from the trajectory to the closed file; and how many sub-rays are enough.


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
BLOCK_SUBRAYS = (7, 19, 61)


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


def _whole_scan(trees: int, triangles: int, subrays: int) -> BenchRow:
    """A quarter turn at 0.1° or so from outside the stand, into a file."""
    scanner = Terrestrial(
        position=(-5.0, -5.0, 1.6),
        azimuth_deg=(0.0, 90.0),
        elevation_deg=(-30.0, 60.0),
        angle_step_deg=0.1 if subrays == 1 else 0.3,
        beam=replace(BEAM, subrays=subrays, max_returns=1 if subrays == 1 else 5),
    )
    work = Scan(scanner, make_caster(forest(trees, triangles), ONE_THREAD))
    folder = TemporaryDirectory()
    return BenchRow(
        lambda: write_scan(Path(folder.name) / "scan.las", work, 0),
        lambda done: f"- ({done.points:,} points)",
        work.pulses,
    )


def _beams(subrays: int) -> BenchRow:
    caster = make_caster(forest(10, 200_000), ONE_THREAD)

    def work(count: int = subrays) -> Cloud:
        beam = replace(BEAM, subrays=count, max_returns=15)
        return scan(replace(FROM_OUTSIDE, beam=beam), caster)

    def error(cloud: Cloud) -> str:
        (got, near), (energy, first) = map(_energy_and_range, (cloud, work(MANY)))
        both = np.isfinite(near) & np.isfinite(first)
        away = 1e3 * np.abs(near[both] - first[both])
        lost = np.mean(np.isinf(near[energy > 0]))
        return (
            f"energy {np.abs(got - energy).sum() / energy.sum():.1%}, bias "
            f"{got.sum() / energy.sum() - 1:+.2%}; no echo for an echo {lost:.1%}; first range "
            f"{np.median(away):.2f} mm, 90 % {np.quantile(away, 0.9):.1f} mm"
        )

    return BenchRow(work, error, work().pulses)


def _energy_and_range(cloud: Cloud) -> tuple[np.ndarray, np.ndarray]:
    """Energy (P,) and range of the first return (P,), inf where there is none."""
    energy = np.bincount(cloud.pulse, cloud.intensity * cloud.true_range**2, cloud.pulses)
    first = np.full(cloud.pulses, np.inf)
    leading = cloud.number == 1
    first[cloud.pulse[leading]] = cloud.true_range[leading]
    return energy, first


def _returns(subrays: int) -> BenchRow:
    beam = replace(BEAM, subrays=subrays, max_returns=15)
    scanner = FROM_OUTSIDE.changed(angle_step_deg=0.3, beam=beam)
    caster = make_caster(forest(10, 200_000), ONE_THREAD)
    work = partial(scan, scanner, caster)
    return BenchRow(
        work, lambda cloud: "; ".join(map(partial(_told, cloud), THRESHOLDS)), work().pulses
    )


def _told(cloud: Cloud, threshold: float) -> str:
    """Returns of a pulse, and the gaps between them, by the least light that is told."""
    told = cloud.intensity * cloud.true_range**2 >= threshold
    _, many = np.unique(cloud.pulse[told], return_counts=True)
    gap = np.diff(cloud.true_range[told])[np.diff(cloud.pulse[told]) == 0]
    low, middle = np.quantile(gap, [0.05, 0.5])
    return (
        f"at {threshold:.0%} {(many == 1).mean():.1%} of one, {(many >= 3).mean():.1%} of three and "
        f"more, gaps {low:.2f} (5 %) and {middle:.2f} m"
    )


def _tripod_among_blocks(subrays: int) -> BenchRow:
    beam = Beam(divergence_mrad=(0.3, 0.3), exit_diameter=0.007, pulse_ns=5.0, subrays=subrays)
    scanner = Terrestrial(
        position=(-26.0, -31.0, 1.7),
        azimuth_deg=(0.0, 90.0),
        elevation_deg=(-40.0, 60.0),
        angle_step_deg=0.12,
        beam=beam,
    )
    work = Scan(scanner, make_caster(blocks(), ONE_THREAD))
    return BenchRow(
        lambda: sum(len(piece) for _, piece in work.chunks()),
        lambda points: f"- ({points:,} points)",
        work.pulses,
    )


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


def impacted_area(scan: Any, tractor: Tractor) -> float:
    """A_IM of an orchard, m²."""
    return float(orchards.beam_areas(scan, tractor).sum())


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


TOLERANCES = (4.0, 1.0, 0.2, 0.05)  # mm
FINE = 1e-4  # metres
PARTS, SOLID = (0, 1, 2, 4), 8
SAME = 0.02  # metres; ranges that differ by more are of another branch
ORCHARD = orchards.Orchard(iterations=4, trees=1, smallest=0.006)
LARGEST = orchards.Orchard(iterations=7, trees=4, smallest=0.006)
EVERY = 8  # of the scans


def _tree() -> Skeleton:
    return orchards.plant(ORCHARD, orchards.first_internode(), seed=1).variants[0, 0].skeleton


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


def _exactly() -> BenchRow:
    skeleton = _tree()
    tractor = _past(skeleton)

    def told(exact: TractorScan) -> str:
        met, area = np.isfinite(exact.distance), impacted_area(exact, tractor)
        return f"- ({met.sum():,} on wood, A_IM {1e4 * area:.2f} cm²)"

    work = partial(drive, tractor, _Cones(skeleton))
    return BenchRow(work, told, work().distance.size)


def _tubes(tolerance: float) -> BenchRow:
    skeleton = _tree()
    tractor, mesh = _past(skeleton), mesh_wood(skeleton, tolerance)
    exact = drive(tractor, _Cones(skeleton))
    sides = np.mean([sides_for(float(r), tolerance) for r in skeleton.radius[:, 0]])

    def error(found: TractorScan) -> str:
        here, there = np.isfinite(found.distance), np.isfinite(exact.distance)
        away = found.distance[here & there] - exact.distance[here & there]
        near = 1e3 * away[np.abs(away) < SAME]
        area = impacted_area(found, tractor) / impacted_area(exact, tractor) - 1
        return (
            f"range {near.mean():+.3f} mm, rms {np.sqrt((near**2).mean()):.3f}, median "
            f"{np.median(np.abs(near)):.4f}; another branch {1 - len(near) / len(away):.2%}, by one only "
            f"{np.mean((here != there)[here | there]):.2%}; A_IM {area:+.2%}; {sides:.1f} sides, "
            f"{len(mesh.triangles):,} triangles"
        )

    caster = make_caster(scene_of([mesh]), ONE_THREAD)
    return BenchRow(partial(drive, tractor, caster), error, exact.distance.size)


def _solid(parts: int) -> BenchRow:
    skeleton = _tree()
    tractor = _past(skeleton)
    exact = impacted_area(drive(tractor, _Cones(skeleton)), tractor)
    caster = make_caster(scene_of([mesh_wood(skeleton, FINE)]), ONE_THREAD)
    solid = impacted_area(drive(replace(tractor, splits=SOLID), caster), tractor)

    def error(found: TractorScan) -> str:
        area = impacted_area(found, tractor)
        return (
            f"A_IM {1e4 * area:.2f} cm², {area / exact:.3f} of exact rays', {area / solid - 1:+.2%} to "
            f"P = {SOLID}"
        )

    work = partial(drive, replace(tractor, splits=parts), caster)
    return BenchRow(work, error, work().distance.size)


def _largest(engine: str) -> BenchRow:
    def work() -> tuple[Any, ...]:
        forest = orchards.plant(LARGEST, orchards.first_internode(), seed=1)
        tractor = orchards.tractor_for(forest, 0)
        rays = Rays(engine=engine, threads=1)
        observer = orchards.stand_up(forest, orchards.scene_of(tractor), rays)
        return forest, tractor, drive(tractor, observer.caster)

    def told(found: tuple[Any, ...]) -> str:
        _, tractor, driven = found
        return f"- ({driven.distance.size:,} beams, A_IM {impacted_area(driven, tractor):.5f} m²)"

    variants = work()[0].variants.values()
    return BenchRow(work, told, sum(len(tree.skeleton) for tree in variants))


class _Cones(RayCaster):
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
        time: float | np.ndarray = 0.0,
    ) -> Hits:
        """The closest hits of rays that start outside of all wood."""
        assert leaving is None
        assert not np.any(min_distance)
        distance = first_hits(self._skeleton, origins, directions)
        distance[distance > max_distance] = np.inf
        what = np.where(np.isfinite(distance), 0, -1)
        return Hits(distance, what, what)


FORESTS = list(product(TREES, INSTANCES, COUNTS))
WINDY = Scene(
    seed=3,
    forest=Forest(size=(40.0, 40.0)),
    plantings=tuple(
        Planting(species=name, expected=expected, variants=4)
        for name, expected in (("european-beech", 32.0), ("scots-pine", 16.0))
    ),
    accuracy=Accuracy(audit=0.0),
    rays=Rays(threads=1),
)
AMONG = Terrestrial(
    position=(20.0, 20.0, 1.5), angle_step_deg=0.5, elevation_deg=(-30.0, 90.0), pulse_rate=1e5
)


def _in_wind(speed: float) -> BenchRow:
    """A scan of a stand in a wind, m/s, and what its audit finds."""
    scene = WINDY.changed(wind=Wind(speed=speed))
    world, audited = build(scene), scene.changed(accuracy=Accuracy())

    def error(_: object) -> str:
        return f"{build(audited).scan(AMONG).audit.worst}"

    return BenchRow(lambda: world.scan(AMONG), error, Scan(AMONG, world.observer.caster).pulses)


ROWS: Rows = {
    **{
        f"a tripod among 48 trees, {f'wind of {speed:g} m/s' if speed else 'still'}": partial(
            _in_wind, speed
        )
        for speed in (0.0, 6.0)
    },
    **{
        f"rays of a {kind}, {c} x {size}, {e.engine}": partial(_cast, size, c, e, kind)
        for size, c, e in FORESTS
        for kind in KINDS
    },
    **{
        f"rays of a {kind}, {INSTANCES[-1]} x {name}": partial(
            _cast, name, INSTANCES[-1], EmbreeCaster, kind
        )
        for name in MEASURED
        for kind in KINDS
    },
    **{
        f"rays of a tripod by two threads, {c} x {size}": partial(
            _cast, size, c, EmbreeCaster, "tripod", threads=2
        )
        for size, c in product(TREES, INSTANCES)
    },
    **{
        f"Embree alone, rays of a tripod, {c} x 200k": partial(_alone, "200k", c) for c in INSTANCES
    },
    **{f"{c} x {size}, {e.engine}, built": partial(_built, size, c, e) for size, c, e in FORESTS},
    **{
        f"rays where of {BODIES} bodies {m} move, {b} bend, {e.engine}": partial(_moving, e, m, b)
        for e in COUNTS
        for m, b in MOVING
    },
    **{
        f"scan of {trees} x {triangles:,}, {subrays} rays a pulse, into a file": partial(
            _whole_scan, trees, triangles, subrays
        )
        for trees, triangles in SCENES
        for subrays in (1, 19)
    },
    **{f"beams of {n} sub-rays": partial(_beams, n) for n in SUBRAYS},
    **{f"returns of beams of {n} sub-rays": partial(_returns, n) for n in SOME_SUBRAYS},
    **{
        f"tripod among blocks, {n} sub-rays": partial(_tripod_among_blocks, n)
        for n in BLOCK_SUBRAYS
    },
    "a drive past exact cylinders": _exactly,
    **{f"a drive past tubes, {mm:g} mm": partial(_tubes, mm / 1000) for mm in TOLERANCES},
    **{f"a drive with S's solid beam, P = {parts}": partial(_solid, parts) for parts in PARTS},
    **{f"S's largest row, whole, {e}": partial(_largest, e) for e in ("embree", "bvhtree")},
}
