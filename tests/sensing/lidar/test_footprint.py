"""Sub-rays against the Gaussian beam: moments, shares of energy at edges, widths at every range."""

import numpy as np
import pytest
from scipy.special import erf

from forest_addon.base.rng import child_keys, first_key
from forest_addon.sensing.lidar.footprint import radii, spread
from forest_addon.sensing.lidar.pattern import Pulses
from forest_addon.spec import Beam


def pulses_along_x(count):
    def every(vector):
        return np.tile(np.array(vector, float), (count, 1))

    return Pulses(
        every([0, 0, 0]), every([1, 0, 0]), every([0, 1, 0]), np.zeros(count), np.zeros(count)
    )


def spots(beam, distance, count=1):
    """(P, N, 2) where sub-rays cross the plane at this distance: along the sweep, and across it."""
    keys = child_keys(first_key(1, "test"), np.arange(count))
    origin, way = spread(pulses_along_x(count), beam, keys)
    origin, way = np.broadcast_to(origin, way.shape), way
    at = origin + way * ((distance - origin[:, :1]) / way[:, :1])
    return at[:, 1:].reshape(count, -1, 2)


@pytest.mark.parametrize("subrays", [2, 7, 19, 100, 1000])
def test_the_second_moment_is_exact_for_any_number(subrays):
    assert np.mean(radii(subrays) ** 2) == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize("subrays", [5, 50])
def test_each_ray_stands_for_a_ring_of_equal_energy(subrays):
    edges = np.sqrt(-np.log(1 - np.arange(subrays) / subrays) / 2)
    assert (radii(subrays) > edges).all()
    assert (radii(subrays)[:-1] < edges[1:]).all()


def test_one_ray_is_the_axis():
    assert spots(Beam(divergence_mrad=(1.0, 1.0), exit_diameter=0.1), 50.0).tolist() == [[[0, 0]]]


@pytest.mark.parametrize("distance", [0.0, 5.0, 28.6, 1000.0])
def test_widths_are_the_gaussian_beams_at_every_range(distance):
    beam = Beam(subrays=4000, divergence_mrad=(0.7, 0.2), exit_diameter=0.02)
    spot = spots(beam, distance)[0]
    for axis, theta in enumerate((0.7e-3, 0.2e-3)):
        radius = np.sqrt(0.01**2 + (distance * theta / 2) ** 2)  # at 1/e², so twice the sd
        assert np.std(spot[:, axis]) == pytest.approx(radius / 2, rel=2e-3)


@pytest.mark.parametrize("edge", [-1.2, -0.5, 0.0, 0.3, 1.0])  # of the 1/e² radius
def test_the_energy_beyond_an_edge_is_the_error_functions(edge):
    beam = Beam(subrays=1000, divergence_mrad=(1.0, 1.0))
    spot = spots(beam, 100.0, count=20)  # w = 0.05 m
    share = np.mean(spot[:, :, 0] > edge * 0.05, axis=1)
    assert share == pytest.approx(0.5 - 0.5 * erf(np.sqrt(2) * edge), abs=0.01)


def test_the_error_at_an_edge_falls_with_the_number_of_sub_rays():
    def error(subrays):
        beam = Beam(subrays=subrays, divergence_mrad=(1.0, 1.0))
        share = np.mean(spots(beam, 100.0, count=400)[:, :, 0] > 0.013, axis=1)
        return np.std(share - (0.5 - 0.5 * erf(np.sqrt(2) * 0.26)))

    errors = [error(n) for n in (10, 100, 1000)]
    assert errors[0] > 3 * errors[1] > 9 * errors[2]  # random points would give a factor of 3.2


def test_no_two_rays_of_a_beam_coincide_and_pulses_turn():
    spot = spots(Beam(subrays=200, divergence_mrad=(1.0, 1.0)), 100.0, count=2)
    gaps = np.linalg.norm(spot[0][:, None] - spot[0][None], axis=2) + np.eye(200)
    assert gaps.min() > 0.05 / 200
    assert np.abs(spot[0] - spot[1]).max() > 0.01
