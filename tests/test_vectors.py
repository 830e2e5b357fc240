"""Angles of directions: right, and to the bit the same wherever their memory lies."""

import math

import numpy as np

from forest_addon.base.vectors import azimuth_of, column, elevation_of, zenith_of


def test_angles_are_those_of_the_standard_library():
    ways = np.random.default_rng(1).normal(size=(500, 3))
    for way, azimuth, elevation, zenith in zip(
        ways, azimuth_of(ways), elevation_of(ways), zenith_of(ways), strict=True
    ):
        x, y, z = way.tolist()
        assert math.isclose(azimuth, math.atan2(y, x), rel_tol=1e-15)
        assert math.isclose(elevation, math.atan2(z, math.hypot(x, y)), rel_tol=1e-15)
        assert math.isclose(zenith, math.atan2(math.hypot(x, y), z), rel_tol=1e-15)


def test_a_column_has_the_same_bits_wherever_the_result_lies():
    """numpy 1.26 takes another way where a column ends within 16 bytes of the result's beginning."""
    count = 1_000
    memory = np.empty(4 * count + 8)
    ways = memory[: 3 * count].reshape(count, 3)
    ways[:] = np.random.default_rng(2).normal(size=ways.shape)
    wanted = azimuth_of(ways.copy())
    assert azimuth_of(ways).tobytes() == wanted.tobytes()
    for gap in range(4):
        behind = memory[3 * count + gap : 4 * count + gap]
        np.arctan2(column(ways, 1), column(ways, 0), out=behind)
        assert behind.tobytes() == wanted.tobytes()
