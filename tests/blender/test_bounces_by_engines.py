"""Bounces by Blender's engines: what brute force finds, and a whole .blend with a mirror."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.lidar_scenes import scene_with
from references.rays_brute import BruteCaster

from forest_addon.base.trimesh import OTHER, WOOD, TriMesh
from forest_addon.blender.rays.bvh import BvhCaster
from forest_addon.blender.rays.embree import EmbreeCaster
from forest_addon.sensing.lidar.scan import scan
from forest_addon.spec import Beam, Surfaces, Terrestrial


def quads(seed, count=40, part=OTHER):
    """Squares of 1 to 4 m about the origin, 5 to 20 m away, turned at random."""
    rng = np.random.default_rng(seed)
    corners, faces = [], []
    for k in range(count):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        centre = turn[0] * rng.uniform(5, 20)
        u, v = (np.linalg.qr(rng.normal(size=(3, 3)))[0] * rng.uniform(1, 4))[:2]
        corners += [centre, centre + u, centre + u + v, centre + v]
        faces += [[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]
    return TriMesh.of_part(np.array(corners), np.array(faces), part)


@pytest.mark.medium
@pytest.mark.parametrize("engine", [BvhCaster, EmbreeCaster], ids=["bvhtree", "embree"])
def test_both_engines_find_what_brute_force_finds(engine):
    scene = scene_with(quads(1, 15), quads(2, 15), quads(3, 15), quads(4, 150, WOOD))
    optics = np.full((4, 4), np.nan)
    optics[:3, 0], optics[:3, 3] = (0, 1, 2), 0.1
    scene = type(scene)(**vars(scene) | {"optics": optics})
    sees = Terrestrial(
        position=(0, 0, 0),
        angle_step_deg=5,
        max_range=60,
        bounces=True,
        surfaces=Surfaces(other=0.0),
        beam=Beam(subrays=3, divergence_mrad=(1.0, 1.0), max_returns=15),
    )
    ours, right = (scan(sees, make(scene)) for make in (engine, BruteCaster))
    assert set(right.bounce.tolist()) == {0, 1, 2, 3}
    assert right.unfollowed == ours.unfollowed > 5
    assert np.array_equal(ours.bounce, right.bounce)
    assert np.array_equal(ours.pulse, right.pulse)
    assert ours.true_range == pytest.approx(right.true_range, abs=1e-9)
    assert ours.intensity == pytest.approx(right.intensity, rel=1e-7)
