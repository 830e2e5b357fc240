"""Scenes by their names on the command line, and what a report calls a forest."""

from pathlib import Path

import pytest

pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.base.places import ASSETS
from headless.command import read_scene, scene_file
from headless.report.findings import _stand_in_words


def test_a_shipped_scene_goes_by_its_name_unless_a_file_has_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert scene_file("hedge-bat") == ASSETS / "scenes" / "hedge-bat.toml"
    assert read_scene(scene_file("hedge-bat"), 3).seed == 3
    assert scene_file("hedge-bat.toml") == Path("hedge-bat.toml")
    assert scene_file("other/hedge-bat") == Path("other/hedge-bat")
    (tmp_path / "hedge-bat").touch()
    assert scene_file("hedge-bat") == Path("hedge-bat")


def test_a_mistyped_scene_is_answered_with_the_nearest():
    with pytest.raises(spec.SpecError, match='did you mean "hedge-bat"'):
        read_scene(scene_file("hedge-bet"), None)


def test_a_thinned_forest_is_not_called_poisson_alone():
    scene = spec.Scene(plantings=(spec.Planting(species="maple", expected=9),))
    assert _stand_in_words(scene, 0) == "A Poisson forest"
    assert "thinned" in _stand_in_words(scene, 2)
