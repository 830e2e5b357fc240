"""A point cloud as a Blender object: vertices with named attributes, its legend, and the cloud read back.

Points are shown by a modifier (``cloud_nodes``). A legend has, for each choice of the menu *Colour By*,
names or values, and colours: organs, species and objects are named, the most frequent first; a measure
has four values along its scale. Colours are those that the nodes give, computed with the same
arithmetic: a number n has the hue frac(0.618 n), a measure its place on the usual scale.
"""

from __future__ import annotations

import colorsys
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import bpy
import numpy as np

from ...base.labels import Labels
from ...base.trimesh import DEAD, GROUND, LEAF, PART_NAMES, WOOD
from ...results.coordinates import Offset
from ...sensing.lidar.cloud import Cloud, Returns
from ...sensing.sonar.echo import Contributions
from ..scene.attributes import mesh_of_points, read, write
from ..scene.layout import (
    CLOUD_KEY,
    COLOUR_BY,
    FAR_POINTS,
    FRAME_KEY,
    GAMMA,
    is_ours,
    make_object,
    own,
    settle,
)
from ..scene.nodes import HIGH as HIGH, LOW, choose_input, has_input, set_input, shown_corners
from .cloud_nodes import (
    FARTHEST,
    GOLDEN,
    LEVEL_MAP,
    SCALE,
    USUAL_MAP,
    VALUE,
    VIVID,
    group_of,
    on_map,
    points_material,
)

MOST = 12  # names of one choice; what is hit more rarely is left out
DEGREES = 180.0 / np.pi

Colour = tuple[float, float, float]


class Entry(NamedTuple):
    """One line: under which choice of the menu, what it says, in which colour."""

    choice: str
    name: str
    colour: Colour


def legend_of(
    cloud: Cloud, objects: Sequence[str] = (), species: Sequence[str] = ()
) -> list[Entry]:
    """The legend of a scanner's cloud.

    objects : names by the number of an instance. species : names by the number of a species.
    """
    incidence = DEGREES * np.arccos(np.minimum(cloud.returns.cos_incidence, 1.0))
    decibels = 10.0 * np.log10(np.maximum(cloud.intensity, 1e-20))
    return [
        *_named("Organ", cloud.returns.organ, PART_NAMES, _of_organ),
        *_named("Species", cloud.returns.species, species, _of_number),
        *_named("Object", cloud.returns.instance, objects, _of_number),
        *_scaled("Height", cloud.position[:, 2], "m"),
        *_scaled("Distance", cloud.returns.distance, "m"),
        *_scaled("Incidence", incidence, "°"),
        *_scaled("Width", 1e9 * cloud.width, "ns"),
        *_scaled("Scan Angle", DEGREES * cloud.scan_angle, "°"),
        *_scaled("Time", cloud.time, "s"),
        *_scaled("Intensity", decibels, "dB"),
    ]


def legend_of_heard(heard: Contributions) -> list[Entry]:
    """The legend of what a sonar heard."""
    if not len(heard):
        return []
    quiet = 20.0 * np.log10(QUIETEST)
    loudness = [
        Entry("Loudness", f"{quiet * (1.0 - share) + 0.0:.0f} dB", tuple(on_map(USUAL_MAP, share)))
        for share in (1.0, 0.5, 0.0)
    ]
    delay = _scaled("Delay", 1e3 * heard.delay, "ms")
    return [*loudness, *delay, *_scaled("Distance", heard.distance, "m")]


def _named(
    choice: str, numbers: np.ndarray, names: Sequence[str], colour_of: Callable[[int], Colour]
) -> list[Entry]:
    """The most frequent of these numbers that have a name; of several that are called alike, as instances of
    one object are, the first."""
    there, count = np.unique(numbers, return_counts=True)
    order = there[np.argsort(-count, kind="stable")]
    known: dict[str, int] = {}
    for number in (int(n) for n in order if 0 <= n < len(names) and names[n]):
        known.setdefault(names[number], number)
    most_frequent = list(known.items())[:MOST]
    return [Entry(choice, name, colour_of(number)) for name, number in most_frequent]


def _scaled(choice: str, values: np.ndarray, unit: str) -> list[Entry]:
    """Values along a scale, the smallest first; none where all are the same."""
    if not len(values) or not np.ptp(values) > 0:
        return []
    ends = np.linspace(float(values.min()), float(values.max()), len(SCALE))
    space = "" if unit == "°" else " "
    return [
        Entry(choice, f"{number}{space}{unit}", colour)
        for number, colour in zip(_in_words(ends), SCALE, strict=True)
    ]


def _in_words(values: np.ndarray) -> list[str]:
    """Numbers as one writes those of a scale: all to the digit that tells neighbours apart, none as -0."""
    step = float(np.ptp(values)) / (len(values) - 1)
    digits = int(np.clip(1 - np.floor(np.log10(step)), 0, 12))
    return [f"{value:,.{digits}f}" for value in (np.round(values, digits) + 0.0)]


def of_organs(organ: np.ndarray) -> np.ndarray:
    """(..., 4) linear colours of organs of nature."""
    colour = np.tile(OTHER, (128, 1))
    for part, shade in COLOUR_OF_ORGAN.items():
        colour[part] = shade
    return colour[organ]


def _of_organ(organ: int) -> Colour:
    return COLOUR_OF_ORGAN.get(organ, OTHER)[:3]


def _of_number(number: int) -> Colour:
    hue = float(np.modf(np.float32(number) * np.float32(GOLDEN))[0])
    return colorsys.hsv_to_rgb(hue, VIVID, VALUE)


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
    returns = cloud.returns
    arrays = {
        "position": cloud.position,
        "surface_normal": returns.normal,
        "distance": returns.distance,
        "true_range": cloud.true_range,
        "intensity": cloud.intensity,
        "width": cloud.width,
        "incidence": np.arccos(np.minimum(returns.cos_incidence, 1.0)),
        "scan_angle": cloud.scan_angle,
        "time": cloud.time,
        **{label: getattr(returns, label) for label in ("tree", "species", "organ", "leaf")},
        "object": returns.instance,
        "pulse": cloud.pulse,
        "return_number": cloud.number,
        "number_of_returns": cloud.count,
        **({} if cloud.bounce is None else {"bounce": cloud.bounce}),
        "organ_colour": of_organs(returns.organ),
    }
    foreign = len(cloud) and not np.isin(returns.organ, list(COLOUR_OF_ORGAN)).any()
    return _show(home, name, mesh_of_points(name, arrays), "scan", "Object" if foreign else "")


def show_heard(home: bpy.types.Collection, name: str, heard: Contributions) -> bpy.types.Object:
    """Put what a sonar heard into a collection as points, on the usual scale of colours by loudness."""
    loudest = float(heard.amplitude.max(initial=0.0)) or 1.0
    level = 20.0 * np.log10(np.maximum(heard.amplitude / loudest, QUIETEST))
    share = 1.0 - level / (20.0 * np.log10(QUIETEST))
    arrays = {
        "position": heard.position,
        "level": level,
        **{key: getattr(heard, key) for key in ("distance", "delay", "tree", "instance", "number")},
        "organ_colour": np.column_stack([on_map(USUAL_MAP, share), np.ones(len(share))]),
    }
    return _show(home, name, mesh_of_points(name, arrays), "heard")


def _show(
    home: bpy.types.Collection,
    name: str,
    data: bpy.types.Mesh,
    kind: str,
    colour_by: str = "",
) -> bpy.types.Object:
    """An object of these points: the one of before, with all that was done to it, or a new one.

    kind : of the nodes of a new one. colour_by : what its menu says at first, if not their default.
    """
    data.update()
    obj = _standing(home, name)
    if obj is not None:
        _hand_over(obj, data)
        return obj
    obj = make_object(f"{name} points", data, home)
    obj[CLOUD_KEY] = name
    data.materials.append(points_material())
    modifier = obj.modifiers.new("Points", "NODES")
    modifier.node_group = group_of(kind)
    if colour_by:
        choose_input(modifier, COLOUR_BY, colour_by)
    obj.hide_render = True
    return obj


def end_with_ground(obj: bpy.types.Object, scene: bpy.types.Scene) -> int:
    """Have views show the points over the ground that they show; returns how many lie beyond that."""
    modifier = next((m for m in obj.modifiers if has_input(m, FAR_POINTS)), None)
    if modifier is None:  # of an older file, or taken away
        return 0
    corners = shown_corners(scene) or ((-FARTHEST, -FARTHEST), (FARTHEST, FARTHEST))
    for name, corner, height in zip((LOW, HIGH), corners, (-FARTHEST, FARTHEST), strict=True):
        set_input(modifier, name, (*corner, height))
    flat = read(obj.data, "position", "FLOAT_VECTOR")[:, :2]
    low, high = np.array(corners, np.float32)
    return int(np.count_nonzero(((flat < low) | (flat > high)).any(axis=1)))


def rename_cloud(obj: bpy.types.Object, name: str) -> None:
    """Have an object of points belong to a sensor of this name, and be called so unless the user named it."""
    obj[CLOUD_KEY] = name
    if is_ours(obj):
        settle(obj, f"{name} points")


def _standing(home: bpy.types.Collection, name: str) -> bpy.types.Object | None:
    """The object that shows this sensor's points: in its collection, or where the user has put it in the
    scene. One that was copied or renamed belongs to the user.
    """
    scenes = {
        s for s in bpy.data.scenes if home in (s.collection, *s.collection.children_recursive)
    }
    elsewhere = (obj for obj in bpy.data.objects if scenes & set(obj.users_scene))
    ours = (t for t in (*home.objects, *elsewhere) if t.get(CLOUD_KEY) == name)
    return next((t for t in ours if is_ours(t) and t.type == "MESH" and t.mode == "OBJECT"), None)


def _hand_over(obj: bpy.types.Object, data: bpy.types.Mesh) -> None:
    """Give an object other points: the mesh takes the place of its old one everywhere, in its clothes.

    One that is kept for its frame is not replaced: only this object shows other points.
    """
    old = obj.data
    for material in old.materials:
        data.materials.append(material)
    for key, value in old.items():
        if key != FRAME_KEY:
            data[key] = value
    if FRAME_KEY in old:
        obj.data = own(data)
        return
    name = old.name
    old.user_remap(data)
    if not old.users:
        bpy.data.meshes.remove(old)
        data.name = name
    own(data)


SCAN_KEY = "forest_scan"  # of a mesh: pulses, engine, offset, names of labels, as JSON
EXACT = ("position", "distance", "true_range", "time", "azimuth", "elevation")  # doubles in files
NEEDED = ("position", "surface_normal", "distance", "intensity", "organ", "pulse")


def note_scan(
    data: bpy.types.Mesh,
    cloud: Cloud,
    offset: Sequence[float],
    crs: str,
    labels: Mapping[str, Labels],
) -> None:
    """Note on a mesh of points what ``kept_scan`` needs.

    offset, crs : of the scene. labels : of the points, by what labels them.
    """
    write(data, "azimuth", cloud.azimuth)
    write(data, "elevation", cloud.elevation)
    for name in EXACT:
        values = cloud.returns.distance if name == "distance" else getattr(cloud, name)
        kind = "FLOAT_VECTOR" if values.ndim == 2 else "FLOAT"
        write(data, f"{name}_rounding", values - values.astype(np.float32), kind)
    for name, label in labels.items():
        write(data, f"label_{name.lower()}", label.number, "INT")
    said = {
        "pulses": cloud.pulses,
        "engine": cloud.engine,
        "offset": list(offset),
        "crs": crs,
        "labels": {name: list(label.names) for name, label in labels.items()},
    }
    data[SCAN_KEY] = json.dumps(said, ensure_ascii=False)


def is_scan(data: bpy.types.Mesh) -> bool:
    """Return whether a mesh of points is a scan that can be read back."""
    return all(name in data.attributes for name in NEEDED)


def kept_scan(data: bpy.types.Mesh) -> tuple[Cloud, Offset, dict[str, Labels]]:
    """The scan of a mesh of points: its cloud, the scene's offset, and labels by what they are of.

    Points that were deleted by hand are gone here, too; those of files before 1.0.1 are of single precision.
    """
    said = json.loads(data.get(SCAN_KEY, "{}"))
    number = {name: _read(data, name, "INT") for name in ("tree", "species", "organ", "leaf")}
    returns = Returns(
        distance=_read(data, "distance", "FLOAT"),
        normal=_read(data, "surface_normal", "FLOAT_VECTOR"),
        cos_incidence=np.cos(_read(data, "incidence", "FLOAT")),
        organ=number["organ"].astype(np.int8),
        leaf=number["leaf"],
        tree=number["tree"],
        species=number["species"],
        instance=_read(data, "object", "INT"),
        triangle=np.full(len(data.vertices), -1, np.int32),
    )
    pulse = _read(data, "pulse", "INT")
    cloud = Cloud(
        position=_read(data, "position", "FLOAT_VECTOR"),
        pulse=pulse,
        number=_read(data, "return_number", "INT").astype(np.uint8),
        count=_read(data, "number_of_returns", "INT").astype(np.uint8),
        returns=returns,
        pulses=int(said.get("pulses", pulse.max(initial=-1) + 1)),
        engine=str(said.get("engine", "")),
        bounce=_read(data, "bounce", "INT").astype(np.int8)
        if "bounce" in data.attributes
        else None,
        **{
            name: _read(data, name, "FLOAT")
            for name in (
                *("time", "azimuth", "elevation", "scan_angle"),
                *("intensity", "width", "true_range"),
            )
        },
    )
    names = {
        n: words
        for n, words in said.get("labels", {}).items()
        if f"label_{n.lower()}" in data.attributes
    }
    labels = {
        n: Labels(_read(data, f"label_{n.lower()}", "INT"), tuple(w)) for n, w in names.items()
    }
    return cloud, Offset(tuple(said.get("offset", (0.0, 0.0, 0.0))), said.get("crs", "")), labels


def _read(data: bpy.types.Mesh, name: str, kind: str) -> np.ndarray:
    """(P,) or (P, 3) float64 or int32 of an attribute; zeros where it was removed."""
    values = read(data, name, kind)
    values = values if kind == "INT" else values.astype(np.float64)
    return values + _read(data, f"{name}_rounding", kind) if name in EXACT else values


DISTANCE, BRIGHTNESS, ORGAN = "DISTANCE", "BRIGHTNESS", "ORGAN"
NOTHING = (0.02, 0.02, 0.03)  # linear, where no pulse meets anything
OUTLIERS = 2  # percent of the values at each end, that share the colour of those
SceneColours = tuple[
    np.ndarray, list[tuple[str, Colour]]
]  # (H, W, 3) of the screen; texts with colours


def glance_colours(found: Any, shown: str) -> SceneColours:
    """Return colours for the screen, 0 to 1, of a ``Glance`` or ``Cochleagram``, and a legend.

    Distances are coloured by their logarithm, near ones bright; ``shown``: DISTANCE, BRIGHTNESS or ORGAN.
    """
    if hasattr(found, "level"):
        return _ear_colours(found)
    there = np.isfinite(found.distance)
    if shown == ORGAN:
        parts = np.unique(found.organ[there]).tolist()
        legend = [(PART_NAMES[part], _of_organ(part)) for part in parts]
        return _screen(of_organs(found.organ)[..., :3], there, legend)
    near = shown == DISTANCE
    values = np.log(np.maximum(found.distance, 1e-3)) if near else found.brightness
    ends = np.percentile(values[there], (OUTLIERS, 100 - OUTLIERS)) if there.any() else np.zeros(2)
    texts = [f"{np.exp(end):.3g} m" if near else f"{100 * end:.0f} %" for end in ends]
    return _on_scale(values, there, ends, texts, near)


def _ear_colours(found: Any) -> SceneColours:
    """Return colours and legend of a ``Cochleagram``, one ear above the other."""
    ears, channels, columns = found.level.shape
    level = np.full((ears, channels + 1, columns), np.nan)  # a dark row between ears
    level[:, :-1] = found.level
    level = level.reshape(-1, columns)[:-1]
    there = np.isfinite(level)
    if not there.any():
        return _screen(np.zeros((*level.shape, 3)), there, [])
    ends = np.array([level[there].min(), level[there].max()])
    texts = [f"{end:.0f} dB" for end in ends]
    colours, legend = _on_scale(level, there, ends, texts, scale=LEVEL_MAP)
    first, last = found.frequency[0] / 1e3, found.frequency[-1] / 1e3
    axes = f"0–{found.reach:g} m, {first:.0f}–{last:.0f} kHz"
    return colours, [*legend, (axes, (0.7, 0.7, 0.7))]


def _on_scale(
    values: np.ndarray,
    there: np.ndarray,
    ends: np.ndarray,
    texts: list[str],
    turned: bool = False,
    scale: str = USUAL_MAP,
) -> SceneColours:
    """Values on a scale between two, which have these texts; turned : the smaller are brighter."""
    share = (np.where(there, values, ends[0]) - ends[0]) / (np.ptp(ends) or 1.0)
    at_ends = on_map(scale, np.array([0.0, 1.0]))[:: -1 if turned else 1]
    colours = on_map(scale, 1.0 - share if turned else share)
    return _screen(colours, there, list(zip(texts, map(tuple, at_ends), strict=True)))


def _screen(
    colours: np.ndarray, there: np.ndarray, legend: list[tuple[str, Colour]]
) -> SceneColours:
    """Linear colours as the screen has them, and dark where there is nothing."""
    shown = np.clip(np.where(there[..., None], colours, NOTHING), 0.0, 1.0) ** GAMMA
    said = [(text, tuple(float(c) ** GAMMA for c in colour)) for text, colour in legend]
    return shown, said if there.any() else []
