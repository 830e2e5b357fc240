"""Blooming of retro-reflectors: a plate's edge in the light beside the beam, by its closed form."""

from dataclasses import replace
from math import erfc, sqrt

import numpy as np
import pytest
from references.lidar_scenes import scene_with
from references.rays_brute import BruteCaster

from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.sensing.lidar.scan import Scan, scan
from forest_addon.sensing.lidar.specular import Halo, SpecularScene
from forest_addon.spec import POLISHED, Beam, Receiver, SpecError, Surfaces, Terrestrial

GAIN, FAR = 500.0, 50.0


def plate(distance, low, high):
    y, z = np.array([low, high, high, low]), np.array([-9.0, -9.0, 9.0, 9.0])
    corners = np.stack([np.full(4, distance), y, z], axis=1)
    return TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), OTHER)


def shining(*meshes, first=True):
    """A scene whose first plate is a retro-reflector."""
    optics = np.full((len(meshes), 4), np.nan)
    if first:
        optics[0] = POLISHED.index("retro"), np.nan, np.nan, GAIN
    return replace(scene_with(*meshes), optics=optics)


def scanner(**receiver):
    return Terrestrial(
        position=(0.0, 0.0, 0.0), azimuth_deg=(-4.0, 4.0), elevation_deg=(-4.0, 4.0), max_range=200.0,
        angle_step_deg=0.25, faintest=0.02, surfaces=Surfaces(other=0.5), pulse_rate=1e5,
        beam=Beam(divergence_mrad=(0.3, 0.3), subrays=7, max_returns=3), receiver=Receiver(**receiver),
    )  # fmt: skip


def test_a_retro_reflector_is_as_bright_as_it_says():
    cloud = scan(scanner(), BruteCaster(shining(plate(FAR, -1.0, 1.0))))
    here = np.abs(cloud.azimuth) < 0.015
    cosine = FAR / cloud.true_range[here]
    assert cloud.intensity[here] == pytest.approx(
        GAIN * cosine / cloud.true_range[here] ** 2, rel=1e-3
    )
    dark = scan(scanner(), BruteCaster(shining(plate(FAR, -1.0, 1.0), first=False)))
    assert cloud.intensity.sum() == pytest.approx(dark.intensity.sum() * GAIN / 0.5, rel=1e-9)


def test_a_gain_below_that_of_white_is_refused():
    scene = shining(plate(FAR, -1.0, 1.0))
    scene.optics[0, 3] = 0.5
    with pytest.raises(SpecError, match=r"forest_gain: of a retro-reflector is 0\.5"):
        Scan(scanner(), BruteCaster(scene))


def test_the_edge_glows_as_a_gaussian_cone_says():
    share, angle = 1e-2, 20.0
    caster = BruteCaster(shining(plate(FAR, 0.0, 60.0)))
    halo = Halo.of(scanner(halo=share, halo_mrad=angle), caster.scene)
    for beside in (0.1, 0.3, 0.5):
        look = Terrestrial(
            position=(0.0, -beside, 0.0), azimuth_deg=(0.0, 1e-6), elevation_deg=(0.0, 1e-6),
            angle_step_deg=1e-8, max_range=200.0,
        )  # fmt: skip
        work = Scan(look, caster)
        pulses = work.pattern.pulses(np.arange(300))
        keys = np.arange(300, dtype=np.uint64)
        found = halo.added(caster, pulses, keys, work._direct(pulses, keys))
        light = np.bincount(found.echoes.pulse, found.echoes.energy, 300).mean()
        width = FAR * angle * 1e-3 / 2
        glow = erfc(sqrt(2) * beside / width) / 2
        assert light == pytest.approx(share * GAIN / FAR**2 * glow, rel=0.03)


def test_a_sign_blooms_and_a_white_wall_does_not():
    meshes = plate(FAR, -0.5, 0.5), plate(90.0, -40.0, 40.0)
    plain = scan(scanner(), BruteCaster(shining(*meshes)))
    glowing = scan(scanner(halo=1e-2), BruteCaster(shining(*meshes)))
    white = scan(scanner(halo=1e-2), BruteCaster(shining(*meshes, first=False)))
    wide = [np.ptp(np.tan(c.azimuth[c.true_range < 60]) * FAR) for c in (plain, glowing)]
    assert wide[0] == pytest.approx(1.0, abs=0.3)
    assert wide[1] > wide[0] + 0.4
    assert np.diff(glowing.pulse).min() >= 0
    assert np.array_equal(
        white.position, scan(scanner(), BruteCaster(shining(*meshes, first=False))).position
    )
    # beside the sign a pulse has two returns: the sign's halo, and the wall behind
    assert (glowing.count == 2).sum() > 2 * (plain.count == 2).sum()


@pytest.mark.medium
def test_chunks_are_the_whole_and_bounces_leave_it_alone():
    caster = BruteCaster(shining(plate(FAR, -0.5, 0.5), plate(90.0, -40.0, 40.0)))
    work = Scan(scanner(halo=1e-2), caster)
    parts = np.concatenate([piece.position for _, piece in work.chunks(at_once=97)])
    assert (parts == scan(scanner(halo=1e-2), caster).position).all()
    assert SpecularScene.of(caster.scene, replace(scanner(), bounces=True)) is None
