"""STL reading and writing, against bytes laid out here by ``struct`` and by hand."""

from __future__ import annotations

import struct
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from forest_addon.base.rng import stream
from forest_addon.formats.stl import StlError, StlWarning, read_stl, write_stl

ONE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]]
TWO = [[0.5, -1.0, 3.0], [0.25, 8.0, -2.0], [1e-3, 1e5, 7.0]]

ASCII = """solid tree
  facet normal 0 0 1
    outer loop
      vertex 0 0 0
      vertex 1 0 0
      vertex 0 2 0
    endloop
  endfacet
  facet normal 0 0 0
    outer loop
      vertex 0.5 -1 3
      vertex 0.25 8 -2
      vertex 1e-3 1e5 7
    endloop
  endfacet
endsolid tree
"""


def binary(facets: list[list[list[float]]], header: bytes = b"", count: int | None = None) -> bytes:
    """A binary STL by the format's description: little-endian, 80 + 4 bytes, then 50 a facet."""
    data = header.ljust(80, b"\0") + struct.pack("<I", len(facets) if count is None else count)
    for facet in facets:
        data += struct.pack("<3f", 0, 0, 0)
        data += b"".join(struct.pack("<3f", *corner) for corner in facet)
        data += struct.pack("<H", 0)
    return data


def read(folder: Path, data: bytes | str) -> np.ndarray:
    path = folder / "tree.stl"
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return read_stl(path)


def refusal(folder: Path, data: bytes | str) -> str:
    """What is said of a file that is refused: one line that names the file and ends as a sentence."""
    with pytest.raises(StlError) as caught:
        read(folder, data)
    text = str(caught.value)
    assert "tree.stl" in text
    assert text.endswith(".")
    assert "\n" not in text
    return text


def as_float32(facets: object) -> np.ndarray:
    return np.array(facets, dtype=np.float32).astype(np.float64)


# ------------------------------------------------------------------------------------- read


def test_binary_is_read_as_float64(tmp_path: Path) -> None:
    facets = read(tmp_path, binary([ONE, TWO]))
    assert facets.dtype == np.float64
    np.testing.assert_array_equal(facets, as_float32([ONE, TWO]))


def test_binary_that_says_solid(tmp_path: Path) -> None:
    facets = read(tmp_path, binary([ONE, TWO], header=b"solid facet outer loop vertex"))
    np.testing.assert_array_equal(facets, as_float32([ONE, TWO]))


def test_binary_that_says_solid_and_is_cut_off(tmp_path: Path) -> None:
    data = binary([ONE, TWO], header=b"solid tree".ljust(80))
    assert "cut off" in refusal(tmp_path, data[:-1])


def test_ascii(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read(tmp_path, ASCII), [ONE, TWO])


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.upper(),
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: " ".join(text.split()),  # one line
        lambda text: "\n\t\v\f ".join(text.split()) + "\n\n\x1a",  # one word a line, Ctrl-Z
        lambda text: "\ufeff" + text,
        lambda text: "\n\n  " + text,
        lambda text: text.replace("normal 0 0 1", "normal nan nan nan"),
        lambda text: text.replace("normal 0 0 1", ""),
        lambda text: text.replace("facet normal 0 0 1", ""),
        lambda text: text.replace("normal 0 0 1", "normal 0 0 -1"),
        lambda text: text.replace("endloop", "end loop").replace("endfacet", "end facet"),
        lambda text: (
            text.replace("1e-3", "+.1E-02").replace("1e5", "100000.").replace("8", "8e+00")
        ),
        lambda text: text.replace("tree", ""),
        lambda text: text.replace("tree", "vertex 1 2 3 outer loops"),
        lambda text: text.replace(
            "  facet normal 0 0 0", "endsolid a\nsolid b\nfacet normal 0 0 0"
        ),
    ],
)
def test_ascii_as_exporters_write_it(tmp_path: Path, change) -> None:  # type: ignore[no-untyped-def]
    np.testing.assert_array_equal(read(tmp_path, change(ASCII)), [ONE, TWO])


@pytest.mark.medium
@given(
    st.lists(
        st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=9, max_size=9),
        min_size=1,
    ),
    st.lists(st.sampled_from([" ", "\n", "\t ", "\r\n"]), min_size=5, max_size=5),
)
def test_ascii_numbers_are_read_exactly(
    tmp_path_factory: pytest.TempPathFactory, facets: list[list[float]], gaps: list[str]
) -> None:
    def word(number: int) -> str:
        return gaps[number % len(gaps)]

    text = "solid" + gaps[0]
    for facet in facets:
        text += "facet outer loop "
        for corner in range(3):
            numbers = facet[3 * corner : 3 * corner + 3]
            text += "vertex" + "".join(word(i) + repr(x) for i, x in enumerate(numbers)) + gaps[3]
        text += "endloop endfacet" + gaps[4]
    found = read(tmp_path_factory.mktemp("ascii"), text + "endsolid")
    np.testing.assert_array_equal(found.reshape(-1, 9), facets)


@pytest.mark.parametrize("bad", ["nan", "-inf", "NaN", "1.#QNAN", "-1.#IND00", "1.#INF", "1e999"])
def test_facets_of_no_finite_number_are_left_out_and_counted(tmp_path: Path, bad: str) -> None:
    with pytest.warns(StlWarning, match="tree.stl: 1 of 2 facets"):
        facets = read(tmp_path, ASCII.replace("-1 3", f"{bad} 3"))
    np.testing.assert_array_equal(facets, [ONE])


def test_binary_facets_of_no_finite_number_are_left_out_and_counted(tmp_path: Path) -> None:
    broken = [[[0.0, 0.0, float("nan")], ONE[1], ONE[2]], [ONE[0], [float("inf"), 0, 0], ONE[2]]]
    with pytest.warns(StlWarning, match="2 of 4 facets"):
        facets = read(tmp_path, binary([broken[0], ONE, broken[1], TWO]))
    np.testing.assert_array_equal(facets, as_float32([ONE, TWO]))
    assert "finite" in refusal(tmp_path, binary(broken))


def test_sound_files_do_not_warn(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read(tmp_path, ASCII)
        read(tmp_path, binary([ONE]))


def test_a_facet_of_zero_area_is_kept(tmp_path: Path) -> None:
    flat = [[1.0, 1.0, 1.0]] * 3
    np.testing.assert_array_equal(read(tmp_path, binary([flat, ONE])), as_float32([flat, ONE]))


# ------------------------------------------------------------------------------------- refuse


@pytest.mark.parametrize("data", [b"", b"\n \n", b"\0" * 100])
def test_empty_file(tmp_path: Path, data: bytes) -> None:
    assert "empty" in refusal(tmp_path, data)


@pytest.mark.parametrize("left", [84, 85, 133, 134, 150, 183])
def test_cut_off_binary(tmp_path: Path, left: int) -> None:
    text = refusal(tmp_path, binary([ONE, TWO], header=b"made by hand")[:left])
    assert "cut off" in text
    assert f"counts 2 facets, the file holds {(left - 84) // 50}" in text


@pytest.mark.parametrize(("count", "extra"), [(0, b""), (1, b""), (2, b"trailer"), (2, b"\1" * 49)])
def test_binary_with_more_than_its_header_counts(tmp_path: Path, count: int, extra: bytes) -> None:
    text = refusal(tmp_path, binary([ONE, TWO], b"made by hand", count) + extra)
    assert "damaged" in text
    assert f"counts {count} facets, the file holds 2" in text


def test_binary_that_counts_more_than_it_holds(tmp_path: Path) -> None:
    assert "cut off" in refusal(tmp_path, binary([ONE, TWO], b"made by hand", 3_000_000))


@pytest.mark.parametrize(
    "data",
    [
        b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n" * 20,  # OBJ
        b"solid advice: plant trees.\n" * 9,
        b"solid",
        b"hello",
        b"ply\nformat ascii 1.0\n",
        b"PK\x03\x04" + bytes(range(256)) * 9,
        b"\x89PNG\r\n\x1a\n" + np.random.default_rng(2).bytes(5000),
        np.random.default_rng(3).bytes(70),
    ],
)
def test_no_stl_at_all(tmp_path: Path, data: bytes) -> None:
    assert "not an STL" in refusal(tmp_path, data)


@pytest.mark.parametrize("data", [binary([], b"nothing"), b"solid tree\nendsolid tree\n"])
def test_no_facets(tmp_path: Path, data: bytes) -> None:
    assert "no facets" in refusal(tmp_path, data)


@pytest.mark.parametrize(
    "end", ["endsolid", "endfacet\nendsolid", "-1 3\n      vertex 0.25", "1e5"]
)
def test_cut_off_ascii(tmp_path: Path, end: str) -> None:
    whole = 2 if "endsolid" in end else 1
    assert f"cut off after {whole} facets" in refusal(tmp_path, ASCII[: ASCII.rindex(end)])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("vertex 0.5 -1 3", "vertex 0.5 -1"),
        ("vertex 0.5 -1 3", "vertex 0.5 -1 3 4"),
        ("vertex 0.5 -1 3", "vertex 0.5 -1 three"),
        ("vertex 0.5 -1 3", "vertex 0,5 -1,0 3,0"),
        ("vertex 0.5 -1 3", "vertex 0.5.1 -1 3"),
        ("1e-3 1e5 7", "1.2.3 1e5 x"),  # three numbers are read before the x
        ("1e-3 1e5 7", "1e-3 1e5 7\n vertex 1 1 1"),  # a quad
        ("      vertex 1e-3 1e5 7\n", ""),
        ("vertex 1e-3 1e5 7\n    endloop", ""),
        ("endloop\n  endfacet\nendsolid", "endsolid"),
    ],
)
def test_ascii_facet_that_is_no_triangle(tmp_path: Path, old: str, new: str) -> None:
    head, _, tail = ASCII.rpartition(old)
    text = head + new + tail
    if "endloop\n  endfacet\nendsolid" in old:  # "endsolid" closes the loop as well as it can
        np.testing.assert_array_equal(read(tmp_path, text), [ONE, TWO])
    else:
        assert "facet 2 is not three vertices" in refusal(tmp_path, text)


def test_missing_file_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_stl(tmp_path / "none.stl")


# ------------------------------------------------------------------------------------- write


def test_write_lays_out_the_format(tmp_path: Path) -> None:
    path = tmp_path / "one.stl"
    write_stl(path, np.array([ONE]), header="made here")
    data = path.read_bytes()
    assert data[:80] == b"made here".ljust(80, b"\0")
    assert struct.unpack("<I", data[80:84]) == (1,)
    numbers = struct.unpack("<12fH", data[84:])
    assert numbers == (0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0)  # the normal follows the right hand


def test_write_then_read(tmp_path: Path) -> None:
    facets = np.random.default_rng(4).normal(size=(1000, 3, 3)) * 100
    write_stl(tmp_path / "a.stl", facets)
    write_stl(tmp_path / "b.stl", facets)
    np.testing.assert_array_equal(read_stl(tmp_path / "a.stl"), as_float32(facets))
    assert (tmp_path / "a.stl").read_bytes() == (tmp_path / "b.stl").read_bytes()


@pytest.mark.parametrize(
    ("facets", "header"),
    [
        (np.full((1, 3, 3), np.nan), "x"),
        (np.full((1, 3, 3), 1e39), "x"),
        (np.zeros((3, 3)), "x"),
        (np.zeros((1, 3, 3)), "solid tree"),
        (np.zeros((1, 3, 3)), "x" * 81),
    ],
)
def test_what_cannot_be_written_leaves_the_old_file(
    tmp_path: Path, facets: np.ndarray, header: str
) -> None:
    path = tmp_path / "old.stl"
    path.write_bytes(b"as it was")
    with pytest.raises(StlError, match=r"old\.stl"):
        write_stl(path, facets, header=header)
    assert path.read_bytes() == b"as it was"
    assert [p.name for p in tmp_path.iterdir()] == ["old.stl"]


def test_a_tree_at_map_coordinates_in_single_precision_is_refused(tmp_path):
    facets = stream(2, "far").random((50, 3, 3)) * [4, 4, 12]
    far, near = np.array([432_100, 5_612_300, 120]), np.array([100, 200, 120])
    write_stl(tmp_path / "a.stl", facets + far)
    with pytest.raises(StlError, match=r"a\.stl lies at map .* steps of 0\.5: its shape is lost"):
        read_stl(tmp_path / "a.stl")
    write_stl(tmp_path / "b.stl", facets + near)
    assert read_stl(tmp_path / "b.stl") == pytest.approx(facets + near, abs=1e-4)
