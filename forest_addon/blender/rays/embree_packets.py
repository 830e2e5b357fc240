"""Packets of rays as Embree wants them: which rays go together, how many, and by which of its ways.

Rays side by side, as those of a beam, go by eight as a coherent packet: Embree passes its tree once for the
pyramid around them, twice as fast as ray by ray. Others go by sixteen, which Embree takes one by one; so do
those of an aircraft's beams, which are farther apart than leaves are wide where they enter the scene and
would be a tenth slower together.
"""

from __future__ import annotations

import ctypes
from collections import deque
from collections.abc import Iterable
from itertools import repeat

import numpy as np

LONE, ALIKE = 16, 8  # rays of a packet
TURN = 0.03  # by how much unit directions of a packet side by side differ at most
ASIDE = 0.05  # metres between the places where they enter the scene, at most: about a leaf
LOOKED_AT = 16  # of so many packets one
MOST_APART = 0.1  # share of the packets that may be wider
# Rows of RTCRayHit8 and 16; between them normal 12-14, u 15, v 16, and 20 the place in an array of instances.
TNEAR, DIRECTION, TIME, TFAR, MASK, ID, FLAGS = 3, 4, 7, 8, 9, 10, 11
PRIMITIVE, GEOMETRY, INSTANCE, OF_ARRAY, ROWS = 17, 18, 19, 20, 21
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
        self._found = self._whole[:, PRIMITIVE:ROWS]
        first, step = self.packets.ctypes.data, self.packets.strides[0]
        self.addresses = range(first, first + step * size, step)

    def fill(
        self,
        origins: np.ndarray,
        directions: np.ndarray,
        reach: np.ndarray,
        time: np.ndarray | None = None,
    ) -> None:
        """Rays (3, R), (3, R), (R,), and their times (R,) from 0 to 1 where their scene moves."""
        count = len(reach)
        if time is not None:
            every = np.zeros(self._lanes.shape[1], dtype=np.float32)
            every[:count] = time
            self.packets[:, TIME] = every.reshape(-1, self.lanes)
        self._lanes[:3, :count] = origins
        self._lanes[3:6, :count] = directions
        np.minimum(reach, FAR, out=reach)
        self._lanes[6, :count] = reach
        self._lanes[6, count:] = -1.0  # ends before it starts: idle
        self.packets[:, :3] = self._by_packet[:, :3]
        self.packets[:, DIRECTION : DIRECTION + 3] = self._by_packet[:, 3:6]
        self.packets[:, TFAR] = self._by_packet[:, 6]
        self._found[:] = NONE

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

    def read(self, count: int, row: int = INSTANCE) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Instance and triangle (M,) of the rays that met something, and which rays (M,) these are.

        row : of packets, that tells the instance: of ``EmbreeBuild.array`` it is ``OF_ARRAY``.
        """
        found = self._found.swapaxes(0, 1).reshape(ROWS - PRIMITIVE, -1)
        met = (found[GEOMETRY - PRIMITIVE, :count] != NONE).nonzero()[0]
        instance = found[row - PRIMITIVE].take(met).astype(np.int64)
        return instance, found[0].take(met).astype(np.int64), met


def _aligned(shape: tuple[int, ...], dtype: type) -> np.ndarray:
    """An array that starts at a multiple of 64 bytes."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    room = np.empty(size + 64, dtype=np.uint8)
    start = -room.ctypes.data % 64
    return room[start : start + size].view(dtype).reshape(shape)


_EVERY_LANE = _aligned((LONE,), np.int32)
_EVERY_LANE[:] = -1
_SENT = _EVERY_LANE.ctypes.data
