"""What is made ahead of a build is what the build would make, and nothing is made of what stands already."""

from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.base.trimesh import GROUND
from forest_addon.blender.scene import assets
from forest_addon.blender.scene import forest as forest_scene
from forest_addon.blender.scene.forest import build, shapes_in
from forest_addon.blender.scene.layout import OUTLINES, VARIANTS, part
from forest_addon.blender.scene.placing import fingerprint
from forest_addon.growth.library import load_species
from forest_addon.stand.forest import grow_forest


def settings(seed):
    planting = spec.Planting(species="apple-stochastic", variants=2, expected=12, exact=True)
    field = spec.Forest(size=(20.0, 20.0), instancing="points")
    return spec.Scene(seed=seed, forest=field, plantings=(planting,))


def grown(asked):
    kind, template = load_species(ASSETS / "species" / "apple-stochastic.toml")
    young = replace(kind, grammar=replace(kind.grammar, generations=1))
    return grow_forest(asked, [(young, template)])


def library(scene):
    """Shape, custom properties and picture of every variant, and the corners of its stand-in."""
    found = []
    for thing in part(scene, VARIANTS).objects:
        data, picture = thing.data, np.empty(4 * assets.PIXELS**2, np.float32)
        thing.preview.image_pixels_float.foreach_get(picture)
        said = {key: value for key, value in data.items() if key.endswith(("_m", "_m2", "_m3"))}
        found.append((data["forest_shape"], said, picture.tobytes()))
    corners = [[tuple(v.co) for v in t.data.vertices] for t in part(scene, OUTLINES).objects]
    return found, corners


@pytest.mark.slow
def test_a_build_of_what_was_made_ahead_is_the_same(monkeypatch):
    monkeypatch.setattr(assets, "DOTS", 2000)
    asked, heard = settings(3), []
    forest = grown(asked)
    plain, other = bpy.data.scenes.new("plain"), bpy.data.scenes.new("other")
    build(plain, asked, forest)
    made = forest_scene.make_ready(
        forest, (), True, lambda done, total: heard.append((done, total))
    )
    assert heard == [(0, 2), (1, 2)]
    again = []  # fingerprints are taken of the ground alone
    monkeypatch.setattr(forest_scene, "stand_in", lambda *_: pytest.fail("made twice"))
    monkeypatch.setattr(
        forest_scene, "fingerprint", lambda mesh: again.append(mesh) or fingerprint(mesh)
    )
    build(other, asked, forest, ready=made)
    assert [set(mesh.part) for mesh in again] == [{GROUND}]
    assert library(other) == library(plain)
    monkeypatch.undo()
    anew = grown(settings(4))
    assert not forest_scene.make_ready(anew, shapes_in(plain), False, lambda *_: None).stand_ins


@pytest.mark.slow
def test_measures_and_pictures_can_follow_once_the_forest_stands(monkeypatch):
    """As a window does it: nothing of the forest before is told of the new one meanwhile."""
    monkeypatch.setattr(assets, "DOTS", 2000)
    asked, other = settings(3), settings(4)
    forest, anew = grown(asked), grown(other)
    at_once, later = bpy.data.scenes.new("at once"), bpy.data.scenes.new("later")
    build(at_once, other, anew)
    build(later, asked, forest)
    assert assets.untold(later, forest) == []
    build(later, other, anew, as_assets=False)
    wanted = assets.untold(later, anew)
    assert set(wanted) == set(anew.variants)
    assert not any("height_m" in thing.data for thing in part(later, VARIANTS).objects)
    first, second = part(later, VARIANTS).objects
    second.asset_clear()
    assets.tell_variants(later, anew, forest_scene.tell_of(anew, wanted[:1]))  # cancelled half way
    assert assets.untold(later, anew) == wanted[1:]
    assets.tell_variants(later, anew, forest_scene.tell_of(anew, wanted[1:]))
    assert assets.untold(later, anew) == []
    assert second.asset_data is None  # the user's choice
    second.asset_mark()
    told = forest_scene.tell_of(anew, wanted)[wanted[1]]
    assets.mark_asset(second, told.description, ("tree", anew.labels[0]), told.picture)
    assert library(later) == library(at_once)
    assert first.data["height_m"] == pytest.approx(anew.variants[wanted[0]].height)
