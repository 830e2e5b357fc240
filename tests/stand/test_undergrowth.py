"""Undergrowth of measured stands: what is planted, that it moves no tree, and ground that is rough."""

from pathlib import Path

import numpy as np
import pytest

from forest_addon.base.trimesh import DEAD
from forest_addon.formats.toml_file import read_settings
from forest_addon.site import ForestSite
from forest_addon.spec import Forest, Planting, Reverb, Scene, SpecError, Terrain, Terrestrial
from forest_addon.stand.intensity.surface import Flat, Heightmap, Triangulated, roughened
from forest_addon.stand.plan import PLANTS

LOOKED_AT = (Terrestrial(),)
SCENES = Path(__file__).parents[2] / "assets" / "scenes"


def scene_of(undergrowth="auto", species="scots-pine", sensors=LOOKED_AT, **field):
    field = Forest(size=(20.0, 20.0), undergrowth=undergrowth, **field)
    planted = Planting(species=species, expected=20.0, exact=True)
    return Scene(seed=3, forest=field, plantings=(planted,), sensors=sensors)


def test_measured_stands_are_clothed_where_something_looks():
    assert len(ForestSite.read(scene_of()).scene.plantings) > 5
    assert len(ForestSite.read(scene_of("none")).scene.plantings) == 1
    assert len(ForestSite.read(scene_of(sensors=(Reverb(),))).scene.plantings) == 1
    assert len(ForestSite.read(scene_of(species="honda-birch")).scene.plantings) == 1
    by_hand = scene_of()
    fern = Planting(species="fern", expected=3.0)
    by_hand = by_hand.changed(plantings=(*by_hand.plantings, fern))
    assert len(ForestSite.read(by_hand).scene.plantings) == 2


@pytest.mark.medium
@pytest.mark.parametrize("name", sorted(path.stem for path in SCENES.glob("*.toml")))
def test_scenes_that_are_shipped_stay_as_they_are(name):
    scene = read_settings(SCENES / f"{name}.toml", Scene)
    site = ForestSite.read(scene, SCENES)
    assert site.scene == scene
    assert site.inputs.terrain is None or isinstance(site.inputs.terrain, Heightmap | Triangulated)


def test_undergrowth_moves_no_tree():
    bare, clothed = (
        ForestSite.read(scene_of(kind, spacing=1.5)).plan() for kind in ("none", "dense")
    )
    own = clothed.first(1)
    assert own.position[:, :2].tobytes() == bare.position[:, :2].tobytes()
    assert own.variant.tolist() == bare.variant.tolist()
    assert clothed.id[: len(bare)].tolist() == bare.id.tolist()
    assert (clothed.too_near[1:] == 0).all()


def test_young_trees_take_no_room_from_the_canopy():
    bare, clothed = (
        ForestSite.read(scene_of(kind)).planned().measured.trees for kind in ("none", "dense")
    )
    assert clothed[: len(bare)] == pytest.approx(bare, abs=1e-12)


def test_numbers_are_those_of_the_table():
    counts = np.zeros(len(PLANTS))
    for seed in range(5):
        site = ForestSite.read(scene_of("dense").changed(seed=seed))
        counts += site.plan().counts()[1 : 1 + len(PLANTS)]
    wanted = 5 * 400 / 1e4 * np.array([numbers[0][1] for numbers in PLANTS.values()])
    assert (abs(counts - wanted) < 4.5 * np.sqrt(wanted) + 1).all()  # Poisson, 1 in 1e5


def test_stumps_and_logs_are_dead_wood():
    for name in ("stump", "log"):
        site = ForestSite.read(scene_of("none", name))
        (tree, *_) = site.grow().variants.values()
        assert (tree.mesh.part == DEAD).all()
        assert tree.height < 0.6


def test_ground_is_as_rough_as_asked():
    field = Forest(size=(40.0, 30.0), margin=20.0)
    for roughness in (0.05, 0.2):
        ground = roughened(Flat(2.0), field, roughness, 5)
        x, y = np.meshgrid(np.linspace(1, 39, 160), np.linspace(1, 29, 120))
        height = ground.height(np.column_stack([x.ravel(), y.ravel()]))
        assert height.std() == pytest.approx(roughness / 4, rel=0.15)
        assert height.mean() == pytest.approx(2.0, abs=roughness / 10)
        edge = ground.height(np.array([[-5.9, 10.0], [45.9, 10.0], [10.0, -5.9], [10.0, 35.9]]))
        assert edge == pytest.approx(2.0, abs=1e-9)
    again = roughened(Flat(2.0), field, 0.2, 5)
    assert again.grid.nodes.tobytes() == ground.grid.nodes.tobytes()
    assert roughened(ground, field, 0.0, 5) is ground


def test_rough_triangles_are_refused():
    square = Triangulated(
        np.array([[0, 0, 0], [9, 0, 0], [9, 9, 0], [0, 9, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]])
    )
    with pytest.raises(SpecError, match="roughness"):
        roughened(square, Forest(), 0.1, 1)


def test_ground_with_undergrowth_is_rough_unless_said():
    assert ForestSite.read(scene_of("sparse")).inputs.terrain is not None
    level = scene_of("sparse", terrain=Terrain(roughness=0.0))
    assert ForestSite.read(level).inputs.terrain is None


def test_trees_of_dead_wood_alone_are_audited_as_others():
    from forest_addon.sensing.audit import held
    from forest_addon.sensing.trees_audit import part_of_tubes

    (tree, *_) = ForestSite.read(scene_of("none", "stump")).grow().variants.values()
    rng = np.random.default_rng(0)
    assert held([part_of_tubes([(tree, 0.002)], rng)], rng, 0.01).kept
