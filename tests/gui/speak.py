"""A language file in the installed extension, and Blender in that language: ``blender -b --python speak.py``.

The Blender that comes as a module speaks English only, so this is where translations are seen to work.
"""

import bpy
from bl_ext.user_default.forest_sensing.forest_addon.ui.shell import words

import addon_utils  # isort: skip

MODULE = "bl_ext.user_default.forest_sensing"
LANGUAGE = "fr_FR"
CATALOG = """
msgid "{name} is no longer in the scene. Run its sensor again"
msgstr "‹{name}›"

msgid "Nothing is running"
msgstr "‹rien›"

msgid "This picture is no longer there. Run its sensor again"
msgstr "‹image›"

msgid "{density:,.0f} trees/ha"
msgstr "‹{density:,.0f}/ha›"

msgctxt "Operator"
msgid "Grow Forest"
msgstr "‹forêt›"
"""


def refused(operator, **settings) -> str:
    """What Blender says when an operator cannot do what it should."""
    try:
        operator(**settings)
    except RuntimeError as problem:
        return str(problem)
    raise AssertionError("nothing was refused")


def enable_anew() -> None:
    addon_utils.disable(MODULE)
    assert addon_utils.enable(MODULE) is not None


assert bpy.app.build_options.international, "this Blender speaks English only"
file = words.LANGUAGES / f"{LANGUAGE}.po"
kept = words.keep("{density:,.0f} trees/ha", density=1234.4)
file.write_text(CATALOG, encoding="utf-8")
try:
    enable_anew()
    view = bpy.context.preferences.view
    view.language = LANGUAGE
    view.use_translate_interface = view.use_translate_reports = True
    ops = bpy.ops.forest
    assert "‹Points›" in refused(ops.select_result, shown="Points")
    assert "‹rien›" in refused(ops.cancel)
    assert "‹image›" in refused(ops.show_picture, result="none")
    assert words.title_of_operator(bpy.types.FOREST_OT_build) == "‹forêt›"
    assert (kept, words.label_of_kept(kept.made_of)) == ("1,234 trees/ha", "‹1,234/ha›")
    view.use_translate_reports = False
    assert "Points is no longer" in refused(ops.select_result, shown="Points")
finally:
    file.unlink()
enable_anew()
view.use_translate_reports = True
assert "Points is no longer" in refused(bpy.ops.forest.select_result, shown="Points")
print("the panel speaks another language, and English again without its file")
