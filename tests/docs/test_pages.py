"""Pages print what can be used: commands, settings, Python, notebooks, every key; links lead somewhere.

The examples of docs/dataset.md are played in headless/dataset/test_convert.py, the sensor of
docs/architecture.md in test_new_sensor.py.
"""

import ast
import dataclasses
import json
import os
import re
import shlex
import subprocess
import sys
import tomllib

import pytest
from references.scripts import ROOT, script

pytest.importorskip("bpy")

from forest_addon import spec
from forest_addon.formats.toml_file import read_settings
from headless.cli import _parser, _values_joined

guides = script("packaging/time_guides.py")
DOCS = ROOT / "docs"
GUIDES = sorted(DOCS.glob("guide/*.md"))
PAGES = [
    *(ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "assets/species/README.md"),
    *sorted(DOCS.glob("*.md")),
    *GUIDES,
]
TEXT = {page: page.read_text(encoding="utf-8") for page in PAGES}
STARTS = r"(?:\.venv/bin/python -m headless|python -m headless|forest-sensing)"
each_page = pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())


def blocks(page, kind):
    """The blocks of a page of one kind, python or toml."""
    return re.findall(rf"^```{kind}\n(.*?)^```", TEXT[page], re.M | re.S)


def commands(page):
    """The words of each command of a page, in blocks and in running text."""
    text = re.sub(r"\\\n\s*", " ", TEXT[page])
    found = re.findall(rf"(?<!`)`{STARTS} +([^`]+)`(?!`)", text.replace("\n", " "))
    for block in re.findall(r"^ *```[a-z]*\n(.*?)^ *```", text, re.M | re.S):
        found += re.findall(rf"^\s*{STARTS} +([^\n]*)", block, re.M)
    return [shlex.split(line, comments=True) for line in found]


@pytest.mark.medium
@each_page
def test_its_commands_are_taken(page, capsys):
    parser = _parser()
    for words in commands(page):
        if "…" in words or "..." in words or len(words) == 1:  # a name, or --help
            continue
        try:
            parser.parse_args(_values_joined(words))
        except SystemExit:
            pytest.fail(f"{' '.join(words)}: {capsys.readouterr().err.splitlines()[-1]}")


@each_page
def test_its_links_lead_somewhere(page):
    text = re.sub(r"^ *```.*?^ *```", "", TEXT[page], flags=re.M | re.S)
    for target in re.findall(r"\]\(([^)\s#]+)[^)\s]*\)", text):
        # scene-file.md is made by docs/scene_reference.py, when the site is built.
        if not re.match(r"[a-z]+:", target) and not target.endswith("scene-file.md"):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_the_gallery_shows_its_scene_files_whole():
    gallery = script("packaging/make_gallery.py")
    assert (DOCS / "gallery.md").read_text("utf-8") == gallery.page()
    assert len(gallery.ORDER) == 12
    assert set(gallery.ORDER) == {file.stem for file in DOCS.glob("gallery/*.toml")}


@pytest.mark.parametrize("sensor", ["lidar", "sonar", "reverb", "flight"])
def test_a_sensor_s_page_is_use_model_and_evidence(sensor):
    """In that order, with a picture and a command before them."""
    begin, *parts = re.split(r"^## ", TEXT[DOCS / f"{sensor}.md"], flags=re.M)
    assert [part.split("\n")[0] for part in parts] == ["Use", "Model", "Evidence"]
    assert "![" in begin
    assert "python -m headless" in begin


# What stands before a table that a page shows without its head.
HEADS = {
    "[plantings.": '[[plantings]]\nspecies = "maple"\nexpected = 9\n',
    "[siblings]": 'name = "mine"\ntemplate = { wood = "wood.stl", leaves = "leaves.stl" }\n',
}


@each_page
def test_its_tables_are_taken(page, tmp_path):
    path = tmp_path / "my.toml"
    for text in blocks(page, "toml"):
        path.write_text("".join(h for start, h in HEADS.items() if text.startswith(start)) + text)
        written = tomllib.loads(path.read_text())
        read = read_settings(path, spec.Species if "name" in written else spec.Scene)
        assert all(getattr(read, table) for table in written.keys() - {"version"}), text


def test_there_is_something_to_hold_pages_to():
    assert sum(len(commands(page)) for page in PAGES) > 40
    assert sum(len(blocks(page, "toml")) for page in PAGES) > 10
    assert len(TEXT[ROOT / "README.md"].splitlines()) <= 200
    described = re.findall(r"!\[(.*?)\]\(", TEXT[DOCS / "index.md"])
    assert len(described) >= 5
    assert all(len(words) > 10 for words in described)


BIG = """
seed = 1

[forest]
size = [60, 60]

[tiles]
size = 30
buffer = 10

[[plantings]]
species = "abop-monopodial-a"
variants = 1
expected = 12
"""


# Pages show forests and scans of a useful size; what is played is the same with less of it.
SMALLER = (
    (r"\bcount=1000\b", "count=100"),
    (r"\bcount = 2\b", "count = 1"),
    (r"\bdensity=0\.1\b", "density=0.05"),
    (r"\bvariants=5, density=1\.0\b", "variants=1, density=1e-6"),
    (r"\bvariants=[23]\b", "variants=1"),
    (r"--variants 2\b", "--variants 1"),
    (r"--episodes 2\b", "--episodes 1"),
    (r"\bnum_envs=64\b", "num_envs=2"),
    (r"\bangle_step_deg=0\.2\b", "angle_step_deg=0.3"),
    (r"\bangle_step_deg=(0\.5|1\.0)", "angle_step_deg=2.0"),
    (r"(position=\(14\.5, 14\.5, 1\.6\))", r"\1, angle_step_deg=2.0"),
    (r"\barange\(-40, 41, 5\.0\)", "arange(-40, 41, 40.0)"),
    (r"\bmax_range=6\.0, cull=0\.01\b", "max_range=3.0, cull=0.1"),
    (r"(dataset (tiny|hazels\.toml)) ", r"\1 --workers 1 "),
    (
        r"dataset tiny ",
        "dataset tiny --set scene.sensors[tls].angle_step_deg=3.0 --set scene.forest.margin=2.0 "
        "--set scene.sensors[als].pulse_rate=2000.0 "
        "--set 'mix.species=[\"hazelnut\"]' --set mix.kinds=[1,1] ",
    ),
    (r"\bcull=0\.01\b", "cull=0.1"),
    (r"\brange\(100\)", "range(10)"),
    (r'^name = "tls"', 'name = "tls"\nangle_step_deg = 3.0'),
    (r'make\("ForestSensing/Flight-v0"\)', 'make("ForestSensing/Flight-v0", scene=SCENE)'),
    (r"\bsize = 20\.0", "size = 10.0"),
    (r'"track": 8', '"track": 1'),
    (r"\bvariants=4\b", "variants=1"),
    (
        r"\bposition=\(10, 10, 1\.6\), angle_step_deg=0\.25",
        "position=(5, 5, 1.6), angle_step_deg=1.0",
    ),
    (r"\barray\(\[3\.0, 6\.0, 12\.0, 24\.0\]\)", "array([3.0, 24.0])"),
    (r"\bside in range\(4\)", "side in range(1)"),
    (r"^bake\(", "bpy.context.scene.frame_end = 3\nbake("),
    (r"\bfly flight-poisson\b", "fly assets/scenes/flight-poisson.toml"),
    (r"max_range=6\.0, cull=0\.1\b", "max_range=4.0, cull=0.1"),
    (r"\barange\(40\)", "arange(12)"),
    (r"\[(:?)20(:?)\]", r"[\g<1>6\2]"),
    (r"\bduration=1\.0\b", "duration=0.3"),
    (r"\bsize = 30\.0", "size = 14.0"),
    (r"\bmost=20_000\b", "most=2_000"),
    (r"\(-15, 10\), angle_step_deg=0\.3", "(-15, 10), angle_step_deg=1.0"),
    (r"\belevation_deg=\(-50, 85\)", "elevation_deg=(-30, 40)"),
    (
        r"angle_step_deg=0\.3, elevation_deg=\(-10, 80\)",
        "angle_step_deg=1.0, elevation_deg=(-10, 80)",
    ),
)


def smaller(text):
    for large, small in SMALLER:
        text = re.sub(large, small, text, flags=re.M)
    return text


@pytest.fixture
def reader(tmp_path, monkeypatch, empty_blender, quick, warm):
    """A reader's folder: the assets, a tree of one's own; scenes that pages name have a few trees."""
    scenes = tmp_path / "assets" / "scenes"
    scenes.mkdir(parents=True)
    for shipped in [*(ROOT / "assets").iterdir(), *(ROOT / "assets" / "scenes").iterdir()]:
        if shipped.name != "scenes":
            (tmp_path / shipped.relative_to(ROOT)).symlink_to(shipped)
    for name in ("demo.toml", "flight-poisson.toml"):
        few = (scenes / name).read_text(encoding="utf-8")
        (scenes / name).unlink()
        few = re.sub(r"^expected = \d+", "expected = 3\nexact = true", few, flags=re.M)
        few = re.sub(r"^variants = \d+", "variants = 1", few, flags=re.M)
        (scenes / name).write_text(few, encoding="utf-8")
    for name in ("wood.stl", "leaves.stl"):
        (tmp_path / name).symlink_to(ROOT / "assets" / "templates" / "hazelnut" / name)
    (tmp_path / "big.toml").write_text(BIG, encoding="utf-8")
    warm.lend(monkeypatch)
    monkeypatch.chdir(tmp_path)
    return tmp_path


RUN_ELSEWHERE = {"dataset", "index", "architecture"}
TUTORIALS = [page for page in [*GUIDES, DOCS / "stand.md"] if guides.steps(page)]
SNIPPETS = [page for page in PAGES if blocks(page, "python") and page.stem not in RUN_ELSEWHERE]


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", dict.fromkeys(TUTORIALS + SNIPPETS), ids=lambda page: page.relative_to(ROOT).as_posix()
)
def test_its_code_and_commands_run(page, reader):
    """As printed but smaller, in order; a tutorial's commands, too."""
    if page in TUTORIALS:
        copy = reader / page.name
        copy.write_text(smaller(TEXT[page]), encoding="utf-8")
        wanted, play = TEXT[page], lambda: guides.play(copy)
    else:
        code = [text for text in blocks(page, "python") if "stable_baselines3" not in text]
        wanted, play = (
            "\n".join(code),
            lambda: exec(smaller("\n".join(code)), {"SCENE": "assets/scenes/flight-poisson.toml"}),
        )
    if "import gymnasium" in wanted:
        pytest.importorskip("gymnasium")
    play()


def test_every_tutorial_says_what_it_takes():
    tasks = guides.TASKS.read_text(encoding="utf-8")
    played = [page for page in TUTORIALS if page in GUIDES]
    assert len(played) >= 9
    cost = re.compile(r"Takes (.*?) of one core, (.*?) of memory, (.*?) of")
    for page in played:
        row = " | ".join(cost.search(guides.COST.search(TEXT[page])[0]).groups())
        assert f"]({page.name}) | {row} |" in tasks, page.name


@pytest.mark.medium
def test_the_landing_page_s_script_runs_in_plain_python(tmp_path):
    """A process of its own that imports bpy when it must, and ends."""
    (tmp_path / "script.py").write_text("\n".join(blocks(DOCS / "index.md", "python")), "utf-8")
    done = subprocess.run(
        [sys.executable, "script.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "cloud.laz").stat().st_size > 1000


@pytest.mark.slow
@pytest.mark.parametrize("book", sorted(DOCS.glob("notebooks/*.ipynb")), ids=lambda p: p.stem)
def test_a_notebooks_cells_run(book, reader):
    """In order, without Jupyter; what a cell ends with is drawn as there."""
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("agg")
    names = {}
    cells = json.loads(book.read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert code
    for number, source in enumerate(code, 1):
        tree = ast.parse(smaller(source))
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, f"{book.name}, cell {number}", "exec"), names)
        if last is not None:
            shown = eval(compile(ast.Expression(last.value), book.name, "eval"), names)
            if hasattr(shown, "_repr_html_"):
                assert "<img" in shown._repr_html_()
    pyplot.close("all")


def test_the_scene_file_page_has_every_key():
    module = script("docs/scene_reference.py")
    text = module.reference()
    groups = {group for _, group in [*module.TABLES, *module.SPECIES]}
    # Their fields stand with each platform; the last is of objects, not of scene files.
    abstract = {spec.Settings, spec.Sensor, spec.Scanner, spec.MovingScanner, spec.Polished}
    for group in vars(spec).values():
        if isinstance(group, type) and issubclass(group, spec.Settings) and group not in abstract:
            assert group in groups, group.__name__
            for field in dataclasses.fields(group):
                assert f"| `{field.name}` |" in text
                assert spec.param_of(field).help.replace("|", "\\|") in text


def test_the_benchmarks_say_what_their_picture_assumes():
    from studies.bench.frontier import ASSUMPTIONS

    assert ASSUMPTIONS in TEXT[DOCS / "benchmarks.md"]
