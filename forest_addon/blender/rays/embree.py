"""Blender's own Embree through its C interface: found, loaded and checked.

Every Blender ships ``libembree4`` for Cycles: beside its module or program, in ``lib``, in
``blender.shared``, or as the system's library. Only versions 4.3 to 4.x are used, as Blender's are: their
functions, constants and layouts are those below (embree4/rtcore.h).
"""

from __future__ import annotations

import ctypes
import sys
import threading
import weakref
from collections import deque
from collections.abc import Iterable, Iterator
from functools import cache
from itertools import repeat
from pathlib import Path

import bpy
import numpy as np

from ...base.rows import distinct
from ...base.trimesh import TriMesh
from ...sensing.rays.boxes import clip
from ...sensing.rays.caster import Hits
from ...sensing.rays.geometry import SceneGeometry, invert_transforms
from ...sensing.rays.search import TASK, Search, whole_triangles

FOLDERS = ("lib", "blender.shared", ".", "../Frameworks", "../Resources/lib")
FILES = {"win32": ("embree4*.dll",), "darwin": ("libembree4*.dylib",)}
SYSTEM = {"win32": ("embree4.dll",), "darwin": ("libembree4.dylib", "libembree4.4.dylib")}

TRIANGLE, INSTANCE, INSTANCES = 0, 121, 122  # RTCGeometryType
INDEX_BUFFER, VERTEX_BUFFER, TRANSFORM_BUFFER = 0, 1, 23  # RTCBufferType
UINT, UINT3, FLOAT3, FLOAT3X4_ROWS = 0x5001, 0x5003, 0x9003, 0x9134  # RTCFormat
ROBUST = 1 << 2  # RTCSceneFlags: no ray slips through an edge
VERSION_PROPERTY = 0  # RTCDeviceProperty

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
    "rtcIntersect8": (None, [_P, _P, _P, _P]),
    "rtcIntersect16": (None, [_P, _P, _P, _P]),
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
            _type(library)
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


def _type(library: ctypes.CDLL) -> None:
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


# Packets of rays as Embree wants them: which rays go together, how many, and by which of its ways.
#
# Rays side by side, as those of a beam, go by eight as a coherent packet: Embree passes its tree once for
# the pyramid around them, twice as fast as ray by ray. Others go by sixteen, which Embree takes one by one;
# so do those of an aircraft's beams, which are farther apart than leaves are wide where they enter the
# scene and would be a tenth slower together.


LONE, ALIKE = 16, 8  # rays of a packet
TURN = 0.03  # by how much unit directions of a packet side by side differ at most
ASIDE = 0.05  # metres between the places where they enter the scene, at most: about a leaf
LOOKED_AT = 16  # of so many packets one
MOST_APART = 0.1  # share of the packets that may be wider
# Rows of RTCRayHit8 and 16; between them normal 12-14, u 15, v 16, and 20 the place in an array of instances.
TNEAR, DIRECTION, TIME, TFAR, MASK, ID, FLAGS = 3, 4, 7, 8, 9, 10, 11
HIT_PRIMITIVE, HIT_GEOMETRY, HIT_INSTANCE, HIT_OF_ARRAY, ROWS = 17, 18, 19, 20, 21
NONE = 0xFFFFFFFF
FAR = 3e38  # the longest way that float32 holds


class _Arguments(ctypes.Structure):
    """RTCIntersectArguments."""

    _fields_ = (
        ("flags", ctypes.c_int),
        ("features", ctypes.c_uint),
        ("context", ctypes.c_void_p),
        ("filter", ctypes.c_void_p),
        ("intersect", ctypes.c_void_p),
        ("width", ctypes.c_float),
    )


_COHERENT = _Arguments(flags=1 << 16, features=NONE)


def lanes_for(origins: np.ndarray, directions: np.ndarray) -> int:
    """Return how many of the rays (3, R), (3, R) should go together, as they follow each other.

    origins : where they enter the scene.
    """
    whole = origins.shape[1] // ALIKE * ALIKE
    for rays, most in ((directions, TURN), (origins, ASIDE)):
        some = rays[:, :whole].reshape(3, -1, ALIKE)[:, ::LOOKED_AT]
        wide = (some.max(axis=2) - some.min(axis=2) > most).any(axis=0)
        if np.count_nonzero(wide) > MOST_APART * len(wide):
            return LONE
    return ALIKE


class RayPackets:
    """Rays as Embree wants them: packets (P, 21, lanes) float32, the last one filled up with idle lanes."""

    def __init__(self, count: int, lanes: int = LONE) -> None:
        self.lanes = lanes
        size = -(-count // lanes)
        self.packets = _aligned((size, ROWS, lanes), np.float32)
        self._whole = self.packets.view(np.uint32)
        self.packets[:, [TNEAR, TIME]] = 0.0
        self._whole[:, MASK] = NONE
        self._whole[:, [ID, FLAGS]] = 0
        self._lanes = np.zeros((7, size * lanes), dtype=np.float32)  # origin, direction, reach
        self._by_packet = self._lanes.reshape(7, size, lanes).swapaxes(0, 1)
        self._found = self._whole[:, HIT_PRIMITIVE:ROWS]
        first, step = self.packets.ctypes.data, self.packets.strides[0]
        self.addresses = range(first, first + step * size, step)

    def fill(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        reach: np.ndarray,
    ) -> None:
        """Rays (3, R), (3, R), (R,)."""
        count = len(reach)
        self._lanes[:3, :count] = origins
        self._lanes[3:6, :count] = directions
        np.minimum(reach, FAR, out=reach)
        self._lanes[6, :count] = reach
        self._lanes[6, count:] = -1.0  # ends before it starts: idle
        self.packets[:, :3] = self._by_packet[:, :3]
        self.packets[:, DIRECTION : DIRECTION + 3] = self._by_packet[:, 3:6]
        self.packets[:, TFAR] = self._by_packet[:, 6]
        self._found[:] = NONE

    def set_time(self, time: np.ndarray) -> None:
        """Times (R,) of the rays from 0 to 1, for a scene that moves."""
        every = np.zeros(self._lanes.shape[1], dtype=np.float32)
        every[: len(time)] = time
        self.packets[:, TIME] = every.reshape(-1, self.lanes)

    def trace(self, library: ctypes.CDLL, scene: int, rays: np.ndarray | None = None) -> None:
        """Send them into a scene.

        rays : some, whose packets go; left out: all.
        """
        run, how = library.rtcIntersect16, None
        if self.lanes == ALIKE:
            run, how = library.rtcIntersect8, ctypes.addressof(_COHERENT)
        going: Iterable[int] = self.addresses
        if rays is not None:
            some = np.flatnonzero(np.bincount(rays // self.lanes, minlength=1))
            going = map(going.__getitem__, some.tolist())
        deque(map(run, repeat(_SENT), repeat(scene), going, repeat(how)), maxlen=0)

    def read(self, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Instance and triangle (M,) of the rays that met something, and which rays (M,) these are."""
        found = self._found.swapaxes(0, 1).reshape(ROWS - HIT_PRIMITIVE, -1)
        met = (found[HIT_GEOMETRY - HIT_PRIMITIVE, :count] != NONE).nonzero()[0]
        instance = found[HIT_INSTANCE - HIT_PRIMITIVE].take(met).astype(np.int64)
        return instance, found[0].take(met).astype(np.int64), met

    def rows_of_array(self, rays: np.ndarray) -> np.ndarray:
        """(M,) which of an array of instances (``EmbreeBuild.array``) rays (M,) met."""
        return self._found[:, HIT_OF_ARRAY - HIT_PRIMITIVE].ravel().take(rays).astype(np.int64)


def _aligned(shape: tuple[int, ...], dtype: type) -> np.ndarray:
    """An array that starts at a multiple of 64 bytes."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    room = np.empty(size + 64, dtype=np.uint8)
    start = -room.ctypes.data % 64
    return room[start : start + size].view(dtype).reshape(shape)


_EVERY_LANE = _aligned((LONE,), np.int32)
_EVERY_LANE[:] = -1
_SENT = _EVERY_LANE.ctypes.data


# The fast engine: Blender's own Embree, instanced, on all cores.
#
# Every unique mesh is an Embree scene of triangles in local space; above them is one of instances, about
# the centre of them all, where float32 holds them best. Rays enter its box in float64 and go in packets
# (``RayPackets``). Python's lock is free meanwhile, so that threads work side by side.


FEW = 64  # rays, of which it is not asked whether they go side by side
KEPT = 1024  # rays, up to which their packets are kept from call to call


class EmbreeCaster(Search):
    """Closest hits and occlusion through Embree (see ``sensing.rays.RayCaster``).

    No ray slips through an edge. Of a million aimed exactly at vertices a few may: the signs of all
    edges that meet there can be rounded alike.
    """

    engine = "embree"

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
        self._low, self._high = (
            low[known].min(0, initial=np.inf),
            high[known].max(0, initial=-np.inf),
        )
        self._centre = (self._low + self._high) / 2 if len(known) else np.zeros(3)
        size = float((self._high - self._low).max()) if len(known) else 0.0
        self._slack = 1e-6 * size + 1e-6

        self._box_low, self._box_high = self._low - self._slack, self._high + self._slack
        self._middle = self._centre[:, None]
        self._kept = threading.local()

        self._library = load()
        if like is None:
            self._device = self._library.rtcNewDevice(f"threads={threads}".encode())
        else:
            self._device = like._device
        self._build = build = EmbreeBuild(self._library, self._device, like and like._build)
        made: dict[int, tuple[np.ndarray | None, int]] = {}
        if like is not None:
            there = {m: k for m, k in self._same.items() if k in like._usable}
            made = {m: (like._usable[k], like._of_mesh[k]) for m, k in there.items()}
        for m in distinct(scene.mesh_index[known]).tolist():
            if m not in made:
                rows = _not_all(scene.meshes[m])
                made[m] = rows, build.mesh(scene.meshes[m], rows, scene.table.short(m))
        self._usable = usable = {m: rows for m, (rows, _) in made.items()}
        self._of_mesh = of_mesh = {m: tree for m, (_, tree) in made.items()}
        self._whole = all(rows is None for rows in usable.values())
        if not self._whole:
            given = {
                m: np.arange(len(scene.meshes[m].triangles)) if rows is None else rows
                for m, rows in usable.items()
            }
            size = np.array([len(given.get(m, ())) for m in range(len(scene.meshes))])
            self._first_number = np.cumsum(size) - size
            self._numbers = np.concatenate(list(given.values()))  # of all that Embree was given
        place = scene.transform.copy()
        place[:, :, 3] -= self._centre
        self._top = build.instances(
            known.tolist(),
            [of_mesh[m] for m in scene.mesh_index[known]],
            place[known].astype(np.float32),
        )

    def _nearest(
        self, origins: np.ndarray, directions: np.ndarray, start: np.ndarray, limit: np.ndarray
    ) -> Hits:
        begin, leaves = clip(self._box_low, self._box_high, origins, directions, start, limit)
        rays = (begin <= leaves).nonzero()[0]
        count = len(rays)
        if count < len(start):
            begin, limit = begin[rays], limit[rays]
            origins, directions = origins.take(rays, 1), directions.take(rays, 1)
        if not count:
            return Hits.misses(len(start))
        moved = begin * directions
        moved += origins
        moved -= self._middle
        limit = limit - begin
        limit *= 1 + 1e-6
        limit += self._slack
        packets = self._packets_of(count, lanes_for(moved, directions) if count > FEW else LONE)
        packets.fill(moved, directions, limit)
        packets.trace(self._library, self._top)
        instance, triangle, met = packets.read(count)
        if not self._whole:
            triangle = self._numbered(instance, triangle)
        if len(met) < count:
            origins, directions = origins.take(met, 1), directions.take(met, 1)
        distance = self._surfaces.distance(origins, directions, instance, triangle)
        if len(met) == len(start):
            return Hits(distance, instance, triangle)
        hits = Hits.misses(len(start))
        hits.put(rays[met], Hits(distance, instance, triangle))
        return hits

    def _packets_of(self, count: int, lanes: int) -> RayPackets:
        """Room for so many rays: of few, or of a whole task, what this thread has kept."""
        if KEPT < count != TASK:
            return RayPackets(count, lanes)
        size = -(-count // lanes), lanes
        kept: dict[tuple[int, int], RayPackets] = self._kept.__dict__.setdefault("packets", {})
        if size not in kept:
            kept[size] = RayPackets(count, lanes)
        return kept[size]

    def _numbered(self, instance: np.ndarray, primitive: np.ndarray) -> np.ndarray:
        """Triangles of the meshes, from those that Embree was given."""
        mesh_of = self.scene.mesh_index[instance]
        found: np.ndarray = self._numbers.take(self._first_number.take(mesh_of) + primitive)
        return found


def _not_all(mesh: TriMesh) -> np.ndarray | None:
    """Return which triangles of a mesh a ray can hit; None: all."""
    rows = whole_triangles(mesh)
    return None if len(rows) == len(mesh.triangles) else rows


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

    def mesh(self, mesh: TriMesh, rows: np.ndarray | None, points: np.ndarray | None = None) -> int:
        """A scene of triangles of a mesh, in its local space.

        rows : their numbers; None: all.
        points : its vertices in float32, where they are kept already, with one row more behind them.
        """
        whole = rows is None or len(rows) == len(mesh.triangles)
        triangles = mesh.triangles if whole else mesh.triangles[rows]
        if points is None or not np.isfinite(points.sum()):
            return self.shape(mesh.vertices[None], triangles)
        return self._of_triangles(points, 1, triangles)

    def shape(self, vertices: np.ndarray, triangles: np.ndarray) -> int:
        """A scene of triangles (T, 3) in their local space.

        vertices : (S, V, 3) at even steps of a ray's time from 0 to 1, between which they go straight.
        """
        kept = np.zeros((vertices.shape[0] * vertices.shape[1] + 1, 3), dtype=np.float32)
        kept[:-1] = np.nan_to_num(vertices.reshape(-1, 3), nan=0.0, posinf=0.0, neginf=0.0)
        return self._of_triangles(kept[:-1], len(vertices), triangles)

    def _of_triangles(self, kept: np.ndarray, steps: int, triangles: np.ndarray) -> int:
        """A scene of triangles, whose arrays Embree reads where they are: vertices 16 bytes at a time."""
        count = len(kept) // steps
        triangles = np.ascontiguousarray(triangles, dtype=np.int32).view(np.uint32)
        self._arrays += [kept, triangles]
        geometry = self._library.rtcNewGeometry(self._device, TRIANGLE)
        if steps > 1:
            self._library.rtcSetGeometryTimeStepCount(geometry, steps)
        given = self._library.rtcSetSharedGeometryBuffer
        first, size = kept.ctypes.data, kept.strides[0] * count
        for step in range(steps):
            place = first + step * size
            given(geometry, VERTEX_BUFFER, step, FLOAT3, place, 0, 12, count)
        place = triangles.ctypes.data
        given(geometry, INDEX_BUFFER, 0, UINT3, place, 0, 12, len(triangles))
        scene = self._scene()
        self._attach(scene, geometry, 0)
        return self._commit(scene)

    def turning(self, numbers: list[int], scenes: list[int], places: list[np.ndarray]) -> int:
        """A scene of instances that turn; a hit names the instance by its number.

        places : of each (S, 16) float32, Embree's ``RTCQuaternionDecomposition``, at even steps of a ray's
        time from 0 to 1, between which turns go at an even rate and all else linearly.
        """
        top = self._scene()
        for number, scene, place in zip(numbers, scenes, places, strict=True):
            geometry = self._library.rtcNewGeometry(self._device, INSTANCE)
            self._library.rtcSetGeometryInstancedScene(geometry, scene)
            if len(place) > 1:
                self._library.rtcSetGeometryTimeStepCount(geometry, len(place))
            rows = range(place.ctypes.data, place.ctypes.data + place.nbytes, place.strides[0])
            turn = self._library.rtcSetGeometryTransformQuaternion
            deque(map(turn, repeat(geometry), range(len(place)), rows), maxlen=0)
            self._attach(top, geometry, number)
        return self._commit(top)

    def instances(self, numbers: list[int], scenes: list[int], place: np.ndarray) -> int:
        """A scene of instances; a hit names the instance by its number.

        place : (I, 3, 4) float32.
        """
        top = self._scene()
        turn, form = self._library.rtcSetGeometryTransform, FLOAT3X4_ROWS
        for number, scene, row in zip(numbers, scenes, place, strict=True):
            geometry = self._library.rtcNewGeometry(self._device, INSTANCE)
            self._library.rtcSetGeometryInstancedScene(geometry, scene)
            turn(geometry, 0, form, row.ctypes.data)
            self._attach(top, geometry, number)
        return self._commit(top)

    def array(self, scenes: list[int], which: np.ndarray, place: np.ndarray, number: int) -> int:
        """A scene of one geometry of many instances; a hit names it by the number, the instance by its row.

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
        self._attach(top, geometry, number)
        return self._commit(top)

    def _scene(self) -> int:
        scene: int = self._library.rtcNewScene(self._device)
        self._scenes.append(scene)
        self._library.rtcSetSceneFlags(scene, ROBUST)
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
