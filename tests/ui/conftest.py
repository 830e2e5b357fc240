"""The add-on registered in Blender, and a forest that is small enough to build in every test."""

import atexit

import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import ui


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
def small(props):
    """The panel filled with a forest of about three hazels and coarse sensors in their midst."""
    props.seed = 3
    props.forest.size = (6, 6)
    props.forest.margin = 2
    planting = props.plantings.add()
    planting.species = "hazelnut"
    planting.variants = 1
    planting.use_expected = True
    planting.expected = 4
    props.terrestrial.position = (3, 3, 1)
    props.terrestrial.angle_step_deg = 6
    props.tractor.position = (-2, 0, 1)
    props.tractor.track = 6
    props.tractor.step = 1
    props.tractor.angle_step_deg = 5
    props.sonar.position = (-1, 3, 1)
    props.sonar.max_range = 4
    props.reverb.source = (1, 1, 1)
    props.reverb.receiver = (5, 5, 1)
    props.reverb.sample_rate = 4000
    props.reverb.duration = 0.1
    return props
