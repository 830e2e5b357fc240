"""Many copies of a mesh in one node of a binary glTF file: the extension EXT_mesh_gpu_instancing.

A .glb is a header, a chunk of JSON and a chunk of binary data. A node with a mesh is given translations,
rotations and scales of its copies, and their numbers as attributes that begin with an underscore; a copy
then costs some fifty bytes, where a node of its own costs hundreds. Khronos glTF 2.0, sections 3.7 and
4.4; extensions/2.0/Vendor/EXT_mesh_gpu_instancing.
"""

from __future__ import annotations

import base64
import json
import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from .foreign import guarded, name_in, refuse_coarse

EXTENSION = "EXT_mesh_gpu_instancing"
MAGIC, JSON, BINARY = 0x46546C67, 0x4E4F534A, 0x004E4942
FLOAT = 5126  # unsigned integers are not allowed in attributes that begin with an underscore
LARGEST_NUMBER = 2**24  # that float32 holds exactly


@dataclass(frozen=True)
class Copies:
    """N copies of the mesh of a node.

    name : what the node is called from now on. transform : (N, 3, 4) to the world, Z up; neither flat
    nor sheared. numbers : (N,) integers by the name of their attribute, which begins with an underscore.
    """

    name: str
    transform: np.ndarray
    numbers: Mapping[str, np.ndarray] = field(default_factory=dict)


def instance_nodes(path: str | os.PathLike[str], copies: Mapping[str, Copies]) -> None:
    """Turn nodes of a .glb file, by name, into copies of their meshes; the nodes lose their own place.

    Raises
    ------
    ValueError : it is no .glb file of version 2, a node is missing or has no mesh, or a number is too
    large for the file.
    """
    document, binary = read_glb(path)
    nodes = {node.get("name"): node for node in document.get("nodes", ())}
    for name, group in copies.items():
        node = nodes.get(name)
        if node is None or "mesh" not in node:
            raise ValueError(f"{Path(path).name} has no node {name!r} with a mesh")
        for place in ("matrix", "translation", "rotation", "scale"):
            node.pop(place, None)
        node["name"] = group.name
        attributes = {
            key: _append(document, binary, values) for key, values in _columns(group).items()
        }
        node.setdefault("extensions", {})[EXTENSION] = {"attributes": attributes}
    if copies:
        for key in ("extensionsUsed", "extensionsRequired"):  # not known: trees in a heap at 0, 0
            document[key] = sorted({*document.get(key, ()), EXTENSION})
    write_glb(path, document, binary)


@guarded("a binary glTF file")
def read_glb(path: Path) -> tuple[dict[str, Any], bytearray]:
    """The JSON and the binary chunk of a .glb file.

    Raises
    ------
    SpecError : it is none, or not of version 2.
    """
    raw = path.read_bytes()
    if len(raw) < 20 or struct.unpack_from("<II", raw) != (MAGIC, 2):
        raise ValueError(f"{path.name} is no binary glTF file of version 2")
    chunks: dict[int, bytes] = {}
    start = 12
    while start + 8 <= len(raw):
        length, kind = struct.unpack_from("<II", raw, start)
        chunks.setdefault(kind, raw[start + 8 : start + 8 + length])
        start += 8 + length
    if JSON not in chunks:
        raise ValueError(f"{path.name} has no JSON chunk")
    document = json.loads(chunks[JSON])
    if not isinstance(document, dict):
        raise ValueError(f"{path.name} has no table in its JSON chunk")
    return document, bytearray(chunks.get(BINARY, b""))


def refuse_broken_gltf(path: Path) -> None:
    """Refuse a glTF with corners that are no finite numbers, or whose shape is lost at map coordinates; those
    that an extension has packed are left to who unpacks them.

    Raises
    ------
    SpecError : says what, and what to do.
    """
    document, binary = (
        read_glb(path)
        if path.suffix.lower() == ".glb"
        else (json.loads(path.read_bytes()), bytearray())
    )
    parts = [
        part["attributes"] for mesh in document.get("meshes", []) for part in mesh["primitives"]
    ]
    for number in {part["POSITION"] for part in parts if "POSITION" in part}:
        accessor = document["accessors"][number]
        view = document["bufferViews"][accessor["bufferView"]] if "bufferView" in accessor else {}
        if not view or "extensions" in view or accessor["componentType"] != FLOAT:
            continue
        uri = document["buffers"][view["buffer"]].get("uri", "")
        stored: bytes | bytearray = binary
        if uri.startswith("data:"):
            stored = base64.b64decode(uri.partition(",")[2])
        elif uri:
            stored = (path.parent / name_in(uri)).read_bytes()
        begin = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        form = (accessor["count"], 3), "<f4", stored, begin, (view.get("byteStride", 12), 4)
        refuse_coarse(path, np.ndarray(*form))


def write_glb(path: str | os.PathLike[str], document: dict[str, Any], binary: bytearray) -> None:
    """Write a .glb file; the document's first buffer is ``binary``."""
    _pad(binary)
    if binary:
        document.setdefault("buffers", [{}])[0]["byteLength"] = len(binary)
    text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 4)
    chunks: list[tuple[int, bytes | bytearray]] = [(JSON, text)]
    if binary:
        chunks.append((BINARY, binary))
    total = 12 + sum(8 + len(chunk) for _, chunk in chunks)
    with open(path, "wb") as file:
        file.write(struct.pack("<III", MAGIC, 2, total))
        for kind, chunk in chunks:
            file.write(struct.pack("<II", len(chunk), kind))
            file.write(chunk)


def _columns(group: Copies) -> dict[str, np.ndarray]:
    """Attributes of copies in glTF's axes: its Y is our Z, its Z our -Y."""
    linear = group.transform[:, :, :3]
    size = np.linalg.norm(linear, axis=1)  # of each axis
    size = size * np.where(np.linalg.det(linear) < 0, -1.0, 1.0)[:, None]
    turn = scipy.spatial.transform.Rotation.from_matrix(
        linear / size[:, None, :]
    ).as_quat()  # x, y, z, w
    columns = {
        "TRANSLATION": group.transform[:, :, 3][:, [0, 2, 1]] * [1, 1, -1],
        "ROTATION": turn[:, [0, 2, 1, 3]] * [1, 1, -1, 1],
        "SCALE": size[:, [0, 2, 1]],
    }
    for name, numbers in group.numbers.items():
        if np.abs(numbers).max(initial=0) > LARGEST_NUMBER:
            raise ValueError(f"{group.name}: {name} has numbers above {LARGEST_NUMBER:,}")
        columns[name] = np.asarray(numbers)[:, None]
    return columns


def _append(document: dict[str, Any], binary: bytearray, values: np.ndarray) -> int:
    """Append rows of numbers to the binary chunk; returns the index of their accessor."""
    raw = np.ascontiguousarray(values, dtype="<f4").tobytes()
    _pad(binary)
    views = document.setdefault("bufferViews", [])
    accessors = document.setdefault("accessors", [])
    views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(raw)})
    binary += raw
    accessors.append(
        {
            "bufferView": len(views) - 1,
            "componentType": FLOAT,
            "count": len(values),
            "type": {1: "SCALAR", 3: "VEC3", 4: "VEC4"}[values.shape[1]],
        }
    )
    return len(accessors) - 1


def _pad(binary: bytearray) -> None:
    binary.extend(b"\0" * (-len(binary) % 4))
