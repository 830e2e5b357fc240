"""Texts can be translated: none with values in it passes Blender's catalogs by, and languages come out."""

import ast
import importlib.util
import json
import re
import shutil
import string
import subprocess
import sys
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import ui
from forest_addon.ui.settings import preferences
from forest_addon.ui.shell import words

ROOT = Path(__file__).resolve().parents[2]
FILES_ROOT = ROOT / "forest_addon" / "ui"
FILES = sorted(FILES_ROOT.rglob("*.py"))
CODE = {
    str(file.relative_to(FILES_ROOT)): ast.parse(file.read_text(encoding="utf-8")) for file in FILES
}
RESULTS = sorted((ROOT / "forest_addon" / "results").glob("*.py"))
OURS = {"say", "label", "keep"}
# Where a text is shown: the number of the argument, or its name.
SHOWN = {"report": 1, "poll_message_set": 0, "status_text_set": 0, "SpecError": 1, "Task": 0}
SHOWN_BY_NAME = {"text", "heading", "placeholder"}
UNITS = {"m", "s", "ms", "MB", "dB", "kHz"}
NAMES_OF_DATA = {
    "{} hill",
    "{} bark",
    "{} leaf",
    "Forest {}",
    "Remove the chosen {}",
}  # things are found by these again
NAMES_OF_PROPERTIES = {"Use {}"}  # the template has each of them, from Blender


def packaging(name):
    """A script of packaging/ as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / f"packaging/{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def name_of(call):
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def calls(*names):
    """(file, call) of every call of these functions of ours."""
    for file, tree in CODE.items():
        for node in ast.walk(tree):
            known = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
            if known and node.func.id in names and file != "shell/words.py":
                yield f"{file}:{node.lineno}", node


def has_words(text):
    return bool(set(re.findall(r"[^\W\d_]+", text)) - UNITS)


def pattern_of(joined):
    """An f-string with {} in place of its values."""
    return "".join(p.value if isinstance(p, ast.Constant) else "{}" for p in joined.values)


def put_together(node):
    """Words that are joined with values on the spot: f-strings, sums, % and .format."""
    if isinstance(node, ast.Call) and name_of(node) in OURS:
        return []
    found = []
    if isinstance(node, ast.JoinedStr) and has_words(pattern_of(node)):
        found.append(pattern_of(node))
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Mod):
        found += [
            side.value
            for side in (node.left, node.right)
            if isinstance(side, ast.Constant) and isinstance(side.value, str)
        ]
    if isinstance(node, ast.Call) and name_of(node) == "format":
        found.append(ast.unparse(node))
    if isinstance(node, ast.FormattedValue):  # not its format
        return found + put_together(node.value)
    return found + [text for child in ast.iter_child_nodes(node) for text in put_together(child)]


def shown_parts(tree):
    """What is given to calls that show it."""
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call):
            continue
        number = SHOWN.get(name_of(call))
        if number is not None and len(call.args) > number:
            yield call.args[number]
        yield from (given.value for given in call.keywords if given.arg in SHOWN_BY_NAME)


@pytest.mark.parametrize("file", CODE)
def test_what_is_shown_is_put_together_by_the_catalogs(file):
    found = [text for part in shown_parts(CODE[file]) for text in put_together(part)]
    assert found == []


@pytest.mark.parametrize("file", CODE)
def test_no_sentence_is_put_together_elsewhere(file):
    """A sentence that is returned and reported by another: words and spaces in an f-string."""
    joined = [pattern_of(n) for n in ast.walk(CODE[file]) if isinstance(n, ast.JoinedStr)]
    sentences = {text for text in joined if " " in text and has_words(text)}
    assert sentences - NAMES_OF_DATA - NAMES_OF_PROPERTIES == set()


@pytest.mark.parametrize(
    ("code", "passes"),
    [
        ('self.report({"INFO"}, f"{n} stems")', False),
        ('row.label(text="stems: " + str(n))', False),
        ('row.label(text="%d stems" % n)', False),
        ('row.label(text="{} stems".format(n))', False),
        ('cls.poll_message_set("a" if x else f"{job} runs")', False),
        ('row.label(text=f"{x:.2f} m")', True),
        ('row.label(text=say("a {b}", b=c))', True),
    ],
)
def test_the_rule_sees_what_is_put_together_and_lets_pass_what_may(code, passes):
    found = [text for part in shown_parts(ast.parse(code)) for text in put_together(part)]
    assert (not found) == passes


def test_poll_messages_are_looked_up():
    """Blender shows them as they are given."""
    literal = [
        f"{file}:{call.lineno}"
        for file, tree in CODE.items()
        for call in ast.walk(tree)
        if isinstance(call, ast.Call) and name_of(call) == "poll_message_set"
        if isinstance(call.args[0], ast.Constant)
    ]
    assert literal == []


def figures_in_words():
    """(place, pattern, keywords) of every figure of a result that is said in words."""
    found = [(f.name, c) for f in RESULTS for c in ast.walk(ast.parse(f.read_text("utf-8")))]
    for file, call in found:
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "words":
            spread = [a.value.elts if isinstance(a, ast.Starred) else [a] for a in call.args]
            yield (
                f"{file}:{call.lineno}",
                [a for part in spread for a in part][2],
                call.keywords,
            )


def test_every_pattern_is_filled_with_what_it_names():
    known = [(place, call.args[0], call.keywords) for place, call in calls(*OURS)]
    figures = list(figures_in_words())
    assert len(known) > 90
    assert len(figures) > 10
    for place, pattern, keywords in known + figures:
        given = {one.arg for one in keywords}
        if not isinstance(pattern, ast.Constant):  # a text that was kept, or a figure's
            assert given <= {None}, place
            assert not isinstance(pattern, ast.JoinedStr | ast.BinOp), place
        elif given:
            named = {name for _, name, _, _ in string.Formatter().parse(pattern.value) if name}
            assert named == given, place
        else:
            assert not re.search(r"{\w*[:!}]", pattern.value), place


# ---------------------------------------------------------------------------------------- catalogs


PO = """
msgid ""
msgstr "Content-Type: text/plain; charset=UTF-8\\n"

#: somewhere
#, python-brace-format
msgid "{count:,} stems"
msgstr "Stämme: {count:,}"

msgctxt "Operator"
msgid "Paint"
msgstr "Malen"

msgid "a text that "
"goes on, \\"so\\""
msgstr ""
"und so "
"weiter"

#, fuzzy, python-brace-format
msgid "{seed} is too large"
msgstr "{seed} ist klein"

msgid "nothing yet"
msgstr ""
"""


def test_a_po_file_is_read():
    assert words.read_catalog(PO) == {
        ("*", "{count:,} stems"): "Stämme: {count:,}",
        ("Operator", "Paint"): "Malen",
        ("*", 'a text that goes on, "so"'): "und so weiter",
    }


@pytest.mark.parametrize("file", sorted(words.LANGUAGES.glob("*.po")), ids=lambda file: file.stem)
def test_each_language_has_the_fields_of_the_english(file):
    for (_, text), translated in words.read_catalog(file.read_text(encoding="utf-8")).items():
        fields = [
            {f for _, f, _, _ in string.Formatter().parse(t) if f} for t in (text, translated)
        ]
        assert fields[0] == fields[1], text


@pytest.fixture(scope="module")
def template(tmp_path_factory):
    """The template of ``make words``, made in a Blender of its own."""
    file = tmp_path_factory.mktemp("words") / "forest_sensing.pot"
    made = subprocess.run(
        [sys.executable, ROOT / "packaging/list_words.py", file],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert made.returncode == 0, made.stderr
    return file.read_text(encoding="utf-8")


def spoken(template):
    """A whole pseudo-language: every text between angle brackets."""
    text = re.sub(
        r'^msgid "(.+)"\nmsgstr ""$', r'msgid "\1"\nmsgstr "‹\1›"', template, flags=re.MULTILINE
    )
    return words.read_catalog(text)


@pytest.mark.medium
def test_the_template_has_every_kind_of_text(template):
    known = set(spoken(template))
    assert {
        ("*", "{count:,} stems"),  # say and label
        ("*", "{removed:,} of {before:,} removed"),  # kept figures
        ("*", "Leaves Heard"),
        ("*", "Images"),  # plain, in a layout
        ("Operator", "Grow Forest"),  # plain, on a button
        ("*", "In this file alone"),  # a placeholder
        ("*", "This picture is no longer there. Run its sensor again"),  # a report
        ("*", "Throw the dice: another seed is another forest. Press Grow Forest to see it"),
        ("*", "Where They Stand"),  # a panel
        ("*", "Frame Range"),  # of an enumeration of an operator
        ("*", "Drag in View"),  # a property
        ("*", "Tractor LiDAR"),  # a kind of sensor
        ("*", "Seen by Sensors"),  # a property of every object
    } <= known
    patterns = {
        call.args[0].value for _, call in calls(*OURS) if isinstance(call.args[0], ast.Constant)
    }
    assert {("*", pattern) for pattern in patterns} <= known


@pytest.mark.medium
@pytest.mark.parametrize("language", ["de_DE", "fr_FR", "es", "ja_JP", "zh_HANS"])
def test_a_language_has_every_name_of_the_panel(language, template):
    """Names are texts of up to three words; sentences that are not translated are shown in English."""
    catalog = words.read_catalog((words.LANGUAGES / f"{language}.po").read_text(encoding="utf-8"))
    names = {
        (context, text)
        for context, text in spoken(template)
        if len(text.split()) <= 3 and text[:1].isupper() and not text.endswith(".")
    }
    assert len(names) > 800
    assert names - catalog.keys() == set()
    assert catalog.keys() <= spoken(template).keys()


def test_gettext_accepts_the_template(template, tmp_path):
    if not shutil.which("msgfmt"):
        pytest.skip("gettext's msgfmt is not installed")
    file = tmp_path / "template.pot"
    file.write_text(template, encoding="utf-8")
    checked = subprocess.run(
        ["msgfmt", "--check-format", "-o", tmp_path / "none.mo", file],
        capture_output=True,
        text=True,
    )
    assert checked.returncode == 0, checked.stderr


# ------------------------------------------------------------------------------------------ saying


@pytest.fixture
def catalog(monkeypatch):
    """A catalog that stands in for Blender's, which this build of it may lack."""
    found = {}
    for name in ("pgettext_rpt", "pgettext_iface"):
        monkeypatch.setattr(words, name, lambda text, context="*": found.get((context, text), text))
    return found


def test_a_pattern_is_looked_up_before_it_is_filled(catalog):
    assert words.say("{count:,} stems", count=1200) == "1,200 stems"
    catalog["*", "{count:,} stems"] = "Stämme: {count:,}"
    assert words.say("{count:,} stems", count=1200) == "Stämme: 1,200"
    assert words.label("{count:,} stems", count=1200) == "Stämme: 1,200"


def test_a_job_is_called_as_its_button(registered, catalog):
    catalog["*", "Grow Forest"] = "‹not this one›"
    catalog["Operator", "Grow Forest"] = "Wald bauen"
    assert words.title_of_operator(bpy.types.FOREST_OT_build) == "Wald bauen"


@pytest.mark.parametrize(
    "broken", ["{number} Stämme", "{} Stämme", "{count", "{count.x}", "{count:q}"]
)
def test_a_broken_translation_is_said_in_english(catalog, broken):
    catalog["*", "{count} stems"] = broken
    assert words.say("{count} stems", count=3) == "3 stems"


def test_braces_in_a_value_stay():
    assert words.say("{name} has no sound", name="{sensor}") == "{sensor} has no sound"
    assert words.say("write {2, 3}") == "write {2, 3}"


def test_a_kept_text_is_english_until_it_is_read(catalog):
    catalog["*", "{heard:,} of {leaves:,}"] = "{leaves:,}, davon {heard:,}"
    kept = words.keep("{heard:,} of {leaves:,}", heard=7, leaves=1200)
    assert kept == "7 of 1,200"
    assert json.loads(kept.made_of)[1] == {"heard": 7, "leaves": 1200}
    assert words.label_of_kept(kept.made_of) == "1,200, davon 7"


def test_figures_are_stored_in_english_and_read_in_the_language(small, catalog):
    catalog["*", "{density:,.0f} trees/ha"] = "{density:,.0f} Bäume/ha"
    catalog["*", "{trees} trees with {leaves} leaves in {seconds:.1f} s"] = "{leaves} an {trees}"
    assert bpy.ops.forest.build() == {"FINISHED"}
    density = small.results["forest"].figures["Density"]
    assert re.fullmatch(r"[\d,]+ trees/ha", density.value)
    assert words.label_of_kept(density.made_of) == density.value.replace("trees", "Bäume")
    assert small.results["forest"].figures["Trees"].made_of == ""


def test_a_language_comes_out_of_blender(registered, monkeypatch, tmp_path):
    """The whole way: a .po file in the folder, Blender in that language, its reports and names."""
    if not bpy.app.build_options.international:
        pytest.skip(
            "this build of Blender speaks English only; make test-gui does it in a real one"
        )
    monkeypatch.setattr(words, "LANGUAGES", tmp_path)
    (tmp_path / "fr_FR.po").write_text(PO.replace("Stämme", "Tiges"), encoding="utf-8")
    view = bpy.context.preferences.view
    before = view.language
    words.unregister()
    words.register()
    try:
        view.language = "fr_FR"
        view.use_translate_interface = view.use_translate_reports = True
        assert words.say("{count:,} stems", count=5) == "Tiges: 5"
        assert bpy.app.translations.pgettext_iface("Paint", "Operator") == "Malen"
    finally:
        view.language = before


# ------------------------------------------------------------------------------------------ glossary
# Names and tooltips of everything that Blender knows of ours, by the rules of docs/glossary.md.

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
    ("text", "passes"),
    [
        *((text, True) for text in ("λ of the call", "Children fork", "1 ping", "10,000 points")),
        ("How many daughters it bears", False),
        ("Needs max_returns above 1", False),
        ("Extent; left out: as the field", False),
        ("Range Sd", False),
        ("1 pings", False),
        ("10000 points", False),
        ("handle", False),
        ("Stop what is running.", False),
        ("Two  spaces", False),
    ],
)
def test_the_rules_see_what_is_wrong_and_let_pass_what_may(text, passes):
    assert (problems("here", text) == []) == passes


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
    every = [(place, text) for _, text, place in packaging("list_words").of_code()]
    assert len(every) > 300
    wrong = [
        line
        for place, text in every
        for line in problems(place, text)
        if not re.search("small letter|single spaces|full stop", line)  # parts of lines
        if not re.search(r"\{\w+_\w+\}", text)
    ]
    assert wrong == []


# -------------------------------------------------------------------------------------------- manual
# F1: every button and setting of ours leads to a place that the manual has.


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """The manual as the extension carries it, by file name."""
    folder = tmp_path_factory.mktemp("manual")
    packaging("write_manual").write_manual(folder)
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
