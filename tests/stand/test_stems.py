"""Stems: exactly as many as asked for, evenly over the field, radii of their law."""

import numpy as np
from scipy import stats

from forest_addon.spec import Forest, Normal, Stems
from forest_addon.stand.layouts import plant_stems

FIELD = Forest(size=(100.0, 50.0), origin=(-20.0, 5.0))


def test_count_place_and_radius() -> None:
    """Kolmogorov-Smirnov at a false alarm in 10 000 for each of x, y and radius."""
    spread = Normal(mean=0.2, sd=0.05)
    position, radius = plant_stems(3, FIELD, (Stems(count=5000, radius=spread),))
    assert position.shape == (5000, 2)
    assert stats.kstest(position[:, 0], stats.uniform(-20, 100).cdf).pvalue > 1e-4
    assert stats.kstest(position[:, 1], stats.uniform(5, 50).cdf).pvalue > 1e-4
    law = stats.truncnorm(-2, 2, loc=0.2, scale=0.05)
    assert stats.kstest(radius, law.cdf).pvalue > 1e-4
    assert abs(np.corrcoef(position[:, 0], radius)[0, 1]) < 4 / np.sqrt(5000)


def test_groups_have_streams_of_their_own() -> None:
    first, second = Stems(count=10), Stems(count=20, radius=Normal(mean=0.1))
    alone, _ = plant_stems(1, FIELD, (first,))
    both, radii = plant_stems(1, FIELD, (first, second))
    np.testing.assert_array_equal(both[:10], alone)
    np.testing.assert_array_equal(radii, [0.25] * 10 + [0.1] * 20)
    assert not np.array_equal(plant_stems(2, FIELD, (first,))[0], alone)
    assert plant_stems(1, FIELD, ())[0].shape == (0, 2)
    np.testing.assert_array_equal(plant_stems(1, FIELD, (first,))[0], alone)
