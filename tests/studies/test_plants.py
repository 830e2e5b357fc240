"""Plants told by their echoes: plants are as they are said to be, and errors are those of known cases."""

import numpy as np

from studies.flight.plants import AREA, BALL, errors, plant, reduced


def test_kinds_have_the_same_leaf_area_of_leaves_four_times_as_large():
    ficus, schefflera = plant(0, 0, 1), plant(1, 0, 1)
    for leaves in (ficus, schefflera):
        assert abs(np.pi * (leaves.radius**2).sum() / AREA - 1) < 0.1
        assert np.linalg.norm(leaves.centre, axis=1).max() <= BALL
    assert abs((schefflera.radius**2).mean() / (ficus.radius**2).mean() - 4) < 0.4
    assert (plant(0, 1, 1).centre[0] != ficus.centre[0]).any()


def test_errors_are_none_of_what_differs_and_half_of_what_does_not():
    rng = np.random.default_rng(2)
    heard = rng.standard_normal((2, 4, 40, 2, 6))
    same, new = errors(heard, 3, 1)
    assert 0.35 < same < 0.65  # 320 answers: 0.5 ± 0.028
    assert 0.35 < new < 0.65
    heard[1] += 6.0
    assert errors(heard, 3, 1) == (0.0, 0.0)


def test_what_tells_one_plant_does_not_tell_another():
    """Each plant has a note of its own, the kinds have none in common."""
    rng = np.random.default_rng(3)
    heard = rng.standard_normal((2, 6, 40, 1, 6)) + 8.0 * rng.standard_normal((2, 6, 1, 1, 6))
    same, new = errors(heard, 1, 1)
    assert same < 0.02
    assert new > 0.15


def test_components_keep_the_variance_of_the_largest():
    rng = np.random.default_rng(4)
    rows = rng.standard_normal((3, 2, 50, 2, 40)) * np.where(np.arange(40) < 5, 10.0, 0.1)
    kept = reduced(rows)
    assert kept.shape == (3, 2, 50, 2, 24)
    assert (
        abs(kept.reshape(-1, 24).var(axis=0).sum() / rows.reshape(-1, 40).var(axis=0).sum() - 1)
        < 1e-3
    )
