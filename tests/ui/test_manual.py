"""F1: every button and setting of ours leads to a place that the manual has."""

import importlib.util
import re
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.ui.settings import preferences

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The manual as the extension carries it, by file name."""
    spec = importlib.util.spec_from_file_location("wm", ROOT / "packaging/write_manual.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    folder = tmp_path_factory.mktemp("manual")
    module.write_manual(folder)
    texts = {path.name: path.read_text(encoding="utf-8") for path in folder.glob("*.html")}
    return folder, texts


def names_of_ours():
    """As Blender names what is under the mouse: operators, and properties of their groups."""
    for name in dir(bpy.ops.forest):
        yield f"bpy.ops.forest.{name}"
    for group in bpy.types.PropertyGroup.__subclasses__():
        if group.__name__.startswith("FOREST_PG_") and group.is_registered:
            keys = group.bl_rna.properties.keys()
            yield from (f"bpy.types.{group.__name__}.{key}" for key in keys)


def found(name, mapping):
    """As Blender looks it up: the first pattern that fits the name in small letters."""
    return next((page for pattern, page in mapping if fnmatchcase(name.lower(), pattern)), None)


@pytest.mark.slow
def test_everything_leads_to_a_place_that_is_there(registered, pages):
    _, texts = pages
    names, mapping = list(names_of_ours()), list(preferences._pages())
    assert len(names) > 400
    for name in names:
        page, _, place = (found(name, mapping) or "nowhere").partition("#")
        assert page in texts, name
        assert not place or f'id="{place}"' in texts[page], (name, place)


def test_a_setting_leads_to_its_own_line(registered):
    mapping = list(preferences._pages())
    lines = {
        "bpy.types.FOREST_PG_sonar.tolerance": "scene-file.html#sonar.tolerance",
        "bpy.types.FOREST_PG_sonar.use_record": "scene-file.html#sonar.record",
        "bpy.ops.forest.import_tree": "template.html",
    }
    assert {name: found(name, mapping) for name in lines} == lines


def test_pages_show_pictures_and_lead_to_each_other_alone(pages):
    folder, texts = pages
    for name, text in texts.items():
        for picture in re.findall(r'src="([^"]+)"', text):
            assert (folder / picture).is_file(), (name, picture)
        for link in re.findall(r'href="([^"]+)"', text):
            if not link.startswith(("http", "#")):
                page, _, place = link.partition("#")
                assert page in texts, (name, link)
                assert not place or f'id="{place}"' in texts[page], (name, link)


def test_blender_is_told_where_they_are_and_forgets_it(registered):
    prefix, mapping = next(found for found in bpy.utils.manual_map() if "forest" in str(found[1]))
    assert (Path(prefix.removeprefix("file://")) / mapping[0][1].partition("#")[0]).is_file()
