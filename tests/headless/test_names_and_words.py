"""Scenes by their names on the command line, what it says, and what a report calls a forest."""

import re
import time
from pathlib import Path

import pytest

pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.base.places import ASSETS
from forest_addon.site import ForestSite
from headless import progress
from headless.command import read_scene, scene_file
from headless.report.page import _stand_in_words


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


def test_a_part_of_a_name_is_answered_with_the_names_that_have_it():
    birch = spec.Scene(plantings=(spec.Planting(species="birch", expected=9),))
    said = r'plantings\[0\]\.species: "birch" is not known; did you mean "honda-birch" or "silver-b'
    with pytest.raises(spec.SpecError, match=said):
        ForestSite.read(birch)


def test_a_table_where_a_list_of_tables_belongs_is_told_its_brackets(tmp_path):
    (tmp_path / "one.toml").write_text('[plantings]\nspecies = "maple"\nexpected = 3\n')
    with pytest.raises(spec.SpecError, match=r"plantings: is one table.*\[\["):
        read_scene(tmp_path / "one.toml", None)


def test_limits_are_said_by_all_their_digits():
    with pytest.raises(spec.SpecError, match=r"-1 .*from 0 to 9,223,372,036,854,775,807$"):
        spec.Scene(seed=-1)


def test_a_thinned_forest_is_not_called_poisson_alone():
    scene = spec.Scene(plantings=(spec.Planting(species="maple", expected=9),))
    assert _stand_in_words(scene, 0) == "A Poisson forest"
    assert "thinned" in _stand_in_words(scene, 2)


def test_what_is_said_beside_a_bar_begins_its_line(monkeypatch, capsys):
    """The terminal's line is what follows the last return to its begin."""
    monkeypatch.setattr(progress, "DELAY", 0.01)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    stages = progress.Stages(quiet=False)
    with stages.stage("scan") as shown:
        time.sleep(0.15)  # a bar is drawn anew after 0.1 s
        shown(1, 1)
        stages.say("  checked")
    lines = [re.split("\r", line)[-1] for line in capsys.readouterr().err.split("\n")]
    assert lines[0] == "  checked"
    assert lines[1].startswith("  scan")
