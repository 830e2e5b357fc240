"""A picture of the forest by the rays that its sensors cast: sun, shadow, sky and haze, in seconds."""

from __future__ import annotations

import os

import bpy
import numpy as np

from ...base.progress import Progress
from ...base.rng import child_keys, keyed_uniform, stream
from ...base.trimesh import LEAF
from ...base.vectors import azimuth_of
from ...formats.atomic import replacing
from ...formats.raster_file import write_png
from ...sensing.rays.caster import RayCaster, hit_normals
from ..scene.layout import is_ours
from .preview import AIR, BELOW, RINGS, SUN, VISIBILITY, WOODED, ridge_of

SAMPLES = 2  # rays a pixel, each somewhere in it
EXPOSURE = 0.6
RAYS = 100_000  # at a time
FAR = 4000.0  # m, as far as a ray goes
LIFT = 1e-3  # m before a surface, where its ways to the sun and the sky begin
OPEN = 2.5  # m without anything that make a direction open sky
HAZE, BLUE = (
    np.array([0.80, 0.88, 0.95]),
    np.array([0.30, 0.50, 0.84]),
)  # the sky's horizon, and above
SUNLIGHT, SKYLIGHT = np.array([2.6, 2.2, 1.65]), np.array([0.42, 0.52, 0.70])
GRAIN, PATCHES = (0.30, 0.03), 1.2  # m, of bark and litter, and of what grows on it
UPRIGHT = np.array([1.0, 1.0, 0.15])  # by which grain is stretched upwards
THROUGH = np.array([0.70, 0.80, 0.25])  # of the sun on a leaf, what leaves it at the other side
MEADOW, BARE = (
    np.array([0.10, 0.13, 0.05]),
    np.array([0.18, 0.16, 0.11]),
)  # around; without material


def draw_scene(
    scene: bpy.types.Scene,
    caster: RayCaster,
    path: str | os.PathLike[str],
    middle: np.ndarray,
    reach: float,
    height: float,
    progress: Progress,
) -> None:
    """Draw a scene as its camera sees it, lit by its sun, to a PNG file of the render's size.

    middle : (2,) of the field, m. reach : from there to its sides. height : of the plain around it.

    Raises
    ------
    OSError : the picture could not be written.
    """
    scene.view_layers[0].update()  # camera and sun may have been moved just now
    wide, tall = scene.render.resolution_x, scene.render.resolution_y
    light = _Light(scene, caster, middle, reach, height)
    # Neighbours in blocks of 8 x 8, so that rays which are cast together pass the same branches.
    number = np.arange(tall * wide)
    order = np.lexsort((number % wide // 8, number // wide // 8))
    total = np.zeros((tall * wide, 3))
    for first in range(0, len(order), RAYS):
        pixels = order[first : first + RAYS]
        rng = stream(5, "preview", first)
        for _ in range(SAMPLES):
            x, y = pixels % wide + rng.random(len(pixels)), pixels // wide + rng.random(len(pixels))
            total[pixels] += filmic(light.seen(camera_rays(scene, x, y), rng))
        progress(first + len(pixels), len(order))
    image = (total / SAMPLES).reshape(tall, wide, 3) ** (1 / 2.2)
    with replacing(path) as partial:
        partial.write_bytes(write_png(image))


def noise(place: np.ndarray) -> np.ndarray:
    """(N,) smooth noise at places (N, 3), 0 to 1: drawn at whole numbers, between them by cubic steps."""
    cell = np.floor(place.T)
    step = place.T - cell
    step *= step * (3.0 - 2.0 * step)
    x, y, z = np.stack([cell, cell + 1.0], axis=1).astype(np.int64).astype(np.uint64)
    key = child_keys(child_keys(x[:, None], y)[:, :, None], z)  # (2, 2, 2, N) of the corners
    a, b, c = np.stack([1.0 - step, step], axis=1)
    value = a[:, None, None] * b[:, None] * c * (key >> np.uint64(11)) * 2.0**-53
    return np.asarray(sum(value.reshape(8, len(place))))


def filmic(light: np.ndarray) -> np.ndarray:
    """Brightness of a picture, 0 to 1, of light: an S-curve that ends in white (Narkowicz 2015)."""
    light = EXPOSURE * light
    curve = light * (2.51 * light + 0.03) / (light * (2.43 * light + 0.59) + 0.14)
    return np.asarray(np.clip(curve, 0.0, 1.0))


def camera_rays(scene: bpy.types.Scene, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(R, 3) unit ways from the camera through places (R,) of the picture, pixels from its top left."""
    camera, wide, tall = scene.camera, scene.render.resolution_x, scene.render.resolution_y
    corners = np.array(camera.data.view_frame(scene=scene))
    right, lower, left = corners[:3]  # upper right, lower right, lower left
    ways = left + np.outer(y / tall - 1, lower - right) + np.outer(x / wide, lower - left)
    turned = ways @ np.array(camera.matrix_world)[:3, :3].T
    return np.asarray(turned / np.linalg.norm(turned, axis=1)[:, None])


def _grained(
    colour: np.ndarray, points: np.ndarray, normal: np.ndarray, textured: np.ndarray
) -> np.ndarray:
    """(R, 3) colours with the grain of bark and litter, moss and herbs where they lie level."""
    some = points[textured] * UPRIGHT
    grain = sum(0.5 * noise(some / size) for size in GRAIN)
    grained = colour.copy()
    grained[textured] *= (0.35 + 0.9 * grain)[:, None]
    level = np.clip(4.0 * normal[textured, 2] - 3.0, 0.0, 1.0)
    green = level * np.clip(3.0 * noise(some / PATCHES) - 1.0, 0.0, 1.0)
    grained[textured] += (
        0.7 * green[:, None] * ((0.6 + 0.8 * grain)[:, None] * MEADOW - grained[textured])
    )
    return grained


class _Light:
    """Light that comes to a camera along a ray."""

    def __init__(
        self,
        scene: bpy.types.Scene,
        caster: RayCaster,
        middle: np.ndarray,
        reach: float,
        height: float,
    ) -> None:
        self.caster, self.middle, self.reach = caster, middle, reach
        self.plain = height - BELOW
        self.eye = np.array(scene.camera.matrix_world.translation)
        self.sun = np.array(scene.objects[SUN].matrix_world)[:3, 2]
        self.colours, self.textured = [], []
        for names in caster.scene.slot_names or [()] * len(caster.scene.meshes):
            known = [bpy.data.materials.get(name) for name in names]
            rows = [BARE if one is None else np.array(one.diffuse_color)[:3] for one in known]
            self.colours.append(np.array(rows or [BARE]))
            self.textured.append(
                np.array([one is not None and is_ours(one) for one in known] or [False])
            )

    def seen(self, directions: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(R, 3) light from directions (R, 3)."""
        hits = self.caster.cast(np.broadcast_to(self.eye, directions.shape), directions, FAR)
        met, missed = np.flatnonzero(hits.found), np.flatnonzero(~hits.found)
        light, far, normal = np.zeros_like(directions), hits.distance, np.zeros_like(directions)
        light[missed], far[missed] = self._around(directions[missed])
        normal[missed, 2] = 1.0
        normal[met] = hit_normals(self.caster.scene, hits.select(met))
        normal *= -np.copysign(1.0, (normal * directions).sum(axis=1))[:, None]
        colour, leaf = np.broadcast_to(MEADOW, light.shape).copy(), np.zeros(len(far), bool)
        textured = np.ones(len(far), bool)
        surfaces = self._surfaces(hits.instance[met], hits.triangle[met])
        colour[met], leaf[met], textured[met] = surfaces
        near = np.flatnonzero(far < FAR)
        normal, colour, leaf, direction = normal[near], colour[near], leaf[near], directions[near]
        points = self.eye + (far[near] - LIFT)[:, None] * direction
        colour = _grained(colour, points, normal, textured[near])
        sunny = ~self.caster.occluded(points, np.broadcast_to(self.sun, points.shape), FAR)
        up = rng.normal(size=points.shape)
        up = normal + up / np.linalg.norm(up, axis=1)[:, None]  # as often as its cosine says
        open_sky = ~self.caster.occluded(points, up, OPEN)
        facing = normal @ self.sun
        passed = np.where((facing < 0) & leaf, -facing, 0.0)[:, None] * THROUGH
        direct = sunny[:, None] * SUNLIGHT * (np.maximum(facing, 0.0)[:, None] + passed)
        sky = SKYLIGHT * ((0.25 + 0.75 * open_sky) * (0.6 + 0.4 * normal[:, 2]))[:, None]
        air = -np.expm1(-far[near] / VISIBILITY)[:, None]
        light[near] = colour * (direct + sky) * (1 - air) + HAZE * air
        return light

    def _surfaces(
        self, instance: np.ndarray, triangle: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(R, 3) colours of triangles that were met, (R,) whether they are leaves, and whether bark or
        ground of ours, which are not even."""
        geometry = self.caster.scene
        mesh_of = geometry.mesh_index[instance]
        colour = np.empty((len(instance), 3))
        leaf, textured = np.empty((2, len(instance)), bool)
        for number in np.unique(mesh_of):
            rows, mesh = np.flatnonzero(mesh_of == number), geometry.meshes[number]
            own = self.colours[number]
            slot = np.clip(mesh.material[triangle[rows]], 0, len(own) - 1)
            leaf[rows] = mesh.part[triangle[rows]] == LEAF
            textured[rows] = self.textured[number][slot] & ~leaf[rows]
            shade = keyed_uniform(mesh.leaf[triangle[rows]].astype(np.uint64), "shade")
            shade = np.where(leaf[rows], 0.6 + 0.8 * shade, 1.0)
            colour[rows] = own[slot] * shade[:, None]
        return colour, leaf, textured

    def _around(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(R, 3) light of sky and hills behind the forest, and (R,) m to the plain, ``FAR`` beyond."""
        level = np.maximum(np.hypot(directions[:, 0], directions[:, 1]), 1e-9)
        slope = directions[:, 2] / level
        light = HAZE + (BLUE - HAZE) * (np.clip(slope / 0.5, 0, 1) ** 0.7)[:, None]
        heading = directions[:, :2] / level[:, None]
        offset = self.eye[:2] - self.middle
        along = heading @ offset
        for number in reversed(range(len(RINGS))):  # the farthest first
            beyond, high, jag = RINGS[number]
            radius = self.reach + beyond
            ahead = np.sqrt(np.maximum(along**2 - offset @ offset + radius**2, 0.0)) - along
            azimuth = azimuth_of(offset + ahead[:, None] * heading)
            angle, ridge = ridge_of(number, high, jag)
            top = np.interp(azimuth, angle, ridge, period=2 * np.pi)
            hidden = slope * ahead < top + self.plain - self.eye[2]
            air = -np.expm1(-beyond / VISIBILITY)
            light[hidden] = np.array(WOODED) * (1 - air) + np.array(AIR) * air
        with np.errstate(divide="ignore"):
            far = np.where(slope < 0, (self.plain - self.eye[2]) / directions[:, 2], np.inf)
        return light, np.where((far * level < ahead) & (far > 0), far, FAR)
