"""Crowns in labelled points, beside shapes whose measures are known."""

import numpy as np
import pytest

from forest_addon import api as forest

TREES = {"tree": [7, 3], "x_m": [50.0, 0.0], "y_m": [0.0, 2.0], "z_m": [1.0, 0.0]}
TREES = {name: np.array(values) for name, values in {**TREES, "dbh_m": [0.3, 0.3]}.items()}


def turned(rng, angle, long, short, low, high, many=20_000):
    """Points on a stem and in a crown that is an ellipse of these diameters between two heights."""
    place = rng.uniform(-1, 1, (many, 2))
    place = place[np.hypot(*place.T) < 1] * [long / 2, short / 2]
    cos, sin = np.cos(angle), np.sin(angle)
    crown = np.column_stack([place @ [[cos, sin], [-sin, cos]], rng.uniform(low, high, len(place))])
    stem = np.column_stack([rng.uniform(-0.1, 0.1, (3000, 2)), rng.uniform(0, low, 3000)])
    herbs = np.column_stack([rng.uniform(-2, 2, (300, 2)), rng.uniform(0, 0.9, 300)])
    return np.concatenate([stem, crown, herbs])


@pytest.fixture(scope="module")
def found():
    rng = np.random.default_rng(5)
    one = turned(rng, 0.7, 8.0, 5.0, 6.0, 15.0) + np.array([50, 0, 1])
    two = turned(rng, 2.9, 4.0, 4.0, 3.0, 9.0)
    two = np.concatenate([two, [[0, 0, 30.0]]]) + np.array([0, 2, 0])
    points = np.concatenate([one, two])
    label = np.repeat([7, 3], [len(one), len(two)])
    mixed = rng.permutation(len(points))
    return forest.crowns(points[mixed], label[mixed], TREES)


def test_an_ellipse_s_height_base_and_mean_diameter_are_found(found):
    assert found["tree"].tolist() == [7, 3]
    assert np.allclose(found["height_m"], [15, 9], atol=0.01)  # a lone point far above is no tip
    assert np.allclose(found["crown_base_m"], [6.05, 3.05], atol=0.101)
    assert np.allclose(found["crown_diameter_m"], [6.5, 4.0], atol=0.05)


def test_a_tree_that_nobody_saw_is_nan_and_labels_have_to_fit():
    points = np.zeros((5, 3))
    none = forest.crowns(points, np.full(5, -1), TREES)
    assert np.isnan(none["height_m"]).all()
    assert none["points"].tolist() == [0, 0]
    line = forest.crowns(np.arange(15.0).reshape(5, 3), np.full(5, 3), TREES)
    assert np.isnan(line["crown_diameter_m"]).all()
    with pytest.raises(forest.SpecError, match="a label for each of 5 points"):
        forest.crowns(points, np.zeros(4), TREES)
