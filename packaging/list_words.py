"""Writes build/forest_sensing.pot: every text of the panel, as a template for translators (GNU gettext).

Names and help come from the classes that Blender registers, the rest from the code: what ``say``, ``label``
and ``keep`` are given, and plain texts in calls that Blender itself looks up. Operators and their buttons
have a context of their own, as in Blender's catalogs.
"""

from __future__ import annotations

import ast
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

UI = ROOT / "forest_addon" / "ui"
WORDED_FILES = (  # other rooms that say what the panel shows
    *sorted((ROOT / "forest_addon" / "results").glob("*.py")),
    *sorted((ROOT / "forest_addon" / "sensing").glob("*/kind.py")),
)
OURS = {"say", "label", "keep"}  # of ui/shell/words.py and base/words.py
WORDED = {"numbers": 2, "words": 3}  # of results/kind.py: the short name; and the pattern
SHOWN = {"text", "heading", "placeholder"}  # what a layout is given by these names
BUTTONS = {"operator", "operator_menu_enum"}
ANY, OPERATOR = "*", "Operator"
HEADER = """msgid ""
msgstr ""
"Project-Id-Version: Forest Sensing\\n"
"MIME-Version: 1.0\\n"
"Content-Type: text/plain; charset=UTF-8\\n"
"Content-Transfer-Encoding: 8bit\\n"
"""

Text = tuple[str, str, str]  # context, English, where it is


def main() -> None:
    file = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "build" / "forest_sensing.pot"
    file.parent.mkdir(exist_ok=True)
    words = template()
    file.write_text(words, encoding="utf-8")
    print(f"{file} ({words.count('msgid') - 1} texts)")


def template() -> str:
    """The whole file, texts in the order of the alphabet."""
    places: dict[tuple[str, str], set[str]] = {}
    for context, text, place in (*of_code(), *of_classes()):
        places.setdefault((text, context), set()).add(place)
    entries = [HEADER]
    for (text, context), where in sorted(places.items()):
        lines = [f"#: {place}" for place in sorted(where)]
        lines += ["#, python-brace-format"] * ("{" in text)
        lines += [f'msgctxt "{context}"'] * (context != ANY)
        entries.append(
            "\n".join([*lines, f"msgid {json.dumps(text, ensure_ascii=False)}", 'msgstr ""\n'])
        )
    return "\n".join(entries)


def of_code() -> Iterator[Text]:
    """Texts that are given to ``words`` and ``figures`` or, as they are, to Blender."""
    for file in (*sorted(UI.rglob("*.py")), *WORDED_FILES):
        place = file.relative_to(ROOT).as_posix()
        for call in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(call, ast.Call):
                for context, part in _given(call):
                    for text in _plain(part):
                        yield context, text, place


def _given(call: ast.Call) -> Iterator[tuple[str, ast.expr]]:
    """Texts that a call is given to say, with their context."""
    name = getattr(call.func, "attr", getattr(call.func, "id", ""))
    if isinstance(call.func, ast.Name) and name in OURS:
        yield ANY, call.args[0]
    elif isinstance(call.func, ast.Name) and name in WORDED:
        given = [each for arg in call.args for each in _spread(arg)]
        yield from ((ANY, each) for each in given[1 : WORDED[name]])
    elif name == "report":
        yield ANY, call.args[1]
    for given in call.keywords:
        if given.arg in SHOWN:
            yield OPERATOR if name in BUTTONS else ANY, given.value


def _spread(part: ast.expr) -> list[ast.expr]:
    """The parts of ``*("a", "b")``, or the part alone."""
    return part.value.elts if isinstance(part, ast.Starred) else [part]


def _plain(part: ast.expr) -> list[str]:
    """A text, or the two of "this" if so else "that"; none of what is put together or computed."""
    if isinstance(part, ast.IfExp):
        return _plain(part.body) + _plain(part.orelse)
    plain = isinstance(part, ast.Constant) and isinstance(part.value, str) and part.value
    return [part.value] if plain else []


def of_classes() -> Iterator[Text]:
    """Names and help of classes, of their properties, and of what can be chosen there."""
    import bpy

    from forest_addon import ui
    from forest_addon.ui.sensors import panels

    ui.register()
    try:
        for cls in ui._classes():
            for context, text in (*_of_class(bpy, cls), *_of_properties(_described(bpy, cls))):
                if text:
                    yield context, text, cls.__name__
        for name in panels.OF_OBJECTS:
            for context, text in _of_property(bpy.types.Object.bl_rna.properties[name]):
                yield context, text, "Object"
    finally:
        ui.unregister()


def _described(bpy: Any, cls: Any) -> Any:
    """Properties that Blender knows of a class; of an operator its settings as well."""
    if not issubclass(cls, bpy.types.Operator):
        return cls.bl_rna
    room, name = cls.bl_idname.split(".")
    return getattr(getattr(bpy.ops, room), name).get_rna_type()


def _of_class(bpy: Any, cls: Any) -> Iterator[tuple[str, str]]:
    if issubclass(cls, bpy.types.Operator):
        known = _described(bpy, cls)
        yield OPERATOR, known.name
        if "INTERNAL" not in getattr(cls, "bl_options", ()):
            yield ANY, known.description
    elif issubclass(cls, bpy.types.Panel | bpy.types.Menu):
        yield ANY, cls.bl_label
        yield ANY, cls.__dict__.get("__doc__") or ""


def _of_properties(known: Any) -> Iterator[tuple[str, str]]:
    of_blender = known.base.properties.keys() if known.base else ()
    for one in known.properties:
        if one.identifier not in of_blender and not one.is_hidden:
            yield from _of_property(one)


def _of_property(one: Any) -> Iterator[tuple[str, str]]:
    if one.name != one.identifier:
        yield one.translation_context, one.name
    yield ANY, one.description
    for item in one.enum_items_static if one.type == "ENUM" else ():
        yield one.translation_context, item.name
        yield ANY, item.description


if __name__ == "__main__":
    main()
