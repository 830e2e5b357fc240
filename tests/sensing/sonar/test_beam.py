"""The beam: plain angles in its two planes, no pole, no wrap."""

from __future__ import annotations

import math

import numpy as np
import pytest

from forest_addon.sensing.sonar.beam import GaussianBeam, beam_offsets
from forest_addon.sensing.trajectory import frame_of

AXES = [(0.0, 0.0), (2.5, 0.6), (-1.0, math.pi / 2), (0.3, -math.pi / 2), (4.0, 1.5)]


@pytest.mark.parametrize(("azimuth", "elevation"), AXES)
def test_frame_is_right_handed(azimuth: float, elevation: float) -> None:
    frame = frame_of(azimuth, elevation)
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(np.cross(frame[0], frame[1]), frame[2], atol=1e-15)
    assert frame[1, 2] == 0  # left is level


@pytest.mark.parametrize(("azimuth", "elevation"), AXES)
@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 2.0, 3.1])
def test_offsets_in_the_two_planes(azimuth: float, elevation: float, angle: float) -> None:
    forward, left, up = frame_of(azimuth, elevation)
    for side, expected in ((left, (angle, 0)), (-left, (-angle, 0)), (up, (0, angle))):
        way = math.cos(angle) * forward + math.sin(angle) * side
        offsets = np.concatenate(beam_offsets(way[None], frame_of(azimuth, elevation)))
        np.testing.assert_allclose(offsets, expected, atol=1e-14)


def beam_gain(directions, azimuth, width):
    """(L,) one way, of a level beam."""
    az, el = beam_offsets(directions, frame_of(azimuth, 0.0))
    return GaussianBeam(width).gain(az, el, np.zeros(1))[0]


def test_offsets_of_a_level_sonar_are_azimuth_and_elevation_nearby() -> None:
    az, el = 0.05, -0.04
    way = [[math.cos(el) * math.cos(az), math.cos(el) * math.sin(az), math.sin(el)]]
    np.testing.assert_allclose(
        np.concatenate(beam_offsets(np.array(way), frame_of(0, 0))), [az, el], rtol=2e-3
    )


def test_no_wrap_behind() -> None:
    """Across the direction straight behind, and past ±180° of world azimuth, the gain is smooth."""
    turn = np.linspace(-4, 4, 2001)
    circle = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    gain = beam_gain(circle, math.pi, (2.0, 2.0))
    assert np.abs(np.diff(gain)).max() < 0.005
    np.testing.assert_allclose(gain[0], beam_gain(circle[:1], math.pi, (2.0, 2.0)))
    straight_behind = np.array([[1.0, 0.0, 0.0]])
    assert np.isfinite(beam_gain(straight_behind, math.pi, (2.0, 1.0))).all()


def test_three_decibels_at_half_the_width() -> None:
    half = math.radians(15)
    way = np.array(
        [[math.cos(half), math.sin(half), 0], [math.cos(half), 0, math.sin(half)], [1, 0, 0]]
    )
    level = 20 * np.log10(beam_gain(way, 0.0, (2 * half, 2 * half)))
    np.testing.assert_allclose(level, [-3, -3, 0], atol=1e-12)
