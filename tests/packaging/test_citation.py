"""Citation files say the version of the manifest, and are files that their readers can read."""

import json
import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
VERSION = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]


def test_codemeta_says_version_licence_and_requirements():
    meta = json.loads((ROOT / "codemeta.json").read_text(encoding="utf-8"))
    assert meta["version"] == VERSION
    assert meta["license"].endswith("GPL-3.0-or-later")
    needed = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    names = [re.match(r"[\w-]+", line).group() for line in needed["dependencies"]]
    assert meta["softwareRequirements"] == names


def test_the_citation_says_the_manifests_version():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (.+)$", text, re.M).group(1) == VERSION
    assert (
        re.search(r"^date-released: (.+)$", text, re.M).group(1)
        == json.loads((ROOT / "codemeta.json").read_text(encoding="utf-8"))["dateModified"]
    )
    assert {"cff-version", "message", "title", "authors", "license"} <= set(
        re.findall(r"^([\w-]+):", text, re.M)
    )


def test_the_changelog_names_the_version():
    assert f"## {VERSION}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_papers_citations_are_in_its_bibliography():
    paper = (ROOT / "paper.md").read_text(encoding="utf-8")
    name = re.search(r"^bibliography: (.+)$", paper, re.M).group(1)
    keys = re.findall(r"^@\w+\{(\w+),", (ROOT / name).read_text(encoding="utf-8"), re.M)
    assert sorted(keys) == sorted(re.findall(r"\[@(\w+)\]", paper))
