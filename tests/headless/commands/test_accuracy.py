"""Error against seconds: choice and words by hand-made points; the command on a small scene, whose
recommended settings run and keep the error."""

from argparse import Namespace

import pytest
from matplotlib.image import imread

bpy = pytest.importorskip("bpy")

from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Scene, Sonar
from headless.accuracy.sensors import AccuracySweep, Point, mean_and_spread, timed

TODAY = Point({}, "today's", 1e-4, 0.0, 2.0)
FAST = Point({"cull": 0.01}, "fast", 8e-4, 0.0, 1.0)
UNSURE = Point({"cull": 0.02}, "unsure", 9e-4, 1e-4, 0.5)
EXACT = Point({"cull": 0.0}, "exact", 1e-8, 0.0, 50.0)
WORSE = Point({"cull": 0.05}, "worse", 9e-4, 0.0, 3.0)


def sweep(model=None, **terms):
    return AccuracySweep(
        Sonar(), "spectrum", "", TODAY, (FAST, UNSURE, EXACT, WORSE), model, terms=terms
    )


FREE = Point({}, "brute force", 0.0, 0.0, 0.01, elsewhere="as audits do")  # in no scene file
SLOWER = Point({"cull": 1e-9}, "slower", 0.99e-4, 0.0, 9.0)  # and hardly more exact
LOST = Point({}, "nothing", *mean_and_spread([]), 1.0)


@pytest.mark.parametrize(
    ("today", "others", "frontier", "chosen"),
    [
        (TODAY, (FAST, UNSURE, EXACT, WORSE), [UNSURE, FAST, TODAY, EXACT], EXACT),
        (TODAY, (FREE, FAST), [FAST, TODAY], TODAY),
        (TODAY, (SLOWER,), [TODAY], TODAY),
        (LOST, (), [], LOST),
    ],
)
def test_the_frontier_leaves_out_what_is_beaten(today, others, frontier, chosen):
    found = AccuracySweep(Sonar(), "spectrum", "", today, others)
    assert all(other in found.all for other in others)
    assert found.frontier() == frontier
    assert found.choice(1e-6, 60) is chosen


@pytest.mark.parametrize(
    ("error", "seconds", "chosen"),
    [
        (1e-3, 60, FAST),  # the sampled error of a faster one may be larger than that
        (2e-3, 60, UNSURE),
        (1e-4, 60, TODAY),
        (1e-6, 60, EXACT),
        (1e-6, 10, TODAY),  # the most exact that fits the time
        (1e-6, 0.1, UNSURE),
    ],
)
def test_the_cheapest_that_keeps_the_error(error, seconds, chosen):
    assert sweep().choice(error, seconds) is chosen


def test_the_largest_term_is_named():
    found = sweep(model=(0.3, "single scattering"), numerics=1e-4, culling=3e-5)
    assert found.dominant() == "model dominates, 3e-01 (beside numerics 1e-04, culling 3e-05)"
    assert "no setting helps" in found.verdict(1e-3, 60)
    assert "2.0 times as fast as today's" in sweep().verdict(1e-3, 60)
    assert "is not reached within 10 s" in sweep().verdict(1e-6, 10)
    assert sweep().dominant() == ""


def test_a_clock_that_ticks_seldom_tells_no_zero(monkeypatch):
    ticks = iter((0.0, 0.0, 0.0, 9.0))
    monkeypatch.setattr("headless.accuracy.sensors.time.process_time", lambda: next(ticks))
    assert timed(int) == (0, 4.5)


SCENE = """
name = "small"
seed = 3

[forest]
size = [5.0, 5.0]
margin = 3.0

[[plantings]]
species = "hazelnut"
variants = 1
expected = 1
exact = true

[[plantings]]
species = "apple"
variants = 1
expected = 1
exact = true

[[sensors]]
kind = "terrestrial"
position = [-2.0, 3.0, 1.5]
angle_step_deg = 8.0
beam = { divergence_mrad = [3.0, 3.0] }

[[sensors]]
kind = "tractor"
position = [-2.0, 0.0, 1.0]
track = 2.0
step = 0.5
angle_step_deg = 8.0

[[sensors]]
kind = "sonar"
position = [-2.0, 3.0, 1.5]
leaf_model = "paper"
shading = "extinction"
max_range = 4.0

[[sensors]]
kind = "reverb"
source = [-3.0, 3.0, 0.2]
receiver = [9.0, 3.0, 0.2]
sample_rate = 8000.0
duration = 0.05
continue_to = 12.0

[output]
blend = false
glb = false
preview = false
pictures = false
goodness = false
report = false
"""


@pytest.mark.slow
def test_a_scene_gets_a_picture_and_settings_that_run(tmp_path, monkeypatch, quick):
    from headless.accuracy.run import run
    from headless.pipeline import run_scene

    path = tmp_path / "small.toml"
    path.write_text(SCENE, encoding="utf-8")
    for name, few in (("NEAREST", 20), ("PULSES", 256), ("MANY_TRUNKS", 2000)):
        monkeypatch.setattr(f"headless.accuracy.sensors.{name}", few)
    said = []
    run(Namespace(scene=path, out=tmp_path / "out", error=1e-2, seconds=60), said.append)
    words = "\n".join(said)
    for name in ("cloud", "scan", "echo", "reverb"):
        assert f"\n{name} (" in f"\n{words}"
    assert "dominates" in words
    assert "leaves nearest to the beam's axis are left out" in words
    for knob in ("rays by BVHTree", "brute force", "tubes within", "of the leaves", "mesh "):
        assert knob in words, knob
    for knob in ("shading rays", "forest as far as 6 m", "extent "):
        assert knob in words, knob
    assert imread(tmp_path / "out" / "accuracy.png").std() > 0.05
    rows = (tmp_path / "out" / "accuracy.csv").read_text().splitlines()
    assert len(rows) > 15
    better = read_settings(tmp_path / "out" / "recommended.toml", Scene)
    run_scene(better, tmp_path, tmp_path / "run", quiet=True)
    assert (tmp_path / "run" / "run.json").is_file()
