"""Arguments that a script hands over, checked at the door: one sentence in place of what breaks further
in."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ..spec import Scene, Settings, SpecError

LONGEST = 200  # bytes of a file's name, so that a temporary one beside it fits


def scene_of(key: str, scene: Any) -> Scene:
    """A scene's settings.

    Raises
    ------
    SpecError : it is something else; says what reads a file.
    """
    if isinstance(scene, Scene):
        return scene
    hint = "; read a scene file by read()" if isinstance(scene, (str, os.PathLike)) else ""
    raise SpecError(key, f"takes a Scene, not {called(scene)}{hint}")


def path_of(key: str, path: Any) -> Path:
    """A path.

    Raises
    ------
    SpecError : it is none.
    """
    if not isinstance(path, (str, os.PathLike)) or "\0" in os.fspath(path):
        raise SpecError(key, f"takes the path of a file or folder, not {called(path)}")
    return Path(path)


def file_to_write(path: Any) -> Path:
    """A path that a file can be written to.

    Raises
    ------
    SpecError : its folder is not there, it is a folder itself, or its name is too long.
    """
    path = path_of("save", path)
    if len(os.fsencode(path.name)) > LONGEST:
        raise SpecError(f"{path.name[:40]}…", f"is a name of more than {LONGEST} bytes; shorten it")
    if not path.parent.is_dir():
        what = "is no folder" if path.parent.exists() else "is not there; make it first"
        raise SpecError(str(path), f"cannot be written: the folder {path.parent} {what}")
    if path.is_dir():
        raise SpecError(str(path), "is a folder; name a file in it")
    return path


def points_of(key: str, points: Any, one: bool = False) -> np.ndarray:
    """Points (N, 3), or one point (3,), metres.

    Raises
    ------
    SpecError : they have another shape, or a coordinate is no finite number.
    """
    shape = "(3,)" if one else "(N, 3)"
    try:
        found = np.asarray(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise SpecError(key, f"takes an array {shape} of metres, not {called(points)}") from None
    fits = found.shape == (3,) if one else found.size > 0 and found.shape[-1:] == (3,)
    if not fits or found.ndim > 2:
        raise SpecError(key, f"takes an array {shape} of metres, not one of shape {found.shape}")
    if not np.isfinite(found).all():
        raise SpecError(key, "has a coordinate that is not finite; correct or remove it")
    return found


def progress_of(progress: Any) -> Any:
    """A function that is told of progress, or None.

    Raises
    ------
    SpecError : it cannot be called.
    """
    if progress is not None and not callable(progress):
        raise SpecError("progress", f"takes a function (done, total), not {called(progress)}")
    return progress


def called(thing: Any) -> str:
    """Return what was handed over instead, in words."""
    shape = getattr(thing, "shape", None)
    name = type(thing).__name__
    article = "an" if name[:1].lower() in "aeiou" else "a"
    if thing is None:
        return "None"
    if isinstance(thing, Settings):
        return f"{article} {name}"
    return f"{article} {name}" + (f" of shape {shape}" if shape is not None else "")


@contextmanager
def enough_memory(key: str, what: str) -> Iterator[None]:
    """Say in one sentence that memory did not suffice.

    Raises
    ------
    SpecError : it did not; ``what`` says what to take less of.
    """
    try:
        yield
    except MemoryError as problem:
        said = f" ({problem})" if str(problem) else ""
        raise SpecError(key, f"needs more memory than there is{said}; {what}") from None


def import_blender() -> Any:
    """``bpy``.

    Raises
    ------
    SpecError : it is not installed; says what to do.
    """
    try:
        import bpy
    except ImportError:
        raise SpecError(
            "bpy",
            "is not installed; pip install bpy (5.2 for Python 3.13, 4.5 for 3.11), or run in Blender",
        ) from None
    return bpy
