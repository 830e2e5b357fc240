"""The table of the exact disc against the solver, and as what the repository ships."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest
from references.hard_disc import HardDisc

from forest_addon.acoustics.disc_table import (
    ERROR,
    FILE,
    LAST,
    MARGIN,
    tabulated,
    tabulated_bound,
    tabulated_ka,
)

SCRIPT = Path(__file__).resolve().parents[2] / "packaging" / "make_disc_table.py"
RANGES = [(1e-9, 0.1), (0.1, 1), (1, 3), (3, 10), (10, 40), (40, 80), (80, LAST)]


@pytest.mark.slow
@pytest.mark.parametrize(("low", "high"), RANGES)
def test_error_is_as_stated(low: float, high: float) -> None:
    rng = np.random.default_rng(5)
    for ka in [*rng.uniform(low, high, 12), high]:
        near = rng.uniform(0, min(1.5, 10 / ka), 300)  # the main lobe and the first side lobes
        angle = np.concatenate([[0, math.pi / 2], near, rng.uniform(0, math.pi / 2, 300)])
        exact = HardDisc(ka).backscatter(angle)
        assert np.abs(tabulated(ka, angle) - exact).max() < ERROR * abs(exact[0])


def test_broadcasting_and_ends() -> None:
    ka, angle = np.array([[0.0], [5e-324], [1e-3], [LAST]]), np.array([0.0, 1.0, math.pi / 2])
    value = tabulated(ka, angle)
    assert value.shape == (4, 3)
    assert np.isfinite(value).all()
    assert (value[0] == 0).all()
    assert np.isnan(tabulated(np.array([np.nan, 1.0]), np.array([1.0, np.nan]))).all()


def test_bound_of_the_table() -> None:
    rng = np.random.default_rng(6)
    angle = np.append(rng.uniform(0, math.pi / 2, 300), [0, math.pi / 2])
    for low, high in ((0.0, 0.3), (0.5, 0.6), (5.0, 6.7), (20.0, 27.0), (3.0, 3.0), (1e-3, LAST)):
        ka = np.linspace(max(low, 1e-6), high, 300)[:, None]
        size = (np.abs(tabulated(ka, angle)) / ka).max(axis=0)
        ends = (np.full(len(angle), end) for end in (low, high))
        assert (size <= tabulated_bound(*ends, angle)).all()


def test_shipped_table_is_what_the_script_makes() -> None:
    spec = importlib.util.spec_from_file_location("make_disc_table", SCRIPT)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    ka = tabulated_ka()
    with np.load(FILE) as data:
        np.testing.assert_allclose(data["ka"], ka, rtol=1e-14)
        rows = np.split(data["series"], np.cumsum(data["terms"])[:-1])
    for index in (0, MARGIN, MARGIN + 1, 100, 300, len(ka) - 1):
        made = script.series(float(ka[index]))
        shared = min(len(made), len(rows[index]))  # the cut may fall one term apart
        assert abs(len(made) - len(rows[index])) <= 1
        np.testing.assert_allclose(rows[index][:shared], made[:shared], atol=3e-7)
    assert FILE.stat().st_size < 1e6
