"""Beams on one face, in closed form, against the same rays one by one."""

import dataclasses

import numpy as np
import pytest
from references.lidar_scenes import ground, scene_with, wall
from references.rays_brute import BruteCaster

from forest_addon.base.trimesh import LEAF, WOOD, TriMesh
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.lidar import passage
from forest_addon.sensing.lidar.scan import Scan
from forest_addon.spec import Beam, Mobile, Noise, Pose, Surfaces, Terrestrial

BEAM = Beam(divergence_mrad=(3.0, 3.0), exit_diameter=0.02, subrays=19, pulse_ns=4.0, max_returns=5)


def stand():
    trunk = TriMesh.of_part(*tube(np.array([[6.0, 1, -1], [6.0, 1, 9]]), np.full(2, 0.2), 12), WOOD)
    leaf = TriMesh.of_part(
        np.array([[8.0, 0, 2], [8, 3, 2], [8, 0, 5]]), np.array([[0, 1, 2]]), LEAF
    )
    return scene_with(ground(60.0), wall(15.0, 30.0), trunk, leaf)


def tripod(**settings):
    given = {"position": (0.0, 0.0, 1.7), "azimuth_deg": (-60.0, 60.0), "angle_step_deg": 4.0}
    given |= {"elevation_deg": (-70.0, 40.0), "beam": BEAM, "max_range": 50.0}
    return Terrestrial(**(given | settings))


def alike(one, other, within=1e-10):
    for name in ("pulse", "number", "count"):
        assert (getattr(one, name) == getattr(other, name)).all()
    for name in ("instance", "triangle", "organ", "tree"):
        assert (getattr(one.returns, name) == getattr(other.returns, name)).all()
    for name in ("position", "true_range"):
        assert np.abs(getattr(one, name) - getattr(other, name)).max() < within
    assert one.width == pytest.approx(other.width, rel=within)
    assert one.intensity == pytest.approx(other.intensity, rel=within)


@pytest.mark.medium
@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"beam": dataclasses.replace(BEAM, extinction=0.01, subrays=7)},
        {"beam": dataclasses.replace(BEAM, divergence_mrad=(0.3, 0.3), subrays=37)},
        {"beam": dataclasses.replace(BEAM, divergence_mrad=(3.0, 1.0))},
        {"min_range": 4.0, "max_range": 9.0, "noise": Noise(range_sd=0.01, drop_out=0.1)},
        {"surfaces": Surfaces(leaf_transmittance=0.3)},
    ],
)
def test_it_is_what_the_rays_one_by_one_make(settings, monkeypatch):
    scanner, caster = tripod(**settings), BruteCaster(stand())
    quick = Scan(scanner, caster, 3)
    found = quick.look(0, quick.pulses)
    traced = quick.seen_by(caster).look(0, quick.pulses)
    none = np.empty(0, np.int64)
    monkeypatch.setattr(passage, "on_one_face", lambda *_: (none, none))
    alike(found, quick.seen_by(caster).look(0, quick.pulses))
    for field in dataclasses.fields(found):  # who traced is no matter, to the bit
        one, other = getattr(found, field.name), getattr(traced, field.name)
        if isinstance(one, np.ndarray):
            assert one.tobytes() == other.tobytes(), field.name
    assert len(found) > 100


@pytest.mark.medium
def test_a_moving_scanner_and_cuts_anywhere():
    poses = (Pose(time=0.0, position=(-5.0, -8.0, 2.0)), Pose(time=1.0, position=(9.0, -3.0, 2.5)))
    scanner = Mobile(poses=poses, pulse_rate=900.0, line_rate=5.0, beam=BEAM, max_range=60.0)
    caster = BruteCaster(stand())
    work = Scan(scanner, caster, 3)
    whole = work.look(0, work.pulses)
    alike(whole, work.seen_by(caster).look(0, work.pulses))
    pieces = [cloud.position for _, cloud in work.chunks(at_once=37)]
    assert np.concatenate(pieces).tobytes() == whole.position.tobytes()
    assert len(whole) > 300


def test_few_rays_are_traced():
    asked = []

    class Counting(BruteCaster):
        def cast(self, origins, directions, *given, **named):
            asked.append(len(origins))
            return super().cast(origins, directions, *given, **named)

    work = Scan(tripod(), Counting(stand()))
    work.look(0, work.pulses)
    assert sum(asked) < 0.8 * work.pulses * BEAM.subrays
