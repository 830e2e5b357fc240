"""The command ``canopy``: its figures are those of the world, its files those that it names."""

import csv
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy")

from forest_addon import api
from forest_addon.sensing.canopy import OUTSIDE, SKY
from forest_addon.spec import SpecError
from headless.commands.canopy import look_up_in

SCENE = """
seed = 3
[forest]
size = [8.0, 8.0]
[[plantings]]
species = "hazelnut"
variants = 1
expected = 6
exact = true
"""


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "small.toml"
    file.write_text(SCENE)
    return file


@pytest.mark.slow
def test_effective_and_true_index_and_pictures(scene, tmp_path):
    told = []
    seen = look_up_in(scene, tmp_path / "out", grid=2, height=0.5, say=told.append)
    world = api.build(api.read(scene))
    leaf = world.trees["leaf_area_m2"].sum() / 64
    assert world.leaf_area_index == pytest.approx(leaf)
    assert any(f"true leaf area index       {leaf:8.3f}" in line for line in told)
    assert 0 < seen.effective < 3 * leaf
    with open(tmp_path / "out/gaps.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["gap_fraction"]) for row in rows] == pytest.approx(seen.gap.tolist())
    with np.load(tmp_path / "out/hemispheres.npz") as held:
        pictures, points = held["picture"], held["point"]
    assert points.shape == (4, 3)
    assert (points[:, 2] == 0.5).all()
    shown = pictures[pictures != OUTSIDE]
    assert np.mean(pictures != OUTSIDE) == pytest.approx(np.pi / 4, abs=0.01)
    assert set(np.unique(shown).tolist()) <= {SKY, 0, 1, 2, 3}
    assert {SKY, 1, 2} <= set(np.unique(shown).tolist())
    assert (tmp_path / "out/hemispheres.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"at": ["1;2"]}, "is no point"),
        ({"at": ["1,2,3,4"]}, "is no point"),
        ({"at": ["nan,2"]}, "is no point"),
        ({"grid": 0}, "out of range"),
    ],
)
def test_what_cannot_be_is_said_before_anything_grows(scene, tmp_path, words, said):
    with pytest.raises(SpecError, match=said):
        look_up_in(scene, tmp_path / "out", **words)
    assert not Path(tmp_path / "out").exists()
