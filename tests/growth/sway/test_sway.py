"""Modes of members: against closed forms of cantilevers, and what rides on them. Pieces of a tree that
moves: as its members move, few, and rigid where a rigid thing moves.
"""

from dataclasses import replace

import numpy as np
import pytest
from references.reverb import rod
from scipy.optimize import brentq
from scipy.special import iv, jv, kv, yv

from forest_addon.growth.skeleton import Skeleton
from forest_addon.growth.sway.beams import (
    STEADY,
    GreenWood,
    members_of,
    modes_of,
    point_masses,
    standing_modes,
    wood_of_genus,
)
from forest_addon.growth.sway.shape import rig_of, shape_with

WOOD = GreenWood(density=800.0, modulus=9e9)
HEIGHT = 20.0
GREEN = GreenWood(800.0, 9e9)


def with_tip_mass(skeleton: Skeleton, mass: float, gravity: float = 0.0) -> np.ndarray:
    members = members_of(skeleton)
    tip = len(members)
    load = point_masses(np.array([tip]), np.array([mass]), np.zeros((1, 3)), tip + 1)
    return modes_of(members, WOOD, load, 6, gravity).frequency


def cone_with_tip_mass(foot: float, tip: float, mass: float) -> float:
    """First frequency of a cut cone with a mass at its tip, Hz: y = (J₂, Y₂, I₂, K₂)(2k√x)/x."""
    apex = HEIGHT * foot / (foot - tip)  # x from the apex that is cut off; r = foot x / apex
    low, high = apex - HEIGHT, apex
    slope = foot / apex

    def determinant(omega: float) -> float:
        k = (4 * WOOD.density * omega**2 / (WOOD.modulus * slope**2)) ** 0.25
        rows = []
        for kind, sign in ((jv, -1), (yv, -1), (iv, 1), (kv, -1)):
            # d/dz [z^-n C_n] = sign z^-n C_(n+1), K with -, I with +, J and Y with -
            def y(x: float, derivative: int, kind=kind, sign=sign) -> float:
                # d/dx of x^(-n/2) C_n(2k√x) is ± k x^(-(n+1)/2) C_(n+1)(2k√x)
                power, order = -(2 + derivative) / 2, 2 + derivative
                return float((sign * k) ** derivative * x**power * kind(order, 2 * k * np.sqrt(x)))

            stiff = WOOD.modulus * np.pi * slope**4 / 4
            moment = stiff * low**4 * y(low, 2)
            shear = stiff * (4 * low**3 * y(low, 2) + low**4 * y(low, 3))
            rows.append([y(high, 0), y(high, 1), moment, shear - mass * omega**2 * y(low, 0)])
        matrix = np.array(rows).T
        return float(np.linalg.det(matrix / np.abs(matrix).max(axis=1, keepdims=True)))

    found = np.linspace(0.3, 20, 800)
    value = [determinant(w) for w in found]
    first = next(i for i in range(len(value) - 1) if value[i] * value[i + 1] < 0)
    return brentq(determinant, found[first], found[first + 1]) / (2 * np.pi)


@pytest.mark.parametrize("mass", [0.0, 30.0, 400.0])
def test_a_tapered_cantilever_with_a_tip_mass_has_the_frequency_of_the_closed_form(mass):
    exact = cone_with_tip_mass(0.15, 0.05, mass)
    assert with_tip_mass(rod(0.15, 0.05), mass)[0] == pytest.approx(exact, rel=1e-3)


def test_a_uniform_cantilever_has_its_first_three_pairs():
    factor = np.array([1.87510407, 4.69409113, 7.85475744]) ** 2 / (2 * np.pi)
    exact = factor * np.sqrt(WOOD.modulus * 0.15**2 / 4 / WOOD.density) / HEIGHT**2
    found = with_tip_mass(rod(0.15, 0.15), 0.0)
    assert found == pytest.approx(np.repeat(exact, 2), rel=1e-3)


def test_a_leaning_rod_without_weight_sways_as_an_upright_one():
    upright, leaning = (with_tip_mass(rod(0.15, 0.05, lean=a), 50.0) for a in (0.0, 1.1))
    assert leaning == pytest.approx(upright, rel=1e-6)


def test_a_column_near_the_height_at_which_it_buckles_hardly_sways():
    """Greenhill 1881: (7.837 E I / (ρ A g))^(1/3)."""
    critical = (7.837 * WOOD.modulus * 0.05**2 / 4 / WOOD.density / 9.81) ** (1 / 3)
    for share, ratio in ((0.3, 0.987), (0.999, 0.055)):
        column = rod(0.05, 0.05, share * critical)
        heavy, light = (with_tip_mass(column, 0.0, g)[0] for g in (9.81, 0.0))
        assert heavy / light == pytest.approx(ratio, abs=0.01)


@pytest.mark.medium
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.99, 1.2, 3.0])
def test_what_stands_keeps_most_of_its_frequency_whatever_it_weighs(share):
    critical = (7.837 * WOOD.modulus * 0.05**2 / 4 / WOOD.density / 9.81) ** (1 / 3)
    members = members_of(rod(0.05, 0.05, share * critical))
    load = np.zeros((len(members) + 1, 6, 6))
    stands = standing_modes(members, WOOD, load, 4).frequency[0]
    light = modes_of(members, WOOD, load, 4, 0.0).frequency[0]
    assert 0.999 * STEADY * light <= stands < light
    if share < 0.7:
        assert stands == modes_of(members, WOOD, load, 4, 9.81).frequency[0]
    if share > 0.8:
        assert stands < 0.9 * light


def test_branches_bend_more_easily_than_stems():
    # Cannell & Morgan 1987: at most 4.6 GPa where trunks of the same trees have at most 7.5.
    stem = rod(0.15, 0.05)
    limb = replace(stem, order=np.ones_like(stem.order))
    slower = with_tip_mass(limb, 30.0)[0] / with_tip_mass(stem, 30.0)[0]
    assert slower == pytest.approx(np.sqrt(4.6 / 7.5), rel=0.02)


def test_bark_weighs_and_does_not_stiffen():
    members = members_of(rod(0.15, 0.05))
    none = np.zeros((len(members) + 1, 6, 6))
    bare = modes_of(members, WOOD, none, 2, 0.0).frequency[0]
    barked = modes_of(members, GreenWood(800.0, 9e9, inside=0.9), none, 2, 0.0).frequency[0]
    assert barked / bare == pytest.approx(0.9**2, rel=1e-3)


def test_modes_are_orthogonal_and_of_unit_mass():
    skeleton = rod(0.15, 0.05)
    shape = shape_with(skeleton, np.full(len(skeleton), 0.5), WOOD)
    _, modes = shape.at_members()
    mass = np.pi * np.linalg.norm(shape.members.end - shape.members.start, axis=1)
    mass *= (shape.members.radius.mean(axis=1)) ** 2 * WOOD.density
    mass += 0.5 * WOOD.leaf_mass
    gram = np.einsum("b,bmi,bni->mn", mass, modes, modes)[:4, :4]
    assert gram == pytest.approx(np.eye(4), abs=0.02)


def test_twigs_ride_on_what_bears_them():
    """A thin side shoot beyond the number of members moves rigidly with the stem's point."""
    stem = rod(0.15, 0.05, count=10)
    start = stem.end[4]
    twig = Skeleton(
        np.vstack([stem.start, start]),
        np.vstack([stem.end, start + np.array([1.0, 0.0, 0.0])]),
        np.vstack([stem.radius, [0.002, 0.001]]),
        np.append(stem.parent, 4),
        np.append(stem.order, 1),
        np.append(stem.generation, 5),
    )
    members = members_of(twig, most=10)
    assert len(members) == 10
    assert not members.kept[-1]
    assert members.of_segment[-1] == 5 - 1
    assert members.along[-1] == pytest.approx([1.0, 1.0])


def test_green_wood_lies_where_living_trees_have_it():
    for genus in ("picea", "pinus", "fagus", "quercus"):
        wood = wood_of_genus(genus)
        assert 650 < wood.density < 1150
        assert 5e9 < wood.modulus < 13e9


def pole():
    skeleton = rod(0.1, 0.02, 15.0, 30)
    return shape_with(skeleton, np.where(skeleton.start[:, 2] > 6, 3.0, 0.0), GREEN)


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
