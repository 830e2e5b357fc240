"""Sweeps of each kind of sensor: settings tried on a part of a scene that is small enough to finish, each
against the exact way; the seconds are those of the whole sensor, scaled up from the part.

Of a LiDAR, blocks of pulses, drawn evenly over the scan, are sent with each number of rays and with many,
which meet the finest tubes too where trees have tubes; the error is the difference of the first return's
range, metres, root mean square over pulses that both saw. The tractor's beams are swept likewise, by the
splits of its sector. Rays themselves are audited in float64.

Of a sonar, a few poses are heard with each tolerance, cull and number of rays that look for leaves in the
way, and by the direct sum over everything in range; the error is that of the spectrum at all ears, L2, as a
share of the exact one.

Of a reverb, the first part of the record is computed with each tolerance and exactly, as long as the direct
sum can be waited for; the error is that of the trunks' sound, L2, as a share. Where the forest goes on
beyond its field, one that goes on twice as far is drawn, and cut off at several distances: what a nearer
end leaves out. The two errors add up as squares.

What models leave out stands beside them, and is often the larger error: the exact disc for another leaf,
leaves that stand in the way, trunks and leaves that scatter more than once.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from forest_addon.api import Site, World
from forest_addon.base.rng import stream
from forest_addon.blender.rays.casters import make_caster
from forest_addon.blender.sensors.observe import Observer
from forest_addon.growth.tree import Tree, with_tolerance
from forest_addon.sensing.audit import AuditPart, held
from forest_addon.sensing.detail import COARSE, coarse_species
from forest_addon.sensing.lidar.audit import ray_errors
from forest_addon.sensing.lidar.scan import Scan
from forest_addon.sensing.lidar.tractor import beam_rays, drive, fan, positions
from forest_addon.sensing.rays.caster import RayCaster
from forest_addon.sensing.reverb.ends import ends_of
from forest_addon.sensing.reverb.forest.surroundings import canopy_of
from forest_addon.sensing.reverb.kind import trunks_between
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.trunks import continue_trunks
from forest_addon.sensing.sonar.echo import Echo
from forest_addon.sensing.sonar.equipment_files import equip
from forest_addon.sensing.sonar.rescattering import nearest_leaves, rescattering
from forest_addon.sensing.sonar.station import Station
from forest_addon.sensing.trajectory import looking
from forest_addon.spec import Rays, Reverb, Scanner, Scene, Settings, Sonar, Tractor

T = TypeVar("T")
NOTABLY = 0.95  # of the error: settings that gain less are not worth their seconds
SOME, ENOUGH = 0.3, 1.0  # s of several runs, and of one, that tell how long it takes
TICK = 1e-9  # s, where a clock that ticks seldom tells none


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
            if point.elsewhere:
                continue
            if math.isfinite(point.error) and (not best or point.error < NOTABLY * best[-1].error):
                best.append(point)
        return best

    def choice(self, error: float, seconds: float) -> Point:
        """The cheapest settings within ``error``; else the most exact of those within ``seconds``."""
        front = self.frontier()
        if not front:
            return self.today
        exact = [point for point in front if point.error + 2 * point.spread <= error]
        soon = [point for point in front if point.seconds <= seconds]
        if exact and exact[0].seconds <= seconds:
            return exact[0]
        return soon[-1] if soon else front[0]

    def dominant(self) -> str:
        """The largest term of today's error and the others, in words; nothing where none is known."""
        terms = self.terms | ({} if self.model is None else {"model": self.model[0]})
        known = sorted(((e, n) for n, e in terms.items() if math.isfinite(e)), reverse=True)
        if not known or known[0][0] == 0:
            return ""
        unit = f" {self.unit}" if self.unit else ""
        others = ", ".join(f"{name} {size:.0e}{unit}" for size, name in known[1:])
        first = f"{known[0][1]} dominates, {known[0][0]:.0e}{unit}"
        return f"{first} (beside {others})" if others else first

    def verdict(self, error: float, seconds: float) -> str:
        """Sentence on what to do about the error."""
        chosen = self.choice(error, seconds)
        unit = f" {self.unit}" if self.unit else ""
        if self.model is not None and self.model[0] > max(error, self.today.error):
            share, words = self.model
            return (
                f"the model's own error is the larger one, about {share:.0e}{unit} ({words}): "
                f"no setting helps; {_advice(chosen, self.today)}"
            )
        if chosen.error > error:
            short = f"{error:.0e}{unit} is not reached within {seconds:g} s"
            return f"{short}; {_advice(chosen, self.today)} ({chosen.error:.0e}{unit})"
        return _advice(chosen, self.today)


def _advice(chosen: Point, today: Point) -> str:
    if chosen is today:
        return "keep today's settings"
    times = today.seconds / chosen.seconds if chosen.seconds else math.inf
    if 1 / 1.2 < times < 1.2:
        return f"take {chosen.label}, about as fast as today's"
    speed = f"{times:.1f} times as fast as" if times >= 1 else f"{1 / times:.1f} times as slow as"
    return f"take {chosen.label}, {speed} today's"


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """Result of some work and its CPU seconds, the least of several runs where it is short."""
    spent: list[float] = []
    while True:
        begin = time.process_time()
        returned = work()
        spent.append(time.process_time() - begin)
        if sum(spent) > ENOUGH or (len(spent) > 1 and sum(spent) > SOME):
            return returned, min(spent) or sum(spent) / len(spent)  # of a clock that ticks seldom


def mean_and_spread(values: Sequence[float]) -> tuple[float, float]:
    """The root mean square of errors and its standard error."""
    squares = np.asarray(values, dtype=np.float64) ** 2
    if not len(squares):
        return math.nan, math.nan
    rms = math.sqrt(float(squares.mean()))
    if len(squares) < 2 or rms == 0:
        return rms, 0.0
    return rms, float(squares.std(ddof=1) / math.sqrt(len(squares)) / (2 * rms))


SUBRAYS, MANY = (1, 3, 7, 19, 37, 61), 397
SPLITS, FINE = (0, 1, 2, 4), 12
BLOCKS, BLOCK = 24, 32  # pulses
LINES = 6  # scans of a tractor
JUMP = 0.1  # m, and more: another surface
TUBES, FINEST = (0.25, 4.0, 16.0), 1 / 16  # times today's tolerance
LEAVES = (1 / 4, 1 / 16)  # of today's
EXACTLY = 1500  # rays in float64
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
TRUNKS = 5e7  # by samples that are summed directly
FARTHER, FARTHEST = 2.0, 2000.0  # times as far, and metres, that the forest goes on at most
ENDS = (0.25, 0.5)  # of today's distance
MANY_TRUNKS = 40_000
NEAREST = 60  # trunks of the comparison with multiple scattering
SHORTEST = 0.05  # s

Look = Callable[[RayCaster, int], tuple[np.ndarray, float]]  # ranges, seconds of the whole sensor


@dataclass
class Meshes:
    """Casters of a world whose trees have other meshes, each made once; ``site`` is what it grew from.

    Only trees whose wood is all in a skeleton have other meshes: a template's is what it is.
    """

    site: Site
    world: World
    _casters: dict[object, RayCaster] = field(default_factory=dict)

    @cached_property
    def of_mesh(self) -> dict[int, tuple[int, int]]:
        """The variant that each mesh of the scene is, of trees that grew from skeletons alone."""
        forest, scene = self.world.forest, self.world.observer.geometry
        if forest is None:
            return {}
        rows = {int(tree): row for row, tree in enumerate(forest.stand.id)}
        variant_of = {}
        for instance in np.flatnonzero(scene.tree >= 0).tolist():
            row = rows.get(int(scene.tree[instance]))
            if row is not None:
                key = int(forest.stand.species[row]), int(forest.stand.variant[row])
                if not forest.variants[key].grafted and len(forest.variants[key].skeleton):
                    variant_of[int(scene.mesh_index[instance])] = key
        return variant_of

    @property
    def tolerance(self) -> float:
        """Metres that today's tubes may be off by, the finest of all species; 0 where there are none."""
        known = [self._grown.species[key[0]].detail.tolerance for key in self.of_mesh.values()]
        return min(known, default=0.0)

    @property
    def leafy(self) -> bool:
        """Return whether any of these trees bears leaves."""
        return any(len(self._grown.variants[key].leaves) for key in self.of_mesh.values())

    @property
    def _grown(self) -> Any:
        return self.world.forest

    def tubes(self, times: float) -> RayCaster | None:
        """Caster of tubes that may be off by ``times`` as much; None where that is too much for memory."""
        grown, keys = self._grown, self.of_mesh.values()
        many = sum(len(grown.variants[key].mesh.triangles) for key in keys)
        if many / min(times, 1.0) ** 0.5 > TRIANGLES:
            return None

        def tree(key: tuple[int, int]) -> Tree:
            finest = times * grown.species[key[0]].detail.tolerance
            return with_tolerance(grown.variants[key], finest)

        return self._kept(("tubes", times), tree)

    def leaves(self, share: float) -> RayCaster:
        """Caster of a share of today's leaves, enlarged to keep their area."""
        plan = self.site.planned()

        def tree(key: tuple[int, int]) -> Tree:
            planting, variant = key
            species = self.site.species[planting][0]
            if variant >= COARSE:
                species = coarse_species(species) or species
            detail = replace(species.detail, leaves=share * species.detail.leaves)
            return plan.tree(planting, variant % COARSE, species.changed(detail=detail))

        return self._kept(("leaves", share), tree)

    def engine(self, name: str) -> RayCaster | None:
        """Caster of the scene by another engine; None where that cannot be used, or is today's."""
        if self.world.observer.caster.engine == name:
            return None
        if name not in self._casters:
            try:
                made = make_caster(self.world.observer.geometry, Rays(engine=name))
            except ValueError:
                return None
            self._casters[name] = made
        return self._casters[name]

    def _kept(self, key: object, tree: Callable[[tuple[int, int]], Tree]) -> RayCaster:
        if key not in self._casters:
            scene = self.world.observer.geometry
            other = {number: tree(variant).mesh for number, variant in self.of_mesh.items()}
            meshes = tuple(other.get(number, mesh) for number, mesh in enumerate(scene.meshes))
            self._casters[key] = make_caster(replace(scene, meshes=meshes), self.site.scene.rays)
        return self._casters[key]


def sweep_scanner(
    sensor: Scanner, observer: Observer, settings: Scene, meshes: Meshes, folder: Path
) -> AccuracySweep:
    """Errors and seconds of a scanner."""
    way = observer.way(sensor, folder)
    wide = max(sensor.beam.divergence_mrad) > 0 or sensor.beam.exit_diameter > 0
    today = sensor.beam.subrays
    whole = Scan(sensor, observer.caster, settings.seed, way)
    rng = stream(settings.seed, "accuracy", sensor.name)
    starts = np.sort(rng.integers(0, max(whole.pulses - BLOCK, 1), BLOCKS)).tolist()

    def look(caster: RayCaster, subrays: int) -> tuple[np.ndarray, float]:
        beam = replace(sensor.beam, subrays=subrays)
        scan = Scan(replace(sensor, beam=beam), caster, settings.seed, way)
        scan.look(starts[0], min(starts[0] + BLOCK, scan.pulses))  # build trees of boxes
        begin = time.process_time()
        ranges = np.concatenate([_first_ranges(scan, start) for start in starts])
        spent = max(time.process_time() - begin, TICK)
        return ranges, spent * scan.pulses / len(ranges)

    def rays(number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        pulse, subray = np.divmod(number, today)
        one = np.arange(len(number)) * today + subray
        origins, ways = whole.rays(pulse)
        return origins[one], ways[one]

    return _sweep_beams(
        sensor,
        observer,
        meshes,
        rng,
        "range of the first return",
        look,
        (today, MANY if wide else today, SUBRAYS if wide else ()),
        lambda n: {"beam": replace(sensor.beam, subrays=n)},
        lambda n: f"{n} sub-ray{'s' * (n > 1)}",
        (rays, whole.pulses * today),
        [] if wide else ["the beam has no width: one ray is all of it"],
    )


def sweep_tractor(
    sensor: Tractor, observer: Observer, settings: Scene, meshes: Meshes, _folder: Path
) -> AccuracySweep:
    """Errors and seconds of a tractor."""
    along, angles = positions(sensor), len(fan(sensor))
    rng = stream(settings.seed, "accuracy", sensor.name)
    chosen = along[np.sort(rng.integers(0, len(along), min(LINES, len(along))))]
    heading = np.deg2rad(sensor.heading_deg)
    forward = np.array([np.cos(heading), np.sin(heading), 0.0])

    def look(caster: RayCaster, splits: int) -> tuple[np.ndarray, float]:
        ranges, spent = [], 0.0
        for metres in (chosen[0], *chosen):  # the first twice: trees of boxes are built
            place = tuple((np.array(sensor.position) + metres * forward).tolist())
            one = replace(sensor, position=place, track=sensor.step / 2, splits=splits)
            begin = time.process_time()
            ranges.append(drive(one, caster).distance.ravel())
            spent += max(time.process_time() - begin, TICK) * (len(ranges) > 1)
        distance = np.concatenate(ranges[1:])
        distance = np.where(np.isfinite(distance), distance, np.nan)
        return distance, spent * len(along) / len(chosen)

    each = (sensor.splits + 1) ** 2

    def rays(number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        beam, ray = np.divmod(number, each)
        one = np.arange(len(number)) * each + ray
        origins, ways = beam_rays(sensor, *np.divmod(beam, angles))
        return origins[one], ways[one]

    beams = len(along) * angles
    return _sweep_beams(
        sensor,
        observer,
        meshes,
        rng,
        "distance of a beam",
        look,
        (sensor.splits, FINE, SPLITS),
        lambda n: {"splits": n},
        lambda n: f"{(n + 1) ** 2} ray{'s' * (n > 0)} a beam",
        (rays, beams * each),
        [f"{beams:,} beams; Méndez et al.'s beam is a solid sector whose nearest hit counts"],
    )


def _sweep_beams(
    sensor: Scanner | Tractor,
    observer: Observer,
    meshes: Meshes,
    rng: np.random.Generator,
    what: str,
    look: Look,
    numbers: tuple[int, int, tuple[int, ...]],
    changes: Callable[[int], dict[str, Any]],
    label: Callable[[int], str],
    rays: tuple[Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], int],
    notes: list[str],
) -> AccuracySweep:
    """Rays, meshes and engines, each against the finest of all.

    look : ranges (P,) of the same beams by a caster and a number of rays, NaN where there is none, and
    seconds. numbers : of rays today, as many as are as good as all, and others. changes, label : of a number.
    rays : origins and directions of rays by number, and how many the whole sensor has.
    """
    now, fine, tried = numbers
    caster = observer.caster
    tubes = meshes.tubes(FINEST) if meshes.tolerance else None
    many, _ = look(caster, fine)
    truth = many if tubes is None else look(tubes, fine)[0]

    def exactly(engine: RayCaster) -> tuple[float, float]:
        """Metres (rms) that an engine is off, and seconds of the whole sensor in float64."""

        def errors(number: np.ndarray) -> np.ndarray:
            return ray_errors(engine, *rays[0](number), sensor.max_range)

        audit = held(
            [AuditPart(rays[1], errors, (("rays", 0.0, "m"),), EXACTLY, exact=True)], rng, 0.0
        )
        return audit.worst.rms, audit.exact_seconds

    numerics, slowly = exactly(caster)

    def point(
        seen: tuple[np.ndarray, float], label: str, off: float = numerics, **given: Any
    ) -> Point:
        error, spread = _rms(seen[0] - truth)
        return Point(
            given.pop("changes", {}), label, math.hypot(error, off), spread, seen[1], **given
        )

    seen, seconds = look(caster, now)
    today = point((seen, seconds), label(now))
    others = [
        point(look(caster, number), label(number), changes=changes(number))
        for number in tried
        if number != now
    ]
    for name, title in ENGINES.items():
        engine = meshes.engine(name)
        if engine is not None:
            others.append(
                point(look(engine, now), f"rays by {title}", exactly(engine)[0], engine=name)
            )
    others.append(point((seen, slowly), "float64 brute force", 0.0, elsewhere="as audits do"))
    terms = {"sampling": _rms(seen - many)[0], "numerics": numerics}
    if tubes is not None:
        terms["mesh"] = _rms(many - truth)[0]
        for times in TUBES:
            other = meshes.tubes(times)
            if other is not None:
                words = f"tubes within {1000 * times * meshes.tolerance:.2g} mm"
                at = "the species' detail.tolerance"
                others.append(point(look(other, now), words, elsewhere=at))
        for share in LEAVES if meshes.leafy else ():
            words = f"{share:.2g} of the leaves, enlarged"
            found = look(meshes.leaves(share), now)
            others.append(point(found, words, elsewhere="the species' detail.leaves"))
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


def _rms(apart: np.ndarray) -> tuple[float, float]:
    return mean_and_spread(apart[np.isfinite(apart)])


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


def _first_ranges(scan: Scan, start: int) -> np.ndarray:
    """(BLOCK,) metres of the first returns, NaN where there is none."""
    stop = min(start + BLOCK, scan.pulses)
    cloud = scan.look(start, stop)
    ranges = np.full(stop - start, np.nan)
    first = cloud.number == 1
    ranges[cloud.pulse[first] - start] = cloud.true_range[first]
    return ranges


def sweep_sonar(
    sensor: Sonar, observer: Observer, settings: Scene, _meshes: Meshes, folder: Path
) -> AccuracySweep:
    """Errors and seconds of a sonar by tolerance, cull and shading rays."""
    given = observer.way(sensor, folder)
    if given is None:
        turn, rise = np.radians([[sensor.azimuth_deg], [sensor.elevation_deg]])
        given = looking(np.array([sensor.position], float), turn, rise, speed=sensor.speed)
    some = given.take(np.unique(np.linspace(0, len(given) - 1, POSES).astype(int)))
    # a record without what is culled would be shorter, its bins others; the spectrum knows no Doppler
    fixed: dict[str, object] = {"doppler": False}
    known: dict[Sonar, tuple[list[Echo], float]] = {}

    def listen(changes: dict[str, object]) -> tuple[list[Echo], float]:
        one = replace(sensor, **changes, **fixed)
        if one not in known:
            result, seconds = timed(lambda: observer.observe(one, settings, None, folder, some))
            known[one] = list(result.echoes), seconds * len(given) / len(some)
        return known[one]

    shaded = "extinction" in sensor.shading
    exact: dict[str, object] = {"cull": 0.0, "tolerance": 1e-9}
    exact |= {"shading_rays": MANY_RAYS} if shaded else {}
    # coarse: it counts, finds the record, and makes what is made once
    coarse, _ = listen({"cull": 0.0, "tolerance": 1e-2})
    heard = sum(len(echo.heard) for echo in coarse) / len(some)
    if not sensor.record:
        longest = max(len(echo.time) for echo in coarse)
        fixed["record"] = min(longest / sensor.sample_rate, 60.0)
    note = "exact: everything in range, tolerance 1e-9"
    if heard * sum(echo.spectra.size for echo in coarse) <= SCATTERERS:
        exact["tolerance"] = 0.0
        note = "exact: the direct sum over everything in range"
    everything, _ = listen(exact)
    if shaded:
        note += f", {MANY_RAYS}² rays a cell for leaves in the way"

    def off(echoes: list[Echo], truth: list[Echo]) -> tuple[float, float]:
        pairs = zip(echoes, truth, strict=True)
        return mean_and_spread([_share(e.spectra, x.spectra) for e, x in pairs])

    def point(changes: dict[str, object], label: str) -> Point:
        echoes, seconds = listen(changes)
        return Point(changes, label, *off(echoes, everything), seconds)

    today = point({}, f"tolerance {sensor.tolerance:g}, cull {sensor.cull:g}")
    points = [point(c, f"tolerance {c['tolerance']:g}, cull {c['cull']:g}") for c in HEARD]
    ours, alike, terms = listen({})[0], everything, {}
    if shaded:
        points += [point({"shading_rays": n}, f"{n}² shading rays a cell") for n in SHADING]
        alike, _ = listen(exact | {"shading_rays": sensor.shading_rays})
        terms["shading rays"] = off(alike, everything)[0]
    terms["numerics"] = off(listen({"cull": 0.0})[0], alike)[0]
    rest = off(ours, alike)[0] ** 2 - terms["numerics"] ** 2
    terms["culling"] = math.sqrt(max(rest, 0.0))
    models = []
    if sensor.leaves and sensor.leaf_model != "exact":
        words = f'the "{sensor.leaf_model}" leaf against the exact disc'
        models.append((off(ours, listen({"leaf_model": "exact"})[0])[0], words))
    if sensor.leaves and not shaded:
        other = f"{'trunks+' * ('trunks' in sensor.shading)}extinction"
        without = off(ours, listen({"shading": other})[0])[0]
        models.append((without, "leaves hide nothing behind them"))
    notes = [note, f"{heard:,.0f} scatterers in range of a ping"]
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


def _share(found: np.ndarray, exact: np.ndarray) -> float:
    """L2 norm of a difference, as a share of the exact; 0 of silence."""
    whole = float(np.linalg.norm(exact))
    return float(np.linalg.norm(found - exact)) / whole if whole > 0 else 0.0


def sweep_reverb(
    sensor: Reverb, observer: Observer, settings: Scene, _meshes: Meshes, folder: Path
) -> AccuracySweep:
    """Errors and seconds of a reverb by its tolerance, and by where the forest ends."""
    pairs = ends_of(sensor, observer.places).pairs
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

    def hear(**changes: object) -> tuple[Any, float]:
        changed = replace(one, **changes)
        return timed(lambda: observer.observe(changed, settings, None, folder))

    today, _ = hear()
    rate, length = sensor.sample_rate, len(today.samples) / sensor.sample_rate
    part = length
    # trunks within a time grow with its square
    while part > SHORTEST and today.trunks * (part / length) ** 2 * part * rate > TRUNKS:
        part /= 2
    exact, _ = hear(tolerance=0.0, duration=part)
    ended, farthest = _ended_sooner(one, observer, settings, length)
    cut = ended[one.continue_to][0] if ended else 0.0

    def point(tolerance: float) -> Point:
        result, seconds = hear(tolerance=tolerance)
        if part < length:
            some = replace(one, tolerance=tolerance, duration=part)
            result = observer.observe(some, settings, None, folder)
        count = min(len(result.trees), len(exact.trees))
        error = math.hypot(_share(result.trees[:count], exact.trees[:count]), cut)
        changes = {"tolerance": tolerance}
        return Point(changes, f"tolerance {tolerance:g}", error, 0.0, seconds * len(pairs))

    near = hear(rescattering=NEAREST, duration=part)[0].model_error
    model = None
    if near is not None and len(near.trunks):
        model = (near.relative, f"single against multiple scattering by {len(near.trunks)} trunks")
    notes = [f"exact: the direct sum over the first {part:.2f} s of {length:.2f} s"]
    others = [point(tolerance) for tolerance in TOLERANCES if tolerance != sensor.tolerance]
    now = point(sensor.tolerance)
    terms = {"numerics": math.sqrt(max(now.error**2 - cut**2, 0.0))}
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
    what = "sound of the trunks"
    return AccuracySweep(sensor, what, "", now, tuple(others), model, tuple(notes), terms)


def _ended_sooner(
    one: Reverb, observer: Observer, settings: Scene, length: float
) -> tuple[dict[float, tuple[float, float]], float]:
    """Errors and CPU seconds of a pair in forests that end after so many metres, and where the farthest ends,
    against which they are; none where the forest does not go on."""
    ends = ends_of(one, observer.places)
    trunks = trunks_between(observer, one, settings, ends)(*ends.pairs[0])
    field = (settings.forest.origin, settings.forest.size)
    area = float(np.prod(settings.forest.size))
    soon = math.sqrt(MANY_TRUNKS * area / (math.pi * len(trunks))) if len(trunks) else FARTHEST
    farthest = min(FARTHER * one.continue_to, FARTHEST, max(soon, 1.2 * one.continue_to))
    if not one.continue_to or farthest <= one.continue_to:
        return {}, farthest
    rng = stream(settings.seed, "accuracy", one.name, "continuation")
    centre = ends.on_ground.mean(axis=0)
    beyond = continue_trunks(trunks, field, centre, farthest, rng, clear=ends.on_ground)
    away = np.hypot(*(beyond.position - centre).T)
    coarse = max(one.tolerance, COARSELY)
    alone = replace(one, continue_to=0.0, duration=length, tolerance=coarse)
    around = {"expansions": observer.expansions, "field": field}
    if one.model == "forest":
        heights = float(one.source[2]), float(one.receiver[2])
        around["canopy"] = canopy_of(observer.geometry, heights, area, trunks.tree)

    def sound(metres: float) -> tuple[np.ndarray, float]:
        some = trunks.with_others(beyond.select(away <= metres))
        response, seconds = timed(lambda: impulse_response(some, alone, settings.air, **around))
        return response.trees, seconds

    truth, _ = sound(farthest)
    found = {}
    for metres in sorted({*(share * one.continue_to for share in ENDS), one.continue_to}):
        heard, seconds = sound(metres)
        found[metres] = _share(heard, truth), seconds
    return found, farthest


SWEEPS: dict[str, Callable[[Any, Observer, Scene, Meshes, Path], AccuracySweep]] = {
    "tractor": sweep_tractor,
    "terrestrial": sweep_scanner,
    "mobile": sweep_scanner,
    "airborne": sweep_scanner,
    "sonar": sweep_sonar,
    "reverb": sweep_reverb,
}
