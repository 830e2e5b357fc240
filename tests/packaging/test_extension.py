"""The extension as a user gets it: built, installed into a clean Blender, enabled, disabled.

Blender runs in a process of its own, on a Python that sees only what Blender ships (bpy and what it
requires), so that scipy can come from the extension's wheels alone.
"""

import ast
import base64
import csv
import email
import hashlib
import io
import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from PIL import Image

from forest_addon.formats.ownership import RECORD

ROOT = Path(__file__).resolve().parents[2]
PYTHON = f"cp{sys.version_info.major}{sys.version_info.minor}"
MANIFEST = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))


def test_archive_holds_the_extension_and_nothing_else(archive):
    assert archive.stat().st_size < 40e6
    with zipfile.ZipFile(archive) as opened:
        names = set(opened.namelist())
        manifest = tomllib.loads(opened.read("blender_manifest.toml").decode())
    assert {"__init__.py", "LICENSE", "forest_addon/__init__.py"} <= names
    assert {"forest_addon/acoustics/hard_disc.npz", "manual/scene-file.html"} <= names
    assert {name.split("/")[0] for name in names} <= {
        *("__init__.py", "blender_manifest.toml", "LICENSE", "README.md", "CHANGELOG.md"),
        *("wheels", "forest_addon", "headless", "assets", "manual"),
    }
    assert not [name for name in names if "__pycache__" in name or "/." in name]
    wheels = {name for name in names if name.startswith("wheels/") and name != "wheels/"}
    assert {f"./{wheel}" for wheel in wheels} == set(manifest["wheels"]) <= set(MANIFEST["wheels"])
    assert len(manifest["platforms"]) == 1
    compiled = [wheel for wheel in wheels if "-cp3" in wheel]
    assert {wheel.split("/")[1].split("-")[0] for wheel in compiled} == {"scipy", "lazrs"}
    assert all(f"-{PYTHON}-" in wheel for wheel in compiled)


def test_scipy_comes_whole_but_for_its_tests(archive):
    """Every other file is as upstream made it; RECORD lists what is there, with the right hashes."""
    with zipfile.ZipFile(archive) as opened:
        (name,) = (n for n in opened.namelist() if n.startswith("wheels/scipy-"))
        with opened.open(name) as file, zipfile.ZipFile(file) as lean:
            ours = {entry.filename: entry for entry in lean.infolist()}
            (record,) = (n for n in ours if n.endswith(".dist-info/RECORD"))
            said = {row[0]: row[1] for row in csv.reader(io.StringIO(lean.read(record).decode()))}
            assert set(said) == {n for n in ours if not n.endswith("/")}
            for file_name, stated in said.items():
                if stated:
                    found = hashlib.sha256(lean.read(file_name)).digest()
                    hashed = base64.urlsafe_b64encode(found).decode().rstrip("=")
                    assert stated == f"sha256={hashed}", file_name
    with zipfile.ZipFile(ROOT / name) as whole:
        theirs = {entry.filename: entry for entry in whole.infolist()}
    gone = theirs.keys() - ours.keys()
    assert gone
    assert all("tests" in Path(n).parts for n in gone)
    for n, entry in ours.items():
        if n != record:
            assert (entry.CRC, entry.external_attr) == (theirs[n].CRC, theirs[n].external_attr), n


def test_installs_with_what_blender_lacks_from_the_wheels(session):
    assert session["installed"] == ["FINISHED"]
    assert session["loaded"]
    assert "add-on bl_ext.user_default.forest_sensing" in session["added"]
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    packages = session["folder"] / "resources/extensions/.local/lib" / python / "site-packages"
    assert {"scipy", "laspy", "lazrs"} <= set(session["lacking"])
    for name in session["lacking"]:
        assert Path(session["origins"][name]).is_relative_to(packages), name
    assert not Path(session["origins"]["numpy"]).is_relative_to(packages)
    declared = {tuple(Path(wheel).name.split("-")[:2]) for wheel in MANIFEST["wheels"]}
    assert set(session["wheels"].items()) == declared


def test_buttons_and_the_python_api_work(session):
    pressed = session["pressed"]
    names = ("build", "cloud", "scan", "echo", "reverb")
    assert all(pressed[name] == ["FINISHED"] for name in names)
    assert pressed["results"] == ["cloud", "echo", "forest", "reverb", "scan"]
    assert pressed["objects"] == ["EMPTY", "MESH", "SPEAKER"]
    files = [RECORD, "cloud.laz", "echo.npz", "echo.wav", "reverb.npz", "reverb.wav", "scan.npz"]
    assert pressed["files"] == files
    assert session["typed"] == {"terrestrial": True, "sonar": True, "reverb": True, "saved": True}


def test_it_writes_only_where_the_user_said_or_into_its_own_folder(session):
    """And neither asks the network nor starts programs; its modules go by the name Blender gave it."""
    home = str(session["folder"])
    results = f"{home}/results"
    for path in session["written"]:
        if "__pycache__" in path or path == "/dev/null":  # Python's own; nothing
            continue
        told = (results, session["own_folder"])
        allowed = told if path.startswith(home) else tuple(session["temporary"])
        assert path.startswith(allowed), path
    assert any(path.startswith(results) for path in session["written"])  # the watch was awake
    for name in ("changed", "suspicious", "foreign_names"):
        assert session[name] == [], name


def test_commands_leave_the_extension_as_it_was(session):
    """Factory settings in a user's Blender would switch it off and remove scipy and the rest."""
    before, *after = session["seen"]
    assert (before["code"], before["enabled"]) == (0, [True, True])
    assert {"scipy", "laspy", "lazrs"} <= set(before["packages"])
    assert not {"matplotlib", "pillow"} & set(before["packages"])
    assert after == [before] * 3
    out = session["folder"] / "out"
    assert {"forest.blend", "own.laz", "points.csv"} <= {path.name for path in out.iterdir()}
    # matplotlib is not there: Blender draws, and what it cannot draw is said.
    report = (out / "report.html").read_text(encoding="utf-8")
    assert report.count("<img") == 6, "the preview, the stand and four sensors"
    assert "the curve of L(r) - r is left out" in report
    assert "-m pip install matplotlib" in report
    for name in ("stand", "cloud", "scan", "echo", "reverb", "points"):
        pixels = np.asarray(Image.open(out / f"{name}.png"))
        assert min(pixels.shape[:2]) > 300
        assert pixels[30:-30].std() > 5, name


def test_the_kernels_come_as_a_wheel_and_run(session):
    record = json.loads((session["folder"] / "out" / "run.json").read_text(encoding="utf-8"))
    assert record["versions"]["kernels"] == "C"


def test_disabling_leaves_nothing_behind(session):
    assert session["disabled"] == ["FINISHED"]
    assert not session["still_loaded"]
    assert session["left"] == []
    assert session["lost"] == []


# ----------------------------------------------------------------------------------------- manifest
# What the repository says of itself: a valid extension, and the same version and needs everywhere.


def read(name):
    return (ROOT / name).read_text(encoding="utf-8")


PROJECT = tomllib.loads(read("pyproject.toml"))["project"]
CONDA = {"matplotlib": "matplotlib-base"}  # what conda-forge calls it
META = json.loads(read("codemeta.json"))
PLATFORM_TAGS = {"linux-x64": "manylinux", "windows-x64": "win_amd64", "macos-arm64": "macosx"}


def validate(folder):
    """Return 0 where Blender's own tool accepts the extension in a folder."""
    scripts = next(Path(find_spec("bpy").origin).parent.glob("*/scripts"))
    tool = scripts / "addons_core/bl_pkg/cli/blender_ext.py"
    tags = scripts / "modules/_bpy_internal/extensions/tags.py"
    return subprocess.run(
        [sys.executable, tool, "validate", folder, f"--valid-tags={tags}"]
    ).returncode


def test_blender_accepts_the_repository_and_refuses_a_broken_manifest(tmp_path):
    assert validate(ROOT) == 0
    (tmp_path / "__init__.py").touch()
    text = read("blender_manifest.toml").replace('"Physics"', '"Forestry"')
    (tmp_path / "blender_manifest.toml").write_text(text)
    assert validate(tmp_path) == 1


def test_wheels_are_declared_for_every_platform_and_python():
    builds = {}
    for wheel in MANIFEST["wheels"]:
        name, version, python, _, tag = Path(wheel).stem.split("-")
        builds.setdefault((name, version), []).append((python, tag))
    assert len({name for name, _ in builds}) == len(builds)  # one version each
    assert set(MANIFEST["platforms"]) == set(PLATFORM_TAGS)
    for name, declared in builds.items():
        compiled = [(python, tag) for python, tag in declared if tag != "any"]
        assert compiled or len(declared) == 1, name
        for python in ("cp311", "cp313") if compiled else ():
            for platform in PLATFORM_TAGS.values():
                fitting = [tag for p, tag in compiled if p in (python, "py3") and platform in tag]
                assert len(fitting) == 1, f"{name}: {python}, {platform}"
    assert {"scipy", "lazrs"} <= {name for name, _ in builds}


def test_all_files_say_the_same():
    assert PROJECT["dynamic"] == ["version"]  # setup.py takes the manifest's; see the wheel below
    assert MANIFEST["license"] == [f"SPDX:{PROJECT['license']}"]
    tested = re.findall(r"bpy>=(\d+\.\d+)", " ".join(PROJECT["optional-dependencies"]["bpy"]))
    assert MANIFEST["blender_version_min"] == f"{min(tested)}.0"
    assert f"## {MANIFEST['version']}" in read("CHANGELOG.md")
    needed = [re.match(r"[\w-]+", line).group() for line in PROJECT["dependencies"]]
    assert (META["version"], META["softwareRequirements"]) == (MANIFEST["version"], needed)
    assert META["license"].endswith("GPL-3.0-or-later")
    cited = dict(re.findall(r"^([\w-]+):(.*)", read("CITATION.cff"), re.M))
    assert {"cff-version", "message", "title", "authors", "license"} <= cited.keys()
    assert cited["version"].strip() == MANIFEST["version"]
    assert cited["date-released"].strip() == META["dateModified"]


def test_the_papers_citations_are_in_its_bibliography():
    paper = read("paper.md")
    name = re.search(r"^bibliography: (.+)$", paper, re.M).group(1)
    keys = re.findall(r"^@\w+\{(\w+),", read(name), re.M)
    assert sorted(keys) == sorted(re.findall(r"\[@(\w+)\]", paper))


def test_the_conda_recipe_needs_what_the_project_does():
    recipe = read("packaging/conda/recipe.yaml")
    assert f'version: "{MANIFEST["version"]}"' in recipe
    run = re.search(r"  run:\n((?:    - .*\n)+)", recipe)[1].replace(" ", "")
    for line in PROJECT["dependencies"]:
        name, _, bounds = re.match(r"([\w-]+)(\[\w+\])?(.*)", line).groups()
        assert f"-{CONDA.get(name, name)}{bounds}\n" in run


# ----------------------------------------------------------------------------------- platform rules
# The rules of extensions.blender.org as a checklist, on the zip that a user gets.
#
# Taken from its terms of service (extensions.blender.org/terms-of-service), the guidelines of its
# moderators (developer.blender.org/docs/features/extensions/moderation/guidelines) and the manual's chapter
# on extensions. What Blender's own tool checks (identifiers, tags, the form of versions and wheels) is
# tested among those of the manifest above, what happens in a session and stays after it at the top.

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


# -------------------------------------------------------------------------------------------- wheel
# The wheel, built, installed into an empty folder and used from another one: its data is inside of it.

SMALL = (ROOT / "tests" / "headless" / "small.toml").read_text(encoding="utf-8")
BARE = "[output]\nblend = false\nglb = false\npreview = false\npictures = false\ngoodness = false\n"
TILES = """
[forest]
size = [8.0, 4.0]
[tiles]
size = 4.0
buffer = 2.0
[[sensors]]
kind = "sonar"
position = [4.0, 2.0, 1.5]
"""
USE = """
import forest_addon
from forest_addon.base.places import ASSETS
from forest_addon.formats.toml_file import FOLDER
from forest_addon.headless.cli import main

print(forest_addon.__file__)
print(*(len(list(folder.glob("*.toml"))) for folder in (FOLDER, ASSETS / "plans")))
assert main(["run", "small.toml", "--out", "out", "--quiet"]) == 0
assert main(["run", "tiles.toml", "--workers", "1", "--out", "tiled", "--quiet"]) == 0
main(["--help"])
"""


def run(*words, **more):
    return subprocess.run(
        [sys.executable, *map(str, words)], capture_output=True, text=True, timeout=600, **more
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"  # leaves no build/ here
    source.mkdir()
    for name in (
        *("forest_addon", "headless", "assets", "pyproject.toml", "setup.py", "README.md"),
        *("LICENSE", "blender_manifest.toml", "MANIFEST.in", "packaging"),
    ):
        (source / name).symlink_to(ROOT / name)
    pytest.importorskip("uv", reason="the environment was made by pip")
    made = run("-m", "uv", "build", "--quiet", "--wheel", "--out-dir", folder, source)
    if made.returncode and "Failed to fetch" in made.stderr:
        pytest.skip("the package index cannot be reached, setuptools is not here")
    assert made.returncode == 0, made.stderr
    return next(folder.glob("*.whl"))


@pytest.mark.slow
def test_the_installed_wheel_works_alone_from_another_folder(wheel, tmp_path):
    version = tomllib.loads((ROOT / "blender_manifest.toml").read_text("utf-8"))["version"]
    assert wheel.name.startswith(f"forest_sensing-{version}-")
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"forest_addon"}
    inside = {name.removeprefix("forest_addon/assets/") for name in names if "/assets/" in name}
    assert {
        p.relative_to(ROOT / "assets").as_posix() for p in ROOT.glob("assets/**/*.toml")
    } <= inside

    site, here = tmp_path / "site", tmp_path / "here"
    of_this = ("--python", sys.executable)
    made = run(
        "-m", "uv", "pip", "install", "--quiet", "--no-deps", *of_this, "--target", site, wheel
    )
    assert made.returncode == 0, made.stderr
    here.mkdir()
    (here / "small.toml").write_text(SMALL.split("[[sensors]]")[0] + BARE, "utf-8")
    (here / "tiles.toml").write_text(TILES, "utf-8")
    done = run("-c", USE, cwd=here, env=os.environ | {"PYTHONPATH": str(site)})
    assert done.returncode == 0, done.stderr
    where, counts, *help_text = done.stdout.splitlines()
    assert where.startswith(str(site))
    assert min(map(int, counts.split())) > 2
    record = json.loads((here / "out" / "run.json").read_text(encoding="utf-8"))
    assert record["versions"]["forest_sensing"] == version
    assert (here / "tiled" / "echo.npz").is_file()  # its worker found the command, too
    assert any("forest-sensing run my.toml" in line for line in help_text)
    assert not any("python -m headless" in line for line in help_text)
