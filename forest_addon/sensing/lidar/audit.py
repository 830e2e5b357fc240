"""A scan held against the exact one: random pulses of what was returned, measured again.

Of all points is looked at whether they are in order and their pulses complete. Then pulses are drawn: as many
as time allows are sent again by the engine, and at least ``LEAST`` of those that came back and of those
that did not are followed ray by ray in float64 (``rays/exact``), each to everything that the cloud says of
it. A pulse that lacks a return, or has one too many or with another label, is infinitely far off.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np

from ...spec import Tractor
from ..audit import LEAST, Audit, Check, Sampled, sample
from ..rays.caster import RayCaster
from ..rays.exact import Referee
from ..rays.geometry import SceneGeometry
from .cloud import Cloud, Returns
from .scan import Scan
from .tractor import TractorScan, beams

BATCH = 50  # pulses in float64 at a time
AGAIN = 2048  # pulses by the engine at a time
RUNS = 16  # pulses that follow each other in such a batch
ALLOWED = 1e-9  # m, and rounding of the coordinates
OF_VALUE = 1e-7  # of intensities and widths; of angles and times, rad and s
LABELS = ("organ", "leaf", "tree", "species", "instance", "triangle")

Draw = Callable[[np.random.Generator, int], np.ndarray]


def audit_scan(
    scan: Scan,
    cloud: Cloud,
    rng: np.random.Generator,
    seconds: float,
    share: float,
    scene: SceneGeometry | None = None,
) -> Audit:
    """Audit of a cloud that took ``seconds``, at a cost of about ``share`` of that.

    scan : the same scan, ready to look again. scene : the true one; left out: the caster's.
    """
    exact = scan.exactly(scene)
    came = cloud.pulse[np.diff(cloud.pulse, prepend=-1) != 0]
    nothing = np.ones(scan.pulses, dtype=bool)
    nothing[came[(came >= 0) & (came < scan.pulses)]] = False
    lost = np.concatenate([np.arange(one.first, one.stop) for one in cloud.lost] or [came[:0]])
    values: list[np.ndarray] = []

    def check(again: Scan, draw: Draw, size: int, within: float, least: int) -> Sampled:
        def batches() -> Iterator[np.ndarray]:
            while True:
                number = np.unique(draw(rng, size))
                number = number[~np.isin(number, lost)] if len(lost) else number
                places, of_value = apart(cloud, again.look_at(number), number)
                values.append(of_value)
                yield places

        return sample(batches(), within, least)

    def back(rng: np.random.Generator, size: int) -> np.ndarray:
        return came[rng.integers(0, len(came), size)]

    def empty(rng: np.random.Generator, size: int) -> np.ndarray:
        number = rng.integers(0, scan.pulses, size)
        return number[nothing[number]]

    def runs(rng: np.random.Generator, size: int) -> np.ndarray:
        first = rng.integers(0, scan.pulses, max(size // RUNS, 1))
        number = np.unique(first[:, None] + np.arange(RUNS))
        return number[number < scan.pulses]

    wanted, budget = ALLOWED + _rounding(scan.caster), share * seconds
    begin = time.perf_counter()
    what, checks = "in float64, ray by ray", [_in_order(scan, cloud)]
    each = 0.0
    if len(came):
        found = check(exact, back, BATCH, budget / 4, LEAST)
        each = found.seconds_each
        checks.append(Check.on(f"pulses {what}", found.errors, len(came), wanted, "m"))
    none = scan.pulses - len(came) - len(lost)
    if none > 0:
        size = BATCH * min(scan.pulses // none, 64)
        found = check(exact, empty, size, budget / 4, min(LEAST, none))
        each = each or found.seconds_each
        checks.append(Check.on(f"pulses that met nothing {what}", found.errors, none, wanted, "m"))
    found = check(scan, runs, AGAIN, budget - (time.perf_counter() - begin), 0)
    checks.append(Check.on("pulses sent again", found.errors, scan.pulses, wanted, "m"))
    rest = np.concatenate(values)
    checks.append(
        Check.on("intensities, widths, angles and times", rest, scan.pulses, OF_VALUE, "of each")
    )
    return Audit(tuple(checks), seconds, each * scan.pulses)


def audit_drive(
    tractor: Tractor,
    found: TractorScan,
    caster: RayCaster,
    rng: np.random.Generator,
    seconds: float,
    share: float,
    scene: SceneGeometry | None = None,
) -> Audit:
    """Audit of a tractor's scan, as ``audit_scan``."""
    exact, returns = Referee(caster, scene), found.returns
    met = np.isfinite(returns.distance)
    wanted, budget = ALLOWED + _rounding(caster), share * seconds
    begin = time.perf_counter()

    def check(again: RayCaster, among: np.ndarray, size: int, within: float, least: int) -> Sampled:
        def batches() -> Iterator[np.ndarray]:
            while True:
                beam = among[rng.integers(0, len(among), size)]
                row, step = np.divmod(beam, len(found.angle))
                there = beams(tractor, again, row, step)
                rays = there.distance.reshape(len(beam), -1)
                ours = returns.select(np.repeat(beam, rays.shape[1]))
                errors = np.fmax(*_differ(ours, there)).reshape(rays.shape)
                first = (
                    rays <= rays.min(axis=1, keepdims=True) + ALLOWED
                )  # on level ground, several
                yield np.where(first, errors, np.inf).min(axis=1)

        return sample(batches(), within, least)

    checks, each = [], 0.0
    kinds = (("beams", np.flatnonzero(met)), ("beams that met nothing", np.flatnonzero(~met)))
    for name, among in kinds:
        if len(among):
            seen = check(exact, among, BATCH, budget / 4, LEAST)
            what = f"{name} in float64, ray by ray"
            checks.append(Check.on(what, seen.errors, len(among), wanted, "m"))
            each = each or seen.seconds_each
    everything = np.arange(len(met))
    seen = check(caster, everything, AGAIN, budget - (time.perf_counter() - begin), 0)
    checks.append(Check.on("beams sent again", seen.errors, len(met), wanted, "m"))
    return Audit(tuple(checks), seconds, each * len(met))


def apart(found: Cloud, again: Cloud, number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P,) metres, and (P,) of each value, between what two clouds say of pulses (P,), ascending."""
    ours, theirs = _rows(found, number), _rows(again, number)
    many = ours[1] - ours[0]
    places, values = np.zeros(len(number)), np.zeros(len(number))
    places[many != theirs[1] - theirs[0]] = np.inf
    same = np.flatnonzero((places == 0) & (many > 0))
    pulse = np.repeat(same, many[same])
    within = np.arange(len(pulse)) - np.repeat(np.cumsum(many[same]) - many[same], many[same])
    a, b = ours[0][pulse] + within, theirs[0][pulse] + within
    far, off = _differ(found.returns.select(a), again.returns.select(b))
    far = np.fmax(far, np.linalg.norm(found.position[a] - again.position[b], axis=1))
    far = np.fmax(far, np.abs(found.true_range[a] - again.true_range[b]))
    for name in ("number", "count", "bounce"):
        if getattr(found, name) is not None:
            far[getattr(found, name)[a] != getattr(again, name)[b]] = np.inf
    far[~np.isfinite(found.position[a]).all(axis=1)] = np.inf
    for name in ("intensity", "width"):
        one, other = getattr(found, name)[a], getattr(again, name)[b]
        off = np.fmax(off, np.abs(one - other) / np.where(other > 0, other, 1.0))
    for name in ("time", "azimuth", "elevation", "scan_angle"):
        off = np.fmax(off, np.abs(getattr(found, name)[a] - getattr(again, name)[b]))
    np.maximum.at(places, pulse, far)
    np.maximum.at(values, pulse, off)
    return places, values


def ray_errors(
    caster: RayCaster, origins: np.ndarray, directions: np.ndarray, reach: float
) -> np.ndarray:
    """(R,) metres between what an engine and float64 find; a miss counts as a hit at ``reach``."""
    ours = np.minimum(caster.cast(origins, directions, reach).distance, reach)
    right = np.minimum(Referee(caster).cast(origins, directions, reach).distance, reach)
    errors: np.ndarray = np.abs(ours - right)
    return errors


def _in_order(scan: Scan, cloud: Cloud) -> Check:
    """Check of all points: pulses in order and of this scan, with all returns, every number finite."""
    pulse, number, last = cloud.pulse, cloud.number, cloud.number == cloud.count
    step = pulse[1:] - pulse[:-1]
    wrong = ~np.isfinite(cloud.position.sum(axis=1))
    if len(pulse):
        wrong[0] |= (pulse[0] < 0) | (number[0] != 1)
        wrong[-1] |= (pulse[-1] >= scan.pulses) | ~last[-1]
    goes_on = step == 0
    wrong[1:] |= (step < 0) | (number[1:] != number[:-1] * goes_on + 1) | (last[:-1] == goes_on)
    count = int(np.count_nonzero(wrong)) + abs(cloud.pulses - scan.pulses)
    what = "points in order, with all returns of their pulses"
    return Check(what, len(pulse), len(pulse), float(count), float(count), 0.0, "points")


def _differ(one: Returns, other: Returns) -> tuple[np.ndarray, np.ndarray]:
    """(R,) metres between ranges, infinite where labels differ; (R,) between normals and cosines."""
    both_miss = ~np.isfinite(one.distance) & ~np.isfinite(other.distance)
    with np.errstate(invalid="ignore"):
        far = np.where(both_miss, 0.0, np.abs(one.distance - other.distance))
    far[np.isnan(far)] = np.inf
    for name in LABELS:
        far[getattr(one, name) != getattr(other, name)] = np.inf
    off = np.abs(one.cos_incidence - other.cos_incidence)
    off = np.fmax(off, np.abs(one.normal - other.normal).max(axis=1, initial=0.0))
    return far, np.where(both_miss, 0.0, off)


def _rows(cloud: Cloud, number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows at which the returns of pulses begin and end."""
    return (
        np.searchsorted(cloud.pulse, number, side="left"),
        np.searchsorted(cloud.pulse, number, side="right"),
    )


def _rounding(caster: RayCaster) -> float:
    """Metres, at the largest coordinate of the scene."""
    shift = np.abs(caster.scene.transform[:, :, 3])
    return float(64 * np.finfo(float).eps * np.nanmax(shift, initial=0.0))
