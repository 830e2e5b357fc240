"""Blender's own Embree through its C interface: found, loaded and checked.

Every Blender ships ``libembree4`` for Cycles: beside its module or program, in ``lib``, in
``blender.shared``, or as the system's library. Only versions 4.x are used: their functions, constants
and layouts are those below (embree4/rtcore.h).
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import bpy

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
}
SINCE_4_3 = {"rtcSetGeometryInstancedScenes": (None, [_P, _P, _Z])}


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


def has_arrays(library: ctypes.CDLL, device: int) -> bool:
    """Return whether many instances can be one geometry: since 4.3, where it was built so."""
    if not all(hasattr(library, name) for name in SINCE_4_3):
        return False
    geometry = library.rtcNewGeometry(device, INSTANCES)
    library.rtcGetDeviceError(device)  # what it says of that is answered
    if geometry:
        library.rtcReleaseGeometry(geometry)
    return bool(geometry)


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
    newer = {name: made for name, made in SINCE_4_3.items() if hasattr(library, name)}
    for name, (result, arguments) in (SIGNATURES | newer).items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    device = library.rtcNewDevice(b"")
    if not device:
        raise EmbreeError("it gives no device")
    version = library.rtcGetDeviceProperty(device, VERSION_PROPERTY)
    library.rtcReleaseDevice(device)
    if version // 10_000 != 4:
        raise EmbreeError(f"it is version {version // 10_000}, not 4")
