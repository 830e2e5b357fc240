"""Tables: CSV with a header and one row a thing, and NPZ with an array a column.

``write_csv`` writes every digit of a float and takes a microsecond a number; ``write_numbers`` writes as many
decimals as a column has, and a million numbers take a tenth of a second. Equal tables are equal files.
"""

from __future__ import annotations

import csv
import gzip
import io
import math
import os
import re
import sys
import unicodedata
import zipfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from ..spec import SpecError
from .atomic import replacing
from .ply import StoredRows

TEXT_AT_ONCE = 20_000  # rows
ROWS_AT_ONCE = 200_000
Columns = Mapping[str, Sequence[Any]]
LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254, "dm": 0.1}
LENGTHS |= {"meters": 1.0, "metres": 1.0, "feet": 0.3048, "inches": 0.0254}
LENGTHS |= {"inch": 0.0254, "foot": 0.3048, "usft": 1200 / 3937}
LENGTHS |= {"м": 1.0, "см": 0.01, "мм": 0.001}
ANGLES = {"deg": math.pi / 180, "rad": 1.0, "gon": math.pi / 200, "degrees": math.pi / 180}
AREAS = {"m2": 1.0, "sqm": 1.0, "ft2": 0.3048**2}

ABSENT = (  # where nothing was measured
    *("", "na", "nan", "n/a", "null", "none", ".", "-"),
    *("n.a.", "k.a.", "nd", "#n/a", "<na>", "?", "–", "—"),
)

SUMS = (  # how rows begin that are no trees
    "total totals sum mean average median summe gesamt mittel mittelwert moyenne somme totale media promedio"
)

PACKED = 200  # times the bytes of a file that it may unpack to, beside a megabyte

NOTES = ("#", "sep=", "SEP=")  # how lines begin that hold no cells; the last are Excel's
TITLES = 10  # rows above a header
# By the mark in them: numbers with decimals, and those that are thousands where decimals have the other mark.
DECIMAL = {mark: re.compile(rf"-?\d+[{mark}]\d+") for mark in ".,"}
ROUNDED = re.compile(r"-?\d[.,](\d+)e\+0*(\d+)", re.IGNORECASE)  # 4.57E+05, as Excel saves it
THOUSANDS = {mark: re.compile(rf"-?[1-9]\d{{0,2}}[{mark}]\d{{3}}") for mark in ".,"}
HUNDREDS = re.compile(r"-?[1-9]\d{2}")

FORMULA = ("=", "+", "@")  # a cell that begins so is a formula to a spreadsheet


def quoted(cell: Any) -> Any:
    """A cell that a spreadsheet takes for what it says: a formula begins with an apostrophe."""
    if not isinstance(cell, str) or not cell.lstrip("'").startswith(FORMULA) or _is_number(cell):
        return cell
    return f"'{cell}"


def unquoted(cell: str) -> str:
    """A cell as it was before ``quoted``."""
    return cell[1:] if cell.startswith("'") and cell.lstrip("'").startswith(FORMULA) else cell


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def write_csv(path: str | os.PathLike[str], table: Columns | Iterable[Columns]) -> None:
    """Write columns of equal length, or parts of a table one below the other; floats keep every digit
    (``repr``), texts that would be formulas are quoted."""
    with replacing(path) as partial, open(partial, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        for number, part in enumerate([table] if isinstance(table, Mapping) else table):
            if not number:
                writer.writerow(map(quoted, part))
            writer.writerows(map(quoted, row) for row in zip(*part.values(), strict=True))


def write_npz(
    path: str | os.PathLike[str],
    arrays: Mapping[str, np.ndarray | StoredRows],
    units: Mapping[str, str],
    packed: bool = True,
) -> None:
    """Write arrays, also columns of stored rows; ``units`` says what each is measured in and becomes
    ``<name>_unit`` texts. packed : compress them."""
    texts = {f"{name}_unit": np.array(unit) for name, unit in units.items()}
    kind = zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED
    with replacing(path) as partial, zipfile.ZipFile(partial, "w", kind) as archive:
        for name, values in {**arrays, **texts}.items():
            entry = zipfile.ZipInfo(f"{name}.npy")
            entry.compress_type = kind
            with archive.open(entry, "w", force_zip64=packed or name not in texts) as file:
                if not isinstance(values, StoredRows):
                    np.lib.format.write_array(file, np.asanyarray(values), allow_pickle=False)
                    continue
                head = np.empty(0, values.dtype)
                told = np.lib.format.header_data_from_array_1_0(head) | {"shape": (len(values),)}
                np.lib.format.write_array_header_1_0(file, told)
                for first in range(0, len(values), ROWS_AT_ONCE):
                    file.write(values[first : first + ROWS_AT_ONCE].tobytes())


def write_numbers(
    path: str | os.PathLike[str], columns: Mapping[str, np.ndarray], decimals: Mapping[str, int]
) -> None:
    """Write columns of equal length; those of floats have ``decimals`` digits after the point.

    Raises
    ------
    OSError : it cannot be written.
    ValueError : a number that is not finite, or too large for its decimals (above 9e18 in its last digit).
    """
    count = len(next(iter(columns.values()))) if columns else 0
    with replacing(path) as partial, open(partial, "wb") as file:
        file.write((",".join(columns) + "\n").encode())
        for first in range(0, count, TEXT_AT_ONCE):
            rows = slice(first, first + TEXT_AT_ONCE)
            parts = []
            for number, (name, values) in enumerate(columns.items()):
                parts.append(_text(np.asarray(values[rows]), decimals.get(name, 0), name))
                end = b"\n" if number == len(columns) - 1 else b","
                parts.append(np.full((len(parts[-1]), 1), end[0], np.uint8))
            text = np.concatenate(parts, axis=1)
            file.write(text[text > 0].tobytes())


def _text(values: np.ndarray, decimals: int, name: str) -> np.ndarray:
    """(N, W) characters of numbers, right-aligned, 0 where there is none."""
    if values.dtype.kind == "f":
        large = np.rint(values * 10.0**decimals)
        if not (np.abs(large) < 9e18).all():
            raise ValueError(f"{name} has a number that is not finite, or too large to be written")
        whole = large.astype(np.int64)
    else:
        whole, decimals = values.astype(np.int64), 0
    rest = np.abs(whole).astype(np.uint64)
    wide = max(len(str(int(rest.max(initial=0)))), decimals + 1)
    text = np.zeros((len(values), wide + 1 + bool(decimals)), np.uint8)
    place = text.shape[1] - 1
    for digit in range(wide):
        if digit == decimals and decimals:
            text[:, place] = ord(".")
            place -= 1
        shown = slice(None) if digit <= decimals else rest > 0
        rest, last = np.divmod(rest, np.uint64(10))
        text[shown, place] = (last.astype(np.uint8) + ord("0"))[shown]
        place -= 1
    negative = np.flatnonzero(whole < 0)
    first = np.argmax(text[negative] > 0, axis=1)
    text[negative, first - 1] = ord("-")
    return text


# ---------------------------------------------------------------------------------- tables of others


def read_columns(path: Path, *needed: str) -> Sheet:
    """Read a table in text whose columns have names of their own, in small letters.

    Raises
    ------
    SpecError : as ``read_text``; a column that is needed is missing.
    """
    sheet = read_text(path, lambda cells: {*needed} <= {cell.strip().lower() for cell in cells})
    names = [name.strip().lower() for name in sheet.head]
    if not {*needed} <= {*names}:
        raise SpecError(str(path), f"needs the columns {', '.join(needed)} in its header")
    sheet.columns = {name: (at, 1.0, "") for at, name in enumerate(names) if name}
    return sheet


@dataclass
class Sheet:
    """Cells of a table as text: its header, its rows with their lines, the system that it names, and
    columns by what they are: where, in our unit, and the name of the unit if the column says one.
    """

    path: Path
    head: list[str]
    rows: list[tuple[int, list[str]]]
    crs: str = ""
    thousands: str = ""  # marks in numbers that may be of thousands
    said: list[str] = field(default_factory=list)
    columns: dict[str, tuple[int, float, str]] = field(default_factory=dict)
    nothing: tuple[float, ...] = ()  # numbers that stand for none
    lowest: float = -sys.float_info.max

    def name(self, key: str) -> str:
        """The name of a column in small letters and digits; "" where there is none."""
        return "".join(words_of(self.head[self.columns[key][0]])) if key in self.columns else ""

    def texts(self, key: str) -> list[str]:
        """Cells of a column without quotes, "" where there is none."""
        if key not in self.columns:
            return [""] * len(self.rows)
        at = self.columns[key][0]
        return [unquoted(cells[at].strip()) for _, cells in self.rows]

    def numbers(self, key: str) -> np.ndarray:
        """(N,) numbers of a column in our unit, NaN where there is none.

        Raises
        ------
        SpecError : a cell that is no finite number.
        """
        numbers = np.full(len(self.rows), np.nan)
        for row, told in enumerate(self.texts(key)):
            if told.lower() in ABSENT:
                continue
            with suppress(ValueError):
                numbers[row] = float(told if "." in told else told.replace(",", ".", 1))
            rounded = ROUNDED.fullmatch(told) if key in "xy" else None
            coarse = rounded is not None and int(rounded[2]) > len(rounded[1])
            unsure = any(THOUSANDS[mark].fullmatch(told) for mark in self.thousands)
            if unsure or coarse or not self.lowest <= numbers[row] < math.inf:
                why = "which may be thousands" if unsure else "not a finite number"
                why = "which a spreadsheet has rounded" if coarse else why
                raise SpecError(
                    str(self.path),
                    f'row {self.rows[row][0]}: {key} is "{told}", {why}; use one kind of decimals '
                    "throughout, without units and without marks of thousands",
                )
        numbers[np.isin(numbers, self.nothing)] = np.nan
        return numbers * self.columns[key][1] if key in self.columns else numbers

    def matrix(self, *keys: str) -> np.ndarray:
        """(N, columns) numbers of columns.

        Raises
        ------
        SpecError : there is no row; a cell that is empty, or no finite number.
        """
        if not self.rows:
            raise SpecError(str(self.path), "has no rows below its header; give one or more")
        rows = np.reshape([self.numbers(key) for key in keys], (len(keys), -1)).T
        for row, column in np.argwhere(np.isnan(rows)):
            raise SpecError(
                str(self.path), f"row {self.rows[row][0]} has no {keys[column]}; give a number"
            )
        return rows


def words_of(name: str) -> list[str]:
    """Words of a column's name in small letters without accents: DBH [cm] as dbh, cm."""
    bare = unicodedata.normalize("NFKD", name.casefold())
    return re.findall(r"[^\W_]+|%", "".join(c for c in bare if not unicodedata.combining(c)))


def refuse_unpacked(path: Path, size: int) -> None:
    """Refuse a file that unpacks to very much more than itself."""
    most = PACKED * path.stat().st_size + 1_000_000
    if size > most:
        raise SpecError(
            str(path), f"unpacks to more than {most / 1e6:,.0f} MB; save it again without packing"
        )


def text_of(path: Path) -> tuple[str, list[str]]:
    """A file's text, UTF-8, UTF-16 or Windows' cp1252, packed by gzip or not, and what was guessed of it.

    Raises
    ------
    SpecError : it unpacks to very much more than itself.
    """
    data = path.read_bytes()
    if data.startswith(b"\x1f\x8b"):
        with gzip.open(path) as file:
            data = file.read(PACKED * len(data) + 1_000_001)
            refuse_unpacked(path, len(data))
    encoding = {0: "utf-16-be", 1: "utf-16-le"}.get(data[:2].find(b"\0"), "utf-8-sig")
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):  # byte order marks
        encoding = "utf-16"
    try:
        return data.decode(encoding), []
    except UnicodeDecodeError:
        return data.decode("cp1252"), [f"{path.name}: is not UTF-8; read as Windows' cp1252"]


def read_text(path: Path, is_head: Callable[[Sequence[str]], bool]) -> Sheet:
    """Read a table in text: commas, semicolons, tabs, bars or spaces; UTF-8, UTF-16 or Windows' cp1252;
    packed by gzip or not. is_head : whether cells are a header; without such a row the first one is.

    Raises
    ------
    SpecError : as ``sheet_of``; it unpacks to very much more than itself.
    """
    text, said = text_of(path)
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith(NOTES)]
    bare = {line: re.sub(r'"[^"]*"| ', "", line) for line in lines[:TITLES]}
    split = {line: max(" ;\t|,", key=told.count) for line, told in bare.items()}
    heads = (by for line, by in split.items() if is_head(line.split(by)))
    separator = next(chain(heads, split.values()), " ")
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True, strict=True
    )
    rows, line = [], 1
    for cells in reader:
        if any(map(str.strip, cells)) and not cells[0].startswith(NOTES):
            rows.append((line, cells))
        line = reader.line_num + 1
    sheet = sheet_of(path, rows, is_head, separator == " " or text.splitlines()[-1:][0][:1] == '"')
    sheet.thousands += "," * (separator == ",")
    sheet.said += said
    return sheet


def sheet_of(
    path: Path,
    rows: list[tuple[int, list[str]]],
    is_head: Callable[[Sequence[str]], bool],
    named: bool = False,
) -> Sheet:
    """The first row that is a header, and rows below it that are as long.

    named : rows may have names, as R's. Titles above the header are left out, and a row of units below it
    goes into it.

    Raises
    ------
    SpecError : no header; a row that is longer or shorter.
    """
    if not rows:
        raise SpecError(str(path), "is empty; it needs a header, and rows below it")
    titles = next((n for n, (_, cells) in enumerate(rows[:TITLES]) if is_head(cells)), 0)
    (line, head), rows = rows[titles], rows[titles + 1 :]
    said = [f"{path.name}: row {line} is its header"] * (titles > 0)
    if rows and {*rows[0][1]} <= {"", *LENGTHS, *ANGLES, *AREAS} and len(rows[0][1]) == len(head):
        head = [
            f"{name} [{unit}]" if unit else name
            for name, unit in zip(head, rows.pop(0)[1], strict=True)
        ]
    if named and rows and all(len(cells) == len(head) + 1 and cells[-1] for _, cells in rows):
        head = ["", *head]
    for line, cells in rows:
        if len(cells) < len(head):
            raise SpecError(
                str(path),
                f"row {line} has {len(cells)} values, its header {len(head)}; complete the row",
            )
        first = next(filter(None, map(str.strip, cells)), "")
        if first.casefold() in SUMS.split():
            raise SpecError(
                str(path),
                f'row {line} begins with "{first}", as a sum of others; leave it out of the table',
            )
        if any(map(str.strip, cells[len(head) :])):
            raise SpecError(
                str(path),
                f"row {line} has {len(cells)} values, its header {len(head)}; name every column, and put "
                "semicolons between columns whose numbers have decimal commas",
            )
    return Sheet(path, head, rows, thousands=_unsure(rows), said=said)


def _unsure(rows: Sequence[tuple[int, list[str]]]) -> str:
    """Marks that may be of thousands: the other one is of decimals, or there are hundreds in their column."""
    columns = [
        [*map(str.strip, cells)] for cells in zip(*(cells for _, cells in rows), strict=False)
    ]
    every = [*chain.from_iterable(columns)]
    sure = {
        mark
        for mark in ".,"
        if any(DECIMAL[mark].fullmatch(c) and not THOUSANDS[mark].fullmatch(c) for c in every)
    }
    mixed = {
        mark
        for mark in {*".,"} - sure
        for cells in columns
        if any(map(THOUSANDS[mark].fullmatch, cells)) and any(map(HUNDREDS.fullmatch, cells))
    }
    return "".join(mark for mark in ",." if mark in mixed or {*".,"} - {mark} <= sure)
