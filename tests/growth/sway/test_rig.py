"""Pieces of a tree that moves: as its members move, few, and rigid where a rigid thing moves."""

from __future__ import annotations

import numpy as np
import pytest
from references.rods import rod

from forest_addon.growth.sway.beams import GreenWood
from forest_addon.growth.sway.shape import rig_of, shape_with

WOOD = GreenWood(800.0, 9e9)


def pole():
    skeleton = rod(0.1, 0.02, 15.0, 30)
    return shape_with(skeleton, np.where(skeleton.start[:, 2] > 6, 3.0, 0.0), WOOD)


def slow(shape):
    """Amplitudes as a slow wind stirs them."""
    weight = (shape.modes.frequency[0] / shape.modes.frequency) ** 2
    return weight * np.random.default_rng(3).uniform(-1, 1, (40, len(weight)))


@pytest.mark.parametrize("within", [0.02, 0.002])
def test_pieces_follow_their_members(within):
    shape = pole()
    rig = rig_of(shape, within)
    amplitude = slow(shape)
    members, (low, high) = shape.members, shape.ends
    most = off = 0.0
    for share in (0.0, 0.3, 0.8, 1.0):
        axis = members.start + share * (members.end - members.start)
        both = low + share * (high - low)
        arm = np.array([0.02, 0.01, 0.0])
        told = np.einsum("km,bmi->kbi", amplitude, both[:, :, :3] + np.cross(both[:, :, 3:], arm))
        places = rig.places(amplitude)[:, rig.of_member]
        point = axis + arm
        found = np.einsum("kbij,bj->kbi", places[..., :3], point) + places[..., 3] - point
        off = max(off, np.linalg.norm(found - told, axis=2).max())
        most = max(most, np.linalg.norm(told, axis=2).max())
    assert off < 2 * within * most
    assert rig.off <= within
    assert 1 < len(rig) <= len(members)


def test_finer_bounds_take_more_pieces():
    shape = pole()
    assert len(rig_of(shape, 0.05)) < len(rig_of(shape, 0.001)) <= len(shape.members)


def test_at_rest_nothing_is_moved():
    rig = rig_of(pole())
    places = rig.places(np.zeros((1, rig.maps.shape[1])))
    assert np.array_equal(places[0], np.tile(np.eye(3, 4), (len(rig), 1, 1)))


def test_the_foot_stands():
    shape = pole()
    rig = rig_of(shape, 0.002)
    places = rig.places(slow(shape))[:, rig.of_member[0]]
    foot = places[..., 3]
    top = rig.places(slow(shape))[:, rig.of_member[-1]]
    reach = np.linalg.norm(
        top[..., :3] @ shape.members.end[-1] + top[..., 3] - shape.members.end[-1], axis=1
    )
    assert np.linalg.norm(foot, axis=1).max() < 0.01 * reach.max()
