"""Echoes end to end: a ping among 5 and 1000 trees, Tanveer et al.'s Table 1, culling, the leaf models.

The kernel's own speed and error, by the number of leaves and the tolerance, is in ``sonar_kernel``.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from forest_addon.base.places import ASSETS
from forest_addon.base.progress import Say
from forest_addon.base.rng import stream
from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.tree import grow
from forest_addon.sensing.kinds import of_family
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.sonar.equipment_files import equip, find, read_route
from forest_addon.sensing.sonar.flight import fly
from forest_addon.sensing.sonar.ping import Echo, EchoTargets, ping
from forest_addon.sensing.sonar.poses import SonarPose, posed, poses_of
from forest_addon.spec import Air, Scene, Sonar
from forest_addon.stand.forest import GrownForest, grow_forest

from ..tables import median_seconds, table
from .cold import say_cold

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
    from . import sonar_doppler, sonar_kernel

    say(f"\n{sonar_doppler.TITLE}\n")
    sonar_doppler.run(say)
    say(f"\n{sonar_kernel.TITLE}\n")
    sonar_kernel.run(say)
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
