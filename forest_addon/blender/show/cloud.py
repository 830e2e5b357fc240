"""A point cloud as a Blender object: vertices with named attributes, shown as points by a modifier.

Every value and label of a return is an attribute; the colour that an organ has in nature, and that of how
loud an echo is, are too. The modifier's node group (``cloud_nodes``) has named inputs: what colours the
points, on which scale, how large they are and which of them are shown. A sensor has one object; what was
done to it stays when the sensor runs again.
"""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np

from ...base.trimesh import DEAD, GROUND, LEAF, WOOD
from ...sensing.lidar.cloud import Cloud
from ...sensing.sonar.ping import Contributions
from ..scene.ground_nodes import HIGH, LOW, shown_corners
from ..scene.layout import (
    CLOUD_KEY,
    COLOUR_BY,
    FAR_POINTS,
    FRAME_KEY,
    is_ours,
    make_object,
    own,
    settle,
)
from ..scene.nodes import choose_input, has_input, set_input
from .cloud_nodes import FARTHEST, SCALE, heard_group, points_material, scan_group

COLOUR_OF_ORGAN = {
    WOOD: (0.30, 0.17, 0.08, 1.0),
    LEAF: (0.08, 0.42, 0.06, 1.0),
    GROUND: (0.45, 0.40, 0.30, 1.0),
    DEAD: (0.42, 0.40, 0.38, 1.0),
}
OTHER = (0.5, 0.5, 0.5, 1.0)  # organs that have no colour of nature
QUIETEST = 1e-3  # amplitude, of the loudest, that is shown faintest


def show_cloud(home: bpy.types.Collection, name: str, cloud: Cloud) -> bpy.types.Object:
    """Put a sensor's cloud into a collection, in place of that sensor's last one.

    Where nothing is of a tree or of the ground it is first coloured by object.
    """
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(cloud))
    fill(data, "position", "FLOAT_VECTOR", cloud.position, "vector")
    fill(data, "surface_normal", "FLOAT_VECTOR", cloud.returns.normal, "vector")
    for measure, values in {
        "distance": cloud.returns.distance,
        "true_range": cloud.true_range,
        "intensity": cloud.intensity,
        "width": cloud.width,
        "incidence": np.arccos(np.minimum(cloud.returns.cos_incidence, 1.0)),
        "scan_angle": cloud.scan_angle,
        "time": cloud.time,
    }.items():
        fill(data, measure, "FLOAT", values)
    for label in ("tree", "species", "organ", "leaf"):
        fill(data, label, "INT", getattr(cloud.returns, label))
    fill(data, "object", "INT", cloud.returns.instance)
    fill(data, "pulse", "INT", cloud.pulse)
    fill(data, "return_number", "INT", cloud.number)
    fill(data, "number_of_returns", "INT", cloud.count)
    if cloud.bounce is not None:
        fill(data, "bounce", "INT", cloud.bounce)
    colour = np.tile(OTHER, (128, 1))
    for organ, shade in COLOUR_OF_ORGAN.items():
        colour[organ] = shade
    fill(data, "organ_colour", "FLOAT_COLOR", colour[cloud.returns.organ], "color")
    foreign = not np.isin(cloud.returns.organ, list(COLOUR_OF_ORGAN)).any()
    return _show(home, name, data, scan_group, "Object" if foreign and len(cloud) else "")


def show_heard(home: bpy.types.Collection, name: str, heard: Contributions) -> bpy.types.Object:
    """Put what a sonar heard into a collection as points, on the usual scale of colours by loudness."""
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(heard))
    fill(data, "position", "FLOAT_VECTOR", heard.position, "vector")
    loudest = float(heard.amplitude.max(initial=0.0)) or 1.0
    level = 20.0 * np.log10(np.maximum(heard.amplitude / loudest, QUIETEST))
    share = 1.0 - level / (20.0 * np.log10(QUIETEST))
    fill(data, "level", "FLOAT", level)
    fill(data, "distance", "FLOAT", heard.distance)
    fill(data, "delay", "FLOAT", heard.delay)
    for label in ("tree", "instance", "number"):
        fill(data, label, "INT", getattr(heard, label))
    place = np.linspace(0.0, 1.0, len(SCALE))
    colour = [np.interp(share, place, channel) for channel in np.array(SCALE).T]
    colour = np.column_stack([*colour, np.ones(len(share))])
    fill(data, "organ_colour", "FLOAT_COLOR", colour, "color")
    return _show(home, name, data, heard_group)


def _show(
    home: bpy.types.Collection,
    name: str,
    data: bpy.types.Mesh,
    group: Callable[[], bpy.types.NodeTree],
    colour_by: str = "",
) -> bpy.types.Object:
    """An object of these points: the one of before, with all that was done to it, or a new one.

    group : the nodes of a new one. colour_by : what its menu says at first, if not the group's default.
    """
    data.update()
    thing = _standing(home, name)
    if thing is not None:
        _hand_over(thing, data)
        return thing
    thing = make_object(f"{name} points", data, home)
    thing[CLOUD_KEY] = name
    data.materials.append(points_material())
    modifier = thing.modifiers.new("Points", "NODES")
    modifier.node_group = group()
    if colour_by:
        choose_input(modifier, COLOUR_BY, colour_by)
    thing.hide_render = True
    return thing


def end_with_ground(thing: bpy.types.Object, scene: bpy.types.Scene) -> int:
    """Have views show the points over the ground that they show; returns how many lie beyond that."""
    modifier = next((m for m in thing.modifiers if has_input(m, FAR_POINTS)), None)
    if modifier is None:  # of an older file, or taken away
        return 0
    corners = shown_corners(scene) or ((-FARTHEST, -FARTHEST), (FARTHEST, FARTHEST))
    for name, corner, height in zip((LOW, HIGH), corners, (-FARTHEST, FARTHEST), strict=True):
        set_input(modifier, name, (*corner, height))
    place = np.empty(3 * len(thing.data.vertices), np.float32)
    thing.data.attributes["position"].data.foreach_get("vector", place)
    flat, (low, high) = place.reshape(-1, 3)[:, :2], np.array(corners, np.float32)
    return int(np.count_nonzero(((flat < low) | (flat > high)).any(axis=1)))


def rename_cloud(thing: bpy.types.Object, name: str) -> None:
    """Have an object of points belong to a sensor of this name, and be called so unless the user named it."""
    thing[CLOUD_KEY] = name
    if is_ours(thing):
        settle(thing, f"{name} points")


def _standing(home: bpy.types.Collection, name: str) -> bpy.types.Object | None:
    """The object that shows this sensor's points: in its collection, or where the user has put it in the
    scene. One that was copied or renamed belongs to the user.
    """
    scenes = {
        s for s in bpy.data.scenes if home in (s.collection, *s.collection.children_recursive)
    }
    elsewhere = (thing for thing in bpy.data.objects if scenes & set(thing.users_scene))
    ours = (t for t in (*home.objects, *elsewhere) if t.get(CLOUD_KEY) == name)
    return next((t for t in ours if is_ours(t) and t.type == "MESH" and t.mode == "OBJECT"), None)


def _hand_over(thing: bpy.types.Object, data: bpy.types.Mesh) -> None:
    """Give an object other points: the mesh takes the place of its old one everywhere, in its clothes.

    One that is kept for its frame is not replaced: only this object shows other points.
    """
    old = thing.data
    for material in old.materials:
        data.materials.append(material)
    for key, value in old.items():
        if key != FRAME_KEY:
            data[key] = value
    if FRAME_KEY in old:
        thing.data = own(data)
        return
    name = old.name
    old.user_remap(data)
    if not old.users:
        bpy.data.meshes.remove(old)
        data.name = name
    own(data)


def fill(
    data: bpy.types.Mesh, name: str, kind: str, values: np.ndarray, key: str = "value"
) -> None:
    """Write values (P,) or (P, K) as an attribute of a mesh's points. key : Blender's name of a value."""
    attribute = data.attributes.get(name) or data.attributes.new(name, kind, "POINT")
    dtype = np.int32 if kind == "INT" else np.float32
    attribute.data.foreach_set(key, np.ascontiguousarray(values, dtype=dtype).ravel())
