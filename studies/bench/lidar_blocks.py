"""Scans of blocks on the ground, as surveys of HELIOS++ have them: beams on one face, against rays.

CPU time of all threads from pulse to cloud; the plain way traces every ray of every beam. Error: the largest
difference of a range between both.
"""

from __future__ import annotations

import time

import numpy as np

from forest_addon.base.progress import Say
from forest_addon.base.trimesh import GROUND, OTHER, TriMesh
from forest_addon.blender.rays.casters import make_caster
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.lidar.cloud import join
from forest_addon.sensing.lidar.scan import Scan
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import Beam, Rays, Terrestrial

from ..tables import table

SUBRAYS = (7, 19, 61)
STEP = 0.12  # degrees


def run(say: Say) -> None:
    """Print one table."""
    say(
        "\nA tripod among blocks, pillars and ground; known: no ray is traced of a beam on one face:\n"
    )
    caster = make_caster(blocks(), Rays(threads=1))
    rows = []
    for subrays in SUBRAYS:
        beam = Beam(divergence_mrad=(0.3, 0.3), exit_diameter=0.007, pulse_ns=5.0, subrays=subrays)
        scanner = Terrestrial(
            position=(-26.0, -31.0, 1.7),
            azimuth_deg=(0.0, 90.0),
            elevation_deg=(-40.0, 60.0),
            angle_step_deg=STEP,
            beam=beam,
        )
        work = Scan(scanner, caster)
        took, ranges = [], []
        for scan in (work, work.seen_by(caster)):
            scan.look(0, 1000)  # whatever is made when it is first needed
            start = time.process_time()
            cloud = join([piece for _, piece in scan.chunks()])
            took.append(time.process_time() - start)
            ranges.append(cloud.true_range)
        known, plain = took
        apart = np.abs(ranges[0] - ranges[1]).max() if len(ranges[0]) == len(ranges[1]) else np.inf
        row = [f"{subrays}", f"{work.pulses:,}", f"{known:.2f}", f"{plain:.2f}"]
        rows.append([*row, f"{plain / known:.1f}", f"{apart:.0e}"])
    head = ["sub-rays", "pulses", "known, s", "every ray, s", "times", "largest difference, m"]
    table(say, head, rows)


def blocks() -> SceneGeometry:
    """Four blocks and two pillars on a wide ground."""
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    ground = TriMesh.of_part(
        np.column_stack([140 * square, np.zeros(4)]), np.array([[0, 1, 2], [0, 2, 3]]), GROUND
    )
    corners = np.concatenate([np.column_stack([square, np.full(4, z)]) for z in (0.0, 2.0)])
    sides = [(0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7)]
    faces = np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])
    block = TriMesh.of_part(corners, faces, OTHER)
    path = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 12.0]])
    pillar = TriMesh.of_part(*tube(path, np.full(2, 2.0), 64), OTHER)
    transform = np.tile(np.eye(3, 4), (7, 1, 1))
    places = [(0, 0, 8.0), (15, -12, 4.0), (-5, 20, 5.0), (30, 18, 9.0)]
    for row, (x, y, size) in enumerate(places):
        transform[1 + row, :, :3] *= size
        transform[1 + row, :2, 3] = x, y
    transform[5:, :2, 3] = [(12, 4), (-12, 8)]
    return SceneGeometry(
        meshes=(ground, block, pillar),
        transform=transform,
        mesh_index=np.array([0, 1, 1, 1, 1, 2, 2]),
        object_name=tuple("gbbbbpp"),
        tree=np.full(7, -1),
        species=np.full(7, -1),
    )
