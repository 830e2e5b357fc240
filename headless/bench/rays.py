"""Rays a second of the BVHTree caster, and its error against float64 brute force."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from forest_addon.blender.bvh import BvhCaster
from forest_addon.formats.species_file import find_species, load_species
from forest_addon.growth.tree import grow
from forest_addon.rng import stream
from forest_addon.sensing.boxes import candidates
from forest_addon.sensing.geometry import SceneGeometry
from forest_addon.sensing.rays import plane_distance

from . import Say, median_seconds, table

TITLE = "rays: BVHTree, leaf-on maples of 5 variants"
RAYS = 50_000
INSTANCES = (1, 10, 100, 1000)


def run(say: Say) -> None:
    """Print rays/s, distance error and wrong-surface rate by number of instances."""
    species, template = load_species(find_species("maple", Path()))
    meshes = tuple(grow(species, template, stream(1, "bench", n)).mesh for n in range(5))
    rows = []
    for count in INSTANCES:
        scene = _forest(meshes, count)
        caster = BvhCaster(scene)
        origins, directions = _rays(scene, RAYS)
        caster.cast(origins[:100], directions[:100], np.inf)  # builds the trees of most meshes
        hits = None

        def cast(caster: BvhCaster = caster, o: np.ndarray = origins, d: np.ndarray = directions):
            nonlocal hits
            hits = caster.cast(o, d, np.inf)

        seconds = median_seconds(cast)
        checked = 100 if count <= 100 else 30
        error, wrong = _against_brute_force(scene, origins, directions, hits, checked)
        triangles = sum(len(meshes[m].triangles) for m in scene.mesh_index)
        rows.append(
            [
                f"{count}",
                f"{triangles:,}",
                f"{RAYS / seconds:,.0f}",
                f"{np.mean(hits.found):.2f}",
                f"{error:.1e}",
                f"{wrong} of {checked}",
            ]
        )
    head = ["trees", "triangles", "rays/s", "share that hit", "largest error, m", "other surface"]
    table(say, head, rows)


def _forest(meshes: tuple, count: int) -> SceneGeometry:
    rng = stream(2, "bench", "stand", count)
    side = 5.0 * np.sqrt(count)
    turn, place = rng.uniform(0, 2 * np.pi, count), rng.uniform(0, side, (count, 2))
    transform = np.zeros((count, 3, 4))
    transform[:, 0, 0] = transform[:, 1, 1] = np.cos(turn)
    transform[:, 1, 0] = np.sin(turn)
    transform[:, 0, 1] = -np.sin(turn)
    transform[:, 2, 2] = 1
    transform[:, :2, 3] = place
    return SceneGeometry(
        meshes=meshes,
        transform=transform,
        mesh_index=np.arange(count) % len(meshes),
        object_name=("tree",) * count,
        tree=np.arange(count),
        species=np.zeros(count, dtype=np.int64),
    )


def _rays(scene: SceneGeometry, count: int) -> tuple[np.ndarray, np.ndarray]:
    """From random places at eye height to random places in the crowns."""
    rng = stream(3, "bench", "rays")
    low, high = scene.transform[:, :2, 3].min(axis=0) - 3, scene.transform[:, :2, 3].max(axis=0) + 3
    start = np.column_stack([rng.uniform(low, high, (count, 2)), np.full(count, 1.6)])
    end = np.column_stack([rng.uniform(low, high, (count, 2)), rng.uniform(0, 9, count)])
    return start, end - start


def _against_brute_force(
    scene: SceneGeometry, origins: np.ndarray, directions: np.ndarray, hits, count: int
) -> tuple[float, int]:
    """Largest distance error where the surface agrees, and how many found another surface."""
    largest, wrong = 0.0, 0
    for ray in range(count):
        way = directions[ray] / np.linalg.norm(directions[ray])
        distance, instance = _nearest(scene, origins[ray], way)
        if instance != hits.instance[ray]:
            wrong += 1
        elif instance >= 0:
            error = abs(distance - hits.distance[ray])
            wrong += error > 1e-6  # another triangle of the same tree
            largest = max(largest, error if error <= 1e-6 else 0.0)
    return largest, wrong


def _nearest(scene: SceneGeometry, origin: np.ndarray, way: np.ndarray) -> tuple[float, int]:
    """One ray against every triangle of every instance it may meet, float64 Möller-Trumbore."""
    _, boxes, entries = candidates(*scene.bounds(), origin[None], way[None], np.array([np.inf]))
    best, owner = np.inf, -1
    for instance, entry in zip(boxes.tolist(), entries, strict=True):
        if entry > best:
            break
        matrix, mesh = scene.transform[instance], scene.meshes[scene.mesh_index[instance]]
        o = matrix[:, :3].T @ (
            origin - matrix[:, 3]
        )  # rotations only: the inverse is the transpose
        d = matrix[:, :3].T @ way
        a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
        e1, e2, s = b - a, c - a, o - a
        h = np.cross(d, e2)
        with np.errstate(divide="ignore", invalid="ignore"):
            f = 1 / np.einsum("ti,ti->t", e1, h)
            u = f * np.einsum("ti,ti->t", s, h)
            q = np.cross(s, e1)
            v = f * (q @ d)
            t = f * np.einsum("ti,ti->t", e2, q)
        hit = np.flatnonzero((u >= -1e-12) & (v >= -1e-12) & (u + v <= 1 + 1e-12) & (t >= 0))
        if len(hit):
            near = hit[np.argmin(t[hit])]
            corners = mesh.vertices[mesh.triangles[near]]
            exact = float(plane_distance(o[None], d[None], corners[None])[0])
            if exact < best:
                best, owner = exact, instance
    return best, owner
