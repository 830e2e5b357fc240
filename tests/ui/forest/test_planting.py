"""The hand that plants: what a stroke sets, clears and takes back, in trees that are objects or points."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from mathutils import Vector
from ui.pressing import press

from forest_addon.blender.scene.instances import stood_trees
from forest_addon.ui.forest import planting
from forest_addon.ui.forest.hand import Hand, swap_tree, take_away
from forest_addon.ui.forest.planting import FOREST_OT_plant, ground_below


def places():
    return np.array(sorted(tree.place for tree in stood_trees(bpy.context.scene))).reshape(-1, 2)


@pytest.fixture(params=["objects", "points"])
def hand(small, request):
    small.forest.instancing = request.param
    small.plantings[0].expected, small.plantings[0].exact = 5, True
    small.plantings[0].variants = 2
    assert press("build") == {"FINISHED"}
    one = Hand(bpy.context.scene, np.random.default_rng(5))
    one.look()
    return one


@pytest.mark.medium
def test_a_click_sets_a_tree_exactly_there(hand, small):
    before = places()
    hand.begin()
    hand.plant(small.plantings[0], (4.5, -3.25))
    press("build")
    assert len(places()) == len(before) + 1
    assert (4.5, -3.25) in map(tuple, places().tolist())


@pytest.mark.medium
def test_a_drag_fills_the_disc_up_to_its_density_and_no_further(hand, small):
    planting, before = small.plantings[0], len(hand.trees)
    middle, radius, density = (40.0, 40.0), 5.0, 0.25
    assert hand.scatter(planting, middle, radius, density) == round(density * np.pi * 25)
    assert hand.scatter(planting, middle, radius, density) == 0
    press("build")
    there = places()
    within = np.hypot(*(there - middle).T) <= radius + 1e-4
    assert within.sum() == len(there) - before == 20
    apart = np.linalg.norm(there[within][:, None] - there[within][None], axis=2)
    assert apart[~np.eye(20, dtype=bool)].min() > 0.6 / np.sqrt(density) - 1e-4


@pytest.mark.slow
def test_a_cleared_disc_stays_free_and_can_be_taken_back(hand, small):
    first = places()
    hand.begin()
    hand.plant(small.plantings[0], (3.0, 3.0))
    hand.begin()
    assert hand.erase((3.0, 3.0), 100.0) == len(first) + 1
    small.seed += 1
    press("build")
    assert len(places()) == 0
    small.seed -= 1
    assert hand.take_back()
    assert hand.take_back()
    assert not hand.take_back()
    press("build")
    assert places() == pytest.approx(first)


@pytest.mark.medium
def test_one_tree_is_moved_changed_and_removed(hand, small):
    tree = hand.nearest(tuple(places()[0]), 0.1)
    hand.change(tree, place=(-5.0, 12.0))
    press("build")
    assert (-5.0, 12.0) in map(tuple, places().tolist())
    hand.look()
    tree = hand.nearest((-5.0, 12.0), 0.1)
    hand.change(tree, swap_tree)
    press("build")
    hand.look()
    now = hand.nearest((-5.0, 12.0), 0.1)
    assert now.variant == (tree.variant + 1) % 2
    assert (now.rotation, now.scale) == pytest.approx((tree.rotation, tree.scale), abs=1e-4)
    count = len(hand.trees)
    hand.change(now, take_away)
    press("build")
    assert len(places()) == count - 1
    assert len(small.plantings[0].by_hand) == 0


@pytest.mark.medium
@pytest.mark.parametrize(
    ("event", "passes"),
    [({"type": "MOUSEMOVE"}, "PASS_THROUGH"), ({"type": "RIGHT_BRACKET"}, "RUNNING_MODAL")],
)
def test_the_brush_follows_the_mouse_and_its_keys(hand, event, passes):
    drawn = []
    area = SimpleNamespace(tag_redraw=lambda: drawn.append(1))
    brush = SimpleNamespace(
        over=False, stroke="", hand=hand, area=area, _below=lambda *_: Vector((1, 2, 0))
    )
    brush._key = partial(FOREST_OT_plant._key, brush)
    given = {"value": "PRESS", "ctrl": False, "oskey": False, "alt": False} | event
    assert FOREST_OT_plant.heed(brush, bpy.context, SimpleNamespace(**given)) == {passes}
    assert drawn


def test_what_the_brush_has_seen_is_looked_at_again_after_undo(registered, monkeypatch):
    """Undo makes objects anew: to move one that is gone would end Blender."""
    looked = []
    seen = SimpleNamespace(scene=None, look=lambda: looked.append(1))
    brush = SimpleNamespace(hand=seen, moved="a tree")
    monkeypatch.setattr(planting, "_working", brush)
    for name, heard in planting.WINDOW_HANDLERS:
        if name in ("undo_post", "redo_post"):
            heard(bpy.context.scene)
    assert len(looked) == 2
    assert (brush.moved, seen.scene) == (None, bpy.context.scene)


def test_a_brush_that_fails_is_put_away(registered):
    ended = []
    brush = SimpleNamespace(heed=lambda *_: 1 / 0, _end=ended.append)
    with pytest.raises(ZeroDivisionError):
        FOREST_OT_plant.modal(brush, bpy.context, SimpleNamespace())
    assert ended == [bpy.context]


@pytest.mark.medium
def test_the_ground_is_found_below_the_mouse(hand):
    place = ground_below(bpy.context, Vector((1, 2, 9)), Vector((0, 0, -1)))
    assert tuple(place) == pytest.approx((1, 2, 0), abs=1e-5)
    far = ground_below(bpy.context, Vector((900, 2, 9)), Vector((0, 0.6, -0.8)))
    assert far.z == pytest.approx(0, abs=1e-5)
    assert ground_below(bpy.context, Vector((900, 2, 9)), Vector((0, 0, 1))) is None
