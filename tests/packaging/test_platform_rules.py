"""The rules of extensions.blender.org as a checklist, on the zip that a user gets.

Taken from its terms of service (extensions.blender.org/terms-of-service), the guidelines of its moderators
(developer.blender.org/docs/features/extensions/moderation/guidelines) and the manual's chapter on
extensions. What Blender's own tool checks (identifiers, tags, the form of versions and wheels) is tested in
test_manifest.py, what happens in a session and stays after it in test_extension.py.
"""

import ast
import email
import re
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[2]
MANIFEST = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
SHIPPED_BY_BLENDER = {"numpy", "OpenImageIO"}
NETWORK = {
    *("socket", "ssl", "http", "urllib", "requests", "ftplib", "smtplib", "poplib", "imaplib"),
    *("aiohttp", "httpx", "websockets", "xmlrpc", "webbrowser", "pip", "ensurepip", "asyncio"),
}
# Licences that may be part of a work under GPL-3.0-or-later (gnu.org/licenses/license-list).
COMPATIBLE = {
    *("MIT", "MIT-CMU", "BSD", "BSD-2-Clause", "BSD-3-Clause", "Apache-2.0", "MPL-2.0", "PSF-2.0"),
    "GPL-3.0-or-later",  # ours: the kernels
    *("MIT License", "BSD License", "BSD 3-Clause License", "Python Software Foundation License"),
}
BINARY = (b"\x7fELF", b"MZ", b"\xcf\xfa\xed\xfe", b"\xca\xfe\xba\xbe")  # Linux, Windows, macOS
COMPILED = r"\.(so|dll|dylib|pyd|exe|pyc|pyo|whl|zip|sh|bat)$"
# Run by hand or by `blender --command forest`, in a process of their own.
COMMAND_LINE = "headless/"
LOADERS = {
    "headless/in_blender.py",
    "headless/commands/__init__.py",  # whether Blender is open is asked, without loading it
    "headless/dataset/engine.py",  # a worker is told where its starter found Blender
    "headless/dataset/loader.py",  # copied into datasets, never run in Blender
}
EMBEDS = {"forest_addon/formats/glb.py"}  # a glTF may hold its corners as base64
BLENDER = {
    *("bpy", "bmesh", "bl_operators", "bl_ui", "bpy_extras", "mathutils", "gpu", "gpu_extras"),
    *("aud", "blf", "imbuf", "forest_addon", "headless"),
}
DRAWERS = {"matplotlib", "PIL"}  # of commands and notebooks
# The benchmarks' other programs, the scheduler of datasets, the rules of flights: each is used by
# commands and scripts where it is installed, and says what to install where it is not. So are formats
# that Blender has no package for: the panel does not offer them.
OPTIONAL = {
    *("pyroomacoustics", "pyhelios", "dask", "distributed", "dask_jobqueue", "gymnasium"),
    *("copclib", "pandas", "pye57", "pyproj", "pystac", "rosbags", "shtab", "sofar"),
    *("upath", "xarray"),
}


class Source:
    """A Python file: its text, what it imports and calls, and what it asks a module for."""

    def __init__(self, name, content):
        self.name, self.text = name, content.decode()
        kinds = ast.Import, ast.ImportFrom, ast.Call, ast.Attribute
        self.nodes = [n for n in ast.walk(ast.parse(self.text)) if isinstance(n, kinds)]
        self.on_command_line = name.startswith(COMMAND_LINE)
        self.imports = {
            *(a.name.split(".")[0] for n in self._all(ast.Import) for a in n.names),
            *(n.module.split(".")[0] for n in self._all(ast.ImportFrom) if not n.level),
        }
        self.calls = {n.func.id for n in self._all(ast.Call) if isinstance(n.func, ast.Name)}

    def _all(self, kind):
        return [node for node in self.nodes if isinstance(node, kind)]

    def asks(self, module):
        asked = self._all(ast.Attribute)
        return {n.attr for n in asked if getattr(n.value, "id", None) == module}


RULES = {  # what no file does; each returns what breaks it
    "asks the network": lambda source: source.imports & NETWORK,
    "starts programs": lambda source: not source.on_command_line and (
        source.imports & {"subprocess"}
        | {used for used in source.asks("os") if re.match("system$|popen$|exec", used)}
    ),
    "runs text": lambda source: source.calls & {"eval", "exec", "compile", "__import__"},
    "hides what it does": lambda source: (
        source.imports & {"marshal", "pickle", "codecs"}
        | {word for word in ["b64decode"] if word in source.text and source.name not in EMBEDS}
        | {line for line in source.text.splitlines() if len(line) > 120}
    ),
    "changes Python's paths and modules": lambda source: source.name not in LOADERS and (
        {used for used in source.asks("sys") if used.startswith(("path", "modules"))}
        | source.asks("site") & {"addsitedir"}
    ),
    "prints": lambda source: not source.on_command_line
    and source.calls & {"print", "breakpoint"},
    "uses the clipboard": lambda source: {
        ast.unparse(node) for node in source.nodes if getattr(node, "attr", "") == "clipboard"
    },
}  # fmt: skip


@pytest.fixture(scope="module")
def shipped(archive):
    """Every file in the zip, by its name."""
    with zipfile.ZipFile(archive) as opened:
        return {name: opened.read(name) for name in opened.namelist() if not name.endswith("/")}


@pytest.fixture(scope="module")
def code(shipped):
    return [Source(name, text) for name, text in shipped.items() if name.endswith(".py")]


@pytest.fixture(scope="module")
def wheels(archive):
    """What each wheel in the zip says of itself, and its files."""
    told = {}
    with zipfile.ZipFile(archive) as opened:
        for name in opened.namelist():
            if name.endswith(".whl"):
                with opened.open(name) as file, zipfile.ZipFile(file) as wheel:
                    about = next(n for n in wheel.namelist() if n.endswith(".dist-info/METADATA"))
                    told[name] = email.message_from_bytes(wheel.read(about)), wheel.namelist()
    return told


def test_the_manifest_is_plain_and_its_licence_comes_along(shipped):
    assert MANIFEST["license"] == ["SPDX:GPL-3.0-or-later"]
    text = shipped["LICENSE"].decode()
    assert "GNU GENERAL PUBLIC LICENSE" in text
    assert "Version 3, 29 June 2007" in text
    assert all(re.match(r"\d{4}(-\d{4})? \S", holder) for holder in MANIFEST["copyright"])
    assert "blender" not in MANIFEST["name"].lower()
    assert MANIFEST["maintainer"]
    assert list(MANIFEST["permissions"]) == ["files"]
    for sentence in (MANIFEST["tagline"], *MANIFEST["permissions"].values()):
        assert len(sentence) <= 64
        assert sentence[-1] not in ".!?"


def test_there_is_a_website():
    """The one open point of the list, until the project has a public address (CONTRIBUTING, Publish)."""
    if "website" not in MANIFEST:
        pytest.xfail("no website in blender_manifest.toml: fill it in before publishing")
    assert MANIFEST["website"].startswith("https://")


def test_wheels_are_free_and_need_nothing_that_does_not_come_along(wheels):
    there = {canonicalize_name(about["Name"]) for about, _ in wheels.values()} | SHIPPED_BY_BLENDER
    for file, (about, names) in wheels.items():
        for needed in map(Requirement, about.get_all("Requires-Dist", [])):
            wanted = [v for v in ("3.11", "3.13") if needed.marker is None or needed.marker.evaluate(
                {"python_version": v, "python_full_version": f"{v}.0", "extra": ""})]  # fmt: skip
            assert not wanted or canonicalize_name(needed.name) in there, f"{file}: {needed}"
        stated = about["License-Expression"] or " AND ".join(
            text.rpartition(" :: ")[2] for text in about.get_all("Classifier", [])
            if text.startswith("License :: OSI Approved :: ")
        ) or about["License"] or ""  # fmt: skip
        choices = [set(choice.split(" AND ")) for choice in stated.strip("()").split(" OR ")]
        assert any(choice <= COMPATIBLE for choice in choices), f"{file}: {stated}"
        assert [n for n in names if re.search("(?i)licen[cs]e|copying", n)], f"{file}: no licence"


def test_what_is_imported_is_ours_or_in_the_zip_or_in_blender(code, wheels):
    """No package that the user would have to find elsewhere; a window draws without matplotlib."""
    known = {name.split("/")[0].partition(".")[0] for _, names in wheels.values() for name in names}
    known |= SHIPPED_BY_BLENDER | set(sys.stdlib_module_names) | BLENDER | DRAWERS | OPTIONAL
    lacking = {source.name: source.imports - known for source in code}
    assert not {name: names for name, names in lacking.items() if names}
    # These can do without, or draw for notebooks and for who plays a flight from Python.
    drawing = {s.name for s in code if s.imports & DRAWERS and not s.on_command_line}
    assert drawing == {
        "forest_addon/api/results.py",
        "forest_addon/drawing/echoes.py",
        "forest_addon/drawing/figures.py",
        "forest_addon/drawing/stands.py",
        "forest_addon/flight/top_view.py",
        "forest_addon/formats/raster_file.py",
    }


def test_the_zip_holds_no_binaries_and_no_bytecode(shipped):
    beside = {name: text for name, text in shipped.items() if not name.startswith("wheels/")}
    for name, content in beside.items():
        assert not re.search(COMPILED, name), name
        assert not content.startswith(BINARY), name
        if name.endswith((".py", ".toml", ".md")) or name == "LICENSE":
            content.decode("utf-8")
    assert max(map(len, beside.values())) < 3e6


@pytest.mark.parametrize("rule", RULES)
def test_no_file(code, rule):
    broken = {source.name: RULES[rule](source) for source in code}
    assert not {name: what for name, what in broken.items() if what}


def test_classes_are_named_as_blender_wants_them():
    bpy = pytest.importorskip("bpy")
    from forest_addon import ui

    letters = {bpy.types.Operator: "OT", bpy.types.Panel: "PT", bpy.types.Menu: "MT",
               bpy.types.UIList: "UL", bpy.types.PropertyGroup: "PG",
               bpy.types.AddonPreferences: "AP", bpy.types.FileHandler: "FH"}  # fmt: skip
    for cls in ui._classes():
        (kind,) = (letters[base] for base in letters if issubclass(cls, base))
        assert cls.__name__.startswith(f"FOREST_{kind}_"), cls
        if kind == "OT":
            room, _, verb = cls.bl_idname.partition(".")
            assert (room, f"FOREST_OT_{verb}") == ("forest", cls.__name__)
            assert cls.__doc__ or hasattr(cls, "description"), cls
            assert not cls.__doc__.endswith("."), cls
