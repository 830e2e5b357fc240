"""The processes that mapped stands need, on the smallest map."""

import numpy as np
import pytest
from references.measured import FOUND, needs_measurements

from forest_addon.base.rng import stream
from forest_addon.formats.tree_map import read_tree_map
from forest_addon.stand.statistics.intensity import Window
from studies.validation.covariates import fit_covariates
from studies.validation.stand import MAPS, judge


@pytest.mark.slow
@needs_measurements
def test_young_pines_are_no_poisson_process_and_groups_serve_them():
    stand = next(s for s in MAPS if s.name == "finpines")
    points = read_tree_map(FOUND / "stands" / "finpines.csv").position
    laws = judge(stand, points, np.linspace(0.1, stand.reach, 25), None, 1)
    p_values = {law.name: law.excess.p_value for law in laws}
    assert p_values["Poisson"] < 0.05 < p_values["clusters"]


def test_coefficients_of_covariates_are_found_again():
    """Each within 4.5 of its standard errors: fails once in 50,000."""
    rows, columns = 40, 50
    window = Window.rectangle(np.zeros(2), np.array([100.0, 80.0]))
    z = np.stack(np.meshgrid(np.linspace(-1, 1, columns), np.linspace(100, 130, rows)))
    mean = np.exp(-16.0 + 1.5 * z[0] + 0.1 * z[1]) * window.area / (rows * columns) * 40
    rng = stream(1, "covariates")
    count = rng.poisson(mean)
    row, column = np.divmod(np.repeat(np.arange(rows * columns), count.ravel()), columns)
    points = (np.stack([column, row], axis=1) + rng.random((len(row), 2))) * [2.0, 2.0]
    fit = fit_covariates(points, z, window)
    assert (np.abs(fit.coefficient[1:] - [1.5, 0.1]) < 4.5 * fit.error[1:]).all()
    assert fit.pixels.sum() * 4.0 == pytest.approx(len(points))
    assert fit.at(points[:5]).min() > 0
    with pytest.raises(ValueError, match="drop one"):
        fit_covariates(points, np.stack([z[0], 2 * z[0] + 1]), window)
