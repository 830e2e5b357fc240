"""The tutorials' code runs as it is printed, in the order it stands, and the reference names every key."""

import dataclasses
import importlib.util
import re
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = sorted(DOCS.glob("guide/*.md"))


def blocks(page):
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)


@pytest.mark.slow
@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p)], ids=lambda p: p.stem)
def test_its_code_runs(page, tmp_path, monkeypatch, empty_blender):
    monkeypatch.chdir(tmp_path)
    names = {}
    for number, block in enumerate(blocks(page), 1):
        exec(compile(block, f"{page.name}, block {number}", "exec"), names)


def test_the_landing_pages_code_runs(tmp_path, monkeypatch, empty_blender):
    monkeypatch.chdir(tmp_path)
    exec("\n".join(blocks(DOCS / "index.md")), {})
    assert (tmp_path / "cloud.laz").stat().st_size > 1000


def test_the_scene_file_page_has_every_key():
    where = importlib.util.spec_from_file_location("scene_reference", DOCS / "scene_reference.py")
    module = importlib.util.module_from_spec(where)
    where.loader.exec_module(module)
    text = module.reference()
    groups = {group for _, group in [*module.TABLES, *module.SPECIES]}
    abstract = {spec.Scanner, spec.MovingScanner}  # their fields stand with each platform
    for group in vars(spec).values():
        if not (isinstance(group, type) and issubclass(group, spec.Settings)):
            continue
        if group is spec.Settings or group in abstract:
            continue
        assert group in groups, group.__name__
        for field in dataclasses.fields(group):
            assert f"| `{field.name}` |" in text
            assert spec.param_of(field).help.replace("|", "\\|") in text
