"""Things in Blender's scene that tests need: made, keyed, read, saved and opened again."""

import bpy
import numpy as np

WIDTHS = {"vector": 3, "color": 4}


def link(name, data=None, home=None):
    """A new object in the scene's own collection, or in another."""
    obj = bpy.data.objects.new(name, data)
    (home or bpy.context.scene.collection).objects.link(obj)
    return obj


def add_mesh(name, corners, *faces, home=None):
    """A new object with a mesh."""
    data = bpy.data.meshes.new(name)
    data.from_pydata(corners, [], faces)
    return link(name, data, home)


def add_collection(name, home=None):
    """A new collection within the scene's own, or within another."""
    made = bpy.data.collections.new(name)
    (home or bpy.context.scene.collection).children.link(made)
    return made


def values(data, name):
    """An attribute of a mesh or of points as an array, a row each where it has several numbers."""
    attribute = data.attributes[name]
    key = {"FLOAT_VECTOR": "vector", "FLOAT_COLOR": "color"}.get(attribute.data_type, "value")
    width = WIDTHS.get(key, 1)
    dtype = np.int32 if attribute.data_type == "INT" else np.float32
    out = np.empty(width * len(attribute.data), dtype)
    attribute.data.foreach_get(key, out)
    return out.reshape(-1, width) if width > 1 else out


def keyed(obj, path, places, interpolation="LINEAR"):
    """Keys of a property by frame; what lies beyond linear ones goes on evenly."""
    for frame, place in places.items():
        setattr(obj, path, place)
        obj.keyframe_insert(path, frame=frame)
    for curve in curves_of(obj.id_data):
        for point in curve.keyframe_points:
            point.interpolation = interpolation
        curve.extrapolation = "LINEAR" if interpolation == "LINEAR" else "CONSTANT"


def hide(obj, frames):
    """Key whether an object is hidden, from frames on."""
    for path in ("hide_viewport", "hide_render"):
        keyed(obj, path, frames, "CONSTANT")


def curves_of(obj):
    """Curves of the keys of an object, which lie elsewhere since Blender 4.4 has layers."""
    action = obj.animation_data.action
    if hasattr(action, "fcurves"):
        return action.fcurves
    return action.layers[0].strips[0].channelbags[0].fcurves


def reopened(path):
    """The scene after saving to a file and opening that."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    return bpy.context.scene
