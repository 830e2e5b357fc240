"""What the repository says of itself: a valid extension, and the same version and needs everywhere."""

import json
import re
import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def read(name):
    return (ROOT / name).read_text(encoding="utf-8")


MANIFEST = tomllib.loads(read("blender_manifest.toml"))
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
