"""Portraits of trees whose numbers are known, and distances of distributions that are."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import ks_2samp

from forest_addon.base.trimesh import WOOD, TriMesh
from forest_addon.growth.likeness import BINS, Portrait, axes_of, compare, kolmogorov, portray
from forest_addon.growth.mesh.leaves import Leaves
from forest_addon.growth.skeleton import Skeleton
from forest_addon.growth.tree import Tree


@pytest.fixture
def tee():
    """A trunk 10 m high, a cone of 0.2 m; a level branch of 3 m at 5 m; four leaves around 5 m."""
    start = np.array([[0, 0, 0], [0, 0, 5], [0, 0, 5.0]])
    end = np.array([[0, 0, 5], [0, 0, 10], [3.0, 0, 5]])
    radius = np.array([[0.2, 0.1], [0.1, 0.0], [0.05, 0.05]])
    parent = np.array([-1, 0, 0])
    wood = Skeleton(start, end, radius, parent, np.array([0, 0, 1]), np.array([0, 1, 1]))
    corner = np.pi / 2 * np.arange(4)
    centre = np.stack([2 * np.cos(corner), 2 * np.sin(corner), np.full(4, 5.0)], axis=1)
    up = np.tile([0.0, 0.0, 1.0], (4, 1))
    size = np.full(4, 0.1)
    leaves = Leaves(centre, up, up, size, size, size, np.zeros(4, np.int32))
    mesh = TriMesh.of_part(
        np.array([[0, 0, 0], [1, 0, 0], [0, 0, 10.0]]), np.array([[0, 1, 2]]), WOOD
    )
    return Tree(mesh, leaves, wood)


def test_a_portrait_has_the_numbers_of_the_tree(tee):
    found = portray(tee).numbers
    assert found["height, m"] == 10
    assert found["DBH, cm"] == pytest.approx(2 * 20 * (1 - 0.13))
    assert found["taper: diameter at half height / DBH"] == pytest.approx(0.5 / 0.87)
    assert found["branches of order 1"] == 1
    assert found["their length, order 1, m"] == pytest.approx(3)
    assert found["wood volume, l"] == pytest.approx(1000 * np.pi * (0.2**2 * 10 / 3 + 0.05**2 * 3))
    assert found["leaf area, m²"] == pytest.approx(4 * np.pi * 0.01)
    assert found["crown base, m"] == 5
    square = 4 * (np.abs(np.cos(np.pi * np.arange(18) / 18))).clip(
        np.sin(np.pi * np.arange(18) / 18)
    )
    assert found["crown width, m"] == pytest.approx(square.mean())
    samples = portray(tee).samples
    assert samples["insertion angle, order 1, deg"] == pytest.approx([90])
    assert samples["inclination of a leaf, deg"] == pytest.approx([0] * 4)
    profile = portray(tee).profiles["leaf area"]
    assert profile[BINS // 2] == 1


def test_axes_begin_where_the_order_changes(tee):
    first, axis = axes_of(tee.skeleton)
    assert first.tolist() == [0, 2]
    assert axis.tolist() == [0, 0, 1]


def test_distances_of_distributions():
    rng = np.random.default_rng(1)
    one, other = rng.normal(size=80), rng.normal(0.5, 1.3, 300)
    assert kolmogorov(one, other) == pytest.approx(ks_2samp(one, other).statistic)


def test_what_misses_a_goal_is_named():
    def portrait(height, profile):
        return Portrait(
            {"height, m": height}, {"angle": np.array([height])}, {"leaf area": profile}
        )

    half = np.full(4, 0.25)
    found = compare(
        portrait(10.0, half),
        [portrait(h, np.array([0.5, 0.5, 0, 0])) for h in (12.0, 12.5, 13.0)],
    )
    assert found.missed == ["height, m", "leaf area"]
    assert found.numbers[0].difference == pytest.approx(0.25)
    assert found.profiles[0].overlap == 0.5
    assert found.samples[0].mover == pytest.approx(2.5)
    near = compare(portrait(10.0, half), [portrait(h, half) for h in (9.0, 10.0, 11.5)])
    assert near.missed == []
