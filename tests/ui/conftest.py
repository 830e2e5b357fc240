"""The add-on registered in Blender, and a forest that is small enough to build in every test."""

import atexit

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import spec, ui
from forest_addon.blender.scene import assets
from forest_addon.drawing import strips as plots
from forest_addon.ui.settings import exchange


@pytest.fixture(scope="session")
def registered():
    """The add-on, registered for all tests that need it.

    bpy 4.5 hangs at exit when an operator stays registered, whatever happens to the tests.
    """
    ui.register()
    undo = atexit.register(ui.unregister)
    yield
    atexit.unregister(undo)
    ui.unregister()


@pytest.fixture
def props(registered, empty_blender):
    """The panel's properties in an empty scene."""
    return empty_blender.context.scene.forest_sensing


@pytest.fixture
def sensor(props):
    """Adds a sensor of a kind to the scene: its object, with settings that are given."""

    def add(kind, **settings):
        return exchange.add_sensor(bpy.context.scene, spec.SENSORS[kind](**settings))

    return add


@pytest.fixture
def small(props, monkeypatch):
    """The panel filled with a forest of about three hazels and coarse sensors in their midst."""
    return fill(monkeypatch)


def fill(patch):
    few_pixels(patch)
    props = bpy.context.scene.forest_sensing
    props.accuracy.audit = 0.0  # sensors in scenes of the user's own are audited
    props.seed = 3
    props.forest.size = (6, 6)
    props.forest.margin = 2
    planting = props.plantings.add()
    planting.species = "hazelnut"
    planting.variants = 1
    planting.use_expected = True
    planting.expected = 4
    for one in (
        spec.Terrestrial(position=(3, 3, 1), angle_step_deg=6),
        spec.Tractor(position=(-2, 0, 1), track=6, step=1, angle_step_deg=5),
        spec.Sonar(position=(-1, 3, 1), max_range=3.5, wood=False),
        spec.Reverb(source=(1, 1, 1), receiver=(5, 5, 1), sample_rate=4000, duration=0.06),
    ):
        exchange.add_sensor(bpy.context.scene, one)
    bpy.context.view_layer.update()  # until then objects do not say where they are
    return props


def few_pixels(patch):
    """Have results and trees drawn coarsely, which takes longer than most sensors."""
    for room, name, few in ((plots, "WIDE", 220), (plots, "HIGH", 60), (assets, "DOTS", 500)):
        patch.setattr(room, name, few)


@pytest.fixture
def built(small):
    """The small forest, built."""
    assert bpy.ops.forest.build() == {"FINISHED"}
    return small


@pytest.fixture(scope="session")
def ran_file(registered, tmp_path_factory):
    """A file with the small forest and what its sensors found there."""
    path = tmp_path_factory.mktemp("ran") / "forest.blend"
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    with pytest.MonkeyPatch.context() as patch:
        fill(patch)
        assert bpy.ops.forest.build() == {"FINISHED"}
        assert bpy.ops.forest.run() == {"FINISHED"}
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


@pytest.fixture
def ran(ran_file, monkeypatch):
    """The small forest, built, and what its sensors found."""
    few_pixels(monkeypatch)
    bpy.ops.wm.open_mainfile(filepath=str(ran_file))
    return bpy.context.scene.forest_sensing
