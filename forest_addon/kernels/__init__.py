"""Kernels in C, called by ctypes: arrays go in by pointer, and other Python threads run meanwhile.

The library, beside this file or in a wheel of its own, is built from the sources beside this file by
packaging/build_kernels.py and carries their hash. Where there is none, or one of other sources, numpy
computes the same, more slowly: ``library`` is None, and ``engine`` says why. FOREST_SENSING_KERNELS=off in
the environment asks for numpy.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib.util
import os
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

SWITCH = "FOREST_SENSING_KERNELS"
ROOM = Path(__file__).resolve().parent
WHEEL = "forest_sensing_kernels"  # of Blender's extension, whose own files hold nothing compiled
FILE = "_kernels" + {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


class _Arrays:
    """Arguments that are arrays of one type and contiguous; numpy's own check takes five times as long."""

    def __init__(self, kind: type) -> None:
        self._kind = np.dtype(kind)

    def from_param(self, array: np.ndarray) -> Any:
        if array.dtype != self._kind or not array.flags.c_contiguous:
            raise TypeError(f"a contiguous array of {self._kind} is wanted, not of {array.dtype}")
        if array.size and array.flags.writeable:
            return ctypes.byref(ctypes.c_char.from_buffer(array))
        return ctypes.c_void_p(array.ctypes.data)


# Arguments and results of the functions in kernels.h. An array of another type, or one that is not
# contiguous, is refused when a function is called; lengths are the caller's to check.
_text = ctypes.c_char_p
_count, _double = ctypes.c_int64, ctypes.c_double
_int8s, _int64s, _floats, _doubles, _singles, _complexes = (
    _Arrays(kind)
    for kind in (np.int8, np.int64, np.float32, np.float64, np.complex64, np.complex128)
)


class CastScene(ctypes.Structure):
    """``struct cast_scene`` of kernels.h."""

    _point = ctypes.c_double * 3
    _fields_ = (
        ("tree", ctypes.c_void_p),
        ("intersect", ctypes.c_void_p),
        ("intersect8", ctypes.c_void_p),
        ("low", _point),
        ("high", _point),
        ("centre", _point),
        ("slack", ctypes.c_double),
        ("steps", ctypes.c_int64),
        ("pieces", ctypes.c_int64),
        ("piece", ctypes.c_void_p),
        ("transform", ctypes.c_void_p),
        ("triangle", ctypes.c_void_p),
        ("vertex", ctypes.c_void_p),
        ("single", ctypes.c_void_p),
    )


_SCATTERERS = _count, _doubles, _count, _doubles, _doubles
_CUBICS = _double, _double, _count, _complexes, _complexes
FUNCTIONS: dict[str, tuple[list[Any], Any]] = {
    "kernels_sources": ([], _text),
    "cast_rays": (
        [
            *(ctypes.POINTER(CastScene), _count, _doubles, _doubles, _doubles, _doubles, _doubles),
            *(_int64s, _int64s, _doubles, _int64s, _int64s, _doubles),
        ],
        None,
    ),
    "send_rays": ([ctypes.c_void_p, ctypes.c_void_p, _count, _floats, _count], None),
    "weigh_echoes": (
        [_count, _count, _int64s, _count, _doubles, _count, _doubles, _doubles, _complexes],
        None,
    ),
    "paper_discs": ([*_SCATTERERS, _doubles, *_CUBICS], None),
    "piston_discs": ([*_SCATTERERS, _doubles, _int8s, *_CUBICS[2:]], None),
    "exact_discs": (
        [*_SCATTERERS, _doubles, _doubles, _doubles, _count, _count, _singles, _complexes],
        None,
    ),
    "cylinders": ([*_SCATTERERS, _doubles, _int8s, _int8s, _double, _complexes, *_CUBICS], None),
    "incidences": ([_count, *[_doubles] * 4], None),
    "trace_paths": ([_count, _doubles, _count, *[_doubles] * 4], None),
    "open_leaves": (
        [
            *(_count, _int64s, _int64s, _doubles, _doubles, _int64s),
            *(_doubles, _doubles, _doubles, _int64s),
            *(_count, _doubles, _doubles, _doubles, _doubles),
            *(_count, _count, _doubles, _count, _complexes, _count, _count, _count, _floats),
            *(_count, _int64s, _int64s, _doubles, _int64s, _doubles, _doubles, _doubles, _int64s),
            *(_doubles, _doubles, _doubles),
        ],
        None,
    ),
    "lay_echoes": (
        [
            *(_count, _doubles, _doubles, _count, _complexes, _count, _count, _count, _doubles),
            *(_count, _count, _doubles, _count, _complexes, _doubles),
        ],
        None,
    ),
    "spread_rays": ([_count, *[_doubles] * 6, _count, *[_doubles] * 3], None),
    "light_back": (
        [
            *(_count, _int64s, _count, _doubles, _doubles, _doubles, _doubles, _doubles),
            *(_doubles, _double, _double, _doubles),
        ],
        None,
    ),
    "blur_patches": (
        [
            *(_count, _int64s, _int64s, _count, _int8s, _doubles, _doubles),
            *(_doubles, _doubles, _doubles, _double, _int64s, _doubles, _doubles, _doubles),
        ],
        None,
    ),
    "find_echoes": (
        [
            *(_count, _int64s, _int64s, _count, _doubles, _doubles, _doubles, _double),
            *(_count, _count, _doubles, _double, _int64s, _doubles),
            *(_int64s, _doubles, _doubles, _doubles, _int64s),
        ],
        _count,
    ),
}


def library() -> ctypes.CDLL | None:
    """Return the library, its functions with the types of their arguments; None where numpy computes."""
    return None if _switched_off() else _opened()[0]


def engine() -> str:
    """Name of what computes, for records and panels: "C", or "numpy" and why."""
    return f"numpy ({SWITCH}=off)" if _switched_off() else _opened()[1]


def _switched_off() -> bool:
    return os.environ.get(SWITCH) == "off"


@cache
def _opened() -> tuple[ctypes.CDLL | None, str]:
    """Return the library and "C", or None and "numpy" with the reason."""
    wheel = importlib.util.find_spec(WHEEL)
    folders = [ROOM, *map(Path, wheel.submodule_search_locations or () if wheel else ())]
    found = next((folder / FILE for folder in folders if (folder / FILE).exists()), None)
    if found is None:
        return None, "numpy (no library is built)"
    sources = b"".join(file.read_bytes() for file in sorted(ROOM.glob("*.[ch]")))
    try:
        opened = ctypes.CDLL(str(found))
        opened.kernels_sources.restype = _text
        if opened.kernels_sources().decode() != hashlib.sha256(sources).hexdigest():
            return None, "numpy (the library is of other sources)"
    except (OSError, AttributeError) as problem:
        return None, f"numpy (the library does not load: {problem})"
    for name, (arguments, result) in FUNCTIONS.items():
        function = getattr(opened, name)
        function.argtypes, function.restype = arguments, result
    return opened, "C"
