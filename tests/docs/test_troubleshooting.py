"""Every line of docs/troubleshooting.md is played: the symptom comes, and goes with what is advised."""

import re
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from references.scripts import ROOT, script

bpy = pytest.importorskip("bpy")

from forest_addon import api as forest
from headless import report

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
