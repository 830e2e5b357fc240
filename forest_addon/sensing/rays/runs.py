"""Samples of a scene over time, and the scene that is put together of the runs in which its parts move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...base.trimesh import TriMesh
from .geometry import SceneGeometry
from .paths import RigidPath, SceneMotion, ShapePath


@dataclass(frozen=True)
class Shape:
    """A mesh that may change: its vertices (V, 3) float32 in its own frame, and which triangles it has."""

    vertices: np.ndarray
    mesh: TriMesh  # the first that was read with these triangles


@dataclass(frozen=True)
class SceneSample:
    """A scene of I instances at one time.

    transform : (I, 3, 4). name : names of objects. object_index, mesh_index : (I,) as in ``SceneGeometry``.
    source : (I,) names of the objects whose meshes these are; "" where nodes made them.
    shapes : of the meshes that may change, by number.
    """

    transform: np.ndarray
    name: tuple[str, ...]
    object_index: np.ndarray
    mesh_index: np.ndarray
    shapes: dict[int, Shape]
    source: tuple[str, ...]

    @property
    def things(self) -> list[tuple[str, str]]:
        """(I,) objects of instances, each with the object whose mesh it is."""
        names = (self.name[index] for index in self.object_index.tolist())
        return list(zip(names, self.source, strict=True))

    @property
    def nbytes(self) -> int:
        """Bytes that it takes."""
        return self.transform.nbytes + sum(s.vertices.nbytes for s in self.shapes.values())


class MovingScene:
    """A scene that moves, put together part by part."""

    def __init__(self, scene: SceneGeometry) -> None:
        self._read = scene
        self._paths: dict[int, RigidPath] = {}
        self._shapes: dict[int, ShapePath] = {}
        self._spans: dict[int, tuple[float, float]] = {}
        self._more: list[
            tuple[int, int]
        ] = []  # what each further instance stands for, and its mesh
        self._meshes: dict[int, tuple[int, TriMesh]] = {}
        self._bent: dict[tuple, ShapePath] = {}

    def add(
        self,
        of: int,
        number: int,
        path: RigidPath,
        shape: ShapePath | None,
        span: tuple[float, float],
        shapes: Sequence[Shape | None],
    ) -> None:
        """Add a run: under its own number where it is the first with the triangles of the scene."""
        mesh = self._read.meshes[self._read.mesh_index[of]]
        given = next((s.mesh for s in shapes if s is not None), mesh)
        alike = same_triangles(given, mesh)
        if not (alike and number < len(self._read) and number not in self._paths):
            index = int(self._read.mesh_index[of])
            if not alike:
                index, _ = self._meshes.setdefault(
                    id(given), (len(self._read.meshes) + len(self._meshes), given)
                )
            number = len(self._read) + len(self._more)
            self._more.append((of, index))
        self._paths[number] = path
        if span != (-np.inf, np.inf):
            self._spans[number] = span
        if shape is not None:
            key = tuple(id(s.vertices) for s in shapes if s is not None)
            self._shapes[number] = self._bent.setdefault(key, shape)

    def never(self, number: int) -> None:
        """Say that an instance is not there at all."""
        if number < len(self._read):
            self._paths[number] = RigidPath(np.zeros(1), self._read.transform[number][None])
            self._spans[number] = (np.inf, np.inf)

    def close(self, number: int) -> None:
        """Say that an instance is not there as the scene has it, if no run was."""
        if number not in self._paths:
            self.never(number)

    def scene(self) -> SceneGeometry:
        """The scene, with the further instances behind its own."""
        read = self._read
        if not self._more:
            return read
        of = np.concatenate([np.arange(len(read)), [one for one, _ in self._more]]).astype(int)
        mesh = [index for _, index in self._more]
        added = [mesh for _, mesh in self._meshes.values()]
        first = {index: of_ for of_, index in reversed(self._more)}
        like = [int(read.mesh_index[first[len(read.meshes) + k]]) for k in range(len(added))]
        return replace(
            read,
            meshes=(*read.meshes, *added),
            transform=read.transform[of],
            mesh_index=np.concatenate([read.mesh_index, np.array(mesh, np.int64)]),
            tree=read.tree[of],
            species=read.species[of],
            object_index=read.object_index[of],
            reflectance=read.reflectance[of],
            optics=None if read.optics is None else read.optics[of],
            **{
                name: (*kept, *(kept[m] for m in like))
                for name in ("slot_reflectance", "asset", "slot_names", "slot_optics")
                if (kept := getattr(read, name))
            },
        )

    def motion(self, within: float, bent: float, held: tuple[str, ...]) -> SceneMotion:
        """The motion of all runs."""
        of = None
        if self._more:
            of = np.concatenate([np.arange(len(self._read)), [one for one, _ in self._more]])
            of = of.astype(np.int64)
        return SceneMotion(self._paths, self._shapes, self._spans, of, within, bent, held)


def same_triangles(one: TriMesh, other: TriMesh) -> bool:
    """Return whether two meshes have the same triangles of as many vertices."""
    return one is other or (
        len(one.vertices) == len(other.vertices) and np.array_equal(one.triangles, other.triangles)
    )
