"""T20's turtle against known angles, lengths and topology, and against a plain recursive turtle."""

import itertools

import numpy as np
import pytest
from references.turtle_plain import grow_plainly

from forest_addon.base.rng import stream
from forest_addon.growth.lsystem.tanveer import (
    CENTRE,
    SIDE,
    SYMMETRIC,
    T20,
    derive,
    interpret,
    parse,
)
from forest_addon.spec import Grammar, Jitter

STILL = Jitter(length=0, angle_deg=0, twist_deg=0, raise_ratio=0, lean_deg=0, leaf_size=0)


def skeleton(generations, grammar=None, jitter=STILL, seed=0):
    return interpret(derive(T20, generations), grammar or Grammar(), jitter, stream(seed, "test"))


def test_mothers_and_roles_of_the_second_iteration():
    parent, role = parse(derive(T20, 2))
    # d ( d (g) [g) + g ) [ d (g) [g) + g ) + d (g) [g) + g )
    assert parent.tolist() == [-1, 0, 1, 1, 1, 0, 5, 5, 5, 0, 9, 9, 9]
    assert role.tolist() == [CENTRE] + [
        r for first in (SIDE, CENTRE, SYMMETRIC) for r in (first, SIDE, CENTRE, SYMMETRIC)
    ]


@pytest.mark.parametrize("text", ["d)g", "d(g))g", "dx", "d(g"])
def test_symbols_that_are_not_t20(text):
    codes = np.frombuffer(text.encode(), np.uint8)
    if text == "d(g":  # an unclosed branch is harmless
        assert parse(codes)[0].tolist() == [-1, 0]
        return
    with pytest.raises(ValueError, match="symbol"):
        parse(codes)


def test_lengths_angles_and_orders_without_jitter():
    grammar = Grammar(twist_deg=-30.0)
    s = skeleton(3, grammar)
    length = np.linalg.norm(s.end - s.start, axis=1)
    heading = (s.end - s.start) / length[:, None]
    for i in range(1, len(s)):
        mother = s.parent[i]
        same = s.order[i] == s.order[mother]
        ratio = grammar.centre_ratio if same else grammar.side_ratio
        assert length[i] == pytest.approx(length[mother] * ratio, rel=1e-12)
        angle = np.rad2deg(np.arccos(np.clip(heading[i] @ heading[mother], -1, 1)))
        assert angle == pytest.approx(0 if same else grammar.angle_deg, abs=1e-5)
        assert np.allclose(s.start[i], s.end[mother])
    trunk = s.axis(0)
    assert s.end[trunk[-1], 2] == pytest.approx(
        grammar.length * (1 - grammar.centre_ratio**4) / (1 - grammar.centre_ratio)
    )
    # Pairs of side branches on one node are opposite; pairs of successive nodes are twisted by 30°.
    pairs = [
        np.flatnonzero((s.parent == t) & (s.order == 1))
        for t in trunk
        if ((s.parent == t) & (s.order == 1)).any()
    ]
    flat = [heading[p][:, :2] / np.linalg.norm(heading[p][:, :2], axis=1)[:, None] for p in pairs]
    for first, second in flat:
        assert first @ second == pytest.approx(-1)
    for lower, upper in itertools.pairwise(flat):
        assert lower[0] @ upper[0] == pytest.approx(np.cos(np.deg2rad(30)))


@pytest.mark.parametrize("seed", range(5))
def test_equals_a_plain_recursive_turtle_with_jitter(seed):
    jitter = Jitter(length=0.1, angle_deg=6, twist_deg=9, raise_ratio=0.5, lean_deg=4)
    grammar = Grammar(angle_deg=40, twist_deg=25)
    ours = skeleton(4, grammar, jitter, seed)
    start, end, radius = grow_plainly(derive(T20, 4), grammar, jitter, stream(seed, "test"))
    assert np.abs(ours.start - start).max() < 1e-12
    assert np.abs(ours.end - end).max() < 1e-12
    assert np.abs(ours.radius[:, 0] - radius).max() < 1e-15


def test_symmetric_branches_are_raised_along_the_axis_by_less_than_an_internode():
    jitter = Jitter(length=0, angle_deg=0, twist_deg=0, raise_ratio=0.9, lean_deg=0)
    s = skeleton(5, jitter=jitter)
    lifted = s.start[1:] - s.end[s.parent[1:]]
    height = np.linalg.norm(lifted, axis=1)
    assert (height > 0).sum() == (3**5 - 1) // 2  # one symmetric branch a node
    onward = np.linalg.norm(s.end - s.start, axis=1)[s.parent[1:]] * Grammar().centre_ratio
    assert (height <= 0.9 * onward + 1e-12).all()


@pytest.mark.parametrize("angle", [0.0, 180.0])
def test_extreme_angles_stay_finite(angle):
    s = skeleton(4, Grammar(angle_deg=angle))
    assert np.isfinite(s.end).all()


def test_no_generation_is_a_single_tip():
    s = skeleton(0)
    assert len(s) == 1
    assert s.end[0].tolist() == [0, 0, 2.0]
