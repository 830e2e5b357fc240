"""Buttons pressed from tests, and what is there after it."""

from pathlib import Path

import bpy
from references.scenes import add_mesh

from forest_addon.blender.scene.instances import TREE_KEY
from forest_addon.blender.scene.layout import CLOUD_KEY

ROOT = Path(__file__).resolve().parents[2]
SENSORS = {"scan": "tractor", "cloud": "terrestrial", "echo": "sonar", "reverb": "reverb"}


def press(name, **settings):
    return getattr(bpy.ops.forest, name)(**settings)


def run(name, **settings):
    return press("run", sensor=name, **settings)


def settings_of(name):
    """The settings on the object of a sensor."""
    return getattr(bpy.data.objects[name].forest_sensor, SENSORS[name])


def trees():
    return [obj for obj in bpy.data.objects if TREE_KEY in obj]


def clouds():
    return [obj for obj in bpy.data.objects if CLOUD_KEY in obj]


def excluded(_):
    """The forest is left out of the view layer."""
    bpy.context.view_layer.layer_collection.children["Forest"].exclude = True


def counts():
    """Return numbers of blocks of each kind."""
    kinds = ("objects", "meshes", "materials", "collections", "node_groups", "images")
    kinds += ("speakers", "sounds", "curves")
    return {kind: len(getattr(bpy.data, kind)) for kind in kinds}


def facts(props, name):
    return {figure.name: figure.value for figure in props.results[name].figures}


def next_uid():
    """The number that Blender gives the next block: it grows with every block that is made."""
    data = bpy.data.meshes.new("probe")
    number = data.session_uid
    bpy.data.meshes.remove(data)
    return number


def add_cube(name="cube", home=None):
    corners = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    sides = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6))
    return add_mesh(name, corners, *sides, home=home)
