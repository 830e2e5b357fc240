"""Grazing incidence: what goes on between sub-rays is one echo, what does not is apart."""

from dataclasses import replace

import numpy as np
import pytest
from references.lidar_scenes import ground, scene_with
from references.rays_brute import BruteCaster

from forest_addon.base.trimesh import GROUND, LEAF, OTHER, WOOD, TriMesh
from forest_addon.formats.toml_file import read_scanner, scanner_names
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.lidar.footprint import places
from forest_addon.sensing.lidar.scan import scan
from forest_addon.sensing.lidar.waveform import LIGHT, pulse_length
from forest_addon.spec import Beam, Terrestrial

FLAT = BruteCaster(scene_with(ground(5000.0)))
SPREADS = (0.3, 1.2, 3.0, 12.0)  # of the footprint in range, in pulse lengths


def beams():
    """Those of all instruments whose pulse is Gaussian: the crest of another moves as it gets longer."""
    found = []
    for name in scanner_names():
        table = next(iter(read_scanner(name).tables.values()))["beam"]
        if "pulse_shape" in table:
            continue
        found.append(
            pytest.param(
                Beam(**table | {"divergence_mrad": tuple(table["divergence_mrad"])}), id=name
            )
        )
    return found


def down(beam, height, distance, pulses=24, **settings):
    """Pulses from a height onto flat ground at a distance, around a quarter of a turn."""
    elevation = -np.rad2deg(np.arcsin(height / distance))
    return Terrestrial(
        position=(0.0, 0.0, height),
        azimuth_deg=(0.0, 90.0),
        angle_step_deg=90.0 / pulses,
        elevation_deg=(elevation, elevation + 1e-9),
        line_step_deg=1.0,
        min_range=0.0,
        max_range=2000.0,
        beam=replace(beam, max_returns=15),
        **settings,
    )


def waveform_of_ground(beam, height, distance):
    """Mean and standard deviation of the light that flat ground sends back, by quadrature over the beam.

    Of each angle from the axis as much as the Gaussian beam has, times sin(elevation)/R².
    """
    width = np.hypot(beam.exit_diameter / 2, distance * beam.divergence_mrad[1] * 5e-4)
    turn = np.linspace(-7, 7, 4001) * width / 2 / distance
    elevation = np.arcsin(height / distance) + turn
    assert elevation.min() > 0
    at = height / np.sin(elevation)
    light = np.exp(-0.5 * (turn / (width / 2 / distance)) ** 2) * np.sin(elevation) / at**2
    light /= light.sum()
    mean = light @ at
    return mean, np.sqrt(light @ (at - mean) ** 2)


def grazing(beam, spread):
    """A height and a distance at which the footprint is about so many pulses long."""
    width = np.hypot(beam.exit_diameter / 2, 80 * beam.divergence_mrad[1] * 5e-4)
    return 80 * np.sin(np.arctan(width / 2 / spread / pulse_length(beam.pulse_ns))), 80.0


@pytest.mark.medium
@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize("beam", beams())
def test_flat_ground_is_one_echo_where_the_beam_meets_it(beam, spread):
    height, distance = grazing(beam, spread)
    cloud = scan(down(beam, height, distance), FLAT)
    mean, length = waveform_of_ground(beam, height, distance)
    sigma = pulse_length(beam.pulse_ns)
    assert len(cloud) == cloud.pulses
    assert (cloud.true_range - mean) == pytest.approx(0, abs=0.03 * length + 1e-3 * sigma)
    assert cloud.width * LIGHT / 2 == pytest.approx(
        np.hypot(sigma, length), rel=0.01 if spread < 5 else 0.03
    )


@pytest.mark.parametrize("subrays", [2, 3, 4, 9, 26, 150])
def test_any_number_of_rays_at_any_turn_makes_one_echo_of_a_plane(subrays):
    beam = Beam(subrays=subrays, divergence_mrad=(1.0, 1.0), pulse_ns=0.05)
    cloud = scan(down(beam, 2.0, 60.0, pulses=100), FLAT)
    mean, length = waveform_of_ground(beam, 2.0, 60.0)
    assert length > 60 * pulse_length(0.05)
    assert len(cloud) == cloud.pulses
    assert np.abs(cloud.true_range - mean).max() < 0.1 * length
    if subrays > 2:  # two lie on a line, which turns
        assert cloud.width * LIGHT / 2 == pytest.approx(length, rel=0.03)


@pytest.mark.parametrize("subrays", [91, 150, 397])
def test_flat_ground_hardly_below_the_horizon_is_one_echo_of_any_number_of_rays(subrays):
    beam = Beam(subrays=subrays, divergence_mrad=(2.0, 2.0))
    cloud = scan(down(beam, 1.7, 1.7 / np.cos(np.deg2rad(89.7)), pulses=60), FLAT)
    assert cloud.number.tolist() == [1] * cloud.pulses


@pytest.mark.parametrize("subrays", [3, 7, 19, 100])
def test_the_moments_of_the_rays_are_exact_along_every_axis(subrays):
    place = places(subrays)
    assert place.mean(axis=0) == pytest.approx([0, 0], abs=1e-15)
    assert place.T @ place / subrays == pytest.approx(np.eye(2) / 4, abs=1e-14)
    assert (np.diff(np.hypot(*place.T)) >= 0).all()


def hills(cell, relief=0.02):
    """Ground in square cells that rises and falls by so much over 40 m."""
    x, y = np.meshgrid(np.arange(0, 120, cell), np.arange(-6, 6, cell), indexing="ij")
    z = relief * np.sin(2 * np.pi * x / 40) * np.cos(2 * np.pi * y / 40)
    corners = np.stack([x, y, z], axis=2).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(x.shape[0] - 1), np.arange(x.shape[1] - 1), indexing="ij")
    a = (i * x.shape[1] + j).ravel()
    b, c, d = a + x.shape[1], a + x.shape[1] + 1, a + 1
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return TriMesh.of_part(corners, faces, GROUND)


def test_ground_of_many_small_triangles_is_one_echo_too():
    beam = Beam(subrays=7, divergence_mrad=(3.0, 1.5), exit_diameter=0.01, pulse_ns=6.0)
    scanner = replace(down(beam, 1.8, 70.0, pulses=1), azimuth_deg=(-1.0, 1.0), angle_step_deg=0.1)
    cloud = scan(scanner, BruteCaster(scene_with(hills(0.8))))
    assert len(cloud) == cloud.pulses == 21
    assert cloud.width.mean() * LIGHT / 2 > 2 * pulse_length(6.0)


BEAM = Beam(
    subrays=19, divergence_mrad=(0.7, 0.7), pulse_ns=2.0
)  # on ground 60 m away: 3 pulses long


def test_a_stem_before_the_ground_is_apart_from_it():
    stem = TriMesh.of_part(
        *tube(np.array([[48.0, 0, -1], [48.0, 0, 9.0]]), np.full(2, 0.01), 24), WOOD
    )
    scanner = replace(down(BEAM, 1.8, 60.0), azimuth_deg=(0.0, 1e-7), angle_step_deg=1e-8)
    cloud = scan(scanner, BruteCaster(scene_with(ground(), stem)))
    assert (np.bincount(cloud.pulse) == 2).all()
    stem, behind = cloud.number == 1, cloud.number == 2
    assert (cloud.returns.organ[stem] == WOOD).all()
    assert cloud.true_range[stem] == pytest.approx(48 / np.cos(np.arcsin(1.8 / 60)), abs=0.02)
    # What is left of the ground keeps the mean and the width of its own rays.
    assert cloud.true_range[behind] == pytest.approx(60, abs=0.5)
    assert (cloud.returns.organ[behind] == GROUND).all()


def steps(count, part):
    """Level plates one after the other, each 1 m long, 1 m from the next, 4 cm below it."""
    meshes = []
    for n in range(count):
        x, z = 20.0 + 2 * n, 0.04 * n
        corners = np.array([[x, -9, z], [x + 1, -9, z], [x + 1, 9, z], [x, 9, z]])
        meshes.append(TriMesh.of_part(corners, np.array([[0, 1, 2], [0, 2, 3]]), part))
    return meshes


@pytest.mark.parametrize("part", [OTHER, LEAF])
def test_plates_one_behind_the_other_stay_apart(part):
    beam = Beam(subrays=100, divergence_mrad=(1.0, 16.0), pulse_ns=0.5, max_returns=9)
    scanner = replace(down(beam, 1.0, 24.0), azimuth_deg=(0.0, 1e-7), angle_step_deg=1e-8)
    plates = steps(4, part)
    cloud = scan(scanner, BruteCaster(scene_with(*plates)))
    order = np.argsort(cloud.pulse * 1000 + cloud.true_range)
    each = [set(cloud.returns.instance[order][cloud.pulse[order] == p]) for p in range(3)]
    assert all(len(one) >= 3 for one in each)
    middle = np.array([20.5, 22.5, 24.5, 26.5])[cloud.returns.instance]
    assert np.abs(cloud.true_range - middle).max() < 0.7  # each echo is on its plate


def test_leaves_at_grazing_incidence_are_not_spread():
    beam = Beam(subrays=19, divergence_mrad=(1.0, 1.0), pulse_ns=1.0, max_returns=9)
    corners = np.array([[30.0, -1, 0], [30.05, -1, 0], [30.05, 1, 0], [30.0, 1, 0]])
    blades = [
        TriMesh.of_part(
            corners + np.array([2.0 * n, 0, -0.01 * n]), np.array([[0, 1, 2], [0, 2, 3]]), LEAF
        )
        for n in range(3)
    ]
    scanner = replace(
        down(beam, 0.02, 32.0), position=(0.0, 0.0, 0.02), elevation_deg=(-0.04, -0.04 + 1e-9)
    )
    scanner = replace(scanner, azimuth_deg=(0.0, 1e-7), angle_step_deg=1e-8)
    cloud = scan(scanner, BruteCaster(scene_with(*blades)))
    assert len(cloud)
    assert cloud.width * LIGHT / 2 == pytest.approx(pulse_length(1.0), rel=0.01)


def test_the_light_stays_what_it_was():
    beam = Beam(subrays=19, divergence_mrad=(3.0, 1.5), pulse_ns=2.0)
    cloud = scan(down(beam, 1.8, 80.0), FLAT)
    short = scan(down(replace(beam, pulse_ns=1000.0), 1.8, 80.0), FLAT)  # nothing is spread
    assert cloud.intensity == pytest.approx(short.intensity, rel=1e-12)
    assert cloud.true_range == pytest.approx(short.true_range, abs=0.05)
