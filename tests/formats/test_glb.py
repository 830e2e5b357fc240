"""Instances in .glb files, read back by a reader of this test's own, after the glTF 2.0 specification."""

import json
import struct

import numpy as np
import pytest

from forest_addon.formats.glb import EXTENSION, Copies, instance_nodes, read_glb, write_glb

WIDTH = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
TO_Y_UP = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], float)  # glTF's x, y, z from ours


def small_glb(path):
    """Two nodes that share a mesh of one triangle, one of them with a place of its own."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    document = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": 36}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [
            {"name": "a", "mesh": 0, "translation": [1, 2, 3], "rotation": [0, 1, 0, 0]},
            {"name": "b", "mesh": 0},
            {"name": "empty"},
        ],
        "scenes": [{"nodes": [0, 1, 2]}],
    }
    write_glb(path, document, bytearray(corners))
    return document


def strictly(path):
    """The document and the binary chunk of a .glb; every rule of its container is checked."""
    raw = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", raw)
    assert (magic, version, length) == (b"glTF", 2, len(raw))
    size, kind = struct.unpack_from("<I4s", raw, 12)
    assert kind == b"JSON"
    assert size % 4 == 0
    document = json.loads(raw[20 : 20 + size])
    rest = raw[20 + size :]
    size, kind = struct.unpack_from("<I4s", rest)
    assert kind == b"BIN\0"
    assert size % 4 == 0
    assert size == len(rest) - 8 == document["buffers"][0]["byteLength"]
    return document, rest[8:]


def column(document, binary, index):
    accessor = document["accessors"][index]
    view = document["bufferViews"][accessor["bufferView"]]
    assert accessor["componentType"] == 5126
    assert view["byteOffset"] % 4 == 0
    width = WIDTH[accessor["type"]]
    assert view["byteLength"] == 4 * width * accessor["count"]
    values = np.frombuffer(binary, "<f4", accessor["count"] * width, view["byteOffset"])
    return values.reshape(-1, width).astype(float)


def turn_of(quaternion):
    """(N, 3, 3) from x, y, z, w by the textbook formula."""
    x, y, z, w = quaternion.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def transforms(count, negative=False):
    """Random turns, by QR, with a size of its own for each axis, and places."""
    rng = np.random.default_rng(3)
    turn = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))[:, None, None]
    size = rng.uniform(0.3, 3, (count, 1, 3)) * (-1 if negative else 1)
    return np.concatenate([turn * size, rng.uniform(-50, 50, (count, 3, 1))], axis=2)


@pytest.mark.parametrize("negative", [False, True])
def test_copies_come_back_where_they_were(tmp_path, negative):
    small_glb(tmp_path / "x.glb")
    placed = transforms(500, negative)
    tree = np.random.default_rng(1).permutation(500)
    instance_nodes(tmp_path / "x.glb", {"a": Copies("oak", placed, {"_TREE": tree})})
    document, binary = strictly(tmp_path / "x.glb")
    (node,) = (n for n in document["nodes"] if n.get("name") == "oak")
    assert not node.keys() & {"translation", "rotation", "scale", "matrix"}
    assert EXTENSION in document["extensionsUsed"]
    assert EXTENSION in document["extensionsRequired"]
    indices = node["extensions"][EXTENSION]["attributes"]
    assert indices.keys() == {"TRANSLATION", "ROTATION", "SCALE", "_TREE"}
    place, turn, size, number = (
        column(document, binary, indices[name])
        for name in ("TRANSLATION", "ROTATION", "SCALE", "_TREE")
    )
    assert (number[:, 0] == tree).all()
    assert np.abs(np.linalg.norm(turn, axis=1) - 1).max() < 1e-6
    linear = turn_of(turn) * size[:, None, :]
    back = TO_Y_UP.T @ linear @ TO_Y_UP
    assert np.abs(back - placed[:, :, :3]).max() < 1e-5
    assert np.abs(place @ TO_Y_UP - placed[:, :, 3]).max() < 1e-5


def test_what_was_in_the_file_stays(tmp_path):
    before = small_glb(tmp_path / "x.glb")
    instance_nodes(tmp_path / "x.glb", {"b": Copies("oak", transforms(3))})
    document, binary = strictly(tmp_path / "x.glb")
    assert document["nodes"][0] == before["nodes"][0]
    assert document["meshes"] == before["meshes"]
    assert (column(document, binary, 0) == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]).all()


def test_a_copy_costs_fifty_bytes(tmp_path):
    small_glb(tmp_path / "x.glb")
    before = (tmp_path / "x.glb").stat().st_size
    many = {"_TREE": np.arange(10_000), "_SPECIES": np.zeros(10_000, int)}
    instance_nodes(tmp_path / "x.glb", {"a": Copies("oak", transforms(10_000), many)})
    assert (tmp_path / "x.glb").stat().st_size - before < 50 * 10_000


def test_no_copies_leave_the_document_as_it_is(tmp_path):
    before = small_glb(tmp_path / "x.glb")
    instance_nodes(tmp_path / "x.glb", {})
    assert strictly(tmp_path / "x.glb")[0] == before


@pytest.mark.parametrize("name", ["nobody", "empty"])
def test_a_node_without_a_mesh_is_refused(tmp_path, name):
    small_glb(tmp_path / "x.glb")
    with pytest.raises(ValueError, match=f"'{name}' with a mesh"):
        instance_nodes(tmp_path / "x.glb", {name: Copies("oak", transforms(1))})


def test_a_number_that_float32_does_not_hold_is_refused(tmp_path):
    small_glb(tmp_path / "x.glb")
    large = Copies("oak", transforms(1), {"_TREE": np.array([2**24 + 1])})
    with pytest.raises(ValueError, match="_TREE has numbers above"):
        instance_nodes(tmp_path / "x.glb", {"a": large})


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"glTF",
        struct.pack("<4sII", b"glTF", 1, 20) + bytes(8),
        struct.pack("<4sII", b"glTF", 2, 20) + struct.pack("<II", 0, 7),
        b"\x89PNG" + bytes(40),
    ],
)
def test_what_is_no_glb_is_refused(tmp_path, raw):
    (tmp_path / "x.glb").write_bytes(raw)
    with pytest.raises(ValueError, match=r"x\.glb"):
        read_glb(tmp_path / "x.glb")
