"""Growing: triangles a second by preset and size, and the mesh's error by tolerance."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import bpy
import numpy as np

from forest_addon.api import Skeleton, Species, Tree, TriMesh

from ..inside import (
    find_species,
    grow,
    load_species,
    mesh_wood,
    skeleton_of,
    stream,
    to_mesh,
    wood_of_mesh,
    wood_of_skeleton,
)
from .rows import BenchRow, Rows

TITLE = "growth: triangles a second, error of the mesh"
WORDS = """\
How many: triangles. Frustums have radii of 1 mm to 20 cm and are seen from the side, against (r₁+r₂)h and
πh(r₁²+r₁r₂+r₂²)/3; rings have the circle's perimeter, so that what a beam sees has no bias; inscribed ones
would be too thin.
"""
SIZES = {"maple": (4, 7), "ginkgo": (7, 8), "apple-stochastic": (5, 7)}
TOLERANCES = (0.02, 0.005, 0.001, 0.0002)
CONES, FINE, MAPLES = 2000, 0.001, 100


def _of_size(name: str, generations: int) -> tuple[Species, object]:
    species, template = load_species(find_species(name, Path()))
    part = "rules" if species.rules is not None else "grammar"
    sized = replace(getattr(species, part), generations=generations)
    return replace(species, **{part: sized}), template


def _grown(name: str, size: int) -> BenchRow:
    species, template = _of_size(name, size)

    def work() -> Tree:
        return grow(species, template, stream(5, "bench", name, size))

    return BenchRow(work, _off_the_wood, len(work().mesh.triangles))


def _off_the_wood(tree: Tree) -> str:
    if tree.grafted:
        return "-"
    off = wood_of_mesh(tree.mesh).area / wood_of_skeleton(tree.skeleton).area - 1
    return f"{100 * off:+.2f} % of the wood's surface"


def _tubes(name: str, size: int) -> BenchRow:
    skeleton, _ = skeleton_of(_of_size(name, size)[0], stream(5, "bench", name, size))
    return BenchRow(
        lambda: mesh_wood(skeleton, FINE), many=len(mesh_wood(skeleton, FINE).triangles)
    )


def _into_blender(name: str, size: int) -> BenchRow:
    mesh = grow(*_of_size(name, size), stream(5, "bench", name, size)).mesh
    return BenchRow(
        lambda: bpy.data.meshes.remove(to_mesh("bench", mesh)), many=len(mesh.triangles)
    )


def _maples() -> BenchRow:
    species, template = load_species(find_species("maple", Path()))

    def work() -> int:
        trees = (grow(species, template, stream(5, "bench", number)) for number in range(MAPLES))
        return sum(len(tree.mesh.triangles) for tree in trees)

    return BenchRow(work, many=work())


def _frustums(tolerance: float) -> BenchRow:
    """Upright frustums, each a closed convex mesh, seen along x."""
    rng = stream(6, "bench", "cones")
    length = rng.uniform(0.05, 2.0, CONES)
    radius = np.exp(rng.uniform(np.log(0.001), np.log(0.2), CONES))
    radius = np.stack([radius, radius * rng.uniform(0.5, 1.0, CONES)], axis=1)
    foot = np.zeros((CONES, 3))
    foot[:, 1] = 10.0 * np.arange(CONES)
    tip = foot + length[:, None] * [0.0, 0.0, 1.0]
    zeros = np.zeros(CONES, dtype=np.int64)
    skeleton = Skeleton(foot, tip, radius, zeros - 1, zeros, zeros)
    r1, r2 = radius.T
    true = (r1 + r2) * length
    whole = np.pi * length * (r1**2 + r1 * r2 + r2**2) / 3

    def error(mesh: TriMesh) -> str:
        corner = mesh.vertices[mesh.triangles]
        cone = np.rint(corner[:, 0, 1] / 10.0).astype(int)
        seen = np.bincount(cone, np.abs(mesh.area_vectors()[:, 0]) / 2, CONES)
        corner = corner - foot[cone][:, None]
        volume = np.einsum("ti,ti->t", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6
        sides = (np.bincount(cone, minlength=CONES) / 4).astype(int)
        inscribed = seen * sides * np.sin(np.pi / sides) / np.pi
        ratios = (seen.sum() / true.sum(), volume.sum() / whole.sum(), inscribed.sum() / true.sum())
        silhouette, filled, thin = (100 * (ratio - 1) for ratio in ratios)
        spread = 100 * np.sqrt(np.mean((seen / true - 1) ** 2))
        return (
            f"silhouette {silhouette:+.3f} %, rms {spread:.2f} %, volume {filled:+.2f} %; inscribed: "
            f"silhouette {thin:+.2f} %; {sides.mean():.1f} sides"
        )

    work = partial(mesh_wood, skeleton, tolerance)
    return BenchRow(work, error, len(work().triangles))


PAIRS = [(name, size) for name, sizes in SIZES.items() for size in sizes]
ROWS: Rows = {
    **{f"{n}, {size} generations, to arrays": partial(_grown, n, size) for n, size in PAIRS},
    **{
        f"{n}, {size} generations, its tubes at 1 mm": partial(_tubes, n, size)
        for n, size in PAIRS
        if n != "maple"
    },
    **{
        f"{n}, {size} generations, into Blender": partial(_into_blender, n, size)
        for n, size in PAIRS
    },
    f"{MAPLES} maples from templates, each its own": _maples,
    **{f"{CONES:,} frustums, tolerance {1e3 * t:g} mm": partial(_frustums, t) for t in TOLERANCES},
}
