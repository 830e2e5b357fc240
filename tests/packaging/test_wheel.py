"""The wheel, built, installed into an empty folder and used from another one: its data is inside of it."""

import json
import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
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
