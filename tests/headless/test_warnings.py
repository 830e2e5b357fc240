"""Warnings: said also when quiet, kept in run.json, and an exit code where that is asked for."""

import json

import numpy as np
import pytest

from forest_addon.formats.wav import write_wav
from headless.cli import main
from headless.command import fault_of, is_told

pytest.importorskip("bpy")
import bpy

from forest_addon.blender.show.wind import knots_of

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
    BARE + "[[sensors]]\nkind = 'terrestrial'\nposition = [5, 5, 1.6]\nelevation_deg = [10, 80]\n"
)
CROWDED = """
[[plantings]]
species = "hazelnut"
variants = 1
expected = 60
exact = false
"""


@pytest.fixture
def run(headless, tmp_path):
    def ran(text, *words):
        scene = tmp_path / "scene.toml"
        scene.write_text(text)
        return headless("run", scene, "--out", tmp_path / "out", *words)

    return ran


def test_a_warning_is_said_when_quiet_and_kept_in_the_record(run, tmp_path):
    ended = run(NOTHING_MET, "--quiet")
    assert ended.returncode == 0
    said = [line.strip().removeprefix("Warning: ") for line in ended.stderr.splitlines()]
    assert said, "a cloud of no point"
    assert json.loads((tmp_path / "out/run.json").read_text())["warnings"] == said


@pytest.mark.medium
def test_strict_makes_a_warning_an_exit_code_and_keeps_the_results(run, tmp_path):
    ended = run(NOTHING_MET, "--quiet", "--strict")
    assert ended.returncode == 3
    assert "the results are kept" in ended.stderr
    assert (tmp_path / "out/run.json").exists()
    sonar = "[[sensors]]\nkind = 'sonar'\nposition = [5, 5, 1.5]\nazimuth_deg = 90\nelevation_deg = -60\n"
    assert run(BARE + sonar, "--strict", "--quiet").returncode == 0


@pytest.mark.slow
def test_trees_that_spacing_takes_away_are_told(run):
    crowded = BARE.replace("size = [10, 10]", "size = [10, 10]\nspacing = 4.0") + CROWDED
    said = run(crowded).stderr
    assert "trees stand" in said
    assert "nearer to others than spacing allows" in said
    assert "nearer to others" not in run(crowded.replace("4.0", "0.05")).stderr


@pytest.mark.parametrize("workers", [0, -3])
def test_fewer_than_one_worker_is_refused(run, workers):
    ended = run(BARE, f"--workers={workers}")
    assert ended.returncode == 2
    assert "--workers" in ended.stderr


def test_what_asks_for_more_memory_than_there_is_by_far_is_refused_before_it_begins(run, tmp_path):
    far = (
        BARE
        + "[[sensors]]\nkind = 'terrestrial'\nposition = [5, 5, 1.6]\nangle_step_deg = 0.0004\n"
    )
    ended = run(far)
    assert ended.returncode == 2
    assert "GB of memory" in ended.stderr
    assert not list((tmp_path / "out").glob("*.laz"))


@pytest.mark.medium
@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("", "neither trees nor sensors"),
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
def test_what_is_hardly_meant_is_warned_of(run, tmp_path, more, said):
    (tmp_path / "trees.csv").write_text("x,y,heigth\n4,5,6\n")
    ended = run(BARE + more, "--quiet")
    assert ended.returncode == 0
    assert said in ended.stderr
    assert said in str(json.loads((tmp_path / "out/run.json").read_text())["warnings"])


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("[tiles]\nsize = 0.0001\n", "give at least 0.01 m"),
        ("[[sensors]]\nkind = 'reverb'\nsample_rate = 8000.5\n", "need a whole number of hertz"),
        (f"[[sensors]]\nkind = 'terrestrial'\nname = '{'x' * 300}'\n", "give a shorter one"),
        (
            "[[sensors]]\nkind = 'sonar'\ncall = 'file'\ncall_file = 'slow.wav'\n",
            "holds nothing above 4000 Hz",
        ),
        (
            "[[plantings]]\nspecies = 'scots-pine'\nexpected = 9\ntargets = {dbh = {mean = 2.8}}\n",
            "times the largest measured of Pinus",
        ),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_sentence(run, tmp_path, more, said):
    write_wav(tmp_path / "slow.wav", np.sin(np.arange(4000.0)), 8000)
    ended = run(BARE + more, "--quiet")
    assert ended.returncode == 2
    assert said in ended.stderr
    assert ended.stderr.count("error:") == 1


def test_a_species_without_a_grammar_has_no_string(headless):
    ended = headless("derive", "scots-pine")
    assert ended.returncode == 2
    assert "not by an L-system" in ended.stderr


def test_a_level_that_is_no_number_is_refused(headless, tmp_path):
    write_wav(tmp_path / "a.wav", np.sin(np.arange(4000.0)), 8000)
    ended = headless("convolve", tmp_path / "a.wav", tmp_path / "a.wav", "--normalise", "nan")
    assert ended.returncode == 2
    assert "nan is no finite number" in ended.stderr


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


def test_memory_that_lacks_is_said_without_the_words_of_numpy(capsys, monkeypatch):
    def takes_all(*_):
        np.empty((8_000_000_000, 1000))

    monkeypatch.setattr("headless.commands.derive.run", takes_all)
    assert main(["derive", "apple"]) == 1
    said = capsys.readouterr().err
    assert said.startswith("error: there is not enough memory for 58.2 TiB more; ")
    assert "shape" not in said
