"""The extension as a user gets it: built, installed into a clean Blender, enabled, disabled.

Blender runs in a process of its own, on a Python that sees only what Blender ships (bpy and what it
requires), so that scipy can come from the extension's wheels alone.
"""

import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MANIFEST = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
SESSION = Path(__file__).with_name("extension_session.py")
NO_NETWORK = 75  # build_extension.py's exit code


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    out = tmp_path_factory.mktemp("extension")
    build = subprocess.run(
        [sys.executable, ROOT / "packaging/build_extension.py", "--out", out],
        capture_output=True,
        text=True,
        timeout=900,
    )
    if build.returncode == NO_NETWORK:
        pytest.skip(
            f"the wheels are not in wheels/ and cannot be downloaded: {build.stderr.strip()}"
        )
    assert build.returncode == 0, build.stderr
    (file,) = out.glob("*.zip")
    return file


@pytest.fixture(scope="module")
def session(archive, tmp_path_factory):
    """What extension_session.py saw."""
    folder = tmp_path_factory.mktemp("session")
    answer = folder / "answer.json"
    environment = {name: value for name, value in os.environ.items() if "PYTHON" not in name}
    run = subprocess.run(
        [sys._base_executable, "-s", "-S", SESSION, archive, answer],
        env=environment
        | {
            "PYTHONPATH": str(what_blender_ships(folder / "blender")),
            "BLENDER_USER_RESOURCES": str(folder / "resources"),
        },
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,  # bpy 4.5 hangs at exit when an operator stays registered
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return json.loads(answer.read_text()) | {"resources": folder / "resources"}


def what_blender_ships(folder: Path) -> Path:
    """A folder with links to bpy and the packages it requires, and nothing else."""
    folder.mkdir()
    pending, seen = ["bpy"], set()
    while pending:
        name = pending.pop()
        if name in seen:
            continue
        seen.add(name)
        package = metadata.distribution(name)
        for top in {file.parts[0] for file in package.files} - {"..", "__pycache__"}:
            link = folder / top
            if not link.exists():
                link.symlink_to(package.locate_file(top))
        for requirement in package.requires or ():
            if "extra ==" not in requirement and "python_version <" not in requirement:
                pending.append(re.match(r"[\w.-]+", requirement)[0])
    return folder


def test_archive_holds_the_extension_and_nothing_else(archive):
    names = zipfile.ZipFile(archive).namelist()
    assert {"__init__.py", "blender_manifest.toml", "LICENSE", "forest_addon/__init__.py"} <= set(
        names
    )
    assert "forest_addon/acoustics/hard_disc.npz" in names
    tops = {name.split("/")[0] for name in names}
    assert tops <= {
        *("__init__.py", "blender_manifest.toml", "LICENSE", "README.md", "CHANGELOG.md"),
        *("wheels", "forest_addon", "headless", "assets"),
    }
    assert not [name for name in names if "__pycache__" in name or "/." in name]
    assert not [name for name in names if name.startswith("wheels/numpy")]


def test_archive_has_wheels_for_both_pythons(archive):
    wheels = [name for name in zipfile.ZipFile(archive).namelist() if name.startswith("wheels/")]
    for python in ("cp311", "cp313"):
        assert [wheel for wheel in wheels if wheel.startswith("wheels/scipy-") and python in wheel]
    assert {f"./{wheel}" for wheel in wheels} <= set(MANIFEST["wheels"])


def test_installs_and_enables(session):
    assert session["installed"] == ["FINISHED"]
    assert session["loaded"]
    assert "add-on bl_ext.user_default.forest_sensing" in session["added"]


def test_what_blender_lacks_comes_from_the_wheels(session):
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    packages = session["resources"] / "extensions/.local/lib" / python / "site-packages"
    assert {"scipy", "laspy", "lazrs"} <= set(session["lacking"])
    for name in session["lacking"]:
        assert Path(session["origins"][name]).is_relative_to(packages), name
    assert not Path(session["origins"]["numpy"]).is_relative_to(packages)
    declared = {tuple(Path(wheel).name.split("-")[:2]) for wheel in MANIFEST["wheels"]}
    assert set(session["wheels"].items()) == declared


def test_every_button_works_after_installation(session):
    pressed = session["pressed"]
    names = ("build", "cloud", "scan", "echo", "reverb")
    assert all(pressed[name] == ["FINISHED"] for name in names)
    assert pressed["results"] == ["cloud", "echo", "forest", "reverb", "scan"]
    assert pressed["objects"] == ["EMPTY", "MESH", "SPEAKER"]
    files = ["cloud.laz", "echo.npz", "echo.wav", "reverb.npz", "reverb.wav", "scan.npz"]
    assert pressed["files"] == files


def test_disabling_leaves_nothing_behind(session):
    assert session["disabled"] == ["FINISHED"]
    assert not session["still_loaded"]
    assert session["left"] == []
    assert session["lost"] == []
