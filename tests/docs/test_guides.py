"""The tutorials' code runs as it is printed, in the order it stands, and the reference names every key."""

import ast
import dataclasses
import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.formats.toml_file import write_settings

DOCS = Path(__file__).resolve().parents[2] / "docs"
GUIDES = sorted(DOCS.glob("guide/*.md"))


def script(path):
    """A file of Python beside the code, as a module."""
    where = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(where)
    where.loader.exec_module(module)
    return module


guides = script(DOCS.parent / "packaging" / "time_guides.py")
NEEDS = {"fly": ["gymnasium"]}  # what a page asks to be installed besides


def blocks(page):
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.M | re.S)


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [p for p in [*GUIDES, DOCS / "stand.md"] if guides.steps(p)], ids=lambda p: p.stem
)
def test_its_code_and_commands_run(page, tmp_path, monkeypatch, empty_blender):
    for extra in NEEDS.get(page.stem, ()):
        pytest.importorskip(extra)
    guides.lay_out(tmp_path)
    monkeypatch.chdir(tmp_path)
    guides.play(page)


def test_every_tutorial_says_what_it_takes():
    tasks = guides.TASKS.read_text(encoding="utf-8")
    played = [page for page in GUIDES if guides.steps(page)]
    assert len(played) >= 9
    for page in played:
        said = guides.COST.search(page.read_text(encoding="utf-8"))[0]
        time, memory, files = re.search(
            r"Takes (.*?) of one core, (.*?) of memory, (.*?) of", said
        ).groups()
        assert f"]({page.name}) | {time} | {memory} | {files} |" in tasks, page.name


@pytest.mark.medium
def test_the_landing_pages_code_runs(tmp_path, monkeypatch, empty_blender):
    monkeypatch.chdir(tmp_path)
    exec("\n".join(blocks(DOCS / "index.md")), {})
    assert (tmp_path / "cloud.laz").stat().st_size > 1000


def test_the_scene_file_page_has_every_key():
    module = script(DOCS / "scene_reference.py")
    text = module.reference()
    groups = {group for _, group in [*module.TABLES, *module.SPECIES]}
    abstract = {
        spec.Sensor,
        spec.Scanner,
        spec.MovingScanner,
        spec.Polished,
    }  # their fields stand with each platform; the last is of objects, not of scene files
    for group in vars(spec).values():
        if not (isinstance(group, type) and issubclass(group, spec.Settings)):
            continue
        if group is spec.Settings or group in abstract:
            continue
        assert group in groups, group.__name__
        for field in dataclasses.fields(group):
            assert f"| `{field.name}` |" in text
            assert spec.param_of(field).help.replace("|", "\\|") in text


@pytest.mark.slow
@pytest.mark.parametrize("book", sorted(DOCS.glob("notebooks/*.ipynb")), ids=lambda p: p.stem)
def test_a_notebooks_cells_run(book, tmp_path, monkeypatch, empty_blender):
    """In order, without Jupyter; what a cell ends with is drawn as there."""
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    monkeypatch.chdir(tmp_path)
    names = {}
    cells = json.loads(book.read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert code
    for number, source in enumerate(code, 1):
        tree = ast.parse(source)
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"{book.name}, cell {number}", "exec"), names)
        if last is not None:
            shown = eval(compile(ast.Expression(last.value), book.name, "eval"), names)
            if hasattr(shown, "_repr_html_"):
                assert "<img" in shown._repr_html_()
    pyplot.close("all")


LINES = """
from forest_addon import api as forest

scene = forest.read("my.toml")
world = forest.build(scene)
world = forest.current()
cloud = world.scan(forest.Terrestrial(position=(0, 0, 1.6), angle_step_deg=2))
echo = world.ping(forest.Sonar(position=(3, 0, 1.5)))
sound = world.impulse_response(forest.Reverb(source=(0, 0, 1.5), receiver=(9, 0, 1.5)))
cloud.save("cloud.laz")
print(cloud.audit)
"""


@pytest.mark.slow
def test_a_script_in_plain_python(tmp_path):
    """A process of its own that imports bpy when it must, and ends."""
    bush = spec.Planting(species="hazelnut", variants=1, expected=3, exact=True)
    write_settings(tmp_path / "my.toml", spec.Scene(seed=1, plantings=(bush,)))
    (tmp_path / "lines.py").write_text(LINES, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "lines.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(DOCS.parent)},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "pulses in float64, ray by ray" in done.stdout
    assert (tmp_path / "cloud.laz").stat().st_size > 1000


def test_pictures_of_the_landing_page_are_described():
    page = (DOCS / "index.md").read_text(encoding="utf-8")
    described = re.findall(r"!\[(.*?)\]\(", page)
    assert len(described) >= 5
    assert all(len(words) > 10 for words in described)


def test_the_benchmarks_say_what_their_picture_assumes():
    from studies.bench.frontier import ASSUMPTIONS

    assert ASSUMPTIONS in (DOCS / "benchmarks.md").read_text(encoding="utf-8")
