"""The picture of an asset: its tree by our own rays, from the front and slightly above, without a floor.

A Blender without a window draws no previews, and a render would need a scene of its own. Here parallel rays
meet the mesh; each hit asks whether the sun is hidden and whether the sky is, in a direction at random about
the zenith. What no ray meets stays transparent.
"""

from __future__ import annotations

import numpy as np

from ...base.rng import stream
from ...base.trimesh import LEAF, TriMesh, is_wood
from ...sensing.rays.caster import hit_normals
from ...sensing.rays.geometry import SceneGeometry
from ...spec import Look, Rays
from ..rays.casters import make_caster

PIXELS = 256
SIDE = 2  # rays along a side of a pixel
TILT = np.deg2rad(8.0)  # that the eye looks down
SUN = np.array([-0.50, -0.62, 0.60]) / np.linalg.norm([-0.50, -0.62, 0.60])  # towards it
SUNLIGHT, SKYLIGHT, THROUGH = 3.4, 1.5, 0.45  # of light from behind a leaf, what comes through
SHADES = 0.22  # how much leaves differ in brightness, relative


def picture(mesh: TriMesh, look: Look, pixels: int = PIXELS) -> np.ndarray:
    """(pixels, pixels, 4) float32 sRGB with alpha, rows from below: a tree, Z up, as large as it fits."""
    image = np.zeros((pixels, pixels, 4))
    if not len(mesh.triangles):
        return image.astype(np.float32)
    forward = np.array([0.0, np.cos(TILT), -np.sin(TILT)])
    up = np.array([0.0, np.sin(TILT), np.cos(TILT)])
    above = mesh.vertices[mesh.vertices[:, 2] >= 0]
    shown = above if len(above) else mesh.vertices
    flat = np.column_stack([shown[:, 0], shown @ up])
    low, high = flat.min(axis=0), flat.max(axis=0)
    size = max(float((high - low).max()), 1e-6) * 1.03
    count = pixels * SIDE
    rng = stream(0, "asset", "rays")
    place = (np.arange(count)[:, None] + rng.random((2, count, count))) / count - 0.5
    across = (low[0] + high[0]) / 2 + size * place[0].T
    over = (low[1] + high[1]) / 2 + size * place[1]
    reach = float(np.abs(mesh.vertices).max()) * 2 + 1.0
    start = across.reshape(-1, 1) * [1.0, 0.0, 0.0] + over.reshape(-1, 1) * up - reach * forward
    colour, found = _seen(mesh, look, start, forward, rng)
    alpha = found.reshape(pixels, SIDE, pixels, SIDE).mean(axis=(1, 3))
    summed = colour.reshape(pixels, SIDE, pixels, SIDE, 3).mean(axis=(1, 3))
    mean = summed / np.maximum(alpha, 1e-9)[..., None]
    image[..., :3] = np.clip(1 - np.exp(-mean), 0, 1) ** (1 / 2.2)
    image[..., 3] = alpha
    image[alpha == 0] = 0.0
    return image.astype(np.float32)


def _seen(
    mesh: TriMesh, look: Look, start: np.ndarray, forward: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Light (R, 3) that comes back along rays, linear, and whether (R,) there is a tree."""
    one = np.zeros(1, dtype=np.int64)
    scene = SceneGeometry((mesh,), np.eye(3, 4)[None], one, ("tree",), one, one)
    caster = make_caster(scene, Rays())
    way = np.broadcast_to(forward, start.shape)
    hits = caster.cast(start, way)
    point = start + np.where(hits.found, hits.distance, 0.0)[:, None] * forward
    found = hits.found & (point[:, 2] >= 0)  # what is sunk into the ground is not shown
    rows = np.flatnonzero(found)
    colour = np.zeros((len(start), 3))
    if not len(rows):
        return colour, found
    met, point = hits.select(rows), point[rows]
    normal = hit_normals(scene, met)
    normal *= -np.sign(normal @ forward)[:, None]  # towards the eye
    is_leaf = mesh.part[met.triangle] == LEAF
    tone = np.full((len(rows), 3), 0.2)
    tone[is_wood(mesh.part[met.triangle])] = look.bark
    tone[is_leaf] = look.foliage()
    leaf = mesh.leaf[met.triangle][is_leaf].astype(np.uint64)
    shade = (leaf * np.uint64(2654435761) % np.uint64(1 << 32)) / 2.0**32
    tone[is_leaf] *= (1 - SHADES + 2 * SHADES * shade)[:, None]
    facing = normal @ SUN
    through = np.where(is_leaf, THROUGH, 0.0)
    lit = np.where(facing > 0, facing, -through * facing)
    towards = np.broadcast_to(SUN, point.shape)
    lit *= ~caster.occluded(point, towards, leaving=met)
    z = rng.random(len(rows))
    turn = 2 * np.pi * rng.random(len(rows))
    wide = np.sqrt(1 - z**2)
    sky = np.column_stack([wide * np.cos(turn), wide * np.sin(turn), z])
    open_sky = ~caster.occluded(point, sky, leaving=met)
    colour[rows] = tone * (SUNLIGHT * lit + SKYLIGHT * (0.35 + 0.65 * open_sky))[:, None]
    return colour, found
