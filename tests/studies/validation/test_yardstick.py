"""The yardstick of plots on a cloud whose stems and branches were put there."""

import numpy as np
import pytest

from forest_addon.base.rng import stream
from studies.validation.plots import VOXEL, measure_plot

STEMS = np.array([[2.0, 2.0, 0.10], [6.0, 2.5, 0.14], [4.0, 6.0, 0.07]])


@pytest.mark.slow
def test_stems_shrubs_and_gaps_are_told_apart():
    rng = stream(3, "yardstick")
    ground = np.column_stack([rng.uniform(0, 8, (20_000, 2)), rng.normal(0, 0.01, 20_000)])
    parts = [ground]
    for x, y, radius in STEMS:
        turn = rng.uniform(0, 2 * np.pi, 30_000)
        reach = radius + rng.normal(0, 0.003, turn.size)
        z = rng.uniform(0, 9, turn.size)
        parts.append(np.column_stack([x + reach * np.cos(turn), y + reach * np.sin(turn), z]))
    shrub = rng.uniform([1.0, 5.0, 0.5], [2.0, 6.0, 1.9], (400, 3))
    crown = rng.uniform([0.0, 0.0, 6.0], [8.0, 4.0, 8.0], (60_000, 3))  # over half of the field
    found = measure_plot(np.concatenate([*parts, shrub, crown]))
    order = np.argsort(found.stems[:, 0])
    assert found.stems[order, :3] == pytest.approx(STEMS[np.argsort(STEMS[:, 0])], abs=0.004)
    low = np.concatenate([*parts[1:], shrub])
    low = low[(low[:, 2] > 0.3) & (low[:, 2] < 4.0)]
    of_shrub = len(np.unique(np.floor(shrub / VOXEL), axis=0))
    share = of_shrub / len(np.unique(np.floor(low / VOXEL), axis=0))
    assert found.not_stem == pytest.approx(share, abs=0.02)
    assert found.empty == pytest.approx(0.5, abs=0.02)
    assert found.profile.sum() == pytest.approx(1)
    assert set(np.argsort(found.profile)[-2:]) == {6, 7}
