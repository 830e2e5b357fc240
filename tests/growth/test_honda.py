"""Honda's trees: angles and ratios without chance, every distribution with it, refusals.

Distribution tests are Kolmogorov-Smirnov (continuous) or chi-square (discrete) over trees of seeds that
are fixed here; each would fail with a chance of 1e-6 for a correct program and an arbitrary seed.
"""

import contextlib
import dataclasses

import numpy as np
import pytest
from scipy.stats import chisquare, kstest, truncnorm

from forest_addon.growth.draw import draw_discrete, draw_normal
from forest_addon.growth.lsystem import branching
from forest_addon.growth.lsystem.branching import grow_honda, predict_branches
from forest_addon.spec import Discrete, Honda, Leaf, Normal, SpecError

FALSE_ALARM = 1e-6
BARE = Leaf(on=False)


def fixed(mean):
    return Normal(mean=mean)


STILL = Honda(
    levels=Discrete(values=(3,)),
    length=fixed(2.0),
    radius=fixed(0.1),
    length_ratio=fixed(0.8),
    radius_ratio=fixed(0.6),
    daughters=Discrete(values=(2,)),
    angle_deg=fixed(35.0),
    twist_deg=fixed(90.0),
    crook_deg=fixed(0.0),
    pieces=1,
    tip=0.9,
)


def but(**changes):
    return dataclasses.replace(STILL, **changes)


def lengths_of(skeleton):
    return np.linalg.norm(skeleton.end - skeleton.start, axis=1)


def expected_normal(spread):
    low, high = ((b - spread.mean) / spread.sd for b in spread.bounds())
    return truncnorm(low, high, spread.mean, spread.sd).cdf


def test_angles_ratios_and_divergence_without_chance():
    skeleton, leaves = grow_honda(STILL, BARE, 1)
    assert len(leaves) == 0
    assert len(skeleton) == 1 + 2 + 4 + 8
    length = lengths_of(skeleton)
    heading = (skeleton.end - skeleton.start) / length[:, None]
    for i in range(1, len(skeleton)):
        parent = skeleton.parent[i]
        assert length[i] == pytest.approx(0.8 * length[parent])
        assert skeleton.radius[i, 0] == pytest.approx(0.6 * skeleton.radius[parent, 0])
        assert skeleton.radius[i, 1] == pytest.approx(0.9 * skeleton.radius[i, 0])
        assert heading[i] @ heading[parent] == pytest.approx(np.cos(np.deg2rad(35)))
        assert np.allclose(skeleton.start[i], skeleton.end[parent])
        assert skeleton.order[i] == skeleton.order[parent] + 1
        assert skeleton.generation[i] == skeleton.generation[parent] + 1
    for parent in range(7):  # two children stand opposite, in a plane square to their parent's
        one, other = np.flatnonzero(skeleton.parent == parent)
        assert heading[one] @ heading[other] == pytest.approx(np.cos(np.deg2rad(70)))
        if parent:
            plane = np.cross(heading[one], heading[other])
            sister = np.cross(heading[parent], heading[skeleton.parent[parent]])
            assert plane @ sister == pytest.approx(0, abs=1e-12)


def test_a_leader_goes_straight_on_as_its_mothers_axis():
    skeleton, _ = grow_honda(but(leader_ratio=0.7), BARE, 1)
    assert len(skeleton) == 1 + 3 + 9 + 27
    trunk = skeleton.axis(0)
    assert len(trunk) == 4
    assert skeleton.end[trunk[-1]] == pytest.approx([0, 0, 2 * (1 + 0.7 + 0.49 + 0.343)])
    assert skeleton.radius[trunk[1], 0] == pytest.approx(skeleton.radius[0, 1])


@pytest.mark.parametrize("droop", [2.0, 20.0])
def test_droop_bends_down_and_never_past_the_vertical(droop):
    skeleton, _ = grow_honda(but(droop=min(droop, 6.0), pieces=20), BARE, 1)
    assert np.isfinite(skeleton.end).all()
    heading = (skeleton.end - skeleton.start) / lengths_of(skeleton)[:, None]
    onward = np.flatnonzero(
        (skeleton.order > 0) & (skeleton.order == skeleton.order[np.maximum(skeleton.parent, 0)])
    )
    assert (heading[onward, 2] <= heading[skeleton.parent[onward], 2] + 1e-12).all()
    assert np.abs(skeleton.end[skeleton.order == 0, :2]).max() < 1e-12  # the trunk stays


@pytest.mark.parametrize("angle", [0.0, 180.0])
def test_angles_of_0_and_180_degrees(angle):
    skeleton, leaves = grow_honda(but(angle_deg=fixed(angle), droop=1.0), Leaf(), 1)
    assert np.isfinite(skeleton.end).all()
    assert np.abs(skeleton.end[:, :2]).max() < 1e-12
    assert np.isfinite(leaves.direction).all()


def test_no_levels_is_a_trunk():
    skeleton, leaves = grow_honda(but(levels=Discrete(values=(0,))), Leaf(), 1)
    assert len(skeleton) == 1
    assert leaves.segment.max() == 0


def test_leaves_reach_the_tips_and_move_no_branch():
    honda = Honda()
    bare, _ = grow_honda(honda, BARE, 5)
    leafy, leaves = grow_honda(honda, Leaf(), 5)
    assert (bare.end == leafy.end).all()
    tips = leafy.end[np.setdiff1d(np.arange(len(leafy)), leafy.parent)]
    reached = (np.abs(leaves.foot[:, None] - tips[None]).max(axis=2) < 1e-9).any(axis=0)
    assert reached.all()
    assert np.abs(np.einsum("li,li->l", leaves.direction, leaves.up)).max() < 1e-12
    assert np.linalg.norm(leaves.direction, axis=1) == pytest.approx(np.ones(len(leaves)))


def test_another_number_of_leaves_or_levels_moves_no_branch():
    """Draws are keyed by lineage: what a tree has less of leaves the rest in its place."""
    full, _ = grow_honda(Honda(levels=Discrete(values=(5,))), BARE, 9)
    fewer, _ = grow_honda(Honda(levels=Discrete(values=(3,))), Leaf(), 9)
    assert (full.end[: len(fewer)] == fewer.end).all()


LENGTH = Normal(mean=2.0, sd=0.5, low=1.4, high=2.5)
RADIUS = Normal(mean=0.1, sd=0.02)
RATIO = Normal(mean=0.7, sd=0.1, high=0.8)


@pytest.mark.slow
def test_what_is_drawn_per_tree():
    honda = but(
        levels=Discrete(values=(1, 2, 4), weights=(1.0, 2.0, 1.0)),
        length=LENGTH,
        radius=RADIUS,
        length_ratio=RATIO,
        radius_ratio=dataclasses.replace(RATIO, mean=0.6),
        daughters=Discrete(values=(1,)),
    )
    trees = [grow_honda(honda, BARE, seed)[0] for seed in range(800)]
    length = [lengths_of(t)[:2] for t in trees]
    radius = [t.radius[:2, 0] for t in trees]
    levels = np.array([len(t) - 1 for t in trees])
    continuous = {
        "length": ([a for a, _ in length], LENGTH),
        "length ratio": ([b / a for a, b in length], RATIO),
        "radius": ([a for a, _ in radius], RADIUS),
        "radius ratio": ([b / a for a, b in radius], honda.radius_ratio),
    }
    for name, (seen, spread) in continuous.items():
        low, high = spread.bounds()
        assert low - 1e-9 <= min(seen) <= max(seen) <= high + 1e-9
        assert kstest(seen, expected_normal(spread)).pvalue > FALSE_ALARM, name
    counts = [(levels == k).sum() for k in (1, 2, 4)]
    assert chisquare(counts, [200, 400, 200]).pvalue > FALSE_ALARM


def test_what_is_drawn_per_branch():
    angle = Normal(mean=40.0, sd=6.0)
    twist = Normal(mean=100.0, sd=20.0)
    honda = but(
        levels=Discrete(values=(1,)),
        sprouting="along",
        bare=0.25,
        trunk_daughters=Discrete(values=(40, 60)),
        angle_deg=angle,
        twist_deg=twist,
    )
    places, angles, twists, born = [], [], [], []
    for seed in range(150):
        s, _ = grow_honda(honda, BARE, seed)
        heading = (s.end - s.start)[1:] / lengths_of(s)[1:, None]
        places += (s.start[1:, 2] / 2.0).tolist()
        angles += np.rad2deg(np.arccos(heading[:, 2])).tolist()
        azimuth = np.rad2deg(np.arctan2(heading[:, 1], heading[:, 0]))
        assert (np.diff(s.start[1:, 2]) >= 0).all()
        twists += (np.diff(azimuth) % 360).tolist()
        born.append(len(heading))
    assert kstest(places, lambda x: np.clip((x - 0.25) / 0.75, 0, 1)).pvalue > FALSE_ALARM
    assert kstest(angles, expected_normal(angle)).pvalue > FALSE_ALARM
    assert kstest(twists, expected_normal(twist)).pvalue > FALSE_ALARM
    counts = [born.count(40), born.count(60)]
    assert chisquare(counts).pvalue > FALSE_ALARM


def test_what_is_drawn_per_leaf():
    leaf = Leaf(
        length=Normal(mean=0.05, sd=0.01, low=0.045),
        width_ratio=Normal(mean=0.6, sd=0.1),
        angle_deg=Normal(mean=50.0, sd=10.0),
    )
    honda = but(leaves=Discrete(values=(10, 30), weights=(3.0, 1.0)), levels=Discrete(values=(8,)))
    skeleton, leaves = grow_honda(honda, leaf, 3)
    heading = (skeleton.end - skeleton.start) / lengths_of(skeleton)[:, None]
    cosine = np.einsum("li,li->l", heading[leaves.segment], leaves.direction)
    angle = np.rad2deg(np.arccos(cosine))
    assert kstest(leaves.length, expected_normal(leaf.length)).pvalue > FALSE_ALARM
    ratio = leaves.width / leaves.length
    assert kstest(ratio, expected_normal(leaf.width_ratio)).pvalue > FALSE_ALARM
    assert kstest(angle, expected_normal(leaf.angle_deg)).pvalue > FALSE_ALARM
    counts = np.bincount(leaves.segment)[-256:]
    assert chisquare([(counts == 10).sum(), (counts == 30).sum()], [192, 64]).pvalue > FALSE_ALARM


def test_draws_are_inverted_not_rejected():
    keys = np.arange(20000, dtype=np.uint64)
    narrow = Normal(mean=3.0, sd=100.0, low=2.9, high=3.1)  # rejection would take a thousand rounds
    values = draw_normal(narrow, keys, "x")
    assert kstest(values, expected_normal(narrow)).pvalue > FALSE_ALARM
    assert draw_normal(fixed(2.5), keys, "x").tolist() == [2.5] * 20000
    never = draw_discrete(Discrete(values=(7, 8, 9), weights=(0.0, 1.0, 0.0)), keys, "y")
    assert set(never.tolist()) == {8}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"length_ratio": fixed(0.0)}, "length_ratio: can draw 0"),
        ({"length_ratio": fixed(-0.5)}, "can draw -0.5"),
        ({"length_ratio": Normal(mean=0.5, sd=0.3)}, "can draw -0.1"),
        ({"radius_ratio": fixed(0.0)}, "radius_ratio: can draw 0"),
        ({"radius_ratio": fixed(1.2)}, "at most 1"),
        ({"length": fixed(0.0)}, "length: can draw 0"),
        ({"angle_deg": fixed(181.0)}, "at most 180"),
        ({"levels": Discrete(values=(13,))}, "at most 12"),
    ],
)
def test_ratios_that_cannot_be_are_refused(changes, words):
    with pytest.raises(SpecError, match=words):
        but(**changes)


def test_sizes_are_predicted_and_refused_with_the_number():
    honda = but(levels=Discrete(values=(2, 4)), daughters=Discrete(values=(1, 3)), leader_ratio=0.5)
    assert predict_branches(honda) == pytest.approx((1 + 3 + 9 + 1 + 3 + 9 + 27 + 81) / 2)
    big = but(levels=Discrete(values=(12,)), daughters=Discrete(values=(5,)), pieces=8)
    with pytest.raises(ValueError, match="about 2,441,406,248 segments"):
        grow_honda(big, BARE, 0)
    with pytest.raises(ValueError, match="would reach 16,382 m"):
        grow_honda(
            but(
                levels=Discrete(values=(12,)),
                length_ratio=fixed(2.0),
                daughters=Discrete(values=(1,)),
            ),
            BARE,
            0,
        )
    growing = but(length_ratio=fixed(1.2))
    assert lengths_of(grow_honda(growing, BARE, 0)[0]).max() == pytest.approx(2 * 1.2**3)


def test_a_tree_larger_than_its_prediction_is_refused_too(monkeypatch):
    monkeypatch.setattr(branching, "MAX_SEGMENTS", 60)
    unlucky = but(
        daughters=Discrete(values=(1, 30), weights=(20.0, 1.0)), levels=Discrete(values=(2,))
    )
    sizes = []
    for seed in range(60):
        with contextlib.suppress(ValueError):
            sizes.append(len(grow_honda(unlucky, BARE, seed)[0]))
    assert 0 < len(sizes) < 60
    assert max(sizes) <= 60
