"""Which engine casts: chosen, found wherever Blender keeps it, refused when it is not to be trusted."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy")

from forest_addon.blender.rays import casters, embree as embree_library
from forest_addon.blender.rays.bvh import BvhCaster
from forest_addon.blender.rays.casters import make_caster
from forest_addon.blender.rays.embree import EmbreeCaster
from forest_addon.sensing.rays.caster import Hits
from forest_addon.spec import Rays

SCENE = casters._trial_scene()


@pytest.fixture(autouse=True)
def _anew():
    """Load and try the library again in each test, and after the last."""
    for known in (embree_library.load, casters.embree_problem):
        known.cache_clear()
    yield
    for known in (embree_library.load, casters.embree_problem):
        known.cache_clear()


def test_settings_choose_the_engine():
    assert make_caster(SCENE, Rays()).engine == "embree"
    assert make_caster(SCENE, Rays(engine="embree", threads=3)).threads == 3
    assert make_caster(SCENE, Rays(engine="bvhtree")).engine == "bvhtree"


def test_without_the_library_auto_falls_back_and_embree_says_why(monkeypatch):
    monkeypatch.setattr(embree_library, "_places", lambda: iter(["no-such-library.so"]))
    assert make_caster(SCENE, Rays()).engine == "bvhtree"
    with pytest.raises(ValueError, match="no Embree 4 beside Blender") as error:
        make_caster(SCENE, Rays(engine="embree"))
    assert "no-such-library.so" in str(error.value)


def test_a_library_that_is_no_embree_is_passed_over(monkeypatch):
    other = sys.modules["_ctypes"].__file__
    if other is None:
        pytest.skip("ctypes is built in here")
    places = [other, *embree_library._places()]
    monkeypatch.setattr(embree_library, "_places", lambda: iter(places))
    assert make_caster(SCENE, Rays()).engine == "embree"


def test_another_version_is_refused(monkeypatch):
    monkeypatch.setattr(embree_library, "VERSION_PROPERTY", 1)  # its major number alone: 4
    assert make_caster(SCENE, Rays()).engine == "bvhtree"
    assert "version 0, not 4" in casters.embree_problem()


def test_an_engine_that_finds_something_else_is_not_trusted(monkeypatch):
    def wrong(self, origins, directions, *limits, **more):
        return Hits.misses(len(np.asarray(origins)))

    monkeypatch.setattr(EmbreeCaster, "cast", wrong)
    assert make_caster(SCENE, Rays()).engine == "bvhtree"
    assert casters.embree_problem() == "it does not find what is there"


@pytest.mark.skipif(sys.platform != "linux", reason="the layout of official builds for Linux")
@pytest.mark.parametrize("folder", ["lib", "blender.shared", "."])
def test_the_library_is_found_in_every_layout(tmp_path, monkeypatch, folder):
    here = Path(next(embree_library._places()))
    assert here.name.startswith("libembree4.so")
    place = tmp_path / folder
    place.mkdir(exist_ok=True)
    shutil.copy(here, place)
    monkeypatch.setattr(
        embree_library.bpy.utils, "resource_path", lambda kind: str(tmp_path / "5.2")
    )
    assert Path(next(embree_library._places())).resolve() == (place / here.name).resolve()


def test_the_engines_share_one_search():
    rays = (SCENE.transform[:, :, 3] - [0, 0, 5.0], np.tile([0.01, 0.02, 1.0], (3, 1)))
    first, second = (engine(SCENE).cast(*rays) for engine in (BvhCaster, EmbreeCaster))
    assert first.found.any()
    assert (first.distance == second.distance).all()
