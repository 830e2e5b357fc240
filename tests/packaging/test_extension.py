"""The extension as a user gets it: built, installed into a clean Blender, enabled, disabled.

Blender runs in a process of its own, on a Python that sees only what Blender ships (bpy and what it
requires), so that scipy can come from the extension's wheels alone.
"""

import base64
import csv
import hashlib
import io
import json
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.util import find_spec
from pathlib import Path

import numpy as np
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
    assert PROJECT["dynamic"] == ["version"]  # setup.py takes the manifest's; see test_wheel.py
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
