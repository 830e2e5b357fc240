"""Blender's own Embree through its C interface: found, loaded and checked.

Every Blender ships ``libembree4`` for Cycles: beside its module or program, in ``lib``, in
``blender.shared``, or as the system's library. Only versions 4.3 to 4.x are used, as Blender's are: their
functions, constants and layouts are those below (embree4/rtcore.h).
"""

from __future__ import annotations

import ctypes
import sys
import weakref
from collections import deque
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import repeat
from pathlib import Path

import bpy
import numpy as np

from ... import kernels
from ...base.rows import distinct
from ...base.trimesh import TriMesh
from ...kernels import CastScene
from ...sensing.rays.boxes import clip
from ...sensing.rays.caster import Hits
from ...sensing.rays.geometry import SceneGeometry, invert_transforms
from ...sensing.rays.search import Search, in_tasks, meet_planes, whole_triangles

FOLDERS = ("lib", "blender.shared", ".", "../Frameworks", "../Resources/lib")
FILES = {"win32": ("embree4*.dll",), "darwin": ("libembree4*.dylib",)}
SYSTEM = {"win32": ("embree4.dll",), "darwin": ("libembree4.dylib", "libembree4.4.dylib")}

TRIANGLE, INSTANCE, INSTANCES = 0, 121, 122  # RTCGeometryType
INDEX_BUFFER, VERTEX_BUFFER, TRANSFORM_BUFFER = 0, 1, 23  # RTCBufferType
UINT, UINT3, FLOAT3, FLOAT3X4_ROWS = 0x5001, 0x5003, 0x9003, 0x9134  # RTCFormat
# RTCSceneFlags: no ray slips through an edge; packets have a filter
ROBUST, FILTERED = 1 << 2, 1 << 3
VERSION_PROPERTY = 0  # RTCDeviceProperty
PACKETS = 33, 66  # the same: packets of eight go natively, and ask a filter

_P, _U, _I, _Z = ctypes.c_void_p, ctypes.c_uint, ctypes.c_int, ctypes.c_size_t
SIGNATURES = {
    "rtcNewDevice": (_P, [ctypes.c_char_p]),
    "rtcReleaseDevice": (None, [_P]),
    "rtcGetDeviceError": (_I, [_P]),
    "rtcGetDeviceProperty": (ctypes.c_ssize_t, [_P, _I]),
    "rtcNewScene": (_P, [_P]),
    "rtcReleaseScene": (None, [_P]),
    "rtcSetSceneFlags": (None, [_P, _I]),
    "rtcCommitScene": (None, [_P]),
    "rtcNewGeometry": (_P, [_P, _I]),
    "rtcReleaseGeometry": (None, [_P]),
    "rtcCommitGeometry": (None, [_P]),
    "rtcAttachGeometryByID": (None, [_P, _P, _U]),
    "rtcSetSharedGeometryBuffer": (None, [_P, _I, _U, _I, _P, _Z, _Z, _Z]),
    "rtcSetGeometryInstancedScene": (None, [_P, _P]),
    "rtcSetGeometryTransform": (None, [_P, _U, _I, _P]),
    "rtcSetGeometryTransformQuaternion": (None, [_P, _U, _P]),
    "rtcSetGeometryTimeStepCount": (None, [_P, _U]),
    "rtcIntersect1": (None, [_P, _P, _P]),
    "rtcIntersect8": (None, [_P, _P, _P, _P]),
    "rtcSetGeometryInstancedScenes": (None, [_P, _P, _Z]),
}


class EmbreeError(RuntimeError):
    """Embree is not there, is another version, or failed."""


@cache
def load() -> ctypes.CDLL:
    """The library, its functions typed.

    Raises
    ------
    EmbreeError : none of version 4.x is found; says what was tried.
    """
    tried = []
    for place in _places():
        try:
            library = ctypes.CDLL(place)
            for name, (result, arguments) in SIGNATURES.items():
                function = getattr(library, name)
                function.restype, function.argtypes = result, arguments
            device = library.rtcNewDevice(b"")
            if not device:
                raise EmbreeError("it gives no device")
            version = library.rtcGetDeviceProperty(device, VERSION_PROPERTY)
            arrays = library.rtcNewGeometry(device, INSTANCES)
            if arrays:
                library.rtcReleaseGeometry(arrays)
            library.rtcReleaseDevice(device)
            if version // 10_000 != 4:
                raise EmbreeError(f"it is version {version // 10_000}, not 4")
            if not arrays:
                raise EmbreeError("it was built without arrays of instances")
            return library
        except (OSError, AttributeError, EmbreeError) as problem:
            tried.append(f"{place}: {problem}")
    raise EmbreeError("no Embree 4 beside Blender or on the system; tried " + "; ".join(tried))


def _places() -> Iterator[str]:
    """Files beside Blender, then names: what is loaded already or what the system finds."""
    roots = [Path(bpy.utils.resource_path("LOCAL")).parent]
    roots += [Path(place).parent for place in (bpy.app.binary_path, bpy.__file__ or "") if place]
    files: dict[str, None] = {}
    for root in roots:
        for folder in FOLDERS:
            for pattern in FILES.get(sys.platform, ("libembree4.so*",)):
                files |= dict.fromkeys(str(path) for path in sorted((root / folder).glob(pattern)))
    yield from files
    yield from SYSTEM.get(sys.platform, ("libembree4.so.4", "libembree4.so"))


# Numbers of RTCRayHit, of four bytes each; before them origin 0-2, direction 4-6.
TIME, TFAR, MASK, HIT_PRIMITIVE, HIT_GEOMETRY, HIT_INSTANCE, HIT_OF_ARRAY, SIZE = (
    *(7, 8, 9, 17, 18, 19, 20, 24),
)
NONE, FAR = 0xFFFFFFFF, 3e38  # the longest way that float32 holds
SPARE, ROUNDING = 4.0, 1e-6  # slacks and share of a coordinate by which packets need larger boxes


# The fast engine: Blender's own Embree, instanced, on all cores.
#
# Every unique mesh is an Embree scene of triangles in local space; above them is one of instances, about
# the centre of them all, where float32 holds them best. ``kernels/cast.c`` sends rays through it, without
# Python's lock, so that threads work side by side; without that library they go one by one.


class EmbreeSearch(Search):
    """A ``Search`` through one of Embree's scenes, whose instances stand, or go as another class says."""

    engine = "embree"
    _last = 1  # of a ray's knots, from 0 on
    _described: CastScene | None = None  # to the kernel; None: numpy computes

    def _bound(self, low: np.ndarray, high: np.ndarray) -> None:
        """Set the box, from (3,) to (3,), that holds all, and about whose centre Embree has it."""
        there = bool(np.isfinite(high - low).all())
        self._centre = (low + high) / 2 if there else np.zeros(3)
        self._slack = 1e-6 * float((high - low).max()) + 1e-6 if there else 1e-6
        self._low, self._high = low - self._slack, high + self._slack

    def _describe(
        self, places: np.ndarray, piece: np.ndarray | None = None, packets: bool = False
    ) -> None:
        """Describe the scene to the kernel. places : (I, 3, 4) of instances; of an array of Embree's
        (K, P, 3, 4) at knots. piece : (P,) the instances of that. packets : rays may go as such."""
        point, places = ctypes.c_double * 3, np.ascontiguousarray(places)
        triangle, vertex, single, _ = self.scene.arrays
        self._arrays = places, piece  # which the kernel reads where they are
        self._described = CastScene(
            tree=self._top,
            intersect=ctypes.cast(self._library.rtcIntersect1, ctypes.c_void_p),
            intersect8=ctypes.cast(
                self._library.rtcIntersect8 if packets else None, ctypes.c_void_p
            ),
            low=point(*self._low),
            high=point(*self._high),
            centre=point(*self._centre),
            slack=self._slack,
            steps=0 if piece is None else len(places),
            pieces=0 if piece is None else len(piece),
            piece=None if piece is None else piece.ctypes.data,
            transform=places.ctypes.data,
            triangle=triangle.ctypes.data,
            vertex=vertex.ctypes.data,
            single=single.ctypes.data,
        )

    def _knot(self, time: np.ndarray) -> np.ndarray:
        """Times (R,), s, from 0 to ``_last``."""
        return time

    def _found(
        self, instance: np.ndarray, row: np.ndarray, triangle: np.ndarray, time: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
        """Instances that Embree names by number and row of an array, their places and the corners of their
        triangles at times; None: as the scene has them."""
        return instance, None, None

    def cast(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        max_distance: float | np.ndarray = np.inf,
        *,
        min_distance: float | np.ndarray = 0.0,
        leaving: Hits | None = None,
        time: float | np.ndarray = 0.0,
    ) -> Hits:
        """The closest hit of each ray; see ``RayCaster``."""
        library, count = kernels.library(), len(origins)
        if library is None or self._described is None:
            return super().cast(
                origins,
                directions,
                max_distance,
                min_distance=min_distance,
                leaving=leaving,
                time=time,
            )
        rays = [
            np.ascontiguousarray(given, np.float64).reshape(count, 3)
            for given in (origins, directions)
        ]
        knot = self._knot(np.full(count, time, np.float64))
        rays += [np.full(count, limit, np.float64) for limit in (min_distance, max_distance)]
        hits = Hits(np.empty(count), *np.full((2, count), -1, np.int64), np.empty((count, 3)))
        left = hits if leaving is None else leaving  # -1 until the kernel writes
        rays += [knot, left.instance, left.triangle, *vars(hits).values()]

        def task(part: slice) -> None:
            columns = [column[part] for column in rays]
            library.cast_rays(self._described, len(columns[0]), *columns)

        in_tasks(task, count, self.threads)
        return hits

    def _nearest(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        start: np.ndarray,
        limit: np.ndarray,
        time: np.ndarray,
    ) -> Hits:
        begin, leaves = clip(self._low, self._high, origins, directions, start, limit)
        rays = (begin <= leaves).nonzero()[0]
        origins, directions, begin = origins[:, rays], directions[:, rays], begin[rays]
        reach = (limit[rays] - begin) * (1 + 1e-6) + self._slack
        moved = begin * directions + origins - self._centre[:, None]
        sent = rays_of(moved, directions, reach)
        sent[:, TIME] = self._knot(time[rays]) / self._last
        send(self._library, self._top, sent)
        whole = sent.view(np.uint32)
        met = np.flatnonzero(whole[:, HIT_GEOMETRY] != NONE)
        named = whole[met][:, [HIT_INSTANCE, HIT_OF_ARRAY, HIT_PRIMITIVE]].astype(np.int64)
        instance, place, corners = self._found(*named.T, time[rays[met]])
        distance, normal = meet_planes(
            self.scene, origins[:, met], directions[:, met], instance, named[:, 2], place, corners
        )
        hits = Hits.misses(len(start))
        hits.put(rays[met], Hits(distance, instance, named[:, 2], normal.T))
        return hits


class EmbreeCaster(EmbreeSearch):
    """Closest hits and occlusion through Embree (see ``sensing.rays.RayCaster``).

    No ray slips through an edge. Of a million aimed exactly at vertices a few may: the signs of all
    edges that meet there can be rounded alike.
    """

    def __init__(
        self, scene: SceneGeometry, threads: int = 1, like: EmbreeCaster | None = None
    ) -> None:
        """Build all trees.

        like : a caster whose trees of the meshes that both scenes have are shared.

        Raises
        ------
        EmbreeError : Embree is not there, or has no memory left.
        """
        super().__init__(scene, threads, like)
        low, high = scene.bounds()
        low[~np.isfinite(invert_transforms(scene.transform)).all(axis=(1, 2))] = np.nan
        known = np.flatnonzero(np.isfinite(low).all(axis=1))  # the others are flat or empty
        low, high = low[known].min(0, initial=np.inf), high[known].max(0, initial=-np.inf)
        if scene.extent is not None:
            low, high = np.minimum(low, scene.extent[0]), np.maximum(high, scene.extent[1])
        self._bound(low, high)
        self._library = load()
        self._device = (
            like._device if like else self._library.rtcNewDevice(f"threads={threads}".encode())
        )
        self._build = build = EmbreeBuild(self._library, self._device, like and like._build)
        # Metres of a mesh that are some slacks in the world, where an instance of it is smallest.
        need, sides = np.zeros(len(scene.meshes)), np.abs(scene.transform[known, :, :3]).sum(axis=2)
        np.maximum.at(need, scene.mesh_index[known], SPARE * self._slack / sides.min(axis=1))
        there = like._of_mesh if like else {}
        # Trees, and by how much their boxes are larger.
        self._of_mesh: dict[int, tuple[int, float]] = {}
        for m in distinct(scene.mesh_index[known]).tolist():
            tree, margin = there.get(self._same.get(m, -1), (0, 0.0))
            if SPARE * margin < need[m]:
                tree, margin = build.mesh(scene.meshes[m], need[m]), need[m]
            self._of_mesh[m] = tree, margin
        place = scene.transform.copy()
        place[:, :, 3] -= self._centre
        self._top = build.instances(
            known.tolist(),
            [self._of_mesh[m][0] for m in scene.mesh_index[known]],
            place[known, None].astype(np.float32),
        )
        able = self._library.rtcGetDeviceProperty
        self._describe(scene.transform, packets=all(able(self._device, p) for p in PACKETS))


def rays_of(origins: np.ndarray, directions: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """(R, SIZE) float32, rays (3, R), (3, R), (R,) as Embree wants them."""
    rays = np.zeros((len(reach), SIZE), np.float32)  # at 16 bytes, as Embree asks of one ray
    rays[:, :3], rays[:, 4:7], rays[:, TFAR] = origins.T, directions.T, np.minimum(reach, FAR)
    rays.view(np.uint32)[:, [MASK, HIT_GEOMETRY, HIT_INSTANCE]] = NONE
    return rays


def send(library: ctypes.CDLL, top: int, rays: np.ndarray) -> None:
    """Send rays into a scene, one by one: packets would find other faces at edges."""
    kernel = kernels.library()
    if kernel is None:
        places = range(rays.ctypes.data, rays.ctypes.data + rays.nbytes, 4 * SIZE)
        deque(map(library.rtcIntersect1, repeat(top), places, repeat(None)), maxlen=0)
    else:
        kernel.send_rays(library.rtcIntersect1, top, len(rays), rays, SIZE)


class EmbreeBuild:
    """Embree's scenes on one device, and the arrays that they read where they are.

    parent : another on the same device, which gives it back, and lives longer.
    """

    def __init__(
        self, library: ctypes.CDLL, device: int, parent: EmbreeBuild | None = None
    ) -> None:
        self._library = library
        self._device = device
        self._scenes: list[int] = []
        self._arrays: list[np.ndarray] = []
        # The parent is held by what releases this, so that it goes after it, also in a collected circle.
        weakref.finalize(self, _release, library, device, self._scenes, self._arrays, parent)

    def mesh(self, mesh: TriMesh, margin: float = 0.0) -> int:
        """A scene of a mesh's triangles, in its local space; its box is larger by a margin, m."""
        triangles = collapsed(mesh.triangles, whole_triangles(mesh))
        if mesh.points.dtype != np.float32 or not np.isfinite(mesh.points.sum()):
            return self.shape(mesh.vertices[None], triangles, margin)
        return self._of_triangles(mesh.points, 1, triangles, margin)

    def shape(self, vertices: np.ndarray, triangles: np.ndarray, margin: float = 0.0) -> int:
        """A scene of triangles (T, 3) in their local space.

        vertices : (S, V, 3) at even steps of a ray's time from 0 to 1, between which they go straight.
        """
        kept = np.zeros((vertices.shape[0] * vertices.shape[1] + 1, 3), dtype=np.float32)
        kept[:-1] = np.nan_to_num(vertices.reshape(-1, 3), nan=0.0, posinf=0.0, neginf=0.0)
        return self._of_triangles(kept[:-1], len(vertices), triangles, margin)

    def _of_triangles(
        self, kept: np.ndarray, steps: int, triangles: np.ndarray, margin: float
    ) -> int:
        """A scene of triangles, whose arrays Embree reads where they are: vertices 16 bytes at a time."""
        scene, parts = self._scene(), [(kept, steps, triangles)]
        if margin and len(kept):  # by two triangles that are points, which no ray meets
            margin += ROUNDING * float(np.abs(kept).max())
            corners = np.stack([kept.min(axis=0) - margin, kept.max(axis=0) + margin, kept[0]])
            parts.append((corners.astype(np.float32)[:2], 1, np.array([[0, 0, 0], [1, 1, 1]])))
        given = self._library.rtcSetSharedGeometryBuffer
        for number, (kept, steps, triangles) in enumerate(parts):
            count = len(kept) // steps
            triangles = np.ascontiguousarray(triangles, dtype=np.int32).view(np.uint32)
            self._arrays += [kept, triangles]
            geometry = self._library.rtcNewGeometry(self._device, TRIANGLE)
            self._library.rtcSetGeometryTimeStepCount(geometry, steps)
            first, size = kept.ctypes.data, kept.strides[0] * count
            for step in range(steps):
                given(geometry, VERTEX_BUFFER, step, FLOAT3, first + step * size, 0, 12, count)
            given(geometry, INDEX_BUFFER, 0, UINT3, triangles.ctypes.data, 0, 12, len(triangles))
            self._attach(scene, geometry, number)
        return self._commit(scene)

    def instances(
        self,
        numbers: list[int],
        scenes: list[int],
        places: Sequence[np.ndarray],
        turn: bool = False,
    ) -> int:
        """A scene of instances; a hit names the instance by its number.

        places : of each (S, 3, 4) float32 at even steps of a ray's time from 0 to 1. turn : they are
        (S, 16), Embree's ``RTCQuaternionDecomposition``, between which turns go at an even rate and all else
        linearly.
        """
        top, library = self._scene(), self._library
        for number, scene, place in zip(numbers, scenes, places, strict=True):
            geometry = library.rtcNewGeometry(self._device, INSTANCE)
            library.rtcSetGeometryInstancedScene(geometry, scene)
            library.rtcSetGeometryTimeStepCount(geometry, len(place))
            first, size = place.ctypes.data, place.strides[0]
            for step in range(len(place)):
                row = first + step * size
                if turn:
                    library.rtcSetGeometryTransformQuaternion(geometry, step, row)
                else:
                    library.rtcSetGeometryTransform(geometry, step, FLOAT3X4_ROWS, row)
            self._attach(top, geometry, number)
        return self._commit(top)

    def array(self, scenes: list[int], which: np.ndarray, place: np.ndarray) -> int:
        """A scene of one geometry of many instances; a hit names the instance by its row.

        which : (I,) of the scenes. place : (K, I, 3, 4) float32, at even steps of a ray's time from 0 to 1,
        between which their elements go linearly.
        """
        top, given = self._scene(), np.array(scenes, dtype=np.uint64)
        if not scenes:
            return self._commit(top)
        index, place = which.astype(np.uint32), np.ascontiguousarray(place, dtype=np.float32)
        self._arrays += [index, place]
        geometry = self._library.rtcNewGeometry(self._device, INSTANCES)
        self._library.rtcSetGeometryInstancedScenes(geometry, given.ctypes.data, len(given))
        self._library.rtcSetGeometryTimeStepCount(geometry, len(place))
        share, form = self._library.rtcSetSharedGeometryBuffer, FLOAT3X4_ROWS
        share(geometry, INDEX_BUFFER, 0, UINT, index.ctypes.data, 0, 4, len(which))
        for step, row in enumerate(place):
            size = row.strides[0]
            share(geometry, TRANSFORM_BUFFER, step, form, row.ctypes.data, 0, size, len(row))
        self._attach(top, geometry, 0)
        return self._commit(top)

    def _scene(self) -> int:
        scene: int = self._library.rtcNewScene(self._device)
        self._scenes.append(scene)
        self._library.rtcSetSceneFlags(scene, ROBUST | FILTERED)
        return scene

    def _attach(self, scene: int, geometry: int, number: int) -> None:
        self._library.rtcCommitGeometry(geometry)
        self._library.rtcAttachGeometryByID(scene, geometry, number)
        self._library.rtcReleaseGeometry(geometry)

    def _commit(self, scene: int) -> int:
        self._library.rtcCommitScene(scene)
        error = self._library.rtcGetDeviceError(self._device)
        if error:
            raise EmbreeError(f"Embree could not build the scene (its error {error})")
        return scene


def collapsed(triangles: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Triangles (T, 3), those that are not whole (T,) drawn together to a corner, where no ray meets them."""
    return triangles if whole.all() else np.where(whole[:, None], triangles, triangles[:, :1])


def _release(
    library: ctypes.CDLL,
    device: int,
    scenes: list[int],
    arrays: list[np.ndarray],
    parent: EmbreeBuild | None,
) -> None:
    """Give everything back, the last made first."""
    for scene in reversed(scenes):
        library.rtcReleaseScene(scene)
    if parent is None:
        library.rtcReleaseDevice(device)
    arrays.clear()
