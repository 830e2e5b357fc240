"""F1: everything of ours leads to a part of a page that is there, without a network."""

import re
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

bpy = pytest.importorskip("bpy")

import bl_operators.wm as wm

from forest_addon import ui
from forest_addon.ui import manual


def opened(rna):
    """Where Blender's own search leads for an identifier: the file, and the part of it."""
    url = wm.WM_OT_doc_view_manual._lookup_rna_url(rna, verbose=False)
    assert url is not None, rna
    assert url.startswith("file:///"), f"{rna} leads to {url}"
    return Path(unquote(urlsplit(url).path)), unquote(urlsplit(url).fragment)


@pytest.fixture
def anchors(props):
    return set(re.findall(r' id="([^"]+)"', manual.page()))


def names():
    """Of all operators, groups and properties of ours, as F1 asks for them."""
    for cls in ui._classes():
        if issubclass(cls, bpy.types.Operator):
            yield f"bpy.ops.{cls.bl_idname}"
            known = bpy.ops
            for part in cls.bl_idname.split("."):
                known = getattr(known, part)
            inner = known.get_rna_type().properties
            yield from (f"bpy.ops.{cls.bl_idname}.{p.identifier}" for p in inner)
        elif issubclass(cls, bpy.types.PropertyGroup):
            yield f"bpy.types.{cls.__name__}"
            yield from (f"bpy.types.{cls.__name__}.{p.identifier}" for p in cls.bl_rna.properties)
    for thing in ("Object.forest_seen", "Object.forest_sensor", "Scene.forest_sensing"):
        yield f"bpy.types.{thing}"


def test_every_operator_group_and_property_has_a_page(anchors):
    prefix, links = manual.manual_map()
    assert Path(unquote(urlsplit(prefix).path)).is_file()
    table = [(pattern, target) for pattern, target in links]
    assert {target.removeprefix("#") for _, target in table} <= anchors
    exact = dict(reversed(table))  # the first counts
    for name in names():
        whole = name.lower()
        assert whole in exact or f"{whole.rpartition('.')[0]}.*" in exact, name


def test_blender_finds_it(anchors):
    for rna, anchor in (
        ("bpy.ops.forest.run", "forest.run"),
        ("bpy.ops.forest.run_frames", "forest.run_frames"),
        ("bpy.types.FOREST_PG_sonar.band", "forest_pg_sonar.band"),
        ("bpy.types.Object.forest_seen", "object.forest_seen"),
    ):
        path, part = opened(rna)
        assert part == anchor
        assert f'id="{part}"' in path.read_text(encoding="utf-8")


def test_others_links_stay_blenders(props):
    url = wm.WM_OT_doc_view_manual._lookup_rna_url("bpy.types.Object.location", verbose=False)
    assert url is None or "docs.blender.org" in url


def test_the_page_says_ranges_and_what_entries_do(props):
    page = manual.page()
    assert "The empty tab has two doors" in page
    assert "A pulse that has every frequency of the band at once" in page
    assert "<code>make extension</code>" in page
    assert page.count("<h3") > 50


def test_it_goes_with_the_add_on(registered):
    assert manual.manual_map in bpy.utils._manual_map
    ui.unregister()
    try:
        assert manual.manual_map not in bpy.utils._manual_map
    finally:
        ui.register()
