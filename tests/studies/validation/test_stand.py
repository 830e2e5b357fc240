"""The processes that mapped stands need, on the smallest map."""

import numpy as np
import pytest
from references.measured import FOUND, needs_measurements

from forest_addon.formats.tree_map import read_tree_map
from studies.validation.stand import MAPS, judge


@pytest.mark.slow
@needs_measurements
def test_young_pines_are_no_poisson_process_and_groups_serve_them():
    stand = next(s for s in MAPS if s.name == "finpines")
    points = read_tree_map(FOUND / "stands" / "finpines.csv").position
    laws = judge(stand, points, np.linspace(0.1, stand.reach, 25), None, 1)
    p_values = {law.name: law.excess.p_value for law in laws}
    assert p_values["Poisson"] < 0.05 < p_values["clusters"]
