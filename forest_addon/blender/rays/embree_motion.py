"""Embree on pieces that move: instances whose places have many steps, and rays with a time each.

Embree takes the elements of a place linearly between two steps, as ``sensing.rays.pieces`` does; what it
finds in float32 is met again in float64, where the piece is at the ray's time.
"""

from __future__ import annotations

import numpy as np

from ...base.trimesh import TriMesh
from ...sensing.rays.boxes import clip
from ...sensing.rays.caster import Hits
from ...sensing.rays.geometry import SceneGeometry
from ...sensing.rays.pieces import boxes_of, placed, swept
from ...sensing.rays.search import RefinedSurfaces, in_tasks, search_on, whole_triangles
from .embree import HIT_INSTANCE, HIT_OF_ARRAY, EmbreeBuild, RayPackets, has_arrays, lanes_for, load

SLACK = 1e-6  # of the scene's size, by which rays go on


class EmbreePieces:
    """Embree's trees of pieces, made once; called, it gives those of a window of time their places.

    Raises
    ------
    EmbreeError : Embree is not there, or has no memory left.
    """

    def __init__(self, meshes: tuple[TriMesh, ...], threads: int = 1) -> None:
        self.library = load()
        self.threads = threads
        self.device = self.library.rtcNewDevice(f"threads={threads}".encode())
        self.build = EmbreeBuild(self.library, self.device)
        self.arrays = has_arrays(self.library, self.device)
        every = np.arange(len(meshes))  # a place each, which is never asked for
        stands = np.broadcast_to(np.eye(3, 4), (len(meshes), 3, 4))
        scene = SceneGeometry(meshes, stands, every, ("",) * len(meshes), every, every)
        self.surfaces = RefinedSurfaces(scene)
        self.usable = [whole_triangles(mesh) for mesh in meshes]
        self.size = np.array([len(rows) for rows in self.usable], np.int64)
        self._first = np.cumsum(self.size) - self.size
        self._all = np.concatenate([np.empty(0, np.int64), *self.usable])  # maybe of no piece
        self.boxes = boxes_of(meshes)
        self._meshes = meshes
        self._scenes: dict[int, int] = {}

    def __call__(self, mesh: np.ndarray, places: np.ndarray) -> _EmbreeWindow:
        return _EmbreeWindow(self, mesh, places)

    def numbered(self, mesh: np.ndarray, primitive: np.ndarray) -> np.ndarray:
        """(R,) triangles of pieces, from those that Embree was given."""
        return np.asarray(self._all[self._first[mesh] + primitive])

    def scene(self, mesh: int) -> int:
        """Embree's scene of a piece."""
        if mesh not in self._scenes:
            self._scenes[mesh] = self.build.mesh(self._meshes[mesh], self.usable[mesh])
        return self._scenes[mesh]


class _EmbreeWindow:
    """Pieces of a window: mesh (P,), places (K, P, 3, 4)."""

    def __init__(self, pieces: EmbreePieces, mesh: np.ndarray, places: np.ndarray) -> None:
        self._pieces, self._mesh, self._places = pieces, mesh, places
        low, high = swept(pieces.boxes[mesh], places)
        low, high = low.min(axis=0), high.max(axis=0)
        self._centre = (low + high) / 2
        self._slack = SLACK * float((high - low).max()) + SLACK
        self._box = low - self._slack, high + self._slack
        moved = places.astype(np.float64)
        moved[:, :, :, 3] -= self._centre
        self._build = EmbreeBuild(pieces.library, pieces.device, pieces.build)
        self._known = np.flatnonzero(pieces.size[mesh] > 0)
        self._top = self._placed(moved[:, self._known])

    def _placed(self, places: np.ndarray) -> int:
        """Embree's scene of the pieces that have a surface, at places (K, P, 3, 4) about the centre."""
        pieces, mesh = self._pieces, self._mesh[self._known]
        if pieces.arrays and len(mesh):
            used, which = np.unique(mesh, return_inverse=True)
            scenes = [pieces.scene(number) for number in used.tolist()]
            return self._build.array(scenes, which, places)
        scenes = [pieces.scene(number) for number in mesh.tolist()]
        every = np.ascontiguousarray(places.swapaxes(0, 1), dtype=np.float32)
        return self._build.instances(list(range(len(mesh))), scenes, every)

    def cast(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        near: np.ndarray,
        far: np.ndarray,
        knot: np.ndarray,
        leaving: Hits | None,
    ) -> Hits:
        """The closest hits; see ``PieceWindow``."""
        hits = Hits.misses(len(origins))

        def task(part: slice) -> None:
            rays = origins[part], ways[part]
            some_near, some_far, some_knot = near[part], far[part], knot[part]
            left = Hits.misses(len(some_near)) if leaving is None else leaving.select(part)

            def nearest(rows: np.ndarray, start: np.ndarray) -> Hits:
                some = rays[0][rows], rays[1][rows]
                return self._nearest(*some, start, some_far[rows], some_knot[rows])

            hits.put(part, search_on(nearest, some_near, some_far, left))

        in_tasks(task, len(origins), self._pieces.threads)
        return hits

    def _nearest(
        self,
        origins: np.ndarray,
        ways: np.ndarray,
        start: np.ndarray,
        limit: np.ndarray,
        knot: np.ndarray,
    ) -> Hits:
        found = Hits.misses(len(origins))
        direction, origin = np.ascontiguousarray(ways.T), np.ascontiguousarray(origins.T)
        begin, leaves = clip(*self._box, origin, direction, start, limit)
        rays = np.flatnonzero(begin <= leaves)
        if not len(rays):
            return found
        origin, direction, knot = origin[:, rays], direction[:, rays], knot[rays]
        moved = origin + begin[rays] * direction - self._centre[:, None]
        reach = (limit[rays] - begin[rays]) * (1 + 1e-6) + self._slack
        packets = RayPackets(len(rays), lanes_for(moved, direction))
        packets.fill(moved, direction, reach, knot / (len(self._places) - 1))
        packets.trace(self._pieces.library, self._top)
        row = HIT_OF_ARRAY if self._pieces.arrays else HIT_INSTANCE
        piece, primitive, met = packets.read(len(rays), row)
        if not len(met):
            return found
        piece = self._known[piece]
        mesh = self._mesh[piece]
        triangle = self._pieces.numbered(mesh, primitive)
        distance = self._pieces.surfaces.distance(
            np.ascontiguousarray(origin[:, met]),
            np.ascontiguousarray(direction[:, met]),
            mesh,
            triangle,
            placed(self._places, piece, knot[met]),
        )
        found.put(rays[met], Hits(distance, piece, triangle))
        return found
