"""The scenes that come along: each is read, and names species and surfaces that are there."""

from pathlib import Path

import pytest

from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.library import find_species
from forest_addon.spec import Scene

SCENES = Path(__file__).resolve().parents[2] / "assets" / "scenes"


@pytest.mark.parametrize("path", sorted(SCENES.glob("*.toml")), ids=lambda path: path.stem)
def test_a_scene_is_whole(path):
    scene = read_settings(path, Scene)
    assert scene.sensors or scene.plantings
    for planting in scene.plantings:
        assert find_species(planting.species, SCENES).is_file()


@pytest.mark.parametrize(
    ("name", "count"), [("100k", 100_000), ("200k", 200_000), ("500k", 500_000)]
)
def test_the_papers_parameters(name, count):
    scene = read_settings(SCENES / f"paper-{name}.toml", Scene)
    (stems,), (reverb,) = scene.stems, scene.sensors
    assert (stems.count, stems.radius.mean, stems.radius.sd) == (count, 0.25, 0)
    assert scene.forest.size == (1000, 1000)
    assert (reverb.ground, reverb.strength, reverb.spreading) == (0.8, 2.0, 0.7)
    assert (reverb.sample_rate, scene.air.speed()) == (24_000, 343)
