"""Names and tooltips of everything that Blender knows of ours, by the rules of docs/glossary.md."""

import re

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import ui

# Words of the glossary's other column: kin of trees, identifiers and left-overs of scene files.
UNWANTED = {
    r"\b(daughters?|mothers?|sisters?|sons?)\b": "child, parent",
    r"\b[a-z]+_[a-z_]+\b": "a word, not an identifier",
    r"\bleft out:": "off:",
    r"\bSd\b|\bCrs\b|\bDbh\b|\bCsv\b|\bLidar\b": "capitals",
    r"\b1 (trees|points|pulses|pings|runs|frames|leaves|channels)\b": "the singular",
    r"\d{4,}(?= (trees|points|pulses))": "thousands with separators",
    r"  |\s$|^\s| [,.;:](\s|$)": "single spaces",
    r"\bmetres a second\b|\bmtr\b|\bsecs?\b": "units as Blender writes them",
}
# Names of columns in files, which must be written as they are there.
COLUMNS = re.compile(r"CSV|counted from 0")
BLENDERS = {"bl_options", "align", "location", "rotation"}  # inherited from its classes
NAMELESS = {"POINTER", "COLLECTION"}  # Blender shows no tooltip of groups and lists themselves
UNSEEN = {  # kept in files, or set by a button for its operator; no panel draws them
    *("layout", "notice", "built", "handle", "thing", "standing", "made_of", "caption", "kind"),
    *("frame", "said", "stale", "shown", "file", "filter_glob", "remove_name", "remove_active"),
    *("sure", "result", "sensor", "scanner", "values", "preset", "directory", "files", "wood"),
    *("leaves", "height", "title", "accept", "filepath", "frames", "keep", "again", "choice"),
    *("colour", "name", "value", "origin", "folder", "grown", "found"),
}


def properties_of(cls):
    """The properties of a class that we wrote, operators' from Blender's own record of them."""
    own = {name for base in cls.__mro__ for name in getattr(base, "__annotations__", {})}
    rna = cls.bl_rna
    if issubclass(cls, bpy.types.Operator):
        room, verb = cls.bl_idname.split(".")
        rna = getattr(getattr(bpy.ops, room), verb).get_rna_type()
    return [known for known in rna.properties if known.identifier in own - BLENDERS]


def texts():
    """(place, text) of every name and tooltip."""
    for cls in ui._classes():
        if getattr(cls, "bl_label", ""):
            yield cls.__name__, cls.bl_label
        if issubclass(cls, bpy.types.Operator):
            words = getattr(cls, "bl_description", "") or (cls.__doc__ or "").strip()
            yield cls.__name__, words.partition("\n\n")[0]
        for known in properties_of(cls):
            place = f"{cls.__name__}.{known.identifier}"
            if known.name != known.identifier:
                yield place, known.name
            yield place, known.description
            for item in getattr(known, "enum_items", ()):
                yield f"{place}.{item.identifier}", item.name
                yield f"{place}.{item.identifier}", item.description


def problems(place, text):
    """Return the faults of a text, in words."""
    if not text:
        return []
    found = [
        f"{place}: {text!r} has {hit.group()!r}; write {instead}"
        for pattern, instead in UNWANTED.items()
        for hit in [re.search(pattern, text)]
        if hit and not (COLUMNS.search(text) and "_" in hit.group())
    ]
    first = text[0]
    if first.islower() and not "α" <= first <= "ω":
        found.append(f"{place}: {text!r} begins with a small letter")
    if re.search(r"\w{6,}\.$", text):
        found.append(f"{place}: {text!r} ends with a full stop, which Blender adds itself")
    return found


def test_every_name_and_tooltip_keeps_the_glossary(registered):
    every = list(texts())
    assert len(every) > 1500
    assert [wrong for place, text in every for wrong in problems(place, text)] == []


@pytest.mark.parametrize(
    "text",
    [
        "How many daughters it bears",
        "Needs max_returns above 1",
        "Extent; left out: as the field",
        "Range Sd",
        "1 pings",
        "10000 points",
        "handle",
        "Stop what is running.",
        "Two  spaces",
    ],
)
def test_the_rules_see_what_is_wrong(text):
    assert problems("here", text)


@pytest.mark.parametrize("text", ["λ of the call", "Children fork", "1 ping", "10,000 points"])
def test_the_rules_let_pass_what_may(text):
    assert problems("here", text) == []


def test_what_is_drawn_has_a_name_and_a_tooltip(registered):
    """Without a name Blender shows the identifier, in small letters and underscores."""
    nameless = [
        f"{cls.__name__}.{known.identifier}"
        for cls in ui._classes()
        for known in properties_of(cls)
        if known.type not in NAMELESS and known.identifier not in UNSEEN
        if known.name == known.identifier or not known.description
    ]
    assert nameless == []


def test_entries_of_a_menu_differ_in_what_they_say(registered):
    """An entry whose tooltip repeats the menu's says nothing of what it does."""
    alike = {
        f"{cls.__name__}.{known.identifier}"
        for cls in ui._classes()
        for known in properties_of(cls)
        if known.type == "ENUM" and len(known.enum_items) > 1
        if len({item.description for item in known.enum_items}) < len(known.enum_items)
    }
    assert alike == set()


@pytest.mark.medium
def test_texts_of_the_code_keep_the_glossary():
    """Messages, labels and buttons, which stand in the code."""
    import sys
    from pathlib import Path

    sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "packaging"))
    try:
        import list_words
    finally:
        sys.path.pop(0)
    every = [(place, text) for _, text, place in list_words.of_code()]
    assert len(every) > 300
    wrong = [
        line
        for place, text in every
        for line in problems(place, text)
        if not re.search("small letter|single spaces|full stop", line)  # parts of lines
        if not re.search(r"\{\w+_\w+\}", text)
    ]
    assert wrong == []
