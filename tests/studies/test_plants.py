"""Plants told by their echoes: plants are as they are said to be, and errors are those of known cases."""

import numpy as np

from studies.flight.plants import AREA, BALL, errors, plant


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
