"""Echoes end to end, and the sum over leaves alone (``sonar_sum``)."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from forest_addon.api import Air, Echo, Scene, Sonar, SonarPose

from ..inside import (
    ASSETS,
    EchoTargets,
    Equipment,
    LeafDiscs,
    MeasuredSphere,
    Say,
    SceneGeometry,
    equip,
    find,
    find_species,
    grow,
    grow_forest,
    load_species,
    of_family,
    ping,
    posed,
    poses_of,
    read_route,
    read_settings,
    stream,
)
from ..inside import fly_pings as fly
from ..scenes import scene_of, scene_of_forest, turned
from ..tables import median_seconds, table
from .cold import say_cold
from .sonar_sum import SUM, say_sum

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
# The kernel's own speed and error, by the number of leaves and the tolerance, is in ``sonar_sum``.


TITLE = "sonar: pings among trees"
SPECIES, VARIANTS = "honda-birch", 5
POSE = {"position": (0.0, 0.0, 4.0), "elevation_deg": 10.0}
PAPER_SECONDS = {  # Tanveer et al. 2020a, Table 1, on 32 cores
    "tanveer-table-1-one": 0.73,
    "tanveer-table-1-five": 3.03,
}


def run(say: Say) -> None:
    """Print the tables one below the other."""
    forests = {count: _forest(count) for count in (5, 1800)}
    say(
        "One ping, the second and later ones: cull 0.01 of all amplitudes, tolerance 1e-6, 60-80 kHz.\n"
    )
    _pings(say, forests)
    say(
        "\nTable 1 of Tanveer et al. 2020a: its scene files, the paper's model, all positions; "
        "cull 0.01, tolerance 1e-4.\n"
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
    return scene_of(meshes, turned(rng.uniform(-half, half, (count, 2)), turn))


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
        scene = scene_of_forest(forest)
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
        "theirs (32 cores), s",
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
