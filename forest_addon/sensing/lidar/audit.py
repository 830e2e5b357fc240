"""Parts of a scan that an audit looks at, and how each value is computed again.

Of all points: their order, that every number is finite, that each lies on its pulse's beam at its range, was
sent when and where it says, and is of the tree, leaf and organ that its triangle is of. Of pulses that are
drawn: all that the cloud says of them, sent again by the engine or followed ray by ray in float64
(``rays/exact``). A pulse that lacks a return, or has one too many or with another label, is infinitely far
off; but of surfaces that lie on each other any one is right, with what light it sends back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import numpy as np

from ...base.vectors import azimuth_of
from ...spec import Tractor
from ..audit import LEAST, AuditPart, figures, shares
from ..rays.caster import Hits, RayCaster
from ..rays.exact import ExactCaster, Referee
from ..rays.geometry import SceneGeometry
from .cloud import Cloud, Returns, cosines, label, organs
from .radiometry import reflectance_of
from .scan import Scan
from .tractor import TractorScan, beam_rays, fan, positions
from .waveform import LIGHT, Waveforms

RAYS = 4000  # followed in float64, for each kind of pulse
AGAIN = 1000  # pulses that are sent again by the engine, at least
BORDERS, BESIDE = 64, 32  # ends of a scan's pieces, and pulses to each side that are sent again
ALLOWED = 1e-9  # m, and rounding of the coordinates
OF_VALUE = (
    1e-7  # of intensities and widths; of angles, normals, speeds and times, rad, 1, m/s and s
)
FLOAT64 = "in float64, ray by ray"
EXCUSES = 64  # pulses that are asked whether surfaces lie on each other
LABELS = ("organ", "leaf", "tree", "species", "instance", "triangle")
VALUES = "intensities, widths and whatever else points say", OF_VALUE, "of each"
TURNS = "normals, angles and times of all of these", OF_VALUE, "of each"


def parts_of_scan(
    scan: Scan,
    cloud: Cloud,
    share: float,
    scene: SceneGeometry | None = None,
    pulses: np.ndarray | None = None,
) -> list[AuditPart]:
    """Parts of a cloud, ``share`` of whose pulses are sent again.

    scan : the same scan, ready to look again. scene : the true one; left out: the caster's. pulses : numbers
    (P,), ascending, of those that the cloud is of; left out: all.
    """
    true = scan.caster.scene if scene is None else scene
    every = np.arange(scan.pulses) if pulses is None else pulses
    exact, count = scan.exactly(scene), len(every)
    wanted = ALLOWED + _rounding(true)
    seen = np.isin(every, cloud.pulse)
    lost = np.zeros(count, dtype=bool)
    for one in cloud.lost:
        lost |= (every >= one.first) & (every < one.stop) & ~seen
    came, empty = every[seen], every[~seen & ~lost]

    def sent(again: Scan, among: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        def look(number: np.ndarray) -> np.ndarray:
            number = among[number]
            held = ~np.isin(number, every[lost])  # all but those that are said to be lost
            errors = np.zeros((2, len(number)))
            errors[:, held] = _again(exact, again, cloud, number[held], wanted)
            return errors

        return look

    right = {"pulses": count, "engine": scan.caster.engine}
    right |= {} if scan.specular else {"unfollowed": 0}
    few = max(LEAST // 4, min(LEAST, RAYS // scan.scanner.beam.subrays))
    ends = np.append(np.arange(0, count, scan.at_once), count)
    ends = ends[np.unique(np.linspace(0, len(ends) - 1, BORDERS).astype(int))]
    beside = np.unique(ends[:, None] + np.arange(-BESIDE, BESIDE))
    beside = beside[(beside >= 0) & (beside < count)]
    order = _out_of_order(scan, cloud)
    again = max(AGAIN, int(share * count)), beside

    def kinds(what: str) -> tuple[tuple[str, float, str], ...]:
        return (what, wanted, "m"), VALUES

    return [
        figures(vars(cloud), right),
        AuditPart(len(cloud), lambda number: order[number], (("points in order, whole", 0.0, ""),)),
        AuditPart(
            len(cloud),
            lambda number: _off_beam(scan, true, cloud, number),
            (("points on their beams", wanted, "m"), TURNS),
        ),
        AuditPart(len(came), sent(exact, came), kinds(f"pulses {FLOAT64}"), few, exact=True),
        AuditPart(len(empty), sent(exact, empty), kinds(f"pulses that met nothing {FLOAT64}"), few),
        AuditPart(count, sent(scan, every), kinds("pulses sent again"), *again),
    ]


def parts_of_drive(
    tractor: Tractor,
    found: TractorScan,
    caster: RayCaster,
    share: float,
    scene: SceneGeometry | None = None,
) -> list[AuditPart]:
    """Parts of a tractor's scan, as ``parts_of_scan``."""
    true = caster.scene if scene is None else scene
    float64, returns = ExactCaster(true), found.returns
    exact = Referee(caster, float64)
    wanted = ALLOWED + _rounding(true)
    met = np.isfinite(returns.distance)

    def labelled(number: np.ndarray) -> np.ndarray:
        some = returns.select(number)
        right = label(true, _named(true, some), np.zeros((len(number), 3)))
        return np.stack([_of_labels(some, right), _apart(some.normal, right.normal)])

    def sent(again: RayCaster, among: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        def look(number: np.ndarray) -> np.ndarray:
            beam = among[number]
            rays = beam_rays(tractor, *np.divmod(beam, len(found.angle)))
            some, nearest = returns.select(beam), beam_ranges(tractor, again, beam)
            ours = some.select(np.repeat(np.arange(len(beam)), len(rays[0]) // len(beam)))
            there = float64.meets(*rays, _named(true, ours), edge=exact.edge)
            at_it = shares(there, ours.distance, 1.0) <= exact.edge
            cosine = np.abs(cosines(ours.normal, rays[1]) - ours.cos_incidence)
            cosine = np.where(at_it, cosine, np.inf).reshape(len(beam), -1).min(axis=1)
            far = shares(some.distance, nearest, 1.0)
            missed = ~np.isfinite(nearest)
            far[~missed & ~at_it.reshape(len(beam), -1).any(axis=1)] = np.inf
            return np.stack([far, np.where(missed, 0.0, cosine)])

        return look

    def kinds(what: str) -> tuple[tuple[str, float, str], ...]:
        return (what, wanted, "m"), ("angles of incidence", OF_VALUE, "of each")

    right = {"angle": fan(tractor), "track": positions(tractor), "engine": caster.engine}
    right["escape"] = np.inf if tractor.escape is None else tractor.escape
    few = max(LEAST // 4, min(LEAST, RAYS // (tractor.splits + 1) ** 2))
    back, nothing, count = np.flatnonzero(met), np.flatnonzero(~met), len(met)
    again = max(AGAIN, int(share * count))
    return [
        figures(vars(found), right),
        AuditPart(count, labelled, (("beams, what their triangles are of", 0.0, ""), TURNS)),
        AuditPart(len(back), sent(exact, back), kinds(f"beams {FLOAT64}"), few, exact=True),
        AuditPart(
            len(nothing), sent(exact, nothing), kinds(f"beams that met nothing {FLOAT64}"), few
        ),
        AuditPart(count, sent(caster, np.arange(count)), kinds("beams sent again"), again),
    ]


def first_ranges(scan: Scan, number: np.ndarray) -> np.ndarray:
    """(P,) metres of the first returns of pulses (P,), ascending; inf where there is none."""
    cloud, ranges = scan.look_at(number), np.full(len(number), np.inf)
    first = cloud.number == 1
    ranges[np.searchsorted(number, cloud.pulse[first])] = cloud.true_range[first]
    return ranges


def beam_ranges(tractor: Tractor, caster: RayCaster, number: np.ndarray) -> np.ndarray:
    """(B,) metres of what a tractor's beams (B,) meet first, inf where nothing."""
    rays = beam_rays(tractor, *np.divmod(number, len(fan(tractor))))
    distance = caster.cast(*rays, tractor.max_range).distance
    return np.asarray(distance.reshape(len(number), -1).min(axis=1))


def _out_of_order(scan: Scan, cloud: Cloud) -> np.ndarray:
    """(P,) 0, infinite of points out of order, not of this scan, without all returns of their pulse or with
    values that are no numbers."""
    pulse, number, last = cloud.pulse, cloud.number, cloud.number == cloud.count
    step = pulse[1:] - pulse[:-1]
    wrong = np.zeros(len(pulse), dtype=bool)
    surface = cloud.returns.instance >= 0  # what is of noise alone has no normal
    for table in (cloud, cloud.returns):
        for name in {field.name for field in fields(table)} - {"rest", "returns"}:
            column = getattr(table, name)
            if isinstance(column, np.ndarray) and column.dtype.kind == "f":
                finite = np.isfinite(column if column.ndim == 1 else column.sum(axis=1))
                wrong |= ~finite & (surface | (name not in ("normal", "cos_incidence", "velocity")))
    if len(pulse):
        wrong[0] |= (pulse[0] < 0) | (number[0] != 1)
        wrong[-1] |= (pulse[-1] >= scan.pulses) | ~last[-1]
    goes_on = step == 0
    wrong[1:] |= (step < 0) | (number[1:] != number[:-1] * goes_on + 1) | (last[:-1] == goes_on)
    return np.where(wrong, np.inf, 0.0)


def _off_beam(scan: Scan, scene: SceneGeometry, cloud: Cloud, rows: np.ndarray) -> np.ndarray:
    """(2, N) metres and values by which points are off what their pulse, range and triangle say."""
    some = cloud.select(rows)
    pulses = scan.pattern.pulses(np.clip(some.pulse, 0, scan.pulses - 1))
    way, returns = pulses.direction, some.returns
    there = scan.placed(pulses, returns.distance)
    far = np.linalg.norm(some.position - there, axis=1)
    noise, still = scan.scanner.noise, cloud.velocity is None
    if not (
        noise.range_sd
        or noise.range_ppm
        or noise.incidence_sd
        or scan.scanner.receiver.beyond == "folded"
    ):
        far = np.fmax(far, shares(returns.distance, some.true_range, 1.0))
    right = label(scene, _named(scene, returns), way, None if still else returns.normal)
    far = np.fmax(far, _of_labels(returns, right))
    off = _apart(returns.normal, right.normal)
    if still and scan.scanner.beam.subrays == 1 and not scan.specular:
        off = np.fmax(off, _apart(returns.cos_incidence, right.cos_incidence))
    sent = {"time": pulses.time, "azimuth": azimuth_of(way), "scan_angle": pulses.scan_angle}
    sent["elevation"] = np.arcsin(np.clip(way[:, 2], -1, 1))
    for name, value in sent.items():
        off = np.fmax(off, _apart(getattr(some, name), value))
    return np.stack([np.where(np.isnan(far), np.inf, far), off])


def _again(exact: Scan, again: Scan, cloud: Cloud, number: np.ndarray, wanted: float) -> np.ndarray:
    """(2, P) metres, and of each value, between a cloud and pulses (P,), ascending, that are sent again."""
    there = again.look_at(number)
    begin, first = (np.searchsorted(one.pulse, number) for one in (cloud, there))
    end, last = (np.searchsorted(one.pulse, number, "right") for one in (cloud, there))
    many = end - begin
    errors = np.zeros((2, len(number)))
    errors[0, many != last - first] = np.inf
    same = np.flatnonzero((errors[0] == 0) & (many > 0))
    pulse = np.repeat(same, many[same])
    within = np.arange(len(pulse)) - np.repeat(np.cumsum(many[same]) - many[same], many[same])
    ours, theirs = cloud.select(begin[pulse] + within), there.select(first[pulse] + within)
    apart = _between(ours, theirs)
    bad = np.unique(pulse[(apart > [[wanted], [OF_VALUE]]).any(axis=0)])[:EXCUSES]
    still = isinstance(exact.caster, Referee) and exact.caster.moving is None
    if len(bad) and still and not exact.specular:
        rows = np.flatnonzero(np.isin(pulse, bad))
        beam = np.searchsorted(bad, pulse[rows])
        right = _lie_on_each_other(exact, number[bad], beam, ours.select(rows), theirs.select(rows))
        apart[:, rows[right]] = 0.0
    for one, each in zip(errors, apart, strict=True):
        np.maximum.at(one, pulse, each)
    if cloud.waves is not None or there.waves is not None:
        rounding = 0 if again.caster.engine == cloud.engine else 1  # counts
        errors[1] = np.fmax(errors[1], _of_waves(cloud.waves, there.waves, number, rounding))
    return errors


def _of_waves(
    ours: Waveforms | None, theirs: Waveforms | None, number: np.ndarray, rounding: int
) -> np.ndarray:
    """(P,) counts, beyond rounding, between records of pulses; infinite where lengths or formats differ."""
    errors = np.zeros(len(number))
    told = ("step", "gain", "las_format")
    if ours is None or theirs is None or any(getattr(ours, k) != getattr(theirs, k) for k in told):
        return np.full(len(number), np.inf)
    rows = [np.flatnonzero(np.isin(one.pulse, number)) for one in (ours, theirs)]
    beams, places, values = (
        [getattr(one, name)[some] for one, some in zip((ours, theirs), rows, strict=True)]
        for name in ("pulse", "index", "value")
    )
    beams = [np.searchsorted(number, beam) for beam in beams]
    many = [np.bincount(beam, minlength=len(number)) for beam in beams]
    errors[many[0] != many[1]] = np.inf
    here, there = (np.flatnonzero(errors[beam] == 0) for beam in beams)
    apart = np.abs(values[0][here].astype(np.float64) - values[1][there])
    apart[(places[0][here] != places[1][there]) | (beams[0][here] != beams[1][there])] = np.inf
    np.maximum.at(errors, beams[0][here], np.maximum(apart - rounding, 0.0))
    return errors


def _between(ours: Cloud, theirs: Cloud) -> np.ndarray:
    """(2, P) metres between places of the same points, infinite where labels differ; and between values."""
    far = np.linalg.norm(ours.position - theirs.position, axis=1)
    far = np.fmax(far, shares(ours.true_range, theirs.true_range, 1.0))
    far = np.fmax(far, shares(ours.returns.distance, theirs.returns.distance, 1.0))
    far = np.fmax(far, _of_labels(ours.returns, theirs.returns))
    for name in ("number", "count", "bounce"):
        far[getattr(ours, name) != getattr(theirs, name)] = np.inf
    off = _apart(ours.returns.cos_incidence, theirs.returns.cos_incidence)
    off = np.fmax(off, _apart(ours.returns.normal, theirs.returns.normal))
    for name in ("intensity", "width"):
        size = np.where(getattr(theirs, name) > 0, getattr(theirs, name), 1.0)
        off = np.fmax(off, shares(getattr(ours, name), getattr(theirs, name), size))
    for name in ("time", "azimuth", "elevation", "scan_angle", "velocity", "rest"):
        if getattr(ours, name) is not None:
            off = np.fmax(off, _apart(getattr(ours, name), getattr(theirs, name)))
    return np.stack([np.where(np.isfinite(ours.position).all(axis=1), far, np.inf), off])


def _lie_on_each_other(
    exact: Scan, number: np.ndarray, beam: np.ndarray, ours: Cloud, theirs: Cloud
) -> np.ndarray:
    """(P,) bool: points, of beams by row of ``number``, that differ as surfaces on each other let them: one
    of these is named, and the light is what one of them sends back."""
    referee, scanner = exact.caster, exact.scanner
    origins, ways = exact.rays(number)
    ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    reach = np.full(len(ways), scanner.max_range)
    ray, hits = referee.exact.through(origins, ways, np.zeros(len(ways)), reach)
    order = np.lexsort((hits.distance, ray))
    ray, hits = ray[order], hits.select(order)
    close = (np.diff(ray) == 0) & (np.diff(hits.distance) <= referee.edge)
    tied = np.flatnonzero(np.append(close, False) | np.append(False, close))
    hits, of_beam = hits.select(tied), ray[tied] // (len(ways) // len(number))
    light = reflectance_of(exact.caster.scene, hits, organs(referee.scene, hits), scanner.surfaces)
    right = np.zeros(len(beam), dtype=bool)
    for row, one in enumerate(beam.tolist()):
        contact = np.flatnonzero(of_beam == one)
        point, there = ours.returns, theirs.returns
        named = (hits.instance[contact] == point.instance[row]) & (
            hits.triangle[contact] == point.triangle[row]
        )
        as_there = (point.instance[row] == there.instance[row]) & (
            point.triangle[row] == there.triangle[row]
        )
        if not len(contact) or not (named.any() or as_there):
            continue
        far, ratio = referee.edge, light[contact].max() / max(light[contact].min(), 1e-300)
        if ratio > 1:  # each ray of the beam may have met a bright one or a dark one
            far += float(np.ptp(hits.distance[contact]))
        ratio *= 1 + 4 * far / max(theirs.true_range[row], far)
        bright = ours.intensity[row] / max(theirs.intensity[row], 1e-300)
        right[row] = (
            np.linalg.norm(ours.position[row] - theirs.position[row]) <= far
            and abs(ours.true_range[row] - theirs.true_range[row]) <= far
            and abs(ours.width[row] - theirs.width[row]) <= far * 2 / LIGHT
            and 1 / ratio <= bright <= ratio
            and ours.number[row] == theirs.number[row]
        )
    return right


def _named(scene: SceneGeometry, returns: Returns) -> Hits:
    """Hits that returns name, misses where those are not there."""
    sizes = np.array([len(mesh.triangles) for mesh in scene.meshes], np.int64)[scene.mesh_index]
    instance, triangle = returns.instance, returns.triangle
    there = (instance >= 0) & (instance < len(sizes)) & (triangle >= 0)
    there[there] = triangle[there] < sizes[instance[there]]
    return Hits(
        np.where(there, returns.distance, np.inf),
        np.where(there, instance, -1),
        np.where(there, triangle, -1),
    )


def _of_labels(one: Returns, other: Returns) -> np.ndarray:
    """(R,) 0, infinite where labels differ."""
    differ = np.zeros(len(one.organ), dtype=bool)
    for name in LABELS:
        differ |= getattr(one, name) != getattr(other, name)
    return np.where(differ, np.inf, 0.0)


def _apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """(R,) largest difference of values (R,) or (R, 3), each as it is."""
    off = shares(one, other, 1.0)
    return off if off.ndim == 1 else off.max(axis=1)


def _rounding(scene: SceneGeometry) -> float:
    """Metres, at the largest coordinate of a scene."""
    shift = np.abs(scene.transform[:, :, 3])
    return float(64 * np.finfo(float).eps * np.nanmax(shift, initial=0.0))
