"""Cylinders of a tree whose every measure is known, and their sums against the truth of its segments."""

from dataclasses import replace

import numpy as np
import pytest

from forest_addon.growth.skeleton import Skeleton, cylinders_of, diameter_at


def fork():
    """A trunk of two segments, a branch of two at its middle, and a twig."""
    start = [[0, 0, 0], [0, 0, 1], [0, 0, 1], [1, 0, 1.5], [1, 0, 1.5]]
    end = [[0, 0, 1], [0, 0, 3], [1, 0, 1.5], [2, 0, 2], [1, 1, 1.5]]
    radius = [[0.2, 0.16], [0.16, 0.08], [0.05, 0.04], [0.04, 0.02], [0.01, 0.01]]
    return Skeleton(
        start=np.array(start, float),
        end=np.array(end, float),
        radius=np.array(radius),
        parent=np.array([-1, 0, 0, 2, 2]),
        order=np.array([0, 0, 1, 1, 2]),
        generation=np.array([0, 1, 1, 2, 2]),
    )


def test_parents_extensions_axes_and_orders():
    found = cylinders_of(fork())
    assert found.parent.tolist() == [-1, 0, 0, 2, 2]
    assert found.extension.tolist() == [1, -1, 3, -1, -1]
    assert found.axis.tolist() == [0, 0, 1, 1, 2]
    assert found.order.tolist() == [0, 0, 1, 1, 2]


def test_a_cylinder_has_the_volume_of_its_cone():
    found = cylinders_of(fork())
    r1, r2 = found.radius.T
    cone = np.pi * found.length * (r1**2 + r1 * r2 + r2**2) / 3
    assert np.allclose(np.pi * found.equal_radius**2 * found.length, cone, rtol=1e-14)


def test_diameter_at_a_height():
    tree = fork()
    assert diameter_at(tree, 1.3) == pytest.approx(2 * (0.16 - 0.08 * 0.15))
    assert diameter_at(tree, 0.0) == pytest.approx(0.4)
    assert diameter_at(tree, 3.0) == 0.0
    two = replace(
        tree,
        **{
            name: np.concatenate([getattr(tree, name), getattr(tree, name)[:2]])
            for name in ("start", "end", "radius", "parent", "order", "generation")
        },
    )
    assert diameter_at(two, 1.3) == pytest.approx(np.sqrt(2) * diameter_at(tree, 1.3))
