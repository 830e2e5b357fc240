"""Meshes by other hands: Wavefront files as they are met, and shapes that single precision has lost."""

import struct

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.formats.helios.parts import read_materials, read_obj
from forest_addon.formats.ply import read_surface
from forest_addon.formats.stl import StlError, read_stl, write_stl
from forest_addon.spec import SpecError

FAR = np.array([432_100, 5_612_300, 120.0])
TREE = stream(2, "far").random((150, 3)) * [4, 4, 12]
PIXELS = np.stack([*np.mgrid[:20, :20] / 2, stream(3, "far").random((20, 20))], 2).reshape(-1, 3)


def test_a_lost_material_file_is_said_and_others_of_its_line_are_read(tmp_path):
    (tmp_path / "a.mtl").write_text("newmtl bark\nhelios_reflectance 0.3\n")
    (tmp_path / "b c.mtl").write_text("newmtl soil\nhelios_isGround true\n")
    (tmp_path / "t.obj").write_text(
        "mtllib a.mtl gone.mtl\nmtllib b c.mtl\nv 0 0 0\nv 1 \\\n 0 0\nv 0 1 0\nusemtl bark\n"
        "f -3 -2 \\\r\n -1\nusemtl \\\nsoil\nf 1 2 3 # \\\n"
    )
    found = read_obj(tmp_path / "t.obj")
    assert found.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert found.triangles.tolist() == [[0, 1, 2]] * 2
    assert found.materials[found.slot[0]].reflectance == 0.3
    assert found.ground.tolist() == [False, True]
    assert len(found.notes) == 1
    assert found.notes[0].startswith("t.obj: its material file gone.mtl is not there")


def test_a_corner_that_is_not_there_is_told_by_its_own_line(tmp_path):
    (tmp_path / "t.obj").write_text("v 0 0 0\nv 1 \\\n0 0\nf -1 -2 \\\n-3\n")
    with pytest.raises(SpecError, match="line 5: a face has a corner that is not there"):
        read_obj(tmp_path / "t.obj")


@pytest.mark.parametrize("said", ["45", "1.01", "-0.1", "inf"])
def test_reflectance_in_percent_is_refused(tmp_path, said):
    (tmp_path / "a.mtl").write_text(f"newmtl bark\nhelios_reflectance {said}\n")
    with pytest.raises(
        SpecError, match=r"is no share from 0 to 1 of the light; write 45 % as 0.45"
    ):
        read_materials(tmp_path / "a.mtl")


def obj(path, places, form):
    lines = ["v " + " ".join(format(x, form) for x in place) for place in places.tolist()]
    lines += [f"f {k + 1} {k + 2} {k + 3}" for k in range(0, len(places) - 2, 3)]
    path.write_text("\n".join(lines))
    return read_obj(path).vertices


def ascii_stl(path, places, form):
    corners = places[: len(places) // 3 * 3].reshape(-1, 3, 3)
    facets = [
        "outer loop\n"
        + "".join(f"vertex {' '.join(format(x, form) for x in one)}\n" for one in facet)
        + "endloop"
        for facet in corners.tolist()
    ]
    path.write_text("solid a\n" + "\n".join(facets) + "\nendsolid a\n")
    return read_stl(path).reshape(-1, 3)


def ply(path, places, kind):
    """Binary, in float or double, or ASCII in a form of numbers."""
    count = len(places) // 3
    binary = kind in ("float", "double")
    head = ["ply", f"format {'binary_little_endian' if binary else 'ascii'} 1.0"]
    head += [f"element vertex {len(places)}"]
    head += [f"property {kind if binary else 'float'} {axis}" for axis in "xyz"]
    head += [f"element face {count}", "property list uchar int vertex_indices", "end_header\n"]
    faces = np.arange(3 * count).reshape(-1, 3).tolist()
    if binary:
        body = places.astype("<f4" if kind == "float" else "<f8").tobytes()
        body += b"".join(struct.pack("<B3i", 3, *face) for face in faces)
    else:
        lines = [" ".join(format(x, kind) for x in place) for place in places.tolist()]
        body = "\n".join([*lines, *("3 {} {} {}".format(*face) for face in faces)]).encode()
    path.write_bytes("\n".join(head).encode() + body)
    return read_surface(path)[0]


def single(places):
    return places.astype(np.float32).astype(np.float64)


DOORS = [
    *((".obj", obj, form) for form in (".6f", ".3f")),
    (".stl", ascii_stl, ".6f"),
    *((".ply", ply, kind) for kind in ("float", "double", ".6f")),
]


@pytest.mark.parametrize(("ending", "write", "form"), DOORS)
def test_a_mesh_at_map_coordinates_in_single_precision_is_refused(tmp_path, ending, write, form):
    with pytest.raises((SpecError, StlError), match=r"^a\.\w+:? lies at map .* steps of 0\.5: its"):
        write(tmp_path / f"a{ending}", single(TREE + FAR), form)
    near = np.array([100, 200, 120])
    found = write(tmp_path / f"b{ending}", single(TREE + near), form)
    assert found == pytest.approx((TREE + near)[: len(found)], abs=1e-3)


@pytest.mark.parametrize(("ending", "write", "form"), [d for d in DOORS if d[2] != "float"])
@pytest.mark.parametrize("shape", [TREE, PIXELS], ids=["tree", "grid"])
def test_a_mesh_at_map_coordinates_with_its_digits_is_read(tmp_path, ending, write, form, shape):
    found = write(tmp_path / f"a{ending}", shape + FAR, form)
    assert found == pytest.approx((shape + FAR)[: len(found)], abs=6e-4)


def test_binary_stl_at_map_coordinates(tmp_path):
    write_stl(tmp_path / "a.stl", (TREE + FAR).reshape(-1, 3, 3))
    with pytest.raises(StlError, match=r"a\.stl lies at map .* its shape is lost; subtract"):
        read_stl(tmp_path / "a.stl")
