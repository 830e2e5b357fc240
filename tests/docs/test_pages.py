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
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.scripts import ROOT, script

from forest_addon import api as forest, spec
from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Scene
from forest_addon.stand.files import read_inputs
from forest_addon.stand.plan import plan_stand
from headless import report
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


# ---------------------------------------------------------------------------------- bring your data
# The table of docs/bring-your-data.md is planted by the scene that the page shows, word for word.

TABLE_PAGE = (ROOT / "docs/bring-your-data.md").read_text(encoding="utf-8")


def test_its_trees_stand_where_they_were_measured(tmp_path):
    (tmp_path / "trees.csv").write_text(TABLE_PAGE.split("```\n")[1], encoding="utf-8")
    toml = re.search(r"^```toml\n(.*?)^```", TABLE_PAGE, re.M | re.S)[1]
    (tmp_path / "these.toml").write_text(toml, encoding="utf-8")
    scene = read_settings(tmp_path / "these.toml", Scene)
    inputs = read_inputs(scene, tmp_path)
    assert 'trees.csv: "Bu" is planted as european-beech' in inputs.told
    assert 'trees.csv: "Fi" is planted as norway-spruce' in inputs.told
    trees = inputs.lists["trees.csv"]
    measured = [[0.315, 22.4], [0.28, 21.0], [0.402, 25.1], [0.228, 17.9]]
    assert trees.measures[:, :2] == pytest.approx(np.array(measured))
    stand = plan_stand(scene.seed, scene.forest, scene.plantings, inputs)
    of = np.array([planting.species for planting in scene.plantings])[stand.species]
    places = {
        (kind, *place)
        for kind, place in zip(of.tolist(), stand.position[:, :2].tolist(), strict=True)
    }
    assert places == {
        ("european-beech", 4.2, 3.75),
        ("norway-spruce", 11.8, 6.1),
        ("european-beech", 6.4, 14.9),
        ("european-beech", 17.1, 4.4),
    }


# ---------------------------------------------------------------------------------- troubleshooting
# Every line of docs/troubleshooting.md is played: the symptom comes, and goes with what is advised.

PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
ROWS = [row for row in re.findall(r"^\| (.+?) \| .+ \|$", PAGE, re.M) if row != "you see"]

OUTPUT = "[output]\npictures = false\npreview = false\nreport = false\nblend = false\nglb = false\n"
BARE = f"[forest]\nsize = [10, 10]\n{OUTPUT}"
TRIPOD = "[[sensors]]\nkind = 'terrestrial'\nposition = [5, 5, 1.6]\nangle_step_deg = 9\n"
SONAR = "[[sensors]]\nkind = 'sonar'\nposition = [5, 5, 1.5]\nelevation_deg = -60\n"
REVERB = "[[sensors]]\nkind = 'reverb'\nsource = [1, 1, 1]\nreceiver = [9, 9, 1]\n"
STEMS = "[[stems]]\ncount = 50\nradius = { mean = 0.2, sd = 0.01 }\n"
CROWDED = (
    BARE.replace("10]", "10]\nspacing = 4", 1)
    + "[[plantings]]\nspecies = 'hazelnut'\nvariants = 1\nexpected = 60\nexact = true\n"
)
GROUND = f"{BARE}[forest.terrain]\nfile = 'dem.asc'\n"

# The scene that shows a symptom, and the scene that is as advised.
SCENES = {
    "`is not known; did you mean`": (BARE.replace("size", "sise"), BARE + TRIPOD),
    "`the scene has neither trees nor sensors`": (BARE, BARE + TRIPOD),
    "`are nearer to others than spacing allows`": (CROWDED, CROWDED.replace("= 4", "= 0.01")),
    "`would put the field on it`": (GROUND, "offset = [500040, 4000040, 0]\n" + GROUND),
    "`there is not enough memory for` or `GB of memory, and`": (
        BARE + TRIPOD.replace("= 9", "= 0.0004"),
        BARE + TRIPOD,
    ),
    "`0 points: nothing that sends enough back`": (
        BARE + TRIPOD + "elevation_deg = [10, 80]\n",
        BARE + TRIPOD + "elevation_deg = [-80, 80]\n",
    ),
    "`0 points: the nearest thing is`": (
        BARE + TRIPOD.replace("5, 5", "200, 5"),
        BARE + TRIPOD.replace("5, 5", "200, 5") + "max_range = 500\nfaintest = 0\n",
    ),
    "`under the ground at`": (BARE + TRIPOD.replace("1.6", "-3"), BARE + TRIPOD),
    "`is for scenes that stand still`": (
        BARE + TRIPOD + "bounces = true\nmotion = true\n",
        BARE + TRIPOD + "bounces = true\n",
    ),
    "`no trunk is heard`": (BARE + REVERB, BARE + STEMS + REVERB),
    '`has no effect: it needs model to be "forest"`': (
        BARE + STEMS + REVERB + "bark = 0.3\n",
        BARE + STEMS + REVERB + "bark = 0.3\nmodel = 'forest'\n",
    ),
    "`hears all trees of a forest at once`": (
        f"{BARE}[tiles]\nsize = 5\nbuffer = 2\n{REVERB}",
        BARE + STEMS + REVERB,
    ),
}


@pytest.fixture
def run(headless, tmp_path, empty_blender, monkeypatch):
    """Runs a scene in a folder of its own, in which a terrain lies; returns what was said."""
    monkeypatch.chdir(tmp_path)
    head = "ncols 3\nnrows 3\nxllcorner 500000\nyllcorner 4000000\ncellsize 30\n"
    Path("dem.asc").write_text(head + "100 101 102\n" * 3)

    def ran(text):
        Path("scene.toml").write_text(text)
        ended = headless("run", "scene.toml", "--out", "out", ends=None)
        return ended.stdout + ended.stderr

    return ran


def no_python(play):
    def found(**where):
        words = ["/bin/sh", ROOT / "packaging/find_python.sh"]
        return subprocess.run(words, env={"HOME": "/none", **where}, capture_output=True, text=True)

    play.shows(found(PATH="/none").stderr)
    assert found(PATH="/none", PYTHON=play.python).returncode == 0


def no_libraries(play):
    setup = script("packaging/setup_env.py")
    advice = setup.advice(["libXi.so.6"], "apt")
    play.shows(advice)
    assert advice.endswith("apt install libxi6")
    assert setup.missing_libraries() == []  # here, where it was done


def no_matplotlib(play):
    Path("scene.toml").write_text(CROWDED.replace("= 4", "= 0.01"))
    with play.patched() as patch:
        for name in report.DRAWERS:
            patch.setitem(sys.modules, name, None)
        play.shows(play.headless("stand", "scene.toml", "--out", "plain.csv", ends=None).stdout)
    play.hides(play.headless("stand", "scene.toml", "--out", "points.csv", ends=None).stdout)


def numpy_computes(play):
    with play.patched() as patch:
        patch.setenv("FOREST_SENSING_KERNELS", "off")
        play.shows(play.headless("doctor", ends=None).stdout)
    assert "(FOREST_SENSING_KERNELS=off)" not in play.headless("doctor", ends=None).stdout


def a_cell_of_a_table(play):
    for dbh in ("abc", "0.2"):
        Path("trees.csv").write_text(f"x,y,dbh\n1,2,{dbh}\n3,4,0.3\n5,1,0.1\n")
        said = play.headless("estimate", "trees.csv", "--out", "site.toml", ends=None).stderr
        (play.shows if dbh == "abc" else play.hides)(said)


def nothing_moves(play):
    bpy.ops.mesh.primitive_cube_add(location=(0, 0, 0))
    cube = bpy.context.object
    cube.keyframe_insert("location", frame=1)
    cube.location.x = 5
    cube.keyframe_insert("location", frame=25)
    scanner = {"position": (0, -4, 0), "angle_step_deg": 5, "pulse_rate": 2000.0}
    still, moving = (
        forest.current().scan(forest.Terrestrial(**scanner, motion=motion))
        for motion in (False, True)
    )
    assert not still.motion
    assert np.nanmax(np.abs(moving.motion["velocity"])) > 1


def ctrl_c(done, total):
    if done > total / 2:
        raise KeyboardInterrupt


def interrupted(play):
    bpy.ops.mesh.primitive_cube_add(location=(0, 0, 0))
    bpy.ops.wm.save_as_mainfile(filepath=str(Path("cube.blend").resolve()))
    scan = ["lidar", "cube.blend", "--scanner", "riegl-vz-400i", "--at", "0,-4,0", "--chunk", 500]
    scan += ["--set", "angle_step_deg=2", "--quiet", "--out"]
    play.headless(*scan, "whole.laz")
    with play.patched() as patch:
        patch.setattr("headless.progress.Stages.stage", lambda *_: nullcontext(ctrl_c))
        play.headless(*scan, "cut.laz", ends=130)
    assert not Path("cut.laz").exists()
    play.headless(*scan, "cut.laz", "--resume")
    assert Path("cut.laz").read_bytes() == Path("whole.laz").read_bytes()


def no_instrument(play):
    play.shows(play.headless("lidar", "none.blend", ends=2).stderr)
    assert "riegl-vz-400i" in play.headless("lidar", "--list").stdout


def an_echo_of_zeros(play):
    for reach, heard in ((1.0, False), (5.0, True)):
        play.run(f"{BARE}{SONAR}max_range = {reach}\n")
        assert np.any(np.load("out/echo.npz")["impulse_response"]) == heard


def no_late_sound(play):
    play.shows(
        play.run(BARE + STEMS + REVERB + "duration = 0.05\n") + Path("out/run.json").read_text()
    )
    play.hides(play.run(BARE + STEMS + REVERB) + Path("out/run.json").read_text())


PLAYS = {
    "`No Python 3.13 or 3.11 that runs was found`": no_python,
    "`Blender needs system libraries that are missing`": no_libraries,
    "`matplotlib is not there`": no_matplotlib,
    "`numpy (FOREST_SENSING_KERNELS=off)` in `forest-sensing doctor`": numpy_computes,
    "`not a finite number; use one kind of decimals`": a_cell_of_a_table,
    "animated objects stand still in the cloud": nothing_moves,
    "a scan was interrupted": interrupted,
    "`--scanner: is missing`": no_instrument,
    "an echo file of zeros": an_echo_of_zeros,
    "`no late sound`, or T30 is missing": no_late_sound,
}


class Play:
    """One line of the page, and what playing it takes."""

    def __init__(self, row, run, headless, monkeypatch):
        self.fragments = re.findall("`(.+?)`", row)
        self.run, self.headless, self.python = run, headless, sys.executable
        self.patched = monkeypatch.context

    def shows(self, said):
        assert any(fragment in said for fragment in self.fragments), said

    def hides(self, said):
        assert not any(fragment in said for fragment in self.fragments), said


@pytest.mark.slow
@pytest.mark.parametrize("row", ROWS)
def test_the_symptom_comes_and_goes(row, run, headless, monkeypatch, quick):
    play = Play(row, run, headless, monkeypatch)
    if row in SCENES:
        sick, well = SCENES[row]
        play.shows(run(sick))
        play.hides(run(well))
    else:
        PLAYS[row](play)


def test_twenty_symptoms_at_least():
    assert len(ROWS) >= 20
    assert set(ROWS) == SCENES.keys() | PLAYS.keys()
