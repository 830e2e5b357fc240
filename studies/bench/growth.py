"""Growing: triangles and trees a second by preset and size, and the mesh's error by tolerance."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from forest_addon.api import Skeleton, Species

from ..inside import (
    Say,
    find_species,
    grow,
    load_species,
    mesh_wood,
    skeleton_of,
    stream,
    to_mesh,
)
from ..tables import median_seconds, table
from .cold import say_cold

TITLE = "growth: trees and triangles a second, error of the mesh"
SIZES = {"maple": (4, 7), "ginkgo": (7, 8), "apple-stochastic": (5, 7)}
TOLERANCES = (0.02, 0.005, 0.001, 0.0002)
CONES = 2000
FINE = 0.001
MAPLES = 100


def run(say: Say) -> None:
    """Print speed by preset and size, a hundred maples, and error by tolerance."""
    rows = [_speed(name, size) for name, sizes in SIZES.items() for size in sizes]
    head = [
        *(
            "preset, generations",
            "triangles",
            "wood, skeleton to arrays at 1 mm, s",
            "M triangles/s",
        ),
        *("grammar to arrays, s", "to a Blender mesh, s", "M triangles/s, all", "trees/s"),
        "peak memory, MB",
    ]
    table(say, head, rows)

    species, template = load_species(find_species("maple", Path()))
    triangles = []

    def forest() -> None:
        for number in range(MAPLES):
            tree = grow(species, template, stream(5, "bench", number))
            triangles.append(len(tree.mesh.triangles))

    seconds = median_seconds(forest, runs=1)
    say(
        f"\n{MAPLES} different maples from templates, {np.mean(triangles):,.0f} triangles each: "
        f"{seconds:.2f} s\n"
    )
    head = [
        *("tolerance, mm", "sides, mean", "triangles/branch", "silhouette bias"),
        *("silhouette rms", "volume bias", "inscribed: silhouette bias"),
    ]
    table(say, head, [_error(tolerance) for tolerance in TOLERANCES])
    say(
        f"\n{CONES} frustums of 1 mm to 20 cm radius seen from the side, against (r₁+r₂)h and "
        "πh(r₁²+r₁r₂+r₂²)/3; rings have the circle's perimeter, so that what a beam "
        "sees has no bias; inscribed ones would be too thin."
    )
    say_cold(say, "growth")


def _speed(name: str, size: int) -> list[str]:
    species, template = load_species(find_species(name, Path()))
    species = _of_size(species, size)
    mesh = grow(species, template, stream(5, "bench", name, size)).mesh
    count = len(mesh.triangles)

    def whole() -> None:
        grow(species, template, stream(5, "bench", name, size))

    arrays = median_seconds(whole)
    meshed, speed = "-", "-"
    if template is None:
        skeleton, _ = skeleton_of(species, stream(5, "bench", name, size))
        wood = len(mesh_wood(skeleton, FINE).triangles)
        seconds = median_seconds(lambda: mesh_wood(skeleton, FINE), runs=5)
        meshed, speed = f"{seconds:.4f}", f"{wood / seconds / 1e6:.1f}"
    blender = median_seconds(lambda: bpy.data.meshes.remove(to_mesh("bench", mesh)))
    tracemalloc.start()
    whole()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return [
        f"{name}, {size}",
        f"{count:,}",
        meshed,
        speed,
        f"{arrays:.4f}",
        f"{blender:.4f}",
        f"{count / (arrays + blender) / 1e6:.2f}",
        f"{1 / (arrays + blender):,.1f}",
        f"{peak / 1e6:,.0f}",
    ]


def _of_size(species: Species, generations: int) -> Species:
    if species.rules is not None:
        return replace(species, rules=replace(species.rules, generations=generations))
    return replace(species, grammar=replace(species.grammar, generations=generations))


def _error(tolerance: float) -> list[str]:
    """Error of upright frustums, each a closed convex mesh, seen along x."""
    rng = stream(6, "bench", "cones")
    length = rng.uniform(0.05, 2.0, CONES)
    radius = np.exp(rng.uniform(np.log(0.001), np.log(0.2), CONES))
    radius = np.stack([radius, radius * rng.uniform(0.5, 1.0, CONES)], axis=1)
    foot = np.zeros((CONES, 3))
    foot[:, 1] = 10.0 * np.arange(CONES)
    tip = foot + length[:, None] * [0.0, 0.0, 1.0]
    zeros = np.zeros(CONES, dtype=np.int64)
    mesh = mesh_wood(Skeleton(foot, tip, radius, zeros - 1, zeros, zeros), tolerance)

    corner = mesh.vertices[mesh.triangles]
    cone = np.rint(corner[:, 0, 1] / 10.0).astype(int)
    seen = np.bincount(cone, np.abs(mesh.area_vectors()[:, 0]) / 2, CONES)
    corner = corner - foot[cone][:, None]
    volume = np.einsum("ti,ti->t", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6
    r1, r2 = radius.T
    exact_seen = (r1 + r2) * length
    exact_volume = np.pi * length * (r1**2 + r1 * r2 + r2**2) / 3
    sides = (np.bincount(cone, minlength=CONES) / 4).astype(int)
    inscribed = seen * sides * np.sin(np.pi / sides) / np.pi
    return [
        f"{1e3 * tolerance:g}",
        f"{sides.mean():.1f}",
        f"{len(mesh.triangles) / CONES:.0f}",
        f"{100 * (seen.sum() / exact_seen.sum() - 1):+.3f} %",
        f"{100 * np.sqrt(np.mean((seen / exact_seen - 1) ** 2)):.2f} %",
        f"{100 * (volume.sum() / exact_volume.sum() - 1):+.2f} %",
        f"{100 * (inscribed.sum() / exact_seen.sum() - 1):+.2f} %",
    ]
