"""Echoes and impulse responses as bytes, which a Blender file keeps with the results that they are.

The bytes are an NPZ: arrays, and how settings and records are made of them as JSON. Clouds need none: the
mesh that shows one holds all of it (``show.cloud``).
"""

from __future__ import annotations

import dataclasses
import io
import json
from typing import Any

import numpy as np

from ...results.coordinates import Offset
from ...results.kind import Finding
from ...spec import Sensor
from ...spec.base import Settings

MOST = 2**30  # bytes of a result; Blender's files hold no text of twice as many
TREE = "tree"  # name of the JSON among the arrays
# What no file that is exported needs: working tables of a ping, and what follows from its responses.
LEFT_OUT = {"groups", "list_heard", "envelopes", "called"}

Kept = tuple[Sensor, Finding, Offset]


def pack(sensor: Sensor, found: Finding, offset: Offset) -> bytes:
    """Return a sensor's settings, what it found and the scene's offset; no bytes of more than ``MOST``."""
    arrays: list[np.ndarray] = []
    tree = json.dumps([_packed(value, arrays) for value in (sensor, found, offset)])
    if sum(array.nbytes for array in arrays) > MOST:
        return b""
    file = io.BytesIO()
    np.savez(file, **{TREE: np.array(tree)}, **{f"{n}": array for n, array in enumerate(arrays)})
    return file.getvalue()


def unpack(data: bytes) -> Kept:
    """Return what was packed: settings, finding, offset; of an echo without what is ``LEFT_OUT``."""
    with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
        sensor, found, offset = (
            _unpacked(value, arrays, _records()) for value in json.loads(str(arrays[TREE]))
        )
    return sensor, found, offset


def _records() -> dict[str, type]:
    """Records that a result is made of, by name: no other is ever made of a file's bytes."""
    from ...sensing.reverb.forest.clutter import Clutter
    from ...sensing.reverb.forest.losses import TrunkStand
    from ...sensing.reverb.model_error import ModelError
    from ...sensing.reverb.pair import ImpulseResponse
    from ...sensing.sonar.flight import PingSeries
    from ...sensing.sonar.ping import Echo
    from ...sensing.sonar.poses import SonarPose

    found = [Echo, PingSeries, SonarPose, ImpulseResponse, ModelError, TrunkStand, Clutter]
    groups: list[type] = [Settings]
    for group in groups:  # it grows
        groups.extend(group.__subclasses__())
    return {kind.__name__: kind for kind in [*groups, *found]}


def _packed(value: Any, arrays: list[np.ndarray]) -> Any:
    """A value as JSON; a list says first what it stands for."""
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return ["array", len(arrays) - 1]
    if isinstance(value, Offset):
        return ["offset", list(value), value.crs]
    if isinstance(value, dict):
        return ["dict", [[_packed(part, arrays) for part in pair] for pair in value.items()]]
    if isinstance(value, tuple | list):
        return [type(value).__name__, [_packed(part, arrays) for part in value]]
    if dataclasses.is_dataclass(value):
        names = [f.name for f in dataclasses.fields(value) if f.init and f.name not in LEFT_OUT]
        said = {name: _packed(getattr(value, name), arrays) for name in names}
        return ["record", type(value).__name__, said]
    return value.item() if isinstance(value, np.generic) else value


def _unpacked(value: Any, arrays: Any, records: dict[str, type]) -> Any:
    """The value that was packed."""
    if not isinstance(value, list):
        return value
    kind, *rest = value
    if kind == "array":
        return arrays[f"{rest[0]}"]
    if kind == "offset":
        return Offset(*rest)
    if kind == "record":
        name, said = rest
        left = {f.name for f in dataclasses.fields(records[name])} & LEFT_OUT
        given = {key: _unpacked(part, arrays, records) for key, part in said.items()}
        return records[name](**given, **dict.fromkeys(left))
    parts = [_unpacked(part, arrays, records) for part in rest[0]]
    return dict(parts) if kind == "dict" else tuple(parts) if kind == "tuple" else parts
