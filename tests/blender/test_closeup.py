"""Pictures from near: a walker stands clear of stems and sees many; close-ups look at what they name."""

from pathlib import Path

import bpy
import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.blender.scene.instances import IGNORED_KEY
from forest_addon.blender.show.preview import (
    AHEAD,
    CLEAR,
    EYE,
    HALF_VIEW,
    NAME,
    SHOTS,
    grow_around,
    set_stage,
    stand_walker,
    walkers_view,
)
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.measured.allometry import Wanted
from forest_addon.growth.tree import grow, without_leaves
from forest_addon.spec import SpecError


def stems(count=80, size=30.0):
    return stream(5, "stems").uniform(0, size, (count, 2))


def test_a_walker_stands_clear_of_stems_and_sees_many():
    trees = stems()
    tall = np.full(len(trees), 15.0)
    place, turn = walkers_view(trees, tall, np.array([15.0, 15.0]), 15.0)
    offset = trees - place
    far = np.hypot(*offset.T)
    assert far.min() >= CLEAR
    aside = (np.arctan2(offset[:, 1], offset[:, 0]) - turn + np.pi) % (2 * np.pi) - np.pi
    seen = (np.abs(aside) < HALF_VIEW) & (far < AHEAD)
    assert seen.sum() > 0.3 * len(trees)
    again = walkers_view(trees, tall, np.array([15.0, 15.0]), 15.0)
    assert again[0].tolist() == place.tolist()


def test_a_walker_without_trees_looks_into_the_field():
    place, turn = walkers_view(np.empty((0, 2)), np.empty(0), np.array([5.0, 5.0]), 5.0)
    assert place.tolist() == [5.0, 0.0]
    assert turn == pytest.approx(np.pi / 2)


@pytest.mark.slow
def test_undergrowth_of_a_picture_is_no_part_of_the_scene(empty_blender):
    scene = bpy.context.scene
    set_stage(scene, (64, 32))
    trees = stems()
    sloped = lambda points: 0.1 * points[:, 0]  # noqa: E731
    tall, middle = np.full(len(trees), 9.0), np.array([15.0, 15.0])
    grow_around(scene, *stand_walker(scene, trees, tall, middle, 15.0, sloped), sloped)
    plants = list(bpy.data.collections[NAME].objects)
    assert len(plants) > 100
    assert all(plant[IGNORED_KEY] and plant.hide_viewport for plant in plants)
    assert len({plant.data.name for plant in plants}) < 20  # patches are shared
    for plant in plants:
        assert plant.location.z == pytest.approx(0.1 * plant.location.x, abs=0.02)
    camera = scene.camera.location
    assert camera.z == pytest.approx(0.1 * camera.x + EYE, abs=1e-3)


@pytest.fixture(scope="module")
def birch():
    species, kind = load_species(find_species("silver-birch", Path()))
    return species, grow(species, kind, stream(2, "close"), Wanted(0.2, 14.0, 4.0, 4.0, 20.0))


def test_bark_is_seen_from_a_metre(birch):
    species, tree = birch
    view = SHOTS["bark"](species, tree)
    assert np.hypot(*view.eye[:2]) == pytest.approx(1.1, abs=0.15)
    assert np.linalg.norm(view.eye - view.target) == pytest.approx(1.0, abs=0.01)


def test_a_twig_stands_between_the_eye_and_the_sun(birch):
    species, tree = birch
    view = SHOTS["twig"](species, tree)
    ahead = view.target - view.eye
    assert ahead @ view.sun > 0.5 * np.linalg.norm(ahead)
    near = np.linalg.norm(tree.leaves.centre - view.target, axis=1) < 0.3
    assert near.sum() >= 3


def test_a_fork_is_where_a_limb_leaves_the_stem(birch):
    species, tree = birch
    view = SHOTS["fork"](species, tree)
    wood = tree.skeleton
    heads = (wood.order == 1) & (wood.order[np.maximum(wood.parent, 0)] == 0)
    assert np.linalg.norm(wood.start[heads] - view.target, axis=1).min() < 0.5


def test_a_bare_tree_has_no_twig_against_the_light(birch):
    species, tree = birch
    with pytest.raises(SpecError, match="bears no leaves"):
        SHOTS["twig"](species, without_leaves(tree))
