"""The gallery: every card has a scene, a small picture and a sentence, and draws them."""

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon.ui.forest.start import (
    GALLERY,
    PREVIEWS,
    SCENES,
    draw_gallery,
    draw_presets,
    presets,
    words_of,
)

from ..test_panels import Layout

LARGEST = 15_000  # bytes of a picture


@pytest.mark.parametrize("card", GALLERY, ids=lambda card: card.preset)
def test_a_card_has_a_scene_a_small_picture_and_a_sentence(card):
    assert (SCENES / f"{card.preset}.toml").is_file()
    picture = (PREVIEWS / f"{card.preset}.jpg").read_bytes()
    assert picture[:2] == b"\xff\xd8"
    assert len(picture) <= LARGEST
    assert words_of(card.preset) == card.words


@pytest.mark.parametrize("operator", ["forest.start", "forest.new"])
def test_the_gallery_shows_them_all(registered, operator):
    seen = []
    draw_gallery(Layout(seen), operator)
    assert {card.title for card in GALLERY} <= set(seen)


def test_an_entry_says_what_it_is_for(props):
    from forest_addon.ui.forest.start import FOREST_OT_start

    given = type("Given", (), {"preset": "hedge-bat"})()
    assert FOREST_OT_start.description(bpy.context, given) == words_of("hedge-bat")


@pytest.mark.parametrize(
    ("preset", "plantings"), [("maple-walk", 1), ("conifer-drone", 1), ("hedge-bat", 2)]
)
def test_a_scene_of_the_gallery_is_taken(props, preset, plantings):
    assert bpy.ops.forest.start(preset=preset) == {"FINISHED"}
    assert len(props.plantings) == plantings


@pytest.mark.parametrize("operator", ["forest.start", "forest.new"])
def test_the_menu_has_names_and_every_preset_once(registered, operator):
    """A name of a paper's scene says what stands there before it says whose it is."""
    seen, direct = [], []
    draw_presets(Layout(seen), operator)
    layout = Layout(direct)
    layout.menu = lambda *_, **__: None
    draw_presets(layout, operator)
    assert len(direct) <= 10
    others = {title for file, title in presets() if file not in {card.preset for card in GALLERY}}
    assert others <= set(seen)
    assert len(seen) == len(set(seen))
    for title in others:
        assert not title.startswith(("T20", "Fig", "Table")), title
        assert title[0].isupper()
        assert "-" not in title
