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
SMALL = ROOT / "tests" / "headless" / "small.toml"
BARE = "[output]\nblend = false\nglb = false\npreview = false\npictures = false\ngoodness = false\n"


def run(*words, **more):
    return subprocess.run(
        [sys.executable, *map(str, words)], capture_output=True, text=True, timeout=600, **more
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    names = ("forest_addon", "headless", "assets", "pyproject.toml", "setup.py", "README.md")
    for name in (
        *names,
        "LICENSE",
        "blender_manifest.toml",
        "MANIFEST.in",
    ):  # leaves no build/ here
        (source / name).symlink_to(ROOT / name)
    made = run("-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", folder, source)
    if made.returncode and "No matching distribution" in made.stderr + made.stdout:
        pytest.skip("the package index cannot be reached, setuptools is not here")
    assert made.returncode == 0, made.stderr
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A folder that the wheel alone was installed into, as the environment of a process elsewhere."""
    folder = tmp_path_factory.mktemp("site")
    made = run("-m", "pip", "install", "--quiet", "--no-deps", "--target", folder, wheel)
    assert made.returncode == 0, made.stderr
    return folder, dict(os.environ) | {"PYTHONPATH": str(folder)}


@pytest.mark.slow
def test_the_wheel_has_one_name_and_its_version_from_the_manifest(wheel):
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"forest_addon"}
    assert wheel.name.startswith(f"forest_sensing-{manifest['version']}-")
    inside = {name.removeprefix("forest_addon/assets/") for name in names if "/assets/" in name}
    files = {p.relative_to(ROOT / "assets").as_posix() for p in (ROOT / "assets").rglob("*.toml")}
    assert files <= inside


@pytest.mark.slow
def test_the_installed_wheel_runs_a_scene_from_another_folder(installed, tmp_path):
    folder, environment = installed
    where = run(
        "-c", "import forest_addon; print(forest_addon.__file__)", cwd=tmp_path, env=environment
    )
    assert where.stdout.startswith(str(folder))
    start = "import sys; from forest_addon.headless.cli import main; sys.exit(main(sys.argv[1:]))"
    scene = tmp_path / "small.toml"
    scene.write_text(SMALL.read_text(encoding="utf-8").split("[output]")[0] + BARE, "utf-8")
    words = ("run", scene, "--out", tmp_path / "out", "--quiet")
    done = run("-c", start, *words, cwd=tmp_path, env=environment)
    assert done.returncode == 0, done.stderr
    record = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert record["versions"]["forest_sensing"] == manifest["version"]
    help_text = run("-c", start, "--help", cwd=tmp_path, env=environment).stdout
    assert "forest-sensing run my.toml" in help_text
    assert "python -m headless" not in help_text


@pytest.mark.slow
def test_presets_instruments_and_plans_are_inside(installed, tmp_path):
    code = (
        "from pathlib import Path\n"
        "from forest_addon.growth.library.species_file import find_species, load_species\n"
        "from forest_addon.formats.scanner_file import FOLDER\n"
        "from forest_addon.base.places import ASSETS\n"
        "load_species(find_species('hazelnut', Path()))\n"
        "print(len(list(FOLDER.glob('*.toml'))), len(list((ASSETS / 'plans').glob('*.toml'))))"
    )
    done = run("-c", code, cwd=tmp_path, env=installed[1])
    assert done.returncode == 0, done.stderr
    assert min(map(int, done.stdout.split())) > 2


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


@pytest.mark.slow
def test_workers_of_the_installed_wheel_find_its_command(installed, tmp_path):
    (tmp_path / "tiles.toml").write_text(TILES, encoding="utf-8")
    start = "import sys; from forest_addon.headless.cli import main; sys.exit(main(sys.argv[1:]))"
    words = ("run", "tiles.toml", "--workers", "2", "--out", "out", "--quiet")
    done = run("-c", start, *words, cwd=tmp_path, env=installed[1])
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "echo.npz").is_file()
