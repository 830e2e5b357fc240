"""Surroundings of a forest in a picture: a plain, and wooded hills, each the paler the farther they are.

For pictures alone: views do not show them, sensors do not meet them, and they are no trees. A ring is a
strip of a few hundred triangles around the field, its upper edge a sum of sines as hills have and a fine
jagged line as crowns have. The light that air scatters into the eye grows as 1 - exp(-distance/visibility),
so that a ring's colour goes from that of leaves to that of the sky above it (Koschmieder 1924); it glows of
itself, which costs a render nothing.
"""

from __future__ import annotations

import bpy
import numpy as np

from ...base.rng import stream
from ..scene import materials
from ..scene.standings import IGNORED_KEY

HORIZON = "Forest horizon"
RINGS = (
    (130.0, 8.0, 1.5),
    (520.0, 27.0, 1.5),
    (1300.0, 70.0, 2.2),
)  # beyond the field, height, crowns; m
CORNERS = 1440
PLAIN, PLAIN_CORNERS = f"{HORIZON} plain", 64
BELOW = 0.3  # metres: the plain lies below the field's own ground
VISIBILITY = 700.0  # m
WOODED, AIR = (0.050, 0.085, 0.030), (0.62, 0.72, 0.80)  # colours


def lay_horizon(scene: bpy.types.Scene, middle: np.ndarray, reach: float, height: float) -> None:
    """Put hills around a field, in place of those that are there.

    middle : (2,) of the field, metres. reach : of the field and what stands on it. height : of its ground.
    """
    for thing in [t for t in scene.objects if t.name.startswith(HORIZON)]:
        data = thing.data
        bpy.data.objects.remove(thing)
        bpy.data.meshes.remove(data)
    for number, (beyond, high, jag) in enumerate(RINGS):
        data = bpy.data.meshes.new(HORIZON)
        vertices, faces = _ring(number, reach + beyond, high, jag)
        vertices += [*middle, height]
        data.from_pydata(vertices.tolist(), [], faces.tolist())
        data.materials.append(_paint(f"{HORIZON} {number}", beyond))
        ring = bpy.data.objects.new(HORIZON, data)
        ring[IGNORED_KEY] = ring.hide_viewport = ring.hide_select = True
        ring.visible_shadow = ring.visible_diffuse = ring.visible_glossy = False
        scene.collection.objects.link(ring)
    data = bpy.data.meshes.new(HORIZON)
    around = 2 * np.pi * np.arange(PLAIN_CORNERS) / PLAIN_CORNERS
    rim = (reach + RINGS[0][0]) * np.stack([np.cos(around), np.sin(around)], axis=1)
    places = np.column_stack([rim + middle, np.full(PLAIN_CORNERS, height - BELOW)])
    data.from_pydata(places.tolist(), [], [list(range(PLAIN_CORNERS))])
    data.materials.append(bpy.data.materials.get(PLAIN) or materials.meadow(PLAIN))
    plain = bpy.data.objects.new(PLAIN, data)
    plain[IGNORED_KEY] = plain.hide_viewport = plain.hide_select = True
    scene.collection.objects.link(plain)


def _ring(number: int, radius: float, high: float, jag: float) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (2 C, 3) and quads (C, 4) of one ring about the origin."""
    rng = stream(7, "horizon", number)
    angle = 2 * np.pi * np.arange(CORNERS) / CORNERS
    ridge = np.full(CORNERS, 0.62)
    for waves in range(2, 24):
        size = 0.55 / waves**1.1
        ridge += size * rng.normal() * np.sin(waves * angle + 2 * np.pi * rng.random())
    crowns = jag * np.abs(np.convolve(rng.normal(size=CORNERS), [0.5, 1.0, 0.5], mode="same"))
    top = high * np.clip(ridge, 0.25, 1.4) + crowns
    around = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    foot = np.column_stack([around, np.full(CORNERS, -0.05 * high - 2.0)])
    corner = np.arange(CORNERS)
    after = (corner + 1) % CORNERS
    faces = np.stack([corner, after, CORNERS + after, CORNERS + corner], axis=1)
    return np.concatenate([foot, np.column_stack([around, top])]), faces


def _paint(name: str, distance: float) -> bpy.types.Material:
    """A flat colour: leaves seen through so much air."""
    material = bpy.data.materials.get(name) or bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    glow, out = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeOutputMaterial")
    air = 1 - np.exp(-distance / VISIBILITY)
    colour = [float(w + air * (a - w)) for w, a in zip(WOODED, AIR, strict=True)]
    glow.inputs["Color"].default_value = (*colour, 1.0)
    tree.links.new(glow.outputs["Emission"], out.inputs["Surface"])
    return material
