"""Warnings: said also when quiet, kept in run.json, and an exit code where that is asked for."""

import json

import pytest

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


def test_strict_makes_a_warning_an_exit_code_and_keeps_the_results(run, tmp_path):
    ended = run(NOTHING_MET, "--quiet", "--strict")
    assert ended.returncode == 3
    assert "the results are kept" in ended.stderr
    assert (tmp_path / "out/run.json").exists()
    assert run(BARE, "--strict", "--quiet").returncode == 0


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
