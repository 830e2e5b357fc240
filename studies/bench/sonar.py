"""The echo sum alone: time, error and memory by leaves and tolerance; what the leaf models differ by."""

from __future__ import annotations

import math
import time
import tracemalloc
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from forest_addon.api import Air, Echo, GrownForest, Scene, Sonar, SonarPose
from studies.bench.cold import say_cold
from studies.tables import median_seconds, table

from ..inside import (
    ASSETS,
    DelayedSum,
    DiscStrength,
    EchoTargets,
    Equipment,
    LeafDiscs,
    MeasuredSphere,
    Say,
    ScattererPart,
    SceneGeometry,
    backscatter,
    equip,
    find,
    find_species,
    forget,
    grow,
    grow_forest,
    load_species,
    of_family,
    ping,
    posed,
    poses_of,
    read_route,
    read_settings,
    smoothness,
    stream,
    sum_delayed,
)
from ..inside import fly_pings as fly

SUM = "sonar: the sum over leaves, 1201 bins from 60 to 80 kHz, amplitudes included"
START, BAND, BINS, SPEED = 60e3, 20e3, 1201, 340.0
SPACING = BAND / (BINS - 1)
SHARE = 40  # every so many bins are summed directly, for the error
TIMED = 5_000  # leaves of the direct sum that is timed
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)


def say_sum(say: Say) -> None:
    """Print the tables."""
    say(f"Errors against the direct sum at every {SHARE}th bin; leaves of 2.5 cm of any direction.")
    say("Spread: at 1 to 10 m. Equal: all at one place, so that all errors add up.")
    say(
        f"Direct: time of {TIMED:,} leaves, times the number of them. First: nothing is known yet.\n"
    )
    rows = []
    for model, count in (("paper", 1_000), ("paper", 10_000), ("paper", 100_000)):
        rows += _rows(model, count, "spread", TOLERANCES)
    rows += _rows("paper", 1_000_000, "spread", (1e-3, 1e-5, 1e-6))
    for model in ("piston", "exact"):
        rows += _rows(model, 100_000, "spread", (1e-3, 1e-4, 1e-5, 1e-6))
    for model in ("paper", "piston", "exact"):
        rows += _rows(model, 100, "spread", (1e-6,))
        rows += _rows(model, 10_000, "equal", (1e-3, 1e-6))
    head = ["leaf model", "leaves", "where", "tolerance", "first, ms", "again, ms", "direct, s"]
    head += ["times as fast", "bound / Σ|A|", "largest error / Σ|A|", "nodes", "MB"]
    table(say, head, rows)
    say(
        "\nLevel of the leaf models re the exact disc, dB: piston / paper. All: rms over directions.\n"
    )
    models(say)


@dataclass(frozen=True)
class _Leaves:
    """Random leaves, summed as a ping sums them: in the parts of their strength."""

    distance: np.ndarray
    strength: DiscStrength

    @classmethod
    def random(cls, model: str, count: int, where: str) -> _Leaves:
        rng = stream(5, "bench", "leaves", count)
        radius = np.clip(rng.normal(0.025, 0.005, count), 0.005, 0.05)
        distance, angle = rng.uniform(1, 10, count), np.arccos(rng.uniform(0, 1, count))
        if where == "equal":
            radius, distance, angle = (np.full(count, v[0]) for v in (radius, distance, angle))
        return cls(distance, DiscStrength(radius, angle, np.ones(count), model))

    def sum(self, tolerance: float, start: float, spacing: float, bins: int) -> DelayedSum:
        """Σ over the parts; the sizes of parts add up, which is more than that of the leaves."""
        band = (start, start + spacing * (bins - 1))
        low, high = (2.0 * math.pi * end / SPEED for end in band)
        every = ScattererPart(
            np.arange(len(self.distance)), np.zeros(len(self.distance)), self.strength
        )
        spectrum, size, error, nodes = np.zeros(bins, dtype=np.complex128), 0.0, 0.0, Counter()
        for part in self.strength.parts(low, high, tolerance) if tolerance else [every]:
            away, strength = self.distance[part.rows], part.strength

            def amplitude(frequency: np.ndarray, rows: np.ndarray) -> np.ndarray:
                k = 2.0 * math.pi * frequency / SPEED
                return strength.select(rows).amplitude(k) / away[rows] ** 2  # noqa: B023

            found = sum_delayed(
                amplitude,
                (2.0 * away + part.offset) / SPEED,
                start,
                spacing,
                bins,
                tolerance=tolerance,
                smooth=smoothness(strength.profile(), band, SPEED, away**-2.0, [])
                if tolerance
                else None,
            )
            spectrum += found.spectrum
            size += found.size
            error += found.error_bound * found.size
            nodes.update(found.nodes)
        return DelayedSum(spectrum, size, 0.0, error / size, dict(nodes))


def _rows(model: str, count: int, where: str, tolerances: tuple[float, ...]) -> list[list[str]]:
    leaves = _Leaves.random(model, count, where)
    few = _Leaves.random(model, min(count, TIMED), where)
    exact = leaves.sum(0.0, START, SHARE * SPACING, (BINS - 1) // SHARE + 1)
    slow = median_seconds(lambda: few.sum(0.0, START, SPACING, BINS), runs=1)
    slow *= count / len(few.distance)
    rows = []
    for tolerance in tolerances:

        def fast(tolerance: float = tolerance) -> DelayedSum:
            return leaves.sum(tolerance, START, SPACING, BINS)

        forget()
        first = median_seconds(fast, runs=1)
        found = fast()
        seconds = median_seconds(fast, runs=3 if count < 1_000_000 else 1)
        difference = found.spectrum[::SHARE] - exact.spectrum
        mean_nodes = sum(nodes * some for nodes, some in found.nodes.items()) / count
        rows.append(
            [
                model,
                f"{count:,}",
                where,
                f"{tolerance:.0e}",
                f"{1e3 * first:.1f}",
                f"{1e3 * seconds:.1f}",
                f"{slow:.2f}",
                f"{slow / seconds:,.0f}",
                f"{found.error_bound:.0e}",
                f"{np.abs(difference).max() / exact.size:.0e}",
                f"{mean_nodes:.1f}",
                f"{_megabytes(fast):.1f}",
            ]
        )
    return rows


def _megabytes(work) -> float:
    """Largest memory in use on the way, beyond what the leaves take."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def models(say: Say) -> None:
    """Print by how much the leaf models differ, by ka and incidence."""
    degrees = (0, 10, 20, 30, 45, 60, 75)
    every = np.arccos((np.arange(20_000) + 0.5) / 20_000)  # isotropic
    rows = []
    for ka in (0.5, 1, 2, 5, 10, 20, 37, 60, 100, 200):
        cells = [f"{ka}"]
        for angle in (*np.radians(degrees), every):
            levels = {
                model: 10.0 * np.log10(np.mean(backscatter(ka, angle, model) ** 2))
                for model in ("exact", "piston", "paper")
            }
            shown = (f"{levels[name] - levels['exact']:+.1f}" for name in ("piston", "paper"))
            cells.append(" / ".join(shown))
        rows.append(cells)
    table(say, ["ka", *(f"{angle}°" for angle in degrees), "all"], rows)


# Pings of two ears with Doppler, plain and measured all round, beside those without.
#
# Leaves of 8 to 30 mm stand at random in a sphere of 1.5 m about a place 4 m ahead; the sonar flies at
# them at 5 m/s with a sweep of 2 ms from 80 to 40 kHz. Nothing is culled, so that every row sums the same
# leaves.


DOPPLER = "sonar: Doppler and measured ears, 6,936 leaves"
LEAVES, DIRECTIONS, AGAIN = 6936, 800, 3
SONAR = Sonar(
    position=(0.0, 0.0, 0.0), ears=2, ear_spacing=0.015, band=(40e3, 80e3), sample_rate=250e3,
    call="fm", speed=5.0, cull=0.0, tolerance=1e-3, facets=False, wood=False, shading="none",
    beam_width_deg=(60.0, 60.0), hearing="gaussian", max_range=10.0,
)  # fmt: skip


def say_doppler(say: Say) -> None:
    """Print the table."""
    targets = EchoTargets.of_discs(_leaves())
    rows = []
    for model in ("paper", "piston", "exact"):
        for hearing in ("gaussian", "measured"):
            taken = [_seconds(targets, model, hearing, doppler) for doppler in (False, True)]
            rows.append([model, hearing, *(f"{1e3 * seconds:.0f}" for seconds in taken)])
    table(say, ["leaf model", "ears", "ping, ms", "with Doppler, ms"], rows)


def _seconds(targets: EchoTargets, model: str, hearing: str, doppler: bool) -> float:
    """The least CPU time of a ping of several, warm."""
    sonar = SONAR.changed(leaf_model=model, doppler=doppler)
    hears = (_ear(1.0), _ear(-1.0)) if hearing == "measured" else ()
    equipment = Equipment.of(sonar, hears=hears)
    ping(targets, sonar, Air(), equipment=equipment)
    taken = []
    for _ in range(AGAIN):
        start = time.thread_time()
        ping(targets, sonar, Air(), equipment=equipment)
        taken.append(time.thread_time() - start)
    return min(taken)


def _leaves() -> LeafDiscs:
    rng = stream(5, "bench", "sonar", "doppler")
    away = rng.normal(size=(LEAVES, 3))
    away *= 1.5 * np.cbrt(rng.uniform(size=(LEAVES, 1))) / np.linalg.norm(away, axis=1)[:, None]
    normal = rng.normal(size=(LEAVES, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    number, one = np.arange(LEAVES), np.zeros(LEAVES, np.int64)
    radius = rng.uniform(0.008, 0.03, LEAVES)
    centre = away + np.array([4.0, 0.0, 0.0])
    return LeafDiscs(centre, normal, radius, one, number, one - 1)


def _ear(left: float) -> MeasuredSphere:
    """An ear that hears best aside and ahead, the more so the higher the frequency."""
    rng = stream(6, "bench", "sonar", "ears")
    towards = rng.normal(size=(DIRECTIONS, 3))
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    frequency = np.linspace(30e3, 90e3, 7)
    level = 12.0 * (0.8 * towards[:, 0] + 0.6 * left * towards[:, 1] - 1.0)
    return MeasuredSphere.all_round(towards, frequency, level[:, None] * frequency / 60e3)


# Echoes end to end: a ping among 5 and 1000 trees, Tanveer et al.'s Table 1, culling, the leaf models.
#
# The kernel's own speed and error, by the number of leaves and the tolerance, is in ``sonar_kernel``.


TITLE = "sonar: pings among trees"
SPECIES, VARIANTS = "honda-birch", 5
POSE = {"position": (0.0, 0.0, 4.0), "elevation_deg": 10.0}
PAPER_SECONDS = {  # T20, Table 1, on 32 cores
    "t20-table-1-one": 0.73,
    "t20-table-1-five": 3.03,
}


def run(say: Say) -> None:
    """Print the tables one below the other."""
    forests = {count: _forest(count) for count in (5, 1800)}
    say(
        "One ping, the second and later ones: cull 0.01 of all amplitudes, tolerance 1e-6, 60-80 kHz.\n"
    )
    _pings(say, forests)
    say(
        "\nT20's Table 1: its scene files, the paper's model, all positions; cull 0.01, tolerance 1e-4.\n"
    )
    _table_1(say)
    say("\nCulling, 5 trees, 30° beam: what is promised and what is true.\n")
    _culling(say, forests[5])
    say(
        "\nWhat leaves, wood and ground add, and what shading takes: 5 trees, 40° beam, peak level.\n"
    )
    _kinds(say, forests[5])
    say(f"\n{DOPPLER}\n")
    say_doppler(say)
    say(f"\n{SUM}\n")
    say_sum(say)
    say_cold(say, "sonar")


def _forest(count: int) -> SceneGeometry:
    """Birches at 0.1 trees/m², a few variants of them."""
    species = load_species(find_species(SPECIES, Path()))
    meshes = tuple(grow(*species, stream(1, "bench", n)).mesh for n in range(VARIANTS))
    rng = stream(7, "bench", "sonar", count)
    half = np.sqrt(count / 0.1) / 2
    turn = rng.uniform(0, 2 * np.pi, count)
    transform = np.zeros((count, 3, 4))
    transform[:, 0, 0] = transform[:, 1, 1] = np.cos(turn)
    transform[:, 1, 0], transform[:, 0, 1] = np.sin(turn), -np.sin(turn)
    transform[:, 2, 2] = 1
    transform[:, :2, 3] = rng.uniform(-half, half, (count, 2))
    return SceneGeometry(
        meshes=meshes,
        transform=transform,
        mesh_index=np.arange(count) % VARIANTS,
        object_name=("tree",) * count,
        tree=np.arange(count),
        species=np.zeros(count, dtype=np.int64),
    )


def _pings(say: Say, forests: dict[int, SceneGeometry]) -> None:
    rows = []
    for count, scene in forests.items():
        for width in (10.0, 30.0):
            for kinds in (
                {"wood": False, "leaf_model": "paper"},
                {"wood": False, "leaf_model": "piston"},
                {},
            ):
                sonar = Sonar(
                    beam_width_deg=(width, width), shading="none", cull=0.01, **POSE, **kinds
                )
                targets = EchoTargets(scene)
                start = time.thread_time()
                echo = ping(targets, sonar, Air())
                first = time.thread_time() - start
                later = [_ping(targets, sonar, 45.0 * n) for n in range(1, 6)]
                seconds = [took for took, _ in later]
                heard = [len(found.heard) for _, found in later]
                rows.append(
                    [
                        f"{count}",
                        f"{echo.leaves:,}",
                        f"{width:g}°",
                        sonar.leaf_model + ("" if sonar.wood is False else ", wood"),
                        f"{first:.2f}",
                        f"{1e3 * float(np.median(seconds)):.0f}",
                        f"{int(np.median(heard)):,}",
                        f"{max(found.cull_bound for _, found in later):.1e}",
                    ]
                )
    head = ["trees", "leaves", "beam", "model", "first ping, s", "ping, ms", "heard", "bound"]
    table(say, head, rows)


def _ping(targets: EchoTargets, sonar: Sonar, azimuth_deg: float) -> tuple[float, Echo]:
    turned = replace(sonar, azimuth_deg=azimuth_deg)
    start = time.thread_time()
    echo = ping(targets, turned, Air())
    return time.thread_time() - start, echo


def _table_1(say: Say) -> None:
    rows = []
    for name, paper in PAPER_SECONDS.items():
        settings = read_settings(ASSETS / "scenes" / f"{name}.toml", Scene)
        species = [load_species(find_species(p.species, Path())) for p in settings.plantings]
        forest = grow_forest(settings, species)
        scene = _scene_of(forest)
        (sonar,) = of_family(settings.sensors, "sonar")
        poses = _poses(sonar)
        equipment = equip(sonar, ASSETS / "scenes")
        targets = EchoTargets(scene)
        start = time.thread_time()
        fly(targets, sonar, settings.air, poses, equipment=equipment)
        first = time.thread_time() - start

        def again(t: EchoTargets = targets, s: Sonar = sonar, p: list[SonarPose] = poses) -> None:
            fly(t, s, settings.air, p, equipment=equipment)  # noqa: B023

        seconds = median_seconds(again)
        rows.append(
            [
                f"{len(forest.stand)}",
                f"{len(poses)}",
                f"{targets.total(sonar, 'leaf'):,}",
                f"{paper:.2f}",
                f"{first:.3f}",
                f"{seconds:.3f}",
                f"{paper / first:.0f}x",
                f"{paper / seconds:.0f}x",
            ]
        )
    head = [
        "trees",
        "positions",
        "leaves",
        "T20 (32 cores), s",
        "first, s",
        "again, s",
        "faster",
        "again",
    ]
    table(say, head, rows)


def _poses(sonar: Sonar) -> list[SonarPose]:
    if not sonar.route:
        return [posed(sonar)]
    return poses_of(read_route(find(sonar.route, ASSETS / "scenes", "route"), sonar.speed))


def _scene_of(forest: GrownForest) -> SceneGeometry:
    """A grown forest as sensors see it, without Blender in between."""
    stand, keys = forest.stand, list(forest.variants)
    index = {key: number for number, key in enumerate(keys)}
    pairs = zip(stand.species.tolist(), stand.variant.tolist(), strict=True)
    return SceneGeometry(
        meshes=tuple(forest.variants[key].mesh for key in keys),
        transform=forest.transforms(),
        mesh_index=np.array([index[pair] for pair in pairs], dtype=np.int64),
        object_name=("tree",) * len(stand),
        tree=stand.id,
        species=stand.species,
    )


def _culling(say: Say, scene: SceneGeometry) -> None:
    targets = EchoTargets(scene)
    sonar = Sonar(shading="none", wood=False, leaf_model="piston", **POSE)
    whole = ping(targets, replace(sonar, cull=0.0), Air())
    rows = []
    for cull in (0.05, 0.01, 1e-3, 1e-4):
        part = ping(targets, replace(sonar, cull=cull), Air())
        kept = float(part.heard.amplitude.sum())
        size = min(len(part.impulse_response), len(whole.impulse_response))
        gap = whole.impulse_response[:size] - part.impulse_response[:size]
        energy = float(np.sum(gap**2) / np.sum(whole.impulse_response**2))
        rows.append(
            [
                f"{cull:g}",
                f"{len(part.heard):,} of {len(whole.heard):,}",
                f"{part.cull_bound:.1e}",
                f"{float(whole.heard.amplitude.sum()) / kept - 1:.1e}",
                f"{energy:.1e}",
            ]
        )
    head = ["cull", "heard", "bound on Σ|A|", "true Σ|A|", "true share of the energy"]
    table(say, head, rows)


def _kinds(say: Say, scene: SceneGeometry) -> None:
    targets, rows = EchoTargets(scene), []
    base = Sonar(shading="none", beam_width_deg=(40.0, 40.0), cull=1e-3, **POSE)
    cases: dict[str, dict[str, object]] = {
        "leaves, exact": {"wood": False},
        "leaves, piston": {"wood": False, "leaf_model": "piston"},
        "leaves, paper": {"wood": False, "leaf_model": "paper"},
        "wood alone": {"leaves": False},
        "leaves and wood": {},
    }
    for name, settings in cases.items():
        echo = ping(targets, replace(base, **settings), Air())  # type: ignore[arg-type]
        energy = float(np.sqrt(np.mean(echo.envelope**2)))
        rows.append(
            [
                name,
                f"{len(echo.heard):,}",
                f"{20 * np.log10(echo.envelope.max()):.1f}",
                f"{20 * np.log10(energy):.1f}",
            ]
        )
    table(say, ["what sounds", "heard", "peak, dB re call at 1 m", "rms, dB"], rows)
