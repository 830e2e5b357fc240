"""Trees set by hand: they stay, they are kept apart from, and they change nothing else."""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.formats.toml_file import read_settings, write_settings
from forest_addon.site import ForestSite
from forest_addon.spec import Clearing, Forest, HandTree, Planting, Scene, SpecError, Terrain
from forest_addon.stand.plan import plan_stand

FIELD = Forest(size=(30.0, 30.0), spacing=2.0)
OAK = Planting(species="maple", expected=40)
TREES = (
    HandTree(position=(5.0, 5.0), rotation_deg=90.0, scale=1.5, variant=2),
    HandTree(position=(5.5, 5.0)),
    HandTree(position=(-3.0, 40.0)),
)


def rows_of(stand, keep):
    names = ("position", "rotation", "scale", "species", "variant", "number")
    return [tuple(np.ravel(getattr(stand, name)[k]).tolist() for name in names) for k in keep]


@pytest.mark.parametrize("rule", ["matern", "greedy"])
def test_trees_set_by_hand_stay_and_others_keep_away(rule):
    field = FIELD.changed(spacing_rule=rule)
    stand = plan_stand(3, field, [OAK.changed(by_hand=TREES)])
    hand = np.flatnonzero(stand.number < 0)
    assert stand.position[hand, :2].tolist() == [[5, 5], [5.5, 5], [-3, 40]]
    assert stand.rotation[hand[0]] == pytest.approx(np.pi / 2)
    assert (stand.scale[hand[0]], stand.variant[hand[0]]) == (1.5, 2)
    drawn = np.flatnonzero(stand.number >= 0)
    apart = np.linalg.norm(stand.position[drawn, None, :2] - stand.position[None, hand, :2], axis=2)
    assert apart.min() >= 2.0
    between = np.linalg.norm(stand.position[drawn, None] - stand.position[None, drawn], axis=2)
    assert between[~np.eye(len(drawn), dtype=bool)].min() >= 2.0


def test_nothing_else_changes():
    """Without spacing every drawn tree is bit for bit what it was, those of other plantings too."""
    field, other = FIELD.changed(spacing=0.0), Planting(species="spruce", expected=25)
    plain = plan_stand(3, field, [OAK, other])
    hand = plan_stand(3, field, [OAK.changed(by_hand=TREES), other])
    assert rows_of(hand, np.flatnonzero(hand.number >= 0)) == rows_of(plain, range(len(plain)))
    assert len(hand) == len(plain) + 3
    assert hand.id.tolist() == list(range(len(hand)))


def test_a_clearing_takes_what_stands_in_it_and_nothing_else():
    field = FIELD.changed(spacing=0.0)
    plain = plan_stand(3, field, [OAK])
    tree = plain.position[7, :2]
    discs = (
        Clearing(position=tuple(tree)),
        Clearing(position=(20.0, 20.0), radius=6.0),
    )
    stand = plan_stand(3, field, [OAK.changed(clearings=discs, by_hand=TREES[:1])])
    far = np.hypot(*(plain.position[:, :2] - [20, 20]).T) > 6
    far[7] = False
    assert 0 < far.sum() < len(plain) - 1
    kept = rows_of(stand, np.flatnonzero(stand.number >= 0))
    assert kept == rows_of(plain, np.flatnonzero(far))


@pytest.mark.parametrize("rule", ["matern", "greedy"])
def test_where_trees_were_deleted_or_moved_none_that_spacing_had_removed_moves_up(rule):
    field, dense = FIELD.changed(spacing_rule=rule), OAK.changed(expected=150)
    plain = plan_stand(3, field, [dense])
    assert plain.removed > 30
    every = range(0, len(plain), 4)
    discs = tuple(Clearing(position=tuple(plain.position[k, :2]), radius=0.01) for k in every)
    left = rows_of(plain, [k for k in range(len(plain)) if k not in every])
    for hand in ((), tuple(HandTree(position=(-20.0, 3.0 * k)) for k in range(len(discs)))):
        stand = plan_stand(3, field, [dense.changed(clearings=discs, by_hand=hand)])
        assert rows_of(stand, np.flatnonzero(stand.number >= 0)) == left
        assert stand.removed == plain.removed


def test_a_new_seed_moves_no_tree_that_was_set():
    planting = OAK.changed(by_hand=TREES, clearings=(Clearing(position=(9.0, 9.0), radius=4.0),))
    for seed in (1, 2):
        stand = plan_stand(seed, FIELD, [planting])
        hand = stand.number < 0
        assert stand.position[hand, :2].tolist() == [[5, 5], [5.5, 5], [-3, 40]]
        assert np.hypot(*(stand.position[~hand, :2] - 9).T).min() > 4


@pytest.mark.medium
def test_a_tree_where_there_is_no_ground_is_said(tmp_path):
    np.save(tmp_path / "hill.npy", np.ones((4, 4)))
    field = FIELD.changed(terrain=Terrain(file="hill.npy"))
    planting = OAK.changed(by_hand=TREES, expected=0, variants=3)
    forest = ForestSite.read(Scene(forest=field, plantings=(planting,)), tmp_path).grow()
    assert len(forest.stand) == 2
    assert any("set by hand" in note and "no ground" in note for note in forest.notes)


def test_a_scene_file_holds_them(tmp_path):
    planting = OAK.changed(by_hand=TREES, clearings=(Clearing(position=(1.0, 2.0), radius=3.0),))
    scene = Scene(plantings=(planting,))
    write_settings(tmp_path / "scene.toml", scene)
    assert read_settings(tmp_path / "scene.toml", Scene) == scene
    (tmp_path / "bad.toml").write_text(
        '[[plantings]]\nspecies = "maple"\nexpected = 1\nby_hand = [{ scale = 2 }]\n'
    )
    with pytest.raises(SpecError, match=r"plantings\[0\].by_hand\[0\].*position"):
        read_settings(tmp_path / "bad.toml", Scene)


def grown(planting):
    scene = Scene(seed=4, forest=Forest(size=(20, 20)), plantings=(planting,))
    return ForestSite.read(scene, Path()).grow()


@pytest.mark.medium
def test_trees_grown_to_measure_keep_theirs_where_one_is_set_beside_them():
    """Of drawn trees no bit changes; the one that is set is a variant of theirs in the size of its stem."""
    drawn = Planting(species="scots-pine", expected=3, exact=True, variants=2)
    plain = grown(drawn)
    tree = HandTree(position=(3.0, 4.0), diameter=0.31, variant=5)
    beside = grown(drawn.changed(by_hand=(tree,)))
    own = beside.stand.number >= 0
    assert (beside.wanted[own] == plain.wanted).all()
    assert (beside.stand.scale[own] == plain.stand.scale).all()
    assert beside.variants.keys() == plain.variants.keys()
    assert beside.stand.variant[~own] == [1]
    assert beside.wanted[~own, 0] == [0.31]
    alone = grown(drawn.changed(by_hand=(tree,), expected=0))
    assert alone.wanted[0, 0] == 0.31
