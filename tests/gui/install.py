"""Install and enable the extension in this Blender, and speak French with it for a moment.

``blender -b --python install.py -- ARCHIVE``. The Blender that comes as a module speaks English only, so this
is where translations are seen to work.
"""

import sys
from importlib import import_module

import bpy

import addon_utils  # isort: skip

MODULE = "bl_ext.user_default.forest_sensing"
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
    """Sentence of Blender when an operator cannot do what it should."""
    try:
        operator(**settings)
    except RuntimeError as problem:
        return str(problem)
    raise AssertionError("nothing was refused")


def enable_anew() -> None:
    addon_utils.disable(MODULE)
    assert addon_utils.enable(MODULE) is not None


installed = bpy.ops.extensions.package_install_files(
    filepath=sys.argv[-1], repo="user_default", enable_on_install=True
)
assert installed == {"FINISHED"}, installed
assert addon_utils.check(MODULE)[1], "installed but not enabled"
bpy.ops.wm.save_userpref()

assert bpy.app.build_options.international, "this Blender speaks English only"
shell = f"{MODULE}.forest_addon.ui.shell"
words = import_module(f"{shell}.words")
file = words.LANGUAGES / "fr_FR.po"
kept = words.keep("{density:,.0f} trees/ha", density=1234.4)
view, ops = bpy.context.preferences.view, bpy.ops.forest
file.write_text(CATALOG, encoding="utf-8")
try:
    enable_anew()
    view.language = file.stem
    view.use_translate_interface = view.use_translate_reports = True
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
assert "Points is no longer" in refused(ops.select_result, shown="Points")
