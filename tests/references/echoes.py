"""Echoes of leaves and facets by scalar loops and by brute force, and scenes that they are heard in.

The foliage echo as the formulas say it: one leaf, one frequency at a time, in plain Python.

Nothing is shared with the product but the definitions of PHYSICS 4.1; the air is that of
``reverb``. Vectors are tuples, angles come from arccos and arctan of plain components.
"""

import cmath
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import special

from forest_addon.base.trimesh import LEAF, TriMesh
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.sonar.echo import Echo
from forest_addon.sensing.sonar.leaves import FoliageDiscs, LeafDiscs
from forest_addon.sensing.sonar.ping import ping
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.spec import Air, Sonar

from .reverb import absorption_direct

Leaf = tuple[Sequence[float], Sequence[float], float]  # centre, unit normal, radius


def leaf_direct(frequency: float, leaf: Leaf, sonar: Sonar, air: Air) -> complex:
    """Echo pressure of one leaf at one frequency, re the call at 1 m."""
    centre, normal, radius = leaf
    azimuth, elevation = math.radians(sonar.azimuth_deg), math.radians(sonar.elevation_deg)
    k = 2 * math.pi * frequency / air.speed()
    ray = [c - p for c, p in zip(centre, sonar.position, strict=True)]
    r = math.sqrt(sum(x * x for x in ray))
    unit = [x / r for x in ray]

    # Turn the axis to +X: first back by the azimuth about Z, then down by the elevation about Y.
    x = unit[0] * math.cos(azimuth) + unit[1] * math.sin(azimuth)
    y = unit[1] * math.cos(azimuth) - unit[0] * math.sin(azimuth)
    forward = x * math.cos(elevation) + unit[2] * math.sin(elevation)
    up = unit[2] * math.cos(elevation) - x * math.sin(elevation)
    off_axis = math.acos(max(-1.0, min(1.0, forward)))
    about = math.atan2(up, y)
    az, el = off_axis * math.cos(about), off_axis * math.sin(about)
    width = map(math.radians, sonar.beam_width_deg)
    sigma = [w / 2 / math.sqrt(-2 * math.log(10 ** (-3 / 20))) for w in width]
    beam = math.exp(-(az**2) / (2 * sigma[0] ** 2) - el**2 / (2 * sigma[1] ** 2))

    cosine = min(1.0, abs(sum(u * n for u, n in zip(unit, normal, strict=True))))
    amplitude = scattering_direct(k * radius, math.acos(cosine), sonar.leaf_model) / k
    state = air.temperature_c, air.humidity, air.pressure_kpa
    loss = absorption_direct(frequency, *state) if sonar.absorption else 0.0
    return beam * beam * amplitude / r**2 * cmath.exp(-2 * (loss + 1j * k) * r)


def scattering_direct(ka: float, incidence: float, model: str) -> complex:
    """k·f of a disc."""
    if ka == 0:
        return 0j
    if model == "paper":
        strength = (0.5003 * ka**2 + 0.6867) * math.cos((0.3999 * ka**-0.9065 + 0.9979) * incidence)
        phase = math.erf((0.9824 * ka**0.3523 - 0.9459) * (math.pi / 2 - incidence)) - 2.6343
        return strength * cmath.exp(-1j * phase)
    x = 2 * ka * math.sin(incidence)
    lobe = 1.0 if x == 0 else 2 * float(special.jv(1, x)) / x
    return 1j * ka**2 / 2 * math.cos(incidence) * lobe


# --------------------------------------------------------------------------------------- echo scenes
# Small scenes that tests of echoes share: one mesh, some instances.


def turn(seed: int) -> np.ndarray:
    """A rotation by chance."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


LINEAR = {
    "turned": turn(1),
    "larger": 1.7 * turn(2),
    "smaller": 0.3 * turn(3),
    "mirrored": np.diag([-1.0, 1.0, 1.0]) @ turn(4),
    "squeezed": np.diag([1.0, 0.2, 2.0]) @ turn(5),
    "sheared": np.array([[1.0, 0.5, 0.2], [0.0, 0.3, -1.0], [0.7, 0.0, 2.0]]),
    "flattened": np.diag([1.0, 1.0, 0.0]),
    "gone": np.zeros((3, 3)),
}


def scene_of(mesh: TriMesh, *transforms: np.ndarray) -> SceneGeometry:
    """Instances of one mesh, as trees 3, 4, …; without transforms one, as it is."""
    placed = np.array(transforms or [np.eye(3, 4)], dtype=np.float64).reshape(-1, 3, 4)
    count = len(placed)
    return SceneGeometry(
        (mesh,),
        placed,
        np.zeros(count, np.int64),
        ("thing",) * count,
        np.arange(count) + 3,
        np.zeros(count, np.int64),
    )


def square_leaves(centre: np.ndarray, normal: np.ndarray, side: float, seed: int = 0) -> TriMesh:
    """Square leaves of two triangles at places (L, 3), facing (L, 3)."""
    rng = np.random.default_rng(seed)
    normal = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    u = np.cross(normal, rng.normal(size=normal.shape))
    u *= side / 2 / np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(normal, u)
    corners = np.stack([centre - u - v, centre + u - v, centre + u + v, centre - u + v], axis=1)
    first = 4 * np.arange(len(centre))[:, None, None]
    triangles = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    count = len(triangles)
    return TriMesh(
        corners.reshape(-1, 3),
        triangles.astype(np.int32),
        np.full(count, LEAF, np.int8),
        np.repeat(np.arange(len(centre)), 2).astype(np.int32),
        np.zeros(count, np.int32),
    )


# -------------------------------------------------------------------------------------- facet direct
# Kirchhoff's integral over a flat facet by brute force: small squares, each with its own distance. p =
# (ik/2π)·Σ (h/r³)·e^{-2ikr}·dA for a sonar at the height h over the plane of a triangle, sound sent and
# heard there, e^{+iωt}. Nothing is shared with the product but this formula.


def triangle_direct(
    corners: np.ndarray, point: np.ndarray, wavenumbers: np.ndarray, side: float
) -> np.ndarray:
    """(K,) pressure at ``point`` from a triangle (3, 3) by points ``side`` metres apart (midpoint rule)."""
    a, b, c = (corner - point for corner in corners)
    count = int(np.ceil(max(np.linalg.norm(b - a), np.linalg.norm(c - a)) / side))
    u, v = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    lower = u + v < count
    upper = u + v < count - 1
    places = [((u + 1 / 3) / count, (v + 1 / 3) / count, lower)]
    places += [((u + 2 / 3) / count, (v + 2 / 3) / count, upper)]
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal) / 2 / count**2
    height = abs(a @ normal) / np.linalg.norm(normal)
    total = np.zeros(len(wavenumbers), dtype=complex)
    for s, t, inside in places:
        r = np.linalg.norm(a + s[inside, None] * (b - a) + t[inside, None] * (c - a), axis=1)
        for number, k in enumerate(wavenumbers):
            total[number] += (height / r**3 * np.exp(-2j * k * r)).sum() * area
    return 1j * wavenumbers / (2 * np.pi) * total


# ---------------------------------------------------------------------------------------- leaf discs
# Leaves as discs at given places, for tests of echoes.


def discs_of(centre: Any, normal: Any, radius: Any) -> LeafDiscs:
    """Discs at (L, 3), facing (L, 3) or (3,), of radius (L,) or one."""
    centre = np.asarray(centre, np.float64).reshape(-1, 3)
    count = len(centre)
    normal = np.broadcast_to(np.asarray(normal, np.float64), (count, 3))
    index = np.arange(count)
    return LeafDiscs(
        centre,
        normal / np.linalg.norm(normal, axis=1, keepdims=True),
        np.broadcast_to(np.asarray(radius, np.float64), (count,)),
        np.zeros(count, np.int64),
        index,
        np.zeros(count, np.int64),
    )


def leaf_discs(scene: SceneGeometry) -> LeafDiscs:
    """Every leaf of a scene: the triangles with ``leaf >= 0``, by instance and number."""
    meshes = {index: FoliageDiscs(scene.meshes[index]) for index in np.unique(scene.mesh_index)}
    counts = np.array([len(meshes[index].leaf) for index in scene.mesh_index], dtype=np.int64)
    ends = np.cumsum(counts)
    total = int(ends[-1]) if len(ends) else 0
    centre, normal, radius = np.empty((total, 3)), np.empty((total, 3)), np.empty(total)
    leaf = np.empty(total, dtype=np.int64)
    for instance, index in enumerate(scene.mesh_index):
        rows = slice(ends[instance] - counts[instance], ends[instance])
        foliage = meshes[index]
        centre[rows], normal[rows], radius[rows] = foliage.moved(scene.transform[instance])
        leaf[rows] = foliage.leaf
    instance_of = np.repeat(np.arange(len(scene)), counts)
    return LeafDiscs(centre, normal, radius, instance_of, leaf, scene.tree[instance_of])


# -------------------------------------------------------------------------------- levels and culling


def amplitude_of(echo: Echo, leaf: int) -> float:
    """Mean |A| of a leaf, 0 where it is not heard."""
    return float(echo.heard.amplitude[echo.heard.number == leaf].sum())


def culled(targets: EchoTargets | LeafDiscs, sonar: Sonar, cull: float, **given: Any) -> Echo:
    """An echo less what is culled, which adds less than is told: in all, at each frequency and time."""
    some, every = (
        ping(targets, sonar.changed(cull=c, record=0.1), Air(sound_speed=340.0), **given)
        for c in (cull, 0.0)
    )
    promised = some.cull_bound * some.heard.amplitude.sum()
    assert len(some.heard) < len(every.heard)
    assert 0 < some.cull_bound <= cull
    assert every.heard.amplitude.sum() - some.heard.amplitude.sum() <= promised
    for name in ("spectra", "envelopes"):
        assert np.abs(getattr(every, name) - getattr(some, name)).max() <= promised
    return some
