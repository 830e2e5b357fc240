"""Sweeps of each kind of sensor: settings tried on a part of a scene that is small enough to finish, each
against the exact way; the seconds are those of the whole sensor, scaled up from the part.

Of a LiDAR, pulses or beams, one from each of so many equal stretches, as audits draw them, are sent with each
number of rays and with many, which meet the finest tubes too where trees have tubes; the error is the
difference of the first return's range, metres, root mean square over those that both saw. Rays themselves are
audited in float64.

Of a sonar, a few poses are heard with each tolerance, cull and number of rays that look for leaves in the
way, and by the direct sum over everything in range; the error is that of the spectrum at all ears, L2, as a
share of the exact one.

Of a reverb, a response is computed with each tolerance and audited; the error is the audit's, of the trunks'
sound by the direct sum: the largest of the whole, its octaves and its tenths, as shares. Where the forest
goes on beyond its field, one that goes on twice as far is drawn, and cut off at several distances: what a
nearer end leaves out, L2, as a share. The two errors add up as squares.

What models leave out stands beside them, and is often the larger error: the exact disc for another leaf,
leaves that stand in the way, trunks and leaves that scatter more than once.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from forest_addon.api import Site, World
from forest_addon.base.rng import stream
from forest_addon.blender.rays.casters import make_caster
from forest_addon.blender.sensors.observe import Observer
from forest_addon.growth.tree import Tree, with_tolerance
from forest_addon.sensing.audit import AuditPart, held, one_of_each, share_off
from forest_addon.sensing.detail import COARSE, coarse_species
from forest_addon.sensing.kind import Observation
from forest_addon.sensing.kinds import audited, kind_of
from forest_addon.sensing.lidar.audit import beam_ranges, first_ranges
from forest_addon.sensing.lidar.scan import Scan
from forest_addon.sensing.lidar.tractor import fan, positions
from forest_addon.sensing.rays.caster import RayCaster
from forest_addon.sensing.rays.exact import Referee
from forest_addon.sensing.reverb.audit import OF_OCTAVE
from forest_addon.sensing.reverb.ends import ends_of
from forest_addon.sensing.reverb.kind import response_inputs
from forest_addon.sensing.reverb.model_error import model_error
from forest_addon.sensing.reverb.pair import Pair
from forest_addon.sensing.reverb.response import pairs_of
from forest_addon.sensing.sonar.echo import Echo
from forest_addon.sensing.sonar.equipment_files import equip
from forest_addon.sensing.sonar.rescattering import nearest_leaves, rescattering
from forest_addon.sensing.sonar.station import Station
from forest_addon.sensing.trees_audit import rows_of_meshes
from forest_addon.spec import Rays, Reverb, Scanner, Scene, Settings, Sonar, Tractor

T = TypeVar("T")
NOTABLY = 0.95  # of the error: settings that gain less are not worth their seconds
SOME, ENOUGH = 0.3, 1.0  # s of several runs, and of one, that tell how long it takes


@dataclass(frozen=True)
class Point:
    """Settings that were tried.

    changes : of the sensor, empty for today's. label : in words. error, spread : against the exact way, and
    the standard error of that estimate. seconds : for the whole sensor.
    engine : of rays, where another is tried. elsewhere : what has to be set in place of the scene file, as a
    species' mesh; empty: the sensor, or the engine.
    """

    changes: dict[str, Any]
    label: str
    error: float
    spread: float
    seconds: float
    engine: str = ""
    elsewhere: str = ""


@dataclass(frozen=True)
class AccuracySweep:
    """Sweep of a sensor's settings.

    unit : of the errors. today : the settings of the scene. points : others.
    model : the error of the model itself, which no setting mends, with its words; None where unknown.
    terms : what today's error is made of, by name.
    notes : what else should be said.
    """

    sensor: Settings
    what: str
    unit: str
    today: Point
    points: tuple[Point, ...]
    model: tuple[float, str] | None = None
    notes: tuple[str, ...] = field(default=())
    terms: dict[str, float] = field(default_factory=dict)

    @property
    def all(self) -> tuple[Point, ...]:
        """Today's settings and the others."""
        return (self.today, *self.points)

    def frontier(self) -> list[Point]:
        """Settings of a scene file that none beats in both error and seconds, the fastest first; a slower
        one is notably more exact.
        """
        best: list[Point] = []
        for point in sorted(self.all, key=lambda p: (p.seconds, p.error)):
            least = NOTABLY * best[-1].error if best else math.inf
            if not point.elsewhere and point.error < least:
                best.append(point)
        return best

    def choice(self, error: float, seconds: float) -> Point:
        """The cheapest settings within ``error``; else the most exact of those within ``seconds``."""
        front = self.frontier() or [self.today]
        soon = [point for point in front if point.seconds <= seconds] or front[:1]
        exact = [point for point in soon if point.error + 2 * point.spread <= error]
        return (exact or soon[-1:])[0]

    def dominant(self) -> str:
        """The largest term of today's error and the others, in words; nothing where none is known."""
        terms = self.terms | ({} if self.model is None else {"model": self.model[0]})
        known = sorted(((e, n) for n, e in terms.items() if math.isfinite(e)), reverse=True)
        if not known or known[0][0] == 0:
            return ""
        others = ", ".join(f"{name} {self.told(size)}" for size, name in known[1:])
        first = f"{known[0][1]} dominates, {self.told(known[0][0])}"
        return f"{first} (beside {others})" if others else first

    def told(self, error: float) -> str:
        """An error with its unit."""
        return f"{error:.0e} {self.unit}".rstrip()

    def verdict(self, error: float, seconds: float) -> str:
        """Sentence on what to do about the error."""
        chosen = self.choice(error, seconds)
        advice = _advice(chosen, self.today)
        if self.model is not None and self.model[0] > max(error, self.today.error):
            share, words = self.model
            return (
                f"the model's own error is the larger one, about {self.told(share)} ({words}): "
                f"no setting helps; {advice}"
            )
        if chosen.error > error:
            short = f"{self.told(error)} is not reached within {seconds:g} s"
            return f"{short}; {advice} ({self.told(chosen.error)})"
        return advice


def _advice(chosen: Point, today: Point) -> str:
    if chosen is today:
        return "keep today's settings"
    times = today.seconds / chosen.seconds
    if 1 / 1.2 < times < 1.2:
        return f"take {chosen.label}, about as fast as today's"
    speed = f"{times:.1f} times as fast as" if times >= 1 else f"{1 / times:.1f} times as slow as"
    return f"take {chosen.label}, {speed} today's"


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """Result of some work and its CPU seconds, the least of several runs where it is short."""
    spent: list[float] = []
    while sum(spent) <= (SOME if len(spent) > 1 else ENOUGH):
        begin = time.process_time()
        returned = work()
        spent.append(time.process_time() - begin)
    return returned, min(spent) or sum(spent) / len(spent)  # of a clock that ticks seldom


def mean_and_spread(errors: np.ndarray) -> tuple[float, float]:
    """The root mean square of the errors (N,) that are finite, and its standard error."""
    squares = np.square(errors)[np.isfinite(errors)]
    if not len(squares):
        return math.nan, math.nan
    rms = math.sqrt(float(squares.mean()))
    spread = float(squares.std()) / math.sqrt(max(len(squares) - 1, 1))
    return rms, spread / (2 * rms) if rms else 0.0


SUBRAYS, MANY = (1, 3, 7, 19, 37, 61), 397
SPLITS, FINE = (0, 1, 2, 4), 12
PULSES, EXACTLY = 768, 1500  # that are sent; rays of some of them, in float64
JUMP = 0.1  # m, and more: another surface
TUBES, FINEST = (0.25, 4.0, 16.0), 1 / 16  # times today's tolerance
LEAVES = (1 / 4, 1 / 16)  # of today's
TRIANGLES = 12_000_000  # of all variants; finer ones are not made
ENGINES = {"embree": "Embree", "bvhtree": "BVHTree"}

HEARD = (
    *({"tolerance": t, "cull": t} for t in (1e-2, 1e-3, 1e-4)),
    {"tolerance": 1e-6, "cull": 0.0},
)
POSES = 2
SHADING, MANY_RAYS = (2, 8), 16  # rays along each side of a cell
SCATTERERS = 6e7  # by bins, ears and pings summed directly; beyond, a tolerance of 1e-9 does

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
COARSELY = 1e-3  # tolerance at which forests that end at different distances are compared
FARTHER, FARTHEST = 2.0, 2000.0  # times as far, and metres, that the forest goes on at most
ENDS = (0.25, 0.5, 1.0)  # of today's distance
MANY_TRUNKS = 40_000
NEAREST = 60  # trunks of the comparison with multiple scattering

Look = Callable[
    [np.ndarray], np.ndarray
]  # metres (P,) of pulses by number, inf where nothing is met


class Meshes:
    """Casters of a world whose trees have other meshes.

    Only trees whose wood is all in a skeleton have other meshes: a template's is what it is.

    tolerance : metres that today's tubes may be off by, the finest of all species; 0 where there are none.
    leafy : whether any of these trees bears leaves. finer : whether the finest tubes fit into memory.
    """

    def __init__(self, site: Site, world: World) -> None:
        assert world.forest is not None
        self._site, self._forest, self._scene = site, world.forest, world.observer.geometry
        rows = rows_of_meshes(self._forest, self._scene)
        trees = {mesh: self._forest.variant_of(row) for mesh, row in rows.items()}
        trees = {n: tree for n, tree in trees.items() if not tree.grafted and len(tree.skeleton)}
        self._keys = {mesh: self._forest.keys[rows[mesh]] for mesh in trees}
        known = [self._forest.species[planting] for planting, _ in self._keys.values()]
        self.tolerance = min((species.detail.tolerance for species in known), default=0.0)
        self.leafy = any(len(tree.leaves) for tree in trees.values())
        triangles = sum(len(tree.mesh.triangles) for tree in trees.values())
        self.finer = bool(trees) and triangles / FINEST**0.5 <= TRIANGLES

    def tubes(self, times: float) -> RayCaster:
        """Caster of tubes that may be off by ``times`` as much."""

        def tree(planting: int, variant: int) -> Tree:
            tolerance = times * self._forest.species[planting].detail.tolerance
            return with_tolerance(self._forest.variants[planting, variant], tolerance)

        return self._with(tree)

    def leaves(self, share: float) -> RayCaster:
        """Caster of a share of today's leaves, enlarged to keep their area."""
        plan = self._site.planned()

        def tree(planting: int, variant: int) -> Tree:
            species = self._forest.species[planting]
            if variant >= COARSE:
                species = coarse_species(species) or species
            detail = replace(species.detail, leaves=share * species.detail.leaves)
            return plan.tree(planting, variant % COARSE, species.changed(detail=detail))

        return self._with(tree)

    def _with(self, tree: Callable[[int, int], Tree]) -> RayCaster:
        meshes = list(self._scene.meshes)
        for number, key in self._keys.items():
            meshes[number] = tree(*key).mesh
        return make_caster(replace(self._scene, meshes=tuple(meshes)), self._site.scene.rays)


def sweep_scanner(
    sensor: Scanner, observer: Observer, settings: Scene, meshes: Meshes, folder: Path
) -> AccuracySweep:
    """Errors and seconds of a scanner."""
    way, today = observer.way(sensor, folder), sensor.beam.subrays
    wide = max(sensor.beam.divergence_mrad) > 0 or sensor.beam.exit_diameter > 0

    def changes(subrays: int) -> dict[str, Any]:
        return {"beam": replace(sensor.beam, subrays=subrays)}

    def looks(caster: RayCaster, subrays: int) -> Look:
        one = replace(sensor, **changes(subrays))
        return partial(first_ranges, Scan(one, caster, settings.seed, way))

    return _sweep_beams(
        sensor,
        observer,
        settings,
        meshes,
        "range of the first return",
        looks,
        (Scan(sensor, observer.caster, settings.seed, way).pulses, today),
        (today, MANY if wide else today, SUBRAYS if wide else ()),
        changes,
        lambda n: f"{n} sub-ray{'s' * (n > 1)}",
        [] if wide else ["the beam has no width: one ray is all of it"],
    )


def sweep_tractor(
    sensor: Tractor, observer: Observer, settings: Scene, meshes: Meshes, _folder: Path
) -> AccuracySweep:
    """Errors and seconds of a tractor."""
    beams = len(positions(sensor)) * len(fan(sensor))

    def looks(caster: RayCaster, splits: int) -> Look:
        return partial(beam_ranges, replace(sensor, splits=splits), caster)

    return _sweep_beams(
        sensor,
        observer,
        settings,
        meshes,
        "distance of a beam",
        looks,
        (beams, (sensor.splits + 1) ** 2),
        (sensor.splits, FINE, SPLITS),
        lambda n: {"splits": n},
        lambda n: f"{(n + 1) ** 2} ray{'s' * (n > 0)} a beam",
        [f"{beams:,} beams; Méndez et al.'s beam is a solid sector whose nearest hit counts"],
    )


def _sweep_beams(
    sensor: Scanner | Tractor,
    observer: Observer,
    settings: Scene,
    meshes: Meshes,
    what: str,
    looks: Callable[[RayCaster, int], Look],
    counts: tuple[int, int],
    numbers: tuple[int, int, tuple[int, ...]],
    changes: Callable[[int], dict[str, Any]],
    label: Callable[[int], str],
    notes: list[str],
) -> AccuracySweep:
    """Rays, meshes and engines, each against the finest of all.

    looks : by a caster and a number of rays. counts : of pulses, and of rays of each today. numbers : of rays
    today, as many as are as good as all, and others. changes, label : of a number.
    """
    (pulses, rays), (now, fine, tried), caster = counts, numbers, observer.caster
    rng = stream(settings.seed, "accuracy", sensor.name)
    number = one_of_each(pulses, PULSES, rng)

    def look(caster: RayCaster, rays: int) -> tuple[np.ndarray, float]:
        ranges = looks(caster, rays)
        ranges(number[:1])  # build trees of boxes
        found, seconds = timed(lambda: ranges(number))
        return np.where(np.isfinite(found), found, np.nan), seconds / len(number) * pulses

    def off(number: np.ndarray) -> np.ndarray:
        ours, right = (
            np.minimum(looks(one, now)(number), sensor.max_range)
            for one in (caster, Referee(caster))
        )
        return np.abs(ours - right)

    few, kinds = math.ceil(EXACTLY / rays), (("pulses in float64", 0.0, "m"),)
    exact = held([AuditPart(pulses, off, kinds, few, exact=True)], rng, 0.0)
    numerics = exact.worst.rms
    many, _ = look(caster, fine)
    tubes = meshes.tubes(FINEST) if meshes.finer else None
    truth = many if tubes is None else look(tubes, fine)[0]

    def point(
        changed: dict[str, Any], words: str, seen: tuple[np.ndarray, float], **given: str
    ) -> Point:
        error, spread = mean_and_spread(seen[0] - truth)
        return Point(changed, words, math.hypot(error, numerics), spread, seen[1], **given)

    seen, seconds = look(caster, now)
    today = point({}, label(now), (seen, seconds))
    others = [point(changes(n), label(n), look(caster, n)) for n in tried if n != now]
    for name, title in ENGINES.items():
        if name != caster.engine:
            try:
                engine = make_caster(observer.geometry, Rays(engine=name))
            except ValueError:
                continue
            others.append(point({}, f"rays by {title}", look(engine, now), engine=name))
    off_by, words = mean_and_spread(seen - truth), "float64 brute force"
    others.append(Point({}, words, *off_by, exact.exact_seconds, elsewhere="as audits do"))
    terms = {"sampling": mean_and_spread(seen - many)[0], "numerics": numerics}
    if tubes is not None:
        terms["mesh"] = mean_and_spread(many - truth)[0]
        for times in TUBES:
            words = f"tubes within {1000 * times * meshes.tolerance:.2g} mm"
            found = look(meshes.tubes(times), now)
            others.append(point({}, words, found, elsewhere="the species' detail.tolerance"))
        for share in LEAVES if meshes.leafy else ():
            words = f"{share:.2g} of the leaves, enlarged"
            found = look(meshes.leaves(share), now)
            others.append(point({}, words, found, elsewhere="the species' detail.leaves"))
    if tubes is not None or fine != now:
        notes.append(_jumps(seen - truth))
    lost = np.isfinite(truth) & ~np.isfinite(seen)
    if lost.any():
        notes.append(f"{lost.mean():.1%} return only with the finest of all that was tried")
    if meshes.tolerance and tubes is None:
        notes.append("finer tubes would not fit into memory: the mesh's part is not known")
    if not meshes.tolerance:
        notes.append("trees are their templates' own meshes: nothing of them can be set")
    return AccuracySweep(sensor, what, "m", today, tuple(others), notes=tuple(notes), terms=terms)


def _jumps(apart: np.ndarray) -> str:
    """Sentence on the few that meet another surface and make nearly all of the error."""
    apart = np.abs(apart[np.isfinite(apart)])
    if not len(apart):
        return "nothing is met"
    other = apart > JUMP
    rest = float(np.median(apart[~other])) if (~other).any() else 0.0
    return (
        f"today {other.mean():.1%} meet another surface than the whole beam does; "
        f"half of the others are within {rest:.0e} m"
    )


def sweep_sonar(
    sensor: Sonar, observer: Observer, settings: Scene, _meshes: Meshes, folder: Path
) -> AccuracySweep:
    """Errors and seconds of a sonar by tolerance, cull and shading rays."""
    way, pings = observer.way(sensor, folder), 1
    if way is not None:
        pings = len(way)
        way = way.take(np.unique(np.linspace(0, pings - 1, POSES).astype(int)))

    @cache
    def listen(one: Sonar) -> tuple[tuple[Echo, ...], float]:
        result, seconds = timed(lambda: observer.observe(one, settings, None, folder, way))
        echoes = getattr(result, "echoes", (result,))
        return echoes, seconds / len(echoes) * pings

    def off(one: Sonar, other: Sonar) -> tuple[float, float]:
        pairs = zip(listen(one)[0], listen(other)[0], strict=True)
        return mean_and_spread(np.array([share_off(e.spectra, x.spectra) for e, x in pairs]))

    # a record without what is culled would be shorter, its bins others; the spectrum knows no Doppler
    plain = replace(sensor, doppler=False)
    coarse, _ = listen(replace(plain, cull=0.0, tolerance=1e-2))
    heard = sum(len(echo.heard) for echo in coarse) / len(coarse)
    if not sensor.record:
        longest = max(len(echo.time) for echo in coarse)
        plain = replace(plain, record=min(longest / sensor.sample_rate, 60.0))
    shaded = "extinction" in sensor.shading
    direct = heard * sum(echo.spectra.size for echo in coarse) <= SCATTERERS
    alike = replace(plain, cull=0.0, tolerance=0.0 if direct else 1e-9)
    exact = replace(alike, shading_rays=MANY_RAYS) if shaded else alike
    note = (
        "the direct sum over everything in range"
        if direct
        else "everything in range, tolerance 1e-9"
    )
    if shaded:
        note += f", {MANY_RAYS}² rays a cell for leaves in the way"

    def point(changes: dict[str, Any], label: str) -> Point:
        one = replace(plain, **changes)
        return Point(changes, label, *off(one, exact), listen(one)[1])

    today = point({}, f"tolerance {sensor.tolerance:g}, cull {sensor.cull:g}")
    points = [point(c, f"tolerance {c['tolerance']:g}, cull {c['cull']:g}") for c in HEARD]
    terms, models = {"numerics": off(replace(plain, cull=0.0), alike)[0]}, []
    if shaded:
        points += [point({"shading_rays": n}, f"{n}² shading rays a cell") for n in SHADING]
        terms["shading rays"] = off(alike, exact)[0]
    rest = off(plain, alike)[0] ** 2 - terms["numerics"] ** 2
    terms["culling"] = math.sqrt(max(rest, 0.0))
    if sensor.leaves and sensor.leaf_model != "exact":
        words = f'the "{sensor.leaf_model}" leaf against the exact disc'
        models.append((off(plain, replace(plain, leaf_model="exact"))[0], words))
    if sensor.leaves and not shaded:
        other = f"{'trunks+' * ('trunks' in sensor.shading)}extinction"
        without = off(plain, replace(plain, shading=other))[0]
        models.append((without, "leaves hide nothing behind them"))
    notes = [f"exact: {note}", f"{heard:,.0f} scatterers in range of a ping"]
    leaves = nearest_leaves(coarse[0].groups)
    if leaves is not None:
        station = Station(sensor, settings.air, coarse[0].pose, equip(sensor, folder))
        solved = rescattering(leaves, station)
        words = f"echoes between the {len(leaves)} leaves nearest to the beam's axis are left out"
        models.append((solved.relative, words))
        notes.append(
            f"{words}: they change the spectrum by {solved.relative:.0%}, its energy by "
            f"{solved.level_db:+.1f} dB and the mean delay by {1e3 * solved.later:+.3f} ms"
        )
    model = max(models, default=None)
    what = "spectrum of the echo"
    return AccuracySweep(sensor, what, "", today, tuple(points), model, tuple(notes), terms)


def sweep_reverb(
    sensor: Reverb, observer: Observer, settings: Scene, _meshes: Meshes, folder: Path
) -> AccuracySweep:
    """Errors and seconds of a reverb by its tolerance, and by where the forest ends."""
    pairs = ends_of(sensor, observer.places, folder).pairs
    source, receiver = (tuple(end.tolist()) for end in pairs[0])
    one = replace(
        sensor,
        source=source,
        receiver=receiver,
        sources=(),
        receivers=(),
        source_objects="",
        receiver_objects="",
        array=1,
        rescattering=0,
    )
    job = Observation(one, observer, settings, folder)
    checked = settings.changed(accuracy=settings.accuracy.changed(audit=1.0))
    pair = pairs_of(**response_inputs(job))[0]
    ended, farthest = _ended_sooner(pair, job)
    cut = ended[one.continue_to][0] if ended else 0.0
    looked: dict[str, float] = {}

    def point(tolerance: float) -> Point:
        asked = replace(one, tolerance=tolerance)
        job = observer.job(asked, checked, folder)
        found, seconds = timed(lambda: kind_of(asked).run(job, None))
        audit = audited(job, found, seconds)
        checks = audit.checks if audit else ()
        looked.update({check.what: check.error for check in checks if check.unit == OF_OCTAVE})
        error = math.hypot(max(looked.values(), default=0.0), cut)
        changes = {"tolerance": tolerance}
        return Point(changes, f"tolerance {tolerance:g}", error, 0.0, seconds * len(pairs))

    others = [point(tolerance) for tolerance in TOLERANCES if tolerance != sensor.tolerance]
    now = point(sensor.tolerance)
    terms = {"numerics": math.sqrt(max(now.error**2 - cut**2, 0.0))}
    notes = [f"exact: {'; '.join(looked)}, in a record of {pair.reverb.duration:.2f} s"]
    if ended:
        terms["extent"] = cut
        notes.append(
            f"extent: against a forest drawn as far as {farthest:g} m: at least so much; of one "
            "drawing that is cut, and another continue_to draws other trunks beyond the field, "
            "whose sound differs by more"
        )
        slower = now.seconds / ended.pop(one.continue_to)[1]
        for metres, (left, seconds) in ended.items():
            error, label = math.hypot(terms["numerics"], left), f"forest as far as {metres:g} m"
            others.append(Point({"continue_to": metres}, label, error, 0.0, seconds * slower))
    solved = model_error(pair.forest, pair.source, pair.receiver, NEAREST, settings.air)
    words = f"single against multiple scattering by {len(solved.trunks)} trunks"
    model = (solved.relative, words) if len(solved.trunks) else None
    what = "sound of the trunks"
    return AccuracySweep(sensor, what, "", now, tuple(others), model, tuple(notes), terms)


def _ended_sooner(pair: Pair, job: Observation) -> tuple[dict[float, tuple[float, float]], float]:
    """Errors and CPU seconds of a pair in forests that end after so many metres, and where the farthest ends,
    against which they are; none where the forest does not go on."""
    one, area = job.sensor, float(np.prod(job.settings.forest.size))
    soon = math.sqrt(MANY_TRUNKS * area / (math.pi * max(len(pair.trunks), 1)))
    farthest = min(FARTHER * one.continue_to, FARTHEST, max(soon, 1.2 * one.continue_to))
    if farthest <= one.continue_to:
        return {}, farthest
    coarse = max(one.tolerance, COARSELY)
    far = replace(one, continue_to=farthest, duration=pair.reverb.duration, tolerance=coarse)
    whole = pairs_of(**response_inputs(replace(job, sensor=far)))[0]
    middle = (pair.source + pair.receiver)[:2] / 2
    away = np.hypot(*(whole.beyond.position - middle).T)

    def sound(metres: float) -> tuple[np.ndarray, float]:
        some = replace(whole, beyond=whole.beyond.select(away <= metres))
        response, seconds = timed(lambda: some.response(job.seen.expansions, None, None))
        return response.trees, seconds

    truth, _ = sound(farthest)
    found = {}
    for metres in sorted(share * one.continue_to for share in ENDS):
        heard, seconds = sound(metres)
        found[metres] = share_off(heard, truth), seconds
    return found, farthest


SWEEPS: dict[str, Callable[[Any, Observer, Scene, Meshes, Path], AccuracySweep]] = {
    "tractor": sweep_tractor,
    "terrestrial": sweep_scanner,
    "mobile": sweep_scanner,
    "airborne": sweep_scanner,
    "sonar": sweep_sonar,
    "reverb": sweep_reverb,
}
