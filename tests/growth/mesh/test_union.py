"""Volume of pieces that reach into each other, against closed forms."""

import numpy as np
import pytest

from forest_addon.growth.truth import shared_once

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([t for a, b, c, d in SIDES for t in ((a, b, c), (a, c, d))])


def box(low, size):
    return (np.asarray(low, float) + CORNERS * size)[FACES]


def turned(corners, angle=0.7):
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]]) @ np.array(
        [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]
    )
    return corners @ turn.T


@pytest.mark.medium
@pytest.mark.parametrize("turn", [lambda corners: corners, turned])
def test_what_two_boxes_share_counts_once(turn):
    """Two boxes of 1 and 0.5 m3 that share a third of the smaller."""
    both = np.concatenate([box((0, 0, 0), (1, 1, 1)), box((0.5, 0.25, 0.25), (1, 1, 0.5))])
    shared = 0.5 * 0.75 * 0.5
    assert shared_once(turn(both)) == pytest.approx((1.5 - shared) / 1.5, abs=2e-3)


@pytest.mark.medium
def test_pieces_apart_are_as_they_are():
    apart = np.concatenate([box((0, 0, 0), (1, 1, 1)), box((3, 0, 5), (1, 2, 0.5))])
    assert shared_once(turned(apart)) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.medium
def test_a_piece_within_another_and_three_in_one_place():
    nested = [box((0, 0, 0), (1, 1, 1)), box((0.2, 0.2, 0.2), (0.5, 0.5, 0.5))]
    assert shared_once(turned(np.concatenate(nested))) == pytest.approx(1 / 1.125, abs=2e-3)
    thrice = np.concatenate([box((0, 0, 0), (1, 1, 1))] * 3)
    assert shared_once(turned(thrice)) == pytest.approx(1 / 3, abs=1e-9)


def test_a_piece_without_a_cap_says_nothing():
    """Lines through the hole of a third box are left out: between 0.75 of two and 2.5 / 3 of three."""
    both = np.concatenate([box((0, 0, 0), (1, 1, 1)), box((0.5, 0, 0), (1, 1, 1))])
    opened = np.concatenate([both, box((9, 0, 0), (1, 1, 1))[:-2]])
    assert 0.75 < shared_once(turned(opened)) < 0.83
    assert shared_once(np.empty((0, 3, 3))) == 1.0
