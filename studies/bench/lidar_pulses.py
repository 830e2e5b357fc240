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

from forest_addon.base.progress import Say
from forest_addon.base.rng import stream
from forest_addon.base.trimesh import GROUND, TriMesh, join
from forest_addon.blender.rays.casters import make_caster
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.tree import grow
from forest_addon.results.scan_file import write_scan
from forest_addon.sensing.lidar.scan import Scan, scan
from forest_addon.sensing.rays.caster import RayCaster
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import Beam, Rays, Terrestrial

from ..tables import table

SCENES = ((1, 200_000), (10, 200_000), (100, 20_000))  # trees, triangles of each
SUBRAYS = (1, 7, 19, 37, 100, 300)
MANY = 1000
ONE_THREAD = Rays(threads=1)
BEAM = Beam(divergence_mrad=(0.35, 0.35), exit_diameter=0.007, max_returns=5, pulse_ns=3.0)


def run(say: Say) -> None:
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


def forest(trees: int, triangles: int) -> SceneGeometry:
    """Trees of one variant on a square grid of 6 m, each turned, on a wide ground."""
    species, template = load_species(find_species("maple", Path()))
    grown = [grow(species, template, stream(1, "bench", n)).mesh for n in range(2)]
    whole = join(grown)
    order = stream(2, "bench", "triangles").permutation(len(whole.triangles))
    keep = np.zeros(len(order), dtype=bool)
    keep[order[:triangles]] = True
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 300.0
    ground = TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), GROUND)

    side = int(np.ceil(np.sqrt(trees)))
    turn = stream(3, "bench", "turn").uniform(0, 2 * np.pi, trees)
    transform = np.tile(np.eye(3, 4), (trees + 1, 1, 1))
    transform[:-1, 0, 0] = transform[:-1, 1, 1] = np.cos(turn)
    transform[:-1, 1, 0], transform[:-1, 0, 1] = np.sin(turn), -np.sin(turn)
    transform[:-1, 0, 3], transform[:-1, 1, 3] = 6.0 * np.array(divmod(np.arange(trees), side))
    number = np.append(np.arange(trees), -1)
    return SceneGeometry(
        meshes=(whole.select(keep), ground),
        transform=transform,
        mesh_index=np.append(np.zeros(trees, dtype=np.int64), 1),
        object_name=("tree",) * trees + ("ground",),
        tree=number,
        species=np.minimum(number, 0),
    )


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
        start = time.process_time()
        done = write_scan(Path(folder) / "scan.las", work, 0)
        seconds = time.process_time() - start
    return [
        f"{subrays}",
        f"{done.pulses:,}",
        f"{done.points:,}",
        f"{done.pulses / seconds:,.0f}",
        f"{done.pulses * subrays / seconds:,.0f}",
        caster.engine,
    ]


def _convergence(caster: RayCaster) -> list[list[str]]:
    scanner = Terrestrial(
        position=(-5.0, -5.0, 1.6),
        azimuth_deg=(20.0, 70.0),
        elevation_deg=(0.0, 40.0),
        angle_step_deg=1.0,
    )
    energy, first, _ = _beams(scanner, caster, MANY)
    rows = []
    for subrays in SUBRAYS:
        got, near, seconds = _beams(scanner, caster, subrays)
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


def _beams(
    scanner: Terrestrial, caster: RayCaster, subrays: int
) -> tuple[np.ndarray, np.ndarray, float]:
    """Energy (P,) and range of the first return (P,), inf where there is none; seconds."""
    start = time.process_time()
    cloud = scan(replace(scanner, beam=replace(BEAM, subrays=subrays, max_returns=15)), caster)
    seconds = time.process_time() - start
    energy = np.bincount(cloud.pulse, cloud.intensity * cloud.true_range**2, cloud.pulses)
    first = np.full(cloud.pulses, np.inf)
    leading = cloud.number == 1
    first[cloud.pulse[leading]] = cloud.true_range[leading]
    return energy, first, seconds
