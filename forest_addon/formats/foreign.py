"""One guard around every reader of files that others wrote.

A reader says in its own words what it knows to be wrong; whatever else a broken file sets off, from numpy's
header to Python's own limits, becomes one sentence with the file's name here. Nothing but what was meant
comes out. What has no end, or counts more in its head than its bytes can hold, is refused before anybody
reads it: that bounds time and memory by the size of the file.
"""

from __future__ import annotations

import functools
import importlib
import json
import os
import re
import struct
from collections.abc import Callable, Iterable
from itertools import takewhile
from pathlib import Path
from typing import Any, BinaryIO, Concatenate, ParamSpec, TypeVar

import numpy as np

from ..spec import SpecError
from .ownership import reads

P = ParamSpec("P")
Found = TypeVar("Found")
StrPath = str | os.PathLike[str]
LONGEST = 160  # characters of another program's words
MOST = 4_000_000_000  # bytes of a file
PACKED = 300  # points of a LAZ over those that its bytes would hold unpacked
HEAD = 100_000  # bytes in which a PLY says what it holds
SIZES = {  # bytes of PLY's types
    **dict.fromkeys(("char", "uchar", "int8", "uint8"), 1),
    **dict.fromkeys(("short", "ushort", "int16", "uint16"), 2),
    **dict.fromkeys(("int", "uint", "int32", "uint32", "float", "float32"), 4),
    **dict.fromkeys(("double", "float64"), 8),
}
_KIND = f"(?:{'|'.join(SIZES)})"
_NOTE = r"(?:(?:comment|obj_info)\b.*\n)*"
PLY_HEAD = re.compile(
    rf"ply\n{_NOTE}format (?:ascii|binary_(?:little|big)_endian) 1\.0\n{_NOTE}"
    rf"(?:element \w+ \d+\n{_NOTE}(?:property (?:list {_KIND} )?{_KIND} \S+\n{_NOTE})*)+"
)
PLY_LONGEST = 60_000  # bytes of a line; Blender's reader ends the process beyond 64 KiB
BESIDE = re.compile(
    rb"^\s*(?:mtllib|map_\w+|bump|disp|refl|norm)\s+(?:-\w+\s+\S+\s+)*(.+?)\s*$", re.M
)
COARSE = 2e-3  # of the extent, a step of single precision that loses the shape
FINEST = 1e-3  # metres, a step that loses none
RASTER = 0.5  # metres, that corners of grids are multiples of


def guarded(
    what: str, *, key: str = "", meant: tuple[type[Exception], ...] = (), most: int = MOST
) -> Callable[[Callable[Concatenate[Path, P], Found]], Callable[Concatenate[StrPath, P], Found]]:
    """Guard a function that reads the file of its first argument: it raises a ``SpecError`` or what is meant.

    what : what the file should be, as in "an npy array". key : the setting that names the file, if the
    sentence should start with that. meant : errors that callers know.
    most : bytes of a file.
    """

    # what is not installed is no fault of a file
    known: tuple[type[Exception], ...] = (ModuleNotFoundError, *meant)

    def around(
        read: Callable[Concatenate[Path, P], Found],
    ) -> Callable[Concatenate[StrPath, P], Found]:
        @functools.wraps(read)
        def guarded_read(path: StrPath, /, *more: P.args, **named: P.kwargs) -> Found:
            place = str(os.fspath(path))
            reads([path])
            try:
                refuse_claims(path, most)
                return read(Path(path), *more, **named)
            except known:
                raise
            except SpecError as problem:
                if problem.key != "crs":
                    raise
                raise SpecError(place, f"crs: {problem.problem}") from None
            except Exception as problem:
                said = _sentence(problem, what)
                refused = SpecError(key, f"{place} {said}") if key else SpecError(place, said)
                raise refused from None

        return guarded_read

    return around


def numbers(rows: Any, path: StrPath, what: str) -> np.ndarray:
    """Return rows of words as numbers; what a file says is not repeated.

    Raises
    ------
    SpecError : one is none; says what a line should be.
    """
    try:
        return np.array(rows, dtype=np.float64)
    except ValueError:
        raise SpecError(str(path), f"has a line that is not {what}") from None


def library(path: StrPath, extra: str, name: str, instead: str = "") -> Any:
    """Return a library of an optional extra of this package. instead : what else one may do.

    Raises
    ------
    SpecError : it is not installed; says how it is.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise SpecError(
            os.path.basename(path),
            f"needs the library {name.partition('.')[0]}; install it with pip install "
            f'"forest-sensing[{extra}]"{instead}',
        ) from None


def refuse_claims(path: StrPath, most: int = MOST) -> None:
    """Refuse what has no end, more than any reader here should hold, or LAS, PLY, glTF, USD and WAV files
    that count more than their bytes can hold; what is missing is told later.

    Raises
    ------
    SpecError : says what, and how many.
    """
    try:
        status = os.stat(path)
    except OSError:
        return
    if _is_endless(path):
        raise SpecError(str(path), "is a device or a pipe; name a file")
    if status.st_size > most:
        raise SpecError(
            str(path),
            f"has {status.st_size / 1e9:.1f} GB, more than the {most / 1e9:g} GB that are read; "
            "give a smaller file",
        )
    if os.path.isdir(path):
        return
    with open(path, "rb") as file:
        head = file.read(HEAD)
        claimed, room = 0, status.st_size
        if head.startswith(b"LASF") and len(head) > 110:
            claimed, room = _claims_of_las(head, room, file)
        elif head.startswith(b"PXR-USDC") and len(head) > 23:
            claimed, room = _claims_of_usd(head, room, file)
        elif head[8:12] == b"WAVE":
            claimed, room = _claims_of_wav(head, room, file)
    if str(path).lower().endswith(".ply") and re.match(rb"ply\s", head):
        claimed = _claims_of_ply(Path(path), head)
    elif str(path).lower().endswith((".obj", ".mtl")):
        _refuse_endless_beside(
            Path(path), map(os.fsdecode, BESIDE.findall(Path(path).read_bytes()))
        )
    elif head.startswith(b"glTF") or str(path).lower().endswith(".gltf"):
        claimed, room = _claims_of_gltf(Path(path), room)
    if claimed > room:
        raise SpecError(
            str(path),
            f"is broken: its head counts {claimed:,} records or bytes, it has room for {room:,}; copy or "
            "export it again",
        )


def _is_endless(path: StrPath) -> bool:
    """Return whether something is neither a file nor a folder; what is not there is not."""
    return os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path))


def _refuse_endless_beside(path: Path, names: Iterable[str]) -> None:
    """Refuse a file that names, as its own parts, what has no end; libraries of materials name more."""
    for name in names:
        beside = path.parent / name
        if _is_endless(beside):
            raise SpecError(str(path), f'names "{name}", which is a device or a pipe; name a file')
        if beside.suffix.lower() == ".mtl" and beside != path:
            refuse_claims(beside)


def _claims_of_las(head: bytes, size: int, file: BinaryIO) -> tuple[int, int]:
    """Records that a LAS file counts, and what it has room for."""
    first, begin, records, kind, length, points = struct.unpack_from("<HIIBHI", head, 94)
    begin = min(begin, size)
    if records * 54 > begin - first:
        return records, max(begin - first, 0) // 54
    if head[25] >= 4 and len(head) >= 255:
        extended, points = struct.unpack_from("<IQ", head, 243)
        if extended * 60 > size:
            return extended, size // 60
    if not kind & 0xC0:
        return points, max(size - begin, 0) // max(length, 1)
    zip_at = head.find(b"laszip encoded") + 84  # how its items begin
    items = struct.unpack_from("<H", head, zip_at)[0] if zip_at > 84 else 0
    size_of_items = sum(struct.unpack_from(f"<{3 * items}H", head, zip_at + 2)[1::3])
    if size_of_items > length:
        return size_of_items, length
    file.seek(begin)
    table = int.from_bytes(file.read(8), "little", signed=True)
    file.seek(table if 0 <= table < size else max(size - 8, 0))
    if table < 0:  # a writer that could not go back has put it last
        table = int.from_bytes(file.read(8), "little", signed=True)
        file.seek(table if 0 <= table < size else 0)
    chunks = int.from_bytes(file.read(8)[4:], "little")
    if chunks > size:
        return chunks, size
    return points, PACKED * max(size - begin, 0) // max(length, 1)


def _claims_of_usd(head: bytes, size: int, file: BinaryIO) -> tuple[int, int]:
    """Bytes or items that a binary USD counts in its sections or their table, and what it has room for."""
    file.seek(min(int.from_bytes(head[16:24], "little"), size))
    table = file.read(8 + 32 * 16)
    counted = [(32 * int.from_bytes(table[:8], "little"), size)]
    whole = min(counted[0][0], (len(table) - 8) // 32 * 32)
    for name, begin, length in struct.iter_unpack("<16sQQ", table[8 : 8 + max(whole, 0)]):
        file.seek(min(begin, size))
        told = file.read(16 if name.startswith(b"TOKENS") else 8)
        words = (int.from_bytes(told[at : at + 8], "little") for at in (0, 8))
        counted += [(begin + length, size), (max(words), PACKED * size)]
    return max(counted, key=lambda one: one[0] / max(one[1], 1))


def _claims_of_wav(head: bytes, size: int, file: BinaryIO) -> tuple[int, int]:
    """Bytes of sound that a WAV counts, and those that follow; a stream counts more than any file has."""
    name, length, at = b"", 0, 12
    while name != b"data" and at + 8 <= size:
        file.seek(at)
        name, length = struct.unpack(">4sI" if head[:4] == b"RIFX" else "<4sI", file.read(8))
        at += 8 if name == b"data" else 8 + length + length % 2
    return (length if name == b"data" and length < 0x7FFFF000 else 0), max(size - at, 0)


def _claims_of_ply(path: Path, head: bytes) -> int:
    """Bytes that a PLY needs for what it counts, at least.

    Raises
    ------
    SpecError : its head is none, or a line is so long that Blender ends on it.
    """
    lines = head.decode("ascii", "replace").splitlines()
    lines = [
        " ".join(line.split()) for line in takewhile(lambda t: t.strip() != "end_header", lines)
    ]
    whole = "".join(f"{line}\n" for line in filter(None, lines))
    if b"end_header" not in head or not PLY_HEAD.fullmatch(whole):
        raise SpecError(
            str(path), "is no PLY that can be read: its head is broken; export it again"
        )
    is_text = "format ascii 1.0" in lines
    with open(path, "rb") as file:
        if is_text and any(len(line) > PLY_LONGEST for line in file):
            raise SpecError(
                str(path), f"has a line of more than {PLY_LONGEST:,} bytes; export it as binary PLY"
            )
    least = count = most = 0
    for words in map(str.split, lines):
        if words[:1] == ["element"]:
            count = int(words[2])
            most = max(most, count)
        elif words[:1] == ["property"]:
            kind = words[2] if words[1] == "list" else words[1]
            least += count * (2 if is_text else SIZES[kind])
    return max(least, most)


def name_in(uri: str) -> str:
    """The name of a file that a URI of a glTF tells; letters may stand as the codes of their UTF-8."""
    codes = re.compile(b"%([0-9a-fA-F]{2})")
    return codes.sub(lambda code: bytes([int(code[1], 16)]), uri.encode()).decode(errors="replace")


def _claims_of_gltf(path: Path, size: int) -> tuple[int, int]:
    """The most items that one part of a glTF counts, and bytes of it and of what it names."""
    raw = path.read_bytes()
    if raw.startswith(b"glTF"):
        raw = raw[20 : 20 + int.from_bytes(raw[12:16], "little")]
    document = json.loads(raw)
    parts = (*document.get("buffers", []), *document.get("images", []))
    names = [name for each in parts if (name := str(each.get("uri", "")))[:5] != "data:"]
    names = [name_in(uri) for uri in names]
    _refuse_endless_beside(path, filter(None, names))
    size += sum(file.stat().st_size for name in names if (file := path.parent / name).is_file())
    counted = [*document.get("accessors", [])]
    counted += [each["sparse"] for each in counted if "sparse" in each]
    return max((int(each.get("count", 0)) for each in counted), default=0), size


def refuse_coarse(path: StrPath, corners: np.ndarray, exact: bool = False) -> None:
    """Refuse corners (..., 3) that are no finite numbers, which Blender's importers put at the origin, or so
    far from it that single precision has rounded the shape away.

    exact : they were stored with more digits, and are refused if they are what single precision had left.

    Raises
    ------
    SpecError : says what, and what to do.
    """
    places = np.reshape(corners, (-1, 3))
    if not np.isfinite(places).all():
        raise SpecError(
            os.path.basename(path),
            "has corners that are NaN or infinite; repair it, and export it again",
        )
    with np.errstate(all="ignore"):
        low, high = places.min(axis=0), places.max(axis=0)
        step = np.spacing(np.maximum(np.abs(low), np.abs(high)).astype(np.float32))
        coarse = step.max() > max(FINEST, COARSE * float((high - low).max()))
        if coarse and exact:
            flat = np.argsort(step)[1:]
            odd = [
                abs(np.remainder(places[:, flat] / of + 0.5, 1) - 0.5)
                for of in (step[flat], RASTER)
            ]
            coarse = odd[0].max() < 0.05 < odd[1].max()
    if coarse:
        raise SpecError(
            os.path.basename(path),
            f"lies at map coordinates, where single precision has steps of {step.max():.2g}: its shape "
            "is lost; subtract the coordinates before you export it",
        )


def _sentence(problem: Exception, what: str) -> str:
    """Sentence on what is wrong and what to do, without the file's name."""
    known: dict[type[Exception], str] = {
        FileNotFoundError: "there is no such file; check the path",
        IsADirectoryError: f"is a folder; name {what} in it",
        UnicodeDecodeError: f"is not a text file; give {what} in UTF-8",
        RecursionError: f"is nested too deeply; give {what} that a person could read",
        MemoryError: "asks for more memory than there is; give a smaller file",
    }
    for kind, sentence in known.items():
        if isinstance(problem, kind):
            return sentence
    if isinstance(problem, OSError) and problem.strerror:
        return f"cannot be read: {problem.strerror}"
    lines = [line for line in str(problem).splitlines() if not line.startswith("Location:")]
    if "Traceback" in str(problem):  # of a script of Blender's: what it ended with
        lines = [line for line in lines if line.strip()][-1:]
    shown = "".join(
        c if c.isprintable() else " " for c in re.sub(r"\bError: ", "", " ".join(lines))
    )
    why = " ".join(shown[:LONGEST].split()).rstrip(".") or type(problem).__name__
    if isinstance(problem, NameError | KeyError):  # of a reader that met no head
        why = "its head is broken" if isinstance(problem, NameError) else f"it has no {why}"
    why = "its points lie on one line" if why.startswith("QH") else why  # Qhull's words
    return f"cannot be read as {what} ({why}); save it again"
