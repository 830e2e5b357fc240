"""One scene through every door (API, panel, dataset, flight, command) is one forest, to the bit."""

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from ui.pressing import press

from forest_addon import api
from forest_addon.blender.files.export import empty_file
from forest_addon.blender.sensors.observe import Observer
from forest_addon.flight.woods import Stock
from forest_addon.formats.toml_file import table_of, write_settings
from forest_addon.spec import (
    Accuracy,
    Flight,
    Forest,
    Normal,
    Output,
    Planting,
    Reverb,
    Scene,
    Sonar,
    Targets,
    Terrestrial,
)
from headless.cli import main
from headless.dataset import scene as dataset
from headless.dataset.plan import Recipe

BUSH = Planting(species="hazelnut", variants=2, expected=3, exact=True)
SAPLING = Planting(
    species="scots-pine",
    variants=2,
    expected=2,
    exact=True,
    targets=Targets(dbh=Normal(mean=0.05, sd=0.01), height=4.0),
)
CLAP = Reverb(source=(1, 1, 1), receiver=(5, 5, 1), sample_rate=4000, duration=0.05)
BAT = Sonar(position=(-1.0, 3.0, 1.0), max_range=2.0)
NOTHING = dict.fromkeys(
    ("pictures", "goodness", "leaves", "report", "blend", "glb", "preview"), False
)
# Whether leaves are there: of a reverb without leaves none, of a bat at the edge those of near variants.
SCENES = {
    "full": ((BUSH,), (CLAP,), "full"),
    "unheard": ((BUSH,), (CLAP,), "auto"),
    "near": ((BUSH,), (BAT,), "auto"),
    "looked at": ((BUSH,), (CLAP, Terrestrial(position=(3, 3, 1), angle_step_deg=20)), "auto"),
    "measured": ((SAPLING, BUSH), (), "full"),
}


def scene_of(name):
    plantings, sensors, detail = SCENES[name]
    return Scene(
        name="Doors",
        seed=5,
        forest=Forest(size=(6.0, 6.0), margin=2.0, instancing="points"),
        plantings=plantings,
        sensors=sensors,
        accuracy=Accuracy(detail=detail, audit=0.0),
        flight=Flight(distance=5.0),
        output=Output(**NOTHING),
    )


def seen():
    """The geometry that stands in Blender now."""
    return Observer(bpy.context.evaluated_depsgraph_get()).geometry


def by_api(scene, _folder):
    empty_file()
    api.build(scene)
    return seen()


def by_panel(scene, folder):
    empty_file()
    path = folder / "scene.toml"
    write_settings(path, scene)
    assert press("load_scene", filepath=str(path)) == {"FINISHED"}
    assert press("build") == {"FINISHED"}
    return seen()


def by_dataset(scene, folder):
    recipe = Recipe(
        number=0,
        split="train",
        seed=0,
        base="doors",
        scene=table_of(scene.changed(sensors=())),
        folder=str(folder),
        ground={},
        places=[],
        keep={},
        library=None,
        varied={},
    )
    recipe.scene["sensors"] = table_of(scene).get("sensors", [])
    out = folder / "dataset"
    out.mkdir()
    dataset.make(recipe, out, dataset.Session())
    return seen()


def by_flight(scene, _folder):
    empty_file()
    around = Stock(scene).surroundings()
    around.world()
    standing = seen()
    same(around.geometry, standing)
    return standing


def by_command(scene, folder):
    path = folder / "command.toml"
    write_settings(path, scene)
    assert main(["run", str(path), "--out", str(folder / "out"), "--quiet"]) == 0
    return seen()


def same(one, other):
    """Two geometries, instance by instance, whatever the order of meshes."""
    assert len(one) == len(other)
    for name in ("transform", "tree", "species"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    for a, b in zip(one.mesh_index.tolist(), other.mesh_index.tolist(), strict=True):
        for name in ("vertices", "triangles", "part", "leaf"):
            ours, theirs = (getattr(g.meshes[k], name) for g, k in ((one, a), (other, b)))
            assert np.array_equal(ours, theirs), name


def leaves_of(geometry):
    """Triangles of leaves that stand."""
    each = np.array([(mesh.leaf >= 0).sum() for mesh in geometry.meshes])
    return int(each[geometry.mesh_index].sum())


@pytest.fixture(scope="module")
def grown():
    """Scenes as the API makes them."""
    kept = {}

    def made(name):
        if name not in kept:
            kept[name] = by_api(scene_of(name), None)
        return kept[name]

    return made


@pytest.mark.slow
@pytest.mark.parametrize(
    ("door", "name"),
    [
        *((by_panel, "measured"), (by_panel, "near"), (by_dataset, "looked at")),
        *((by_dataset, "full"), (by_command, "near"), (by_command, "unheard")),
    ],
)
def test_every_door_opens_on_the_same_forest(props, grown, door, name, tmp_path):
    same(door(scene_of(name), tmp_path), grown(name))


@pytest.mark.medium
@pytest.mark.parametrize("name", ["unheard", "measured"])
def test_a_flyer_meets_the_whole_forest(props, grown, name, tmp_path):
    """It may come near any tree, so that its forest is that of full detail, whatever other sensors need."""
    scene = scene_of(name)
    met = by_flight(scene, tmp_path)
    same(met, grown("full" if name == "unheard" else name))


def test_who_hears_no_leaf_grows_none(grown):
    assert leaves_of(grown("full")) > 1000
    assert leaves_of(grown("unheard")) == 0
    assert leaves_of(grown("looked at")) == leaves_of(grown("full"))
