"""Absorption of air: values of ISO 9613-1 and its limits."""

from __future__ import annotations

import numpy as np
import pytest
from references.reverb_direct import absorption_direct

from forest_addon.acoustics.air import DB_PER_NEPER, absorption

VALUES = [
    (1000, 20, 50, 101.325, 0.004664672605),
    (4000, 20, 50, 101.325, 0.0296651515043),
    (12000, 20, 50, 101.325, 0.220939171002),
    (70000, 20, 50, 101.325, 2.290820845537),
    (2000, 0, 10, 101.325, 0.016560481964),
    (8000, -20, 100, 101.325, 0.04128782229943),  # PHYSICS 5.3 prints this one with a digit lost
    (1000, 35, 80, 80, 0.00807349176466),
]


@pytest.mark.parametrize(("frequency", "celsius", "humidity", "pressure", "expected"), VALUES)
def test_values(
    frequency: float, celsius: float, humidity: float, pressure: float, expected: float
) -> None:
    conditions = (frequency, celsius, humidity, pressure)
    assert DB_PER_NEPER * absorption(*conditions) == pytest.approx(expected, rel=1e-11)
    assert absorption(*conditions) * DB_PER_NEPER == pytest.approx(expected, rel=1e-11)
    assert absorption_direct(*conditions) == pytest.approx(absorption(*conditions), rel=1e-13)


def test_table_of_the_standard() -> None:
    """dB/km at the exact midband frequencies of the octaves from 63 Hz, ISO 9613-1, table 1."""
    octaves = 1000.0 * 10.0 ** (0.3 * np.arange(-4, 4))
    table = {
        (10, 70): [0.122, 0.411, 1.04, 1.93, 3.66, 9.66, 32.8, 117.0],
        (20, 70): [0.0898, 0.339, 1.13, 2.80, 4.98, 9.02, 22.9, 76.6],
    }
    for (celsius, humidity), expected in table.items():
        np.testing.assert_allclose(
            1000 * DB_PER_NEPER * absorption(octaves, celsius, humidity), expected, rtol=6e-3
        )


def test_broadcasting_and_defaults() -> None:
    loss = DB_PER_NEPER * absorption(
        np.array([[1000.0], [4000.0]]), temperature_c=np.array([20.0, 0.0, -20.0])
    )
    assert loss.shape == (2, 3)
    assert loss[1, 0] == DB_PER_NEPER * absorption(4000.0)
    assert DB_PER_NEPER * absorption(1000.0, 20, 50, 101.325) == DB_PER_NEPER * absorption(1000.0)


def test_limits() -> None:
    assert DB_PER_NEPER * absorption(0.0) == 0
    dry = DB_PER_NEPER * absorption([1.0, 1e3, 1e6], humidity=0.0)
    assert np.isfinite(dry).all()
    assert np.isfinite(
        DB_PER_NEPER * absorption(1e5, temperature_c=[-40.0, 50.0], humidity=1e-9)
    ).all()
    grid = DB_PER_NEPER * absorption(np.geomspace(1e-3, 1e7, 400))
    assert (np.diff(grid) > 0).all()  # the culling of leaves relies on it


@pytest.mark.parametrize(
    "wrong",
    [{"humidity": -1.0}, {"humidity": 101.0}, {"pressure_kpa": 0.0}, {"temperature_c": -274.0}],
)
def test_impossible_air_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"humidity|temperature"):
        absorption(1000.0, **wrong)
