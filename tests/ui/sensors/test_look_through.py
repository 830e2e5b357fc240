"""Look through a scanner: the image has the scan's own pulses, follows the scanner, leaves nothing behind."""

import math

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.scenes import add_mesh
from ui.pressing import counts, press, trees

from forest_addon.blender.sensors.observe import Observer
from forest_addon.blender.show.cloud import glance_colours
from forest_addon.sensing.lidar.glance import range_image
from forest_addon.ui.sensors import look_through
from forest_addon.ui.settings import exchange
from forest_addon.ui.shell.views import choose_sensor


@pytest.fixture(autouse=True)
def ended(registered):
    yield
    look_through.end()


def choose(name):
    choose_sensor(bpy.context, bpy.data.objects[name])


def scanned(name):
    """The first returns of a scan, without noise: (E, A) metres."""
    settings = exchange.to_spec(bpy.context.scene, [bpy.data.objects[name]])
    (scanner,) = settings.sensors
    cloud = Observer(bpy.context.evaluated_depsgraph_get()).observe(scanner, settings)
    return range_image(cloud, scanner)


def agree(image, scan):
    """Columns of the image are those of the scan from the last to the first, as one sees them."""
    return np.allclose(
        np.where(np.isfinite(image), image, np.nan)[:, ::-1], scan, atol=1e-9, equal_nan=True
    )


@pytest.mark.medium
def test_the_image_is_the_scan_and_follows_the_scanner(built):
    obj = bpy.data.objects["cloud"]
    obj.forest_sensor.terrestrial.range_noise = 0.0
    choose("cloud")
    press("look_through")
    eye = look_through.eye()
    assert np.isfinite(eye.found.distance).mean() > 0.2
    assert agree(eye.found.distance, scanned("cloud"))
    observer = eye.observer
    assert not eye.look(bpy.context)  # nothing has changed
    obj.location.x += 0.5
    obj.rotation_euler.z = 0.3
    bpy.context.view_layer.update()
    assert eye.look(bpy.context)
    assert eye.observer is observer  # the scene is not read again
    assert agree(eye.found.distance, scanned("cloud"))
    obj.forest_sensor.terrestrial.max_range = 2.0
    assert eye.look(bpy.context)
    assert np.max(eye.found.distance, where=np.isfinite(eye.found.distance), initial=0) <= 2.0


def test_a_changed_scene_is_read_again_when_it_is_quiet(built, monkeypatch):
    choose("cloud")
    press("look_through")
    eye = look_through.eye()
    observer, before = eye.observer, eye.found.distance
    trees()[0].location.z += 30
    bpy.context.view_layer.update()
    eye.look(bpy.context)
    assert eye.observer is observer
    assert eye.changed_at is not None
    monkeypatch.setattr(look_through, "QUIET", -1.0)
    assert eye.look(bpy.context)
    assert eye.observer is not observer
    assert eye.changed_at is None
    assert (eye.found.distance != before).any()
    assert agree(eye.found.distance, scanned("cloud"))


def test_a_plane_below_by_the_equation(props, sensor):
    add_mesh(
        "plane", [(-200, -200, 0), (200, -200, 0), (200, 200, 0), (-200, 200, 0)], (0, 1, 2, 3)
    )
    sensor(
        "terrestrial", position=(0, 0, 2), angle_step_deg=3, elevation_deg=(-60, 30), max_range=100
    )
    bpy.context.view_layer.update()
    press("look_through")
    found = look_through.eye().found
    elevation = np.radians(np.arange(-60, 31, 3))
    below = np.flatnonzero(elevation < -math.asin(2 / 100) - 1e-9)
    wanted = 2 / np.sin(-elevation[below])
    assert np.abs(found.distance[below] - wanted[:, None]).max() < 1e-5
    others = np.delete(found.distance, below, axis=0)
    assert not np.isfinite(others).any()
    scanner = exchange.sensor_of(bpy.data.objects["cloud"])
    clear = np.exp(-2 * scanner.beam.extinction * wanted)
    bright = scanner.surfaces.other * np.sin(-elevation[below]) * clear
    assert np.abs(found.brightness[below] - bright[:, None]).max() < 1e-6
    assert (np.delete(found.brightness, below, axis=0) == 0).all()


@pytest.mark.medium
@pytest.mark.parametrize(
    ("name", "shown"),
    [
        *(("cloud", shown) for shown in ("DISTANCE", "BRIGHTNESS", "ORGAN")),
        *(("scan", "ORGAN"), ("drone", "BRIGHTNESS"), ("airborne", "DISTANCE")),
    ],
)
def test_every_scanner_has_an_image_in_colours(built, name, shown):
    if name in bpy.data.objects:
        choose(name)
    else:
        press("add_sensor", kind=name)
    press("look_through")
    found = look_through.eye().found
    colours, legend = glance_colours(found, shown)
    assert colours.shape == (*found.distance.shape, 3)
    assert legend
    there = np.isfinite(found.distance)
    assert there.any()
    assert len(np.unique(colours[there], axis=0)) > 1
    assert len(np.unique(colours[~there], axis=0)) <= 1


@pytest.mark.medium
def test_a_sonar_listens_at_the_cursor(built):
    choose("echo")
    sonar = bpy.data.objects["echo"].forest_sensor.sonar
    sonar.ears = 2
    cursor = bpy.context.scene.cursor
    cursor.location = (-1.0, 3.0, 1.0)
    press("look_through")
    eye = look_through.eye()
    assert not eye.problem
    first = eye.found.level
    assert first.shape[0] == 2
    assert first.max() > first.min()
    assert not eye.look(bpy.context)  # nothing has changed
    cursor.location.x -= 1.0  # away from all that sounds
    assert eye.look(bpy.context)
    channel = first.shape[1] // 2
    moved = int(eye.found.level[0, channel].argmax()) - int(first[0, channel].argmax())
    assert moved > 256 / sonar.max_range / 4
    colours, legend = glance_colours(eye.found, "DISTANCE")
    assert colours.shape == (2 * 41 - 1, 256, 3)
    assert [text[-2:] for text, _ in legend] == ["dB", "dB", "Hz"]
    cursor.location = (0.0, 0.0, 0.0)  # on the ground itself
    assert eye.look(bpy.context)
    assert not eye.problem
    cursor.location = (500.0, 0.0, 1.0)
    assert eye.look(bpy.context)
    assert not eye.problem
    press("look_through")


def test_ears_do_not_look_and_the_end_leaves_nothing(built):
    choose("cloud")
    before = counts()
    press("look_through")
    choose("reverb")
    eye = look_through.eye()
    assert eye.look(bpy.context)
    assert "no eyes" in eye.problem
    press("look_through")
    assert look_through.eye() is None
    assert counts() == before
    assert not bpy.app.timers.is_registered(look_through._tick)
