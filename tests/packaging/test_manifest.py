"""The repository is a valid extension as it stands, and says the same as pyproject.toml."""

import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MANIFEST = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def validate(folder):
    scripts = next(Path(find_spec("bpy").origin).parent.glob("*/scripts"))
    tool = scripts / "addons_core/bl_pkg/cli/blender_ext.py"
    tags = scripts / "modules/_bpy_internal/extensions/tags.py"
    return subprocess.run(
        [sys.executable, tool, "validate", folder, f"--valid-tags={tags}"],
        capture_output=True,
        text=True,
    )


def test_blender_accepts_the_repository():
    run = validate(ROOT)
    assert run.returncode == 0, run.stdout + run.stderr


def test_blender_refuses_a_broken_manifest(tmp_path):
    (tmp_path / "__init__.py").touch()
    text = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    (tmp_path / "blender_manifest.toml").write_text(text.replace('"Physics"', '"Forestry"'))
    assert validate(tmp_path).returncode == 1


def test_manifest_and_project_agree():
    assert PROJECT["dynamic"] == [
        "version"
    ]  # setup.py takes the manifest's; tests/packaging/test_wheel.py
    assert MANIFEST["license"] == [f"SPDX:{PROJECT['license']}"]


@pytest.mark.parametrize("platform", ["manylinux", "win_amd64", "macosx"])
@pytest.mark.parametrize("package", ["scipy", "lazrs"])
def test_compiled_wheels_are_declared_for_both_pythons(package, platform):
    found = [
        Path(wheel).name.split("-")
        for wheel in MANIFEST["wheels"]
        if Path(wheel).name.startswith(f"{package}-") and platform in wheel
    ]
    assert sorted(parts[2] for parts in found) == ["cp311", "cp313"]
    assert len({parts[1] for parts in found}) == 1  # one version
