"""STL: a list of facets, three corners each; binary or ASCII, told apart by content.

Reading gives the corners alone, (T, 3, 3) float64 in file units: an STL has no units, and its normals
are left out because exporters leave them zero or flipped, while the corners always tell them. Writing
makes binary STL, the same bytes for the same facets.

A file is binary if its size is what its facet count says, whatever its header; else it is ASCII if it
is text that starts with "solid" or "facet"; else it is refused.
"""

from __future__ import annotations

import os
import re
import warnings
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..spec import SpecError
from .atomic import replacing
from .foreign import guarded, refuse_coarse

HEADER_BYTES = 84  # 80 of text, then the facet count
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
MOST_FACETS = 20_000_000
LOOP = re.compile(rb"outer\s+loop\s")


class StlError(ValueError):
    """A file that cannot be read or written as STL: one sentence with what, which file, what to do."""


class StlWarning(UserWarning):
    """Facets were left out of what was read."""


def read_stl(path: str | os.PathLike[str], most: int = MOST_FACETS) -> np.ndarray:
    """Facets of an STL file: (T, 3, 3) float64, T >= 1, every number finite, in the file's order.

    Facets with a corner that is NaN or infinite are left out, and an ``StlWarning`` says how many.
    most : facets that make sense of what the file should be.

    Raises
    ------
    StlError : the file is empty, cut off, no STL, says another count than it holds, has no facet or too many.
    OSError : it cannot be opened.
    """
    try:
        return _read(path, most)
    except SpecError as problem:
        name = os.path.basename(os.fspath(path))
        raise StlError(f"{name} {problem.problem}.") from None


def refuse_broken_stl(path: Path) -> None:
    """Refuse an STL of which ``read_stl`` leaves out facets.

    Raises
    ------
    SpecError : it does, or the shape is lost at map coordinates.
    StlError : as ``read_stl``.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("error", StlWarning)
        _read(path, path.stat().st_size)


@guarded("an STL file", meant=(StlError, OSError))
def _read(path: Path, most: int) -> np.ndarray:
    name = path.name
    data = path.read_bytes()
    if not data.strip(b"\0 \t\r\n"):
        raise StlError(f"{name} is empty; export it again.")
    counted = int.from_bytes(data[80:HEADER_BYTES], "little")
    if len(data) >= HEADER_BYTES and len(data) == HEADER_BYTES + FACET.itemsize * counted:
        records = np.frombuffer(data, FACET, offset=HEADER_BYTES)
        _refuse_many(name, counted, most)
        facets = records["corners"].astype(np.float64)
    elif _is_text(data):
        _refuse_many(name, data.lower().count(b"endloop"), most)
        facets = _parse_ascii(data.lower(), name)
    else:
        raise _wrong_size(data, counted, name)

    finite = np.isfinite(facets).all(axis=(1, 2))
    if not finite.any():
        what = "no facet of finite numbers" if len(facets) else "no facets"
        raise StlError(f"{name} has {what}; export it again with the mesh selected.")
    if not finite.all():
        lost = int(np.count_nonzero(~finite))
        warnings.warn(
            f"{name}: {lost} of {len(facets)} facets have a corner that is not a finite number; "
            "they were left out.",
            StlWarning,
            stacklevel=4,
        )
        facets = facets[finite]
    refuse_coarse(path, facets, exact=_is_text(data))
    return facets


def _refuse_many(name: str, count: int, most: int) -> None:
    if count > most:
        raise StlError(f"{name} has {count:,} facets, more than {most:,}; make it coarser.")


def write_stl(
    path: str | os.PathLike[str], facets: np.ndarray, header: str = "Forest Sensing"
) -> None:
    """Write facets (T, 3, 3) as binary STL; normals follow from the corners (right-hand rule).

    header : up to 80 ASCII characters; it may not start with "solid", which marks ASCII files.

    Raises
    ------
    StlError : a coordinate is not finite or does not fit in float32, or the shape or header is wrong.
    """
    name = os.path.basename(os.fspath(path))
    corners = np.asarray(facets, dtype=np.float64)
    if corners.ndim != 3 or corners.shape[1:] != (3, 3):
        raise StlError(f"{name}: facets must have the shape (T, 3, 3), not {corners.shape}.")
    if not np.all(np.abs(corners) <= np.finfo(np.float32).max):
        raise StlError(f"{name}: a corner is not a finite float32 number; remove that facet first.")
    text = header.encode("ascii", "replace")
    if len(text) > 80 or text.lstrip().lower().startswith(b"solid"):
        raise StlError(
            f'{name}: the header must be at most 80 characters and not start with "solid".'
        )

    record = np.zeros(len(corners), dtype=FACET)
    record["corners"] = corners
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    norm = np.linalg.norm(cross, axis=1, keepdims=True)
    record["normal"] = cross / np.where(norm > 0, norm, 1.0)  # zero area: zero normal
    with replacing(path) as partial, open(partial, "wb") as file:
        file.write(text.ljust(80, b"\0"))
        file.write(np.uint32(len(record)).astype("<u4").tobytes())
        file.write(record.tobytes())


# ------------------------------------------------------------------------------------- binary


def _is_text(data: bytes) -> bool:
    """Return whether this can only be ASCII STL: it starts as one, and has no zero byte near its start.

    A binary file has zeros there even if its header says "solid": in its count, below 2^24 facets.
    """
    head = data[:1024].removeprefix(b"\xef\xbb\xbf").lstrip().lower()
    return head.startswith((b"solid", b"facet")) and b"\0" not in head


def _wrong_size(data: bytes, counted: int, name: str) -> StlError:
    """Sentence on a file whose size is not that of its facet count: damaged, or no STL at all."""
    held, rest = divmod(max(len(data) - HEADER_BYTES, 0), FACET.itemsize)
    sample = np.frombuffer(data, FACET, count=min(held, 1000), offset=HEADER_BYTES if held else 0)
    with np.errstate(invalid="ignore"):
        corners, normals = np.abs(sample["corners"]), np.abs(sample["normal"])
        usual = ((corners == 0) | ((corners > 1e-12) & (corners < 1e12))).all(axis=(1, 2))
        usual &= (normals <= 1.5).all(axis=1)
    looks_binary = len(data) >= HEADER_BYTES and counted < 10**9
    if not looks_binary or (held and usual.mean() < 0.9):
        return StlError(f"{name} is not an STL file; choose a binary or ASCII STL.")
    if held < counted:
        return StlError(
            f"{name} is cut off: its header counts {counted} facets, the file holds {held}; "
            "copy or export it again."
        )
    return StlError(
        f"{name} is damaged: its header counts {counted} facets, the file holds {held}"
        f"{f' and {rest} bytes' if rest else ''}; export it again."
    )


# ------------------------------------------------------------------------------------- ASCII


def _parse_ascii(text: bytes, name: str) -> np.ndarray:
    """Facets (T, 3, 3) of lower-case ASCII STL: what stands between "outer loop" and "endloop".

    Words may be split by any white space; normals may be missing.
    """
    end = max(text.rfind(b"endsolid"), text.rfind(b"end solid"))
    if LOOP.search(text, max(end, 0)):
        raise StlError(
            f'{name} is cut off after {text.count(b"endloop")} facets: "endsolid" is missing; '
            "copy or export it again."
        )
    if end < 0:
        raise StlError(f"{name} is not an STL file; choose a binary or ASCII STL.")
    # "1.#qnan", "-1.#ind", "1.#inf" of old Windows programs
    text = re.sub(rb"[+-]?1\.#[a-z]+\d*", b"nan", text)
    loops = enumerate(LOOP.split(text)[1:], 1)
    values = (value for number, loop in loops for value in _corners(loop, number, name))
    return np.fromiter(values, dtype=np.float64).reshape(-1, 3, 3)


def _corners(loop: bytes, number: int, name: str) -> list[float]:
    """Nine numbers of what stands between "outer loop" and the next.

    Raises
    ------
    StlError : they are not three vertices of three numbers.
    """
    words = loop.partition(b"end")[0].split()
    if words[::4] == [b"vertex"] * 3 and len(words) == 12:
        with suppress(ValueError):
            return [float(word) for place, word in enumerate(words) if place % 4]
    raise StlError(
        f"{name}: facet {number} is not three vertices of three numbers; export it again."
    )
