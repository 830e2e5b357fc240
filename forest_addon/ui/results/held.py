"""Results of this session, held for export and play until another file is loaded.

Only what Blender shows is saved with a file; this is the finding itself, with all its labels.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import bpy

if TYPE_CHECKING:
    from ...base.labels import Labels
    from ...results.kind import Finding
    from ...spec import Sensor

    Held = tuple[Sensor, Finding, tuple[float, float, float]]

MOST = 20_000_000  # points of a cloud; of larger ones only what is shown is kept

_held: dict[tuple[int, str], Held] = {}  # sensor, finding, offset; by scene and name
_labels: dict[tuple[int, str], dict[str, Labels]] = {}  # of points, by what labels them


def hold(
    scene: bpy.types.Scene, name: str, held: Held, labels: dict[str, Labels] | None = None
) -> None:
    """Hold a finding in place of the one of before, unless it is too large.

    labels : of its points, by what labels them: OBJECT, SPECIES, MATERIAL.
    """
    key = scene.session_uid, name
    _held.pop(key, None)
    _labels.pop(key, None)
    size = len(held[1]) if hasattr(held[1], "__len__") else 0
    if size <= MOST:
        _held[key] = held
        _labels[key] = labels or {}


def find(scene: bpy.types.Scene, name: str) -> Held | None:
    """Return what a sensor found in this session, None where that is not held."""
    return _held.get((scene.session_uid, name))


def rename(scene: bpy.types.Scene, old: str, new: str) -> None:
    """Hold under another name what is held under one."""
    for kept in (_held, _labels):
        if (scene.session_uid, old) in kept:
            kept[scene.session_uid, new] = kept.pop((scene.session_uid, old))  # type: ignore[attr-defined]


def labels_of(scene: bpy.types.Scene, name: str) -> dict[str, Labels]:
    """The labels of a result's points that are held with it."""
    return _labels.get((scene.session_uid, name), {})


def let_go(*_: object) -> None:
    """Hold nothing any longer."""
    _held.clear()
    _labels.clear()
