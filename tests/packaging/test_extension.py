"""The extension as a user gets it: built, installed into a clean Blender, enabled, disabled.

Blender runs in a process of its own, on a Python that sees only what Blender ships (bpy and what it
requires), so that scipy can come from the extension's wheels alone.
"""

import base64
import csv
import hashlib
import io
import json
import sys
import tomllib
import zipfile
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
