"""What is made ahead of a build is what the build would make, and nothing is made of what stands already."""

from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.blender.scene import assets, ready
from forest_addon.blender.scene.forest import build, shapes_in
from forest_addon.blender.scene.layout import OUTLINES, VARIANTS, part
from forest_addon.growth.library.species_file import load_species
from forest_addon.stand.forest import grow_forest


def settings(seed):
    planting = spec.Planting(species="apple-stochastic", variants=2, expected=4, exact=True)
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


def test_a_build_of_what_was_made_ahead_is_the_same(monkeypatch):
    monkeypatch.setattr(assets, "DOTS", 2000)
    asked, told = settings(3), []
    forest = grown(asked)
    plain, other = bpy.data.scenes.new("plain"), bpy.data.scenes.new("other")
    build(plain, asked, forest)
    made = ready.make_ready(forest, (), True, lambda done, total: told.append((done, total)))
    assert told == [(0, 2), (1, 2)]
    for name in ("portray", "stand_in", "fingerprint"):  # or it was in vain
        monkeypatch.setattr(ready, name, lambda *_: pytest.fail("made twice"))
    build(other, asked, forest, ready=made)
    assert library(other) == library(plain)
    monkeypatch.undo()
    assert not ready.make_ready(forest, shapes_in(plain), True, lambda *_: None).portraits
    anew = grown(settings(4))
    new = ready.make_ready(anew, shapes_in(plain), False, lambda *_: None)
    assert len(new.portraits) == len(anew.variants)
    assert not new.stand_ins
