"""A scan held against the exact one: rays of random pulses, by brute force in float64.

Both engines search in float32 and refine what they find; here the first surface of a ray is found again
over all triangles that it may meet (``rays/exact``). Where the two part, the ray may pass an edge so
closely that either is right: then a ray that is moved aside by ``EDGE`` finds what the engine found. And two
surfaces may lie so closely behind one another, as the front and the back beside an outer edge do, that
single precision does not tell which is first: then the distance to the triangle that the engine named counts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ...spec import Tractor
from ..audit import Audit, sample
from ..rays.caster import RayCaster
from ..rays.exact import cast_exactly, meet_exactly
from .footprint import spread
from .scan import Scan
from .tractor import axes, fan, positions

BATCH = 4  # rays
EDGE = 2e-5  # m; engines search in float32, whose steps are so large 100 m away
SURE = 1e-10  # m; where an engine is off by more, it may have named another triangle
SAME = 1e-3  # m; nearer surfaces count as the same one when a ray is moved aside
ALLOWED = 1e-9  # m, and rounding of the coordinates

Draw = Callable[[np.random.Generator, int], tuple[np.ndarray, np.ndarray]]


def audit_scan(scan: Scan, rng: np.random.Generator, seconds: float, share: float) -> Audit:
    """Of a scan that took ``seconds``, at a cost of about ``share`` of that."""

    def draw(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        number = rng.integers(0, scan.pulses, count)
        keys = rng.integers(0, 2**63, count, dtype=np.uint64)
        origins, directions = spread(scan.pattern.pulses(number), scan.scanner.beam, keys)
        chosen = np.arange(count) * scan.scanner.beam.subrays
        chosen += rng.integers(0, scan.scanner.beam.subrays, count)
        return origins[chosen], directions[chosen]

    rays = scan.pulses * scan.scanner.beam.subrays
    return _audit(scan.caster, draw, scan.scanner.max_range, rays, rng, seconds, share)


def audit_drive(
    tractor: Tractor, caster: RayCaster, rng: np.random.Generator, seconds: float, share: float
) -> Audit:
    """Of a tractor's scan, as ``audit_scan``."""
    scans, angles = len(positions(tractor)), len(fan(tractor))

    def draw(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
        return axes(tractor, rng.integers(0, scans, count), rng.integers(0, angles, count))

    rays = scans * angles * (tractor.splits + 1) ** 2
    return _audit(caster, draw, tractor.max_range, rays, rng, seconds, share)


def _audit(
    caster: RayCaster,
    draw: Draw,
    reach: float,
    rays: int,
    rng: np.random.Generator,
    seconds: float,
    share: float,
) -> Audit:
    def batches() -> Iterator[np.ndarray]:
        while True:
            yield ray_errors(caster, *draw(rng, BATCH), reach)

    found = sample(batches(), share * seconds)
    return Audit(
        what="rays by brute force in float64",
        checked=len(found.errors),
        error=found.largest,
        rms=found.rms,
        allowed=ALLOWED + 64 * np.finfo(float).eps * _extent(caster),
        seconds=seconds,
        exact_seconds=found.seconds_each * rays,
        unit="m",
    )


def ray_errors(
    caster: RayCaster, origins: np.ndarray, directions: np.ndarray, reach: float
) -> np.ndarray:
    """(R,) metres between what an engine and brute force find; a miss counts as a hit at ``reach``."""
    found = caster.cast(origins, directions, reach)
    ours = np.minimum(found.distance, reach)
    exact = np.minimum(cast_exactly(caster.scene, origins, directions).distance, reach)
    errors = np.abs(ours - exact)
    for row in np.flatnonzero((errors > SURE) & (errors <= EDGE) & found.found):
        named = int(found.instance[row]), int(found.triangle[row])
        there = meet_exactly(caster.scene, origins[row], directions[row], *named)
        errors[row] = min(errors[row], abs(ours[row] - there))
    for row in np.flatnonzero(errors > SAME):
        if _at_an_edge(caster, origins[row], directions[row], float(ours[row]), reach):
            errors[row] = 0.0
    return errors


def _at_an_edge(
    caster: RayCaster, origin: np.ndarray, way: np.ndarray, ours: float, reach: float
) -> bool:
    """Whether a ray that is moved aside a little finds, by brute force, what the engine found."""
    way = way / np.linalg.norm(way)
    across = np.cross(way, np.eye(3)[np.abs(way).argmin()])
    across /= np.linalg.norm(across)
    turn = np.arange(8) * np.pi / 4
    aside = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * np.cross(way, across)
    moved = cast_exactly(caster.scene, origin + EDGE * aside, np.repeat(way[None], 8, axis=0))
    return bool((np.abs(np.minimum(moved.distance, reach) - ours) < SAME).any())


def _extent(caster: RayCaster) -> float:
    """The largest coordinate of the scene."""
    shift = np.abs(caster.scene.transform[:, :, 3])
    return float(np.nanmax(shift, initial=0.0))
