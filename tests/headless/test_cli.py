"""The command line itself: a loop over commands, quick to answer, the same words for all."""

import json
import re
import shutil
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import laspy
import numpy as np
import pytest

from forest_addon import api, kernels, spec
from forest_addon.api import given
from forest_addon.base.places import ASSETS, environment_of_child, version
from forest_addon.formats.wav import write_wav
from headless import cli
from headless.cli import main
from headless.command import fault_of, is_told
from headless.commands import COMMANDS

bpy = pytest.importorskip("bpy")

from forest_addon.api.results import Response
from forest_addon.blender import packages
from forest_addon.blender.show.wind import knots_of
from forest_addon.drawing.palette import SPECIES, rgb
from forest_addon.drawing.stands import draw_stand
from forest_addon.drawing.strips import WIDE, stand_map
from forest_addon.formats.raster_file import read_png
from forest_addon.spec import Forest, Planting, Reverb, Scene, SpecError
from forest_addon.stand.compose import Inputs
from forest_addon.stand.plan import plan_stand
from forest_addon.ui.results.images import ABOVE, BELOW, LEFT
from headless import progress, report
from headless.command import read_scene, scene_file
from headless.report import page
from headless.report.page import _stand_in_words

ROOT = Path(__file__).resolve().parents[2]
HEAVY = {"numpy", "scipy", "matplotlib", "bpy", "laspy", "cattrs", "tqdm"}


def test_every_file_of_commands_is_one_command():
    files = {p.stem for p in (ROOT / "headless" / "commands").glob("[a-z]*.py")}
    assert files == {command.name for command in COMMANDS if not command.by}
    for by in {command.by for command in COMMANDS if command.by}:
        assert "def run(" in (ROOT / "headless" / f"{by.replace('.', '/')}.py").read_text()


HELP = "import headless.cli\ntry: headless.cli.main(['--help'])\nexcept SystemExit: pass"
SUMS = {f"scipy.{part}" for part in ("fft", "linalg", "sparse", "spatial", "special")} | {
    f"forest_addon.sensing.{part}"
    for part in ("sonar.ping", "sonar.search", "reverb.pair", "reverb.response", "reverb.sums")
}


@pytest.mark.medium
@pytest.mark.parametrize(
    ("code", "needed", "heavy"),
    [
        (HELP, "headless.commands", HEAVY),
        ("import headless.pipeline", "forest_addon.results.sonar", SUMS),
    ],
    ids=["help", "the steps of a run"],
)
def test_little_is_imported(code, needed, heavy):
    code = f"{code}\nimport sys; print(*sys.modules, file=sys.stderr)"
    ended = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    loaded = set(ended.stderr.split())
    assert needed in loaded
    assert not loaded & heavy


@pytest.mark.parametrize(
    ("words", "out"),
    [
        (["run", "a/my.toml"], "out/my"),
        (["demo"], "out/demo"),
        (["template", "w.stl", "--name", "elm"], "out/elm"),
        (["stand", "my.toml"], "out/my/points.csv"),
        (["estimate", "trees.csv"], "out/trees/site.toml"),
        (["lidar", "park.blend", "--scanner", "riegl-vz-400i"], "out/park-riegl-vz-400i.laz"),
        (["lidar", "park.blend", "--out", "a.las", "--format", "ply"], "a.las.ply"),
        (["convolve", "out/ir.wav", "clap.wav"], "out/ir-clap.wav"),
        (["stand", "my.toml", "--out", "b.csv"], "b.csv"),
    ],
)
def test_where_results_go(words, out):
    chosen = cli._parser().parse_args(words)
    assert chosen.command.output(chosen) == Path(out)


@pytest.mark.parametrize("study", cli.STUDIES)
def test_studies_have_moved(study, capsys):
    assert cli.main([study, "--seed", "3"]) == 2
    assert capsys.readouterr().err.endswith(f"python -m studies {study}\n")


@pytest.mark.slow
def test_a_species_called_as_no_file_can_be(headless, tmp_path, monkeypatch):
    monkeypatch.setattr("headless.report.trees.ICON", 24)
    (tmp_path / "s.toml").write_text('name = "oak/pine\\\\x"\n[honda]\nlevels.values = [1]\n')
    headless("species", tmp_path / "s.toml", "--pictures", tmp_path / "p")
    assert [path.name for path in (tmp_path / "p").glob("*.jpg")] == ["oak_pine_x.jpg"]


@pytest.mark.slow
@pytest.mark.parametrize(("ending", "code"), [("| true; exit ${PIPESTATUS[0]}", 141), (">&-", 0)])
def test_output_that_nobody_reads_ends_a_command_quietly(ending, code):
    words = f"{sys.executable} -m headless derive maple --generations 12 {ending}"
    ended = subprocess.run(["bash", "-c", words], cwd=ROOT, capture_output=True, text=True)
    assert ended.returncode == code
    assert ended.stderr == ""


def test_versions_say_what_computes(capsys, monkeypatch):
    monkeypatch.setenv("FOREST_SENSING_KERNELS", "off")
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--version"])
    said = f"Forest Sensing {version()}, kernels: numpy (FOREST_SENSING_KERNELS=off)\n"
    assert capsys.readouterr().out == said


@pytest.mark.skipif(shutil.which("bash") is None, reason="completion is played by bash")
@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("dem", {"demo"}),
        ("doc", {"doctor"}),
        ("run my.toml --conv", {"--convolve"}),
        ("run a", {"a tree.toml", "any.toml"}),  # files, also with blanks
        ("run any.toml --out a", {"a tree.toml", "any.toml"}),
        ("lidar any.toml --format double.", {"double.ply"}),
    ],
)
def test_a_shell_completes_commands_options_and_files(typed, offered, tmp_path, capsys):
    shtab = pytest.importorskip("shtab")
    assert cli.FILES.items() <= shtab.FILE.items()
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--completion", "bash"])
    for name in ("a tree.toml", "any.toml"):
        (tmp_path / name).touch()
    words = ["forest-sensing", *typed.split()]
    asked = f"COMP_WORDS=({' '.join(words)}); COMP_CWORD={len(words) - 1}"
    script = f"{capsys.readouterr().out}\n{asked}\n_shtab_forest_sensing"
    ended = subprocess.run(
        ["bash", "-c", script + '\nprintf "%s\\n" "${COMPREPLY[@]}"'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert set(ended.stdout.splitlines()) == offered


def test_completion_without_shtab_is_one_line(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert cli.main(["--completion", "bash"]) == 2
    assert capsys.readouterr().err == "error: this needs shtab: pip install shtab\n"


# ------------------------------------------------------------------------------------------ terminal
# Words of a run in a terminal and in a pipe: a line a step, and what it found; nothing is redrawn.

SCENE = """
seed = 7
[forest]
size = [8.0, 8.0]
[[plantings]]
species = "maple"
variants = 1
expected = 1
exact = true
[output]
report = false
preview = false
pictures = false
blend = false
glb = false
goodness = false
[[sensors]]
kind = "terrestrial"
name = "tripod"
position = [1.0, 1.0, 1.6]
angle_step_deg = 3.0
"""


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def test_a_step_is_a_line_that_says_what_it_found(scene, tmp_path, monkeypatch, headless):
    """Also where a folder is called like the command."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    said = headless("run", "scene.toml", "--out", "run").stderr
    assert "\r" not in said
    assert "\n\n" not in said
    lines = said.splitlines()
    assert max(map(len, lines)) < 110 + len(str(tmp_path))
    tripod = next(line for line in lines if "terrestrial tripod" in line)
    with laspy.open(tmp_path / "run" / "tripod.laz") as cloud:
        assert f"{cloud.header.point_count:,} points" in tripod
    assert "checked: " in tripod
    assert not any("sent again" in line for line in lines)


def test_details_are_said_where_they_are_asked_for_and_the_record_is_printed(
    scene, tmp_path, headless
):
    said = headless("run", scene, "--out", tmp_path / "out", "--verbose", "--json")
    assert any("sent again" in line for line in said.stderr.splitlines())
    assert json.loads(said.stdout) == json.loads((tmp_path / "out" / "run.json").read_text())


@pytest.mark.parametrize("word", ["demo", "assets/scenes/demo.toml"])
def test_what_ships_is_named_from_any_folder(word, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert api.read(word).name == api.read(ASSETS / "scenes" / "demo.toml").name
    (tmp_path / word).mkdir(parents=True)  # such as results of an earlier run
    assert api.read(word).name == api.read(ASSETS / "scenes" / "demo.toml").name


def test_a_mistyped_scene_is_answered_with_the_nearest_in_python():
    with pytest.raises(spec.SpecError, match='did you mean "demo"'):
        api.read("dmo")


def test_doctor_names_what_computes_and_how_to_get_what_is_missing(monkeypatch, capsys):
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert f"numpy {metadata.version('numpy')}" in said
    assert kernels.engine() in said
    monkeypatch.setenv(kernels.SWITCH, "off")
    monkeypatch.setitem(sys.modules, "bpy", None)
    monkeypatch.setattr(metadata, "version", lambda name: _version_but_of(name, "scipy"))
    assert main(["doctor"]) == 4
    told = capsys.readouterr()
    assert "missing scipy: pip install forest-sensing" in told.out
    assert "C compiler" in told.out
    assert "Blender, scipy missing" in told.err
    monkeypatch.setattr(metadata, "version", lambda name: _version_but_of(name, "3DFin"))
    main(["doctor"])
    apart = 'pip install "forest-sensing[trees]", in an environment of its own'
    assert f"missing 3DFin: {apart}" in capsys.readouterr().out


def _version_but_of(name, missing):
    if name == missing:
        raise metadata.PackageNotFoundError(name)
    return "1.0"


def test_without_blender_a_run_says_what_to_install(tmp_path):
    code = "import sys; sys.modules['bpy'] = None; from headless.cli import main; sys.exit(main())"
    words = [sys.executable, "-c", code, "run", "demo", "--out", str(tmp_path / "out")]
    ended = subprocess.run(words, capture_output=True, text=True, env=environment_of_child())
    assert ended.returncode == 2
    assert ended.stderr.splitlines()[-1].startswith(
        "error: run: Blender as a module is not installed"
    )
    assert "pip install bpy" in ended.stderr


def test_a_forest_that_memory_will_not_hold_is_refused_as_it_has_grown(
    scene, tmp_path, monkeypatch, headless
):
    monkeypatch.setattr(given, "free_memory", lambda: 1e5)
    said = headless("run", scene, "--out", tmp_path / "out", ends=2).stderr.splitlines()[-1]
    assert re.match(r"error: plantings: their 1 different trees need about \S+ GB of memory", said)
    assert said.endswith("0.0001 GB are free; give about 1 variants in all")


# ----------------------------------------------------------------------------------- names and words
# Scenes by their names on the command line, what it says, and what a report calls a forest.


def test_a_shipped_scene_goes_by_its_name_unless_a_file_has_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert scene_file("hedge-bat") == ASSETS / "scenes" / "hedge-bat.toml"
    assert read_scene(scene_file("hedge-bat"), 3).seed == 3
    assert scene_file("hedge-bat.toml") == Path("hedge-bat.toml")
    assert scene_file("other/hedge-bat") == Path("other/hedge-bat")
    (tmp_path / "hedge-bat").touch()
    assert scene_file("hedge-bat") == Path("hedge-bat")


def test_a_thinned_forest_is_not_called_poisson_alone():
    scene = spec.Scene(plantings=(spec.Planting(species="maple", expected=9),))
    assert _stand_in_words(scene, 0) == "A Poisson forest"
    assert "thinned" in _stand_in_words(scene, 2)


def test_what_is_said_beside_a_bar_begins_its_line(monkeypatch, capsys):
    """The terminal's line is what follows the last return to its begin."""
    monkeypatch.setitem(progress.BAR, "delay", 0.01)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    stages = progress.Stages(quiet=False)
    with stages.stage("scan") as shown:
        time.sleep(0.15)  # a bar is drawn anew after 0.1 s
        shown(1, 1)
        stages.say("  checked")
    lines = [re.split("\r", line)[-1] for line in capsys.readouterr().err.split("\n")]
    assert lines[0] == "  checked"
    assert lines[1].startswith("  scan")


# ------------------------------------------------------------------------------------------ warnings
# Warnings: said also when quiet, kept in run.json, and an exit code where that is asked for.

BARE = """
[forest]
size = [10, 10]
[output]
pictures = false
preview = false
report = false
blend = false
glb = false
"""
NOTHING_MET = (
    "[[sensors]]\nkind = 'terrestrial'\nposition = [5, 5, 1.6]\nelevation_deg = [10, 80]\n"
)


@pytest.fixture
def run(headless, tmp_path):
    def ran(text, *words):
        scene = tmp_path / "scene.toml"
        scene.write_text(text)
        return headless("run", scene, "--out", tmp_path / "out", *words, ends=None)

    return ran


@pytest.mark.medium
def test_strict_makes_a_warning_an_exit_code_and_keeps_the_results(run, tmp_path):
    ended = run(BARE + NOTHING_MET, "--quiet", "--strict")
    assert ended.returncode == 3
    assert "the results are kept" in ended.stderr
    assert (tmp_path / "out/run.json").exists()
    sonar = "[[sensors]]\nkind = 'sonar'\nposition = [5, 5, 1.5]\nazimuth_deg = 90\nelevation_deg = -60\n"
    assert run(BARE + sonar, "--strict", "--quiet").returncode == 0


@pytest.mark.medium
@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("", "neither trees nor sensors"),
        (NOTHING_MET, "0 points"),
        ("[air]\nhumidity = 0.5\n", "air.humidity is 0.5 %"),
        (
            "[[sensors]]\nkind = 'terrestrial'\nposition = [5, 5, -3]\nangle_step_deg = 9\n",
            "m under the ground",
        ),
        (
            "[[sensors]]\nkind = 'reverb'\nbark = 0.3\nsource = [1, 1, 1]\nreceiver = [9, 9, 1]\n",
            "bark has no effect",
        ),
        (
            "[[plantings]]\nspecies = 'silver-birch'\nexpected = 1\nscale = [2, 2]\n",
            "scale has no effect",
        ),
        (
            "[[plantings]]\nspecies = 'apple'\nlayout = 'list'\ntrees = 'trees.csv'\n",
            "column heigth is not used; did you mean height?",
        ),
        ("qsm = true\n[[stems]]\ncount = 5\n", "output.qsm has no effect"),
    ],
)
def test_what_is_hardly_meant_is_warned_of_when_quiet_and_kept_in_the_record(
    run, tmp_path, more, said
):
    (tmp_path / "trees.csv").write_text("x,y,heigth\n4,5,6\n")
    ended = run(BARE + more, "--quiet")
    assert ended.returncode == 0
    told = [line.strip().removeprefix("Warning: ") for line in ended.stderr.splitlines()]
    assert said in str(told)
    assert json.loads((tmp_path / "out/run.json").read_text())["warnings"] == told


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            "[[sensors]]\nkind = 'terrestrial'\nposition = [5, 5, 1.6]\nangle_step_deg = 0.0004\n",
            "GB of memory",
        ),
        (
            "[[sensors]]\nkind = 'sonar'\ncall = 'file'\ncall_file = 'slow.wav'\n",
            "holds nothing above 4000 Hz",
        ),
    ],
)
def test_what_is_found_wrong_beside_the_trees_is_one_sentence(run, tmp_path, more, said):
    write_wav(tmp_path / "slow.wav", np.sin(np.arange(4000.0)), 8000)
    ended = run(BARE + more, "--quiet")
    assert ended.returncode == 2
    assert said in ended.stderr
    assert ended.stderr.count("error:") == 1
    assert not list((tmp_path / "out").glob("*.laz"))


def test_words_of_numpy_are_a_fault_of_the_program_and_say_where(empty_blender):
    for raised, told in (
        (lambda: np.empty(0).max(), False),
        (lambda: knots_of(bpy.context.scene, 10), True),
    ):
        with pytest.raises(ValueError, match=r"\w") as problem:
            raised()
        assert is_told(problem.value) == told
        assert fault_of(problem.value).startswith(
            "a fault of this program that is worth a report: V"
        )
    assert fault_of(problem.value).endswith(")")


def test_an_error_that_nobody_meant_is_a_fault_of_the_program(capsys, monkeypatch):
    monkeypatch.setattr("headless.commands.derive.run", lambda *_: {}["gone"])
    assert main(["derive", "apple"]) == 1
    assert "a fault of this program that is worth a report: K" in capsys.readouterr().err


def test_memory_that_lacks_is_said_without_the_words_of_numpy(capsys, monkeypatch):
    def takes_all(*_):
        np.empty((8_000_000_000, 1000))

    monkeypatch.setattr("headless.commands.derive.run", takes_all)
    assert main(["derive", "apple"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("error: there is not enough memory for 58.2 TiB more; ")
    assert "shape" not in said


# -------------------------------------------------------------------------------- without matplotlib
# Where there is no matplotlib, as in Blender: data are written, pictures are plain, a sentence says so.

PLANTING = '[[plantings]]\nspecies = "{}"\nexpected = 20\nexact = true\n'


@pytest.fixture
def no_matplotlib(monkeypatch):
    """As if neither were installed; what was imported before is forgotten meanwhile."""
    drawing_ones = ("forest_addon.drawing.", "headless.report.", "headless.accuracy.")
    for name in list(sys.modules):
        if name.split(".")[0] in report.DRAWERS or name.startswith(drawing_ones):
            monkeypatch.delitem(sys.modules, name)
    for name in report.DRAWERS:
        monkeypatch.setitem(sys.modules, name, None)


@pytest.mark.medium
def test_the_map_of_a_stand_is_drawn_all_the_same(tmp_path, headless, no_matplotlib):
    scene = tmp_path / "scene.toml"
    scene.write_text("[forest]\nsize = [40, 20]\n" + PLANTING.format("maple"))
    ended = headless("stand", scene, "--out", tmp_path / "points.csv")
    assert "The map is plain: matplotlib is not there" in ended.stdout
    assert len((tmp_path / "points.csv").read_text().splitlines()) == 21
    pixels, _ = read_png((tmp_path / "points.png").read_bytes())
    green = np.abs(pixels / 255 - rgb(SPECIES["green"])).max(axis=2) < 0.12
    assert green.sum() > 20 * 50


@pytest.mark.medium
def test_an_estimate_is_written_without_its_picture(tmp_path, headless, no_matplotlib):
    trees = np.random.default_rng(1).uniform(0, 60, (80, 2))
    np.savetxt(tmp_path / "t.csv", trees, delimiter=",", header="x,y", comments="")
    words = ("--window", 0, 0, 60, 60, "--species", "maple", "--out", tmp_path / "site.toml")
    ended = headless("estimate", tmp_path / "t.csv", *words)
    assert (tmp_path / "site.toml").exists()
    assert "The picture is left out: matplotlib is not there" in ended.stdout
    assert not list(tmp_path.glob("*.png"))


@pytest.mark.medium
def test_what_was_asked_to_be_drawn_is_refused_in_a_sentence(tmp_path, headless, no_matplotlib):
    ended = headless("species", "hazelnut", "--sheet", tmp_path / "a.png", ends=2)
    assert "hazelnut" in ended.stdout  # the table comes first
    assert "--sheet" in ended.stderr
    assert "pip install matplotlib" in ended.stderr


def test_a_command_that_only_draws_says_what_it_lacks(tmp_path, headless, no_matplotlib):
    ended = headless("accuracy", "demo", "--out", tmp_path / "figures", ends=2)
    assert "accuracy cannot draw its pictures: matplotlib is not there" in ended.stderr


def test_blender_is_told_where_it_looks_for_packages(monkeypatch, tmp_path):
    """The folder is on its path; a plain Python's pip knows its own."""
    assert "--target" not in report.without("Nothing is drawn")
    app = SimpleNamespace(binary_path="/opt/blender/blender")
    monkeypatch.setattr(packages, "bpy", SimpleNamespace(app=app, utils=bpy.utils))
    folder = report.without("Nothing is drawn").split('--target "')[1].split('"')[0]
    assert Path(folder) in map(Path, sys.path)


def test_a_figure_that_a_notebook_asks_for_says_what_it_lacks(no_matplotlib):
    with pytest.raises(SpecError, match=r'plot.*needs matplotlib; type once: ".*" -m pip install'):
        Response(Reverb(), None, 0.0).plot()


@pytest.mark.medium
def test_trees_stand_in_the_plain_map_where_they_stand(tmp_path, no_matplotlib):
    settings = Scene(
        forest=Forest(size=(100, 50)),
        plantings=(Planting(species="a", crown=3.0, expected=1), Planting(species="b", expected=1)),
    )
    stand = SimpleNamespace(
        position=np.array([[25.0, 10.0, 0.0], [80.0, 40.0, 0.0]]),
        species=np.array([0, 1]),
        scale=np.ones(2),
        area=5000.0,
    )
    stand = type("Stand", (), {**vars(stand), "__len__": lambda self: 2})()
    path = page.draw_stand(stand, ("a", "b"), settings, Inputs(), tmp_path / "map.png")
    pixels = read_png(path.read_bytes())[0][ABOVE:-BELOW, LEFT:] / 255
    for name, place in (("green", (25, 10)), ("orange", (80, 40))):
        rows, columns = np.nonzero(np.abs(pixels - rgb(SPECIES[name])).max(axis=2) < 0.12)
        metres = np.array([columns.mean(), len(pixels) - 1 - rows.mean()]) / WIDE * 100
        assert metres == pytest.approx(place, abs=0.3)
        if name == "green":  # as wide as its crown
            assert np.ptp(columns) / WIDE * 100 == pytest.approx(6.0, abs=0.3)
    assert page.colours_in_words(("a", "b")) == "In the map: a green, b orange."


def test_a_single_tree_is_no_trees():
    settings = Scene(
        forest=Forest(size=(20, 20)), plantings=(Planting(species="a", expected=9, exact=True),)
    )
    stand = plan_stand(1, settings.forest, settings.plantings)
    one = stand.select(np.zeros(1, dtype=int))
    assert ": 1 tree on " in stand_map(one, settings, Inputs()).strips[0].title
    (key,) = draw_stand(one, ("a",), settings, Inputs()).axes[0].get_legend().get_texts()
    assert "\n1 tree, " in key.get_text()
