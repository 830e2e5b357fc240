"""Tables of trees as foresters have them: a row a tree, where it stands and what was measured of it.

Text (CSV and its kin: commas, semicolons, tabs, bars or spaces; UTF-8, UTF-16 or Windows' cp1252; packed by
gzip or not), XLSX by openpyxl, GeoJSON, and GeoPackage, shapefile and FlatGeobuf by pyogrio. Columns are told
by the names of ``COLUMNS``, the first of them first; case, accents, dots, brackets and underscores do not
matter, and a unit may end a name, as in x_ft, DBH.cm or BHD [cm]. Without one a length is in metres, but for
columns whose inventory always has another (``USUAL``, ``FIA``). Where a table has distances and azimuths from
north in place of coordinates, these follow from them. Degrees are projected; rows at one place are stems of
one tree. What was taken for what, and what was left out, is in ``TreeMap.said``.
"""

from __future__ import annotations

import csv
import gzip
import io
import json
import math
import re
import unicodedata
import zipfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from ..spec import SpecError
from .crs import moved
from .foreign import guarded, library
from .table import unquoted

PLACES = (  # names of x and y, the first pair that a table has
    *("x y", "xutm yutm", "utmx utmy", "utme utmn", "adjeasting adjnorthing", "easting northing"),
    *("east north", "gx gy", "px py", "pointx pointy", "xcoord ycoord", "coordx coordy"),
    *("xkoordinate ykoordinate", "koordinatex koordinatey", "xkoord ykoord"),
    *("rechtswert hochwert", "ostwert nordwert", "xl93 yl93", "xlambert93 ylambert93", "est nord"),
    *("rechts hoch", "gausskrugerrechts gausskrugerhoch", "gkrechts gkhoch"),
    *("e n", "longitude latitude", "lon lat", "long lat", "lng lat"),
    "decimallongitude decimallatitude",
)
COLUMNS = {
    "species": "species kind planting sp spp spcode speciescode scientificname taxonid treespecies "
    "commonname baumart artname art spcd espar essence espece",
    "ring": "ring part",
    "status": "status treestatus plantstatus dfstatus statuscd zustand etat dead tot mort "
    "alive live lebend vivant",
    "plot": "plot plotid subplot subp",
    "scale": "scale",
    "rotation": "rotation turn",
    "dbh": "dbh bhd d13 d130 dhp dap stemdiameter dia diam diameter durchmesser diametre "
    "brusthohendurchmesser brusthoehendurchmesser diameterbreastheight",
    "girth": "gbh girth circumference c13 c130 umfang circonference",
    "height": "height h ht hoehe hohe baumhohe baumhoehe hauteur htot treeheight totalheight actualht",
    "crown_width": "crownwidth crowndiameter crowndiam maxcrowndiameter kronendurchmesser "
    "kronenbreite crownspread diametrehouppier",
    "crown_area": "crownarea convhullarea kronenflache",
    "crown_base": "crownbase crownbaseheight basecrownheight heightcrownbase hcb kronenansatz "
    "kronenansatzhohe",
    "leaf_area": "leafarea blattflache",
    "distance": "distance dist stemdistance horizontaldistance hdist entfernung distanz dpr",
    "azimuth": "azimuth azimut stemazimuth azi az bearing azpr",
}
LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254, "dm": 0.1}
LENGTHS |= {"meters": 1.0, "metres": 1.0, "feet": 0.3048, "inches": 0.0254}
ANGLES = {"deg": math.pi / 180, "rad": 1.0, "gon": math.pi / 200, "degrees": math.pi / 180}
AREAS = {"m2": 1.0, "sqm": 1.0, "ft2": 0.3048**2}
UNITS = {  # of columns that are no lengths, the first without a word
    "rotation": {"rad": 1.0, **ANGLES},
    "azimuth": ANGLES,
    "leaf_area": AREAS,
    "crown_area": AREAS,
    "scale": {"": 1.0, "%": 0.01},
}
USUAL = {"dia": "in", "stemdiameter": "cm", "azpr": "gon"}  # of FIA, NEON and the French inventory
FIA = {"ht": "ft", "actualht": "ft", "dist": "ft"}  # beside a column of FIA's own
FIA_OWN = {"spcd", "statuscd"}
TEXTS = ("species", "ring", "status", "plot")
NUMBERS = ("scale", "rotation", "dbh", "height", "crown_width", "crown_base", "leaf_area")
ABSENT = ("", "na", "nan", "n/a", "null", "none", ".", "-")  # where nothing was measured
GONE = (  # with letters of ForestGEO and numbers of FIA
    *(
        "dead",
        "standing dead",
        "snag",
        "downed",
        "removed",
        "missing",
        "lost",
        "tot",
        "abgestorben",
    ),
    *("mort", "morte", "d", "g", "m", "2", "3"),
)
YES = ("1", "true", "t", "yes", "y", "ja", "oui", "x", "dead")
NO = ("0", "false", "f", "no", "n", "nein", "non", "dead")
LIVING = ("alive", "live", "lebend", "vivant")
MOST = 500_000_000  # bytes of a table
PACKED = 200  # times the bytes of a file that it may unpack to, beside a megabyte
LIKE = 0.8  # of a column's name, beyond which it is a slip of the keyboard
STEMS = 50  # rows at one place that may be one tree
CROWDED = 0.02  # m² a tree, below which numbers that may be degrees are degrees
DEGREES = "EPSG:4326"
THOUSANDS = re.compile(r"-?\d{1,3},\d{3}")


@dataclass(frozen=True)
class TreeMap:
    """Trees of a table.

    position : (N, 2) metres. species : (N,) names, "" without such a column. line : (N,) in the file.
    numbers : (N, 7) as ``NUMBERS``, in metres, radians and m², NaN where there is none. said : sentences
    about what was taken for what. crs : the system that the file names, or that it was projected to.
    """

    position: np.ndarray
    species: np.ndarray
    line: np.ndarray
    numbers: np.ndarray
    said: tuple[str, ...] = ()
    crs: str = ""

    def __len__(self) -> int:
        return len(self.position)


@dataclass
class _Sheet:
    """Cells of a table as text: its header, its rows with their lines, the system that it names, and
    columns by what they are: where, in our unit, and the name of the unit if the column says one.
    """

    path: Path
    head: list[str]
    rows: list[tuple[int, list[str]]]
    crs: str = ""
    commas: bool = False  # between columns
    said: list[str] = field(default_factory=list)
    columns: dict[str, tuple[int, float, str]] = field(default_factory=dict)

    def name(self, key: str) -> str:
        """The name of a column in small letters and digits; "" where there is none."""
        return "".join(_plain(self.head[self.columns[key][0]])) if key in self.columns else ""

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
            point = "." in told or (self.commas and THOUSANDS.fullmatch(told))
            with suppress(ValueError):
                numbers[row] = float(told if point else told.replace(",", ".", 1))
            if not math.isfinite(numbers[row]):
                raise SpecError(
                    str(self.path),
                    f'row {self.rows[row][0]}: {key} is "{told}", not a finite number; use metres with a '
                    "decimal point",
                )
        return numbers * self.columns[key][1] if key in self.columns else numbers


@guarded("a table of trees with columns x and y", most=MOST)
def read_tree_map(path: Path, crs: str = "") -> TreeMap:
    """Read where trees stand and what they measure; dead ones are left out, stems of one tree are joined.

    crs : the system of the map that the trees are for, "EPSG:32632".

    Raises
    ------
    SpecError : the file is missing or no table with x and y; a row with what is no finite number; a unit that
    is not known or makes no sense; degrees without a system to project to.
    """
    sheet = _sheet(path)
    columns = _words(sheet)
    position = _position(sheet)
    found = {key: sheet.numbers(key) for key in (*NUMBERS, "girth", "crown_area")}
    found["dbh"] = np.fmax(found["dbh"], found["girth"] / np.pi)
    found["crown_width"] = np.fmax(found["crown_width"], 2 * np.sqrt(found["crown_area"] / np.pi))
    line = np.array([line for line, _ in sheet.rows], dtype=np.int64)
    species = np.array(sheet.texts("species"), dtype=np.str_)
    numbers = np.column_stack([found[key] for key in NUMBERS]).reshape(-1, len(NUMBERS))
    here, alive = np.isfinite(position).all(axis=1), ~_dead(sheet)
    for rows, what in ((~here, "without x or y"), (here & ~alive, "of dead trees")):
        if rows.any():
            count = "1 row" if rows.sum() == 1 else f"{rows.sum():,} rows"
            sheet.said.append(f"{path.name}: left out {count} {what}")
    keep = np.flatnonzero(here & alive)
    position, crs = _projected(sheet, position[keep], crs)
    said = (f"{len(keep):,} trees of {path.name}: {columns}", *sheet.said)
    trees = TreeMap(position, species[keep], line[keep], numbers[keep], said, crs)
    return _with_stems(path, trees)


@guarded("a CSV file with columns x, y and ring", most=MOST)
def read_rings(path: Path) -> list[np.ndarray]:
    """Read the corners of a polygon: its outline and, where a column ``ring`` changes, its holes.

    Raises
    ------
    SpecError : as for a map of trees; a corner without a number.
    """
    sheet = _sheet(path)
    rings: dict[str, list[np.ndarray]] = {}
    corners = _position(sheet)
    for row, ring in enumerate(sheet.texts("ring")):
        if not np.isfinite(corners[row]).all():
            raise SpecError(str(path), f"row {sheet.rows[row][0]} has no x or y; complete the row")
        rings.setdefault(ring, []).append(corners[row])
    return [np.array(ring) for ring in rings.values()]


# ------------------------------------------------------------------------------- what the cells say


# What is told of a table: a file of something else may hold what nobody may read.
HEADING = re.compile(r"[^\W\d][\w .()\[\]²°-]{0,29}")


def _columns(path: Path, head: Sequence[str]) -> dict[str, tuple[int, float, str]]:
    """Place of each kind of column, and its unit in ours.

    Raises
    ------
    SpecError : neither x and y nor distance and azimuth; a unit in brackets that is not known.
    """
    whole = {"".join(_plain(name)): at for at, name in enumerate(head)}
    usual = USUAL | (FIA if FIA_OWN & set(whole) else {})
    column = partial(_column, path, head, usual)
    columns = {key: one for key, names in COLUMNS.items() if (one := column(key, names.split()))}
    pairs = [[column("x", [name]) for name in names.split()] for names in PLACES]
    both = next(filter(all, pairs), None)
    if both:
        columns |= {axis: one for axis, one in zip("xy", both, strict=True) if one}
    elif not {"distance", "azimuth"} <= set(columns):
        axis = "y" if any(x for x, _ in pairs) else "x"
        shown = ", ".join(filter(HEADING.fullmatch, head))
        there = f", only {shown}; call one of them {axis}" if shown else f"; name one {axis}"
        raise SpecError(str(path), f"has no column {axis}{there}, or give distance and azimuth")
    if {"treeid", "z"} <= set(whole) and not {"height", "scale"} & set(columns):
        columns["height"] = (whole["z"], 1.0, "")  # tree tops of lidR
    return columns


def _column(
    path: Path, head: Sequence[str], usual: Mapping[str, str], key: str, names: Sequence[str]
) -> tuple[int, float, str] | None:
    """Place of the column with the first of these names, and its unit; None without one."""
    units = {"": 1.0} if key in TEXTS else UNITS.get(key, LENGTHS)
    plain = [_plain(name) for name in head]
    for name in names:
        for at, words in enumerate(plain):
            if "".join(words) == name:
                unit = usual.get(name, "")
                return at, units[unit or next(iter(units))], unit
        for at, words in enumerate(plain):
            glued = "".join(words).removeprefix(name) if len(name) > 1 else ""
            unit = words[-1] if "".join(words[:-1]) in (name, f"{name}in") else glued
            if unit in units and "".join(words) in (name + unit, f"{name}in{unit}"):
                return at, units[unit], unit
            if "".join(words[:-1]) == name and head[at].strip()[-1] in ")]" and key not in TEXTS:
                raise SpecError(
                    str(path),
                    f'the unit of column "{head[at].strip().lower()}" is not known; use one of '
                    + ", ".join(filter(None, units)),
                )
    return None


def _plain(name: str) -> list[str]:
    """Words of a column's name in small letters without accents: DBH [cm] as dbh, cm."""
    bare = unicodedata.normalize("NFKD", name.casefold())
    return re.findall(r"[a-z0-9%]+", "".join(c for c in bare if not unicodedata.combining(c)))


def _words(sheet: _Sheet) -> str:
    """Say which columns were taken for what, and which were not used."""
    columns = {key: one for key, one in sheet.columns.items() if key not in ("ring", "plot")}
    taken = [
        f"{key} = {sheet.head[at].strip()}{f' ({unit})' if unit else ''}"
        for key, (at, _, unit) in sorted(columns.items(), key=lambda item: item[1][0])
    ]
    used = {at for at, *_ in columns.values()}
    left = [name.strip() for at, name in enumerate(sheet.head) if at not in used and name.strip()]
    missing = {
        word: key for key in {*COLUMNS} - {*columns} for word in COLUMNS[key].split() if word[3:]
    }
    for name in left:
        near = get_close_matches("".join(_plain(name)), missing, 1, LIKE)
        meant = f"{sheet.path.name}: column {name} is not used; did you mean {{}}?"
        sheet.said += [meant.format(missing[word]) for word in near]
    return ", ".join(taken) + (f"; not used: {', '.join(left)}" if left else "")


def _position(sheet: _Sheet) -> np.ndarray:
    """(N, 2) places in the file's own units made metres: x and y, or what distance and azimuth say of them.

    Raises
    ------
    SpecError : an azimuth of more than a turn; several plots without their centres.
    """
    place = np.column_stack([sheet.numbers("x"), sheet.numbers("y")])
    if not {"distance", "azimuth"} <= set(sheet.columns):
        return place
    distance, azimuth = sheet.numbers("distance"), sheet.numbers("azimuth")
    if "x" in sheet.columns:  # of each tree, unless many have the same: a plot's
        if len(np.unique(place, axis=0)) > 0.5 * len(place):
            return place
    elif len({*sheet.texts("plot")}) > 1:
        raise SpecError(
            str(sheet.path), "has trees of several plots; give columns x and y of their centres"
        )
    else:
        place = np.zeros_like(place)
    if np.nanmax(azimuth, initial=0.0) > 2 * np.pi + 1e-9:
        raise SpecError(
            str(sheet.path), "has azimuths above 360 degrees; call the column azimuth_gon"
        )
    sheet.said.append("x and y follow from distance and azimuth, clockwise from north")
    return place + distance[:, None] * np.column_stack([np.sin(azimuth), np.cos(azimuth)])


def _dead(sheet: _Sheet) -> np.ndarray:
    """(N,) bool, which rows say that their tree is dead or gone."""
    told = [text.casefold().partition(",")[0].strip() for text in sheet.texts("status")]
    name = sheet.name("status")
    return np.isin(told, YES if name in ("dead", "tot", "mort") else NO if name in LIVING else GONE)


def _projected(sheet: _Sheet, place: np.ndarray, crs: str) -> tuple[np.ndarray, str]:
    """Places (N, 2) in metres of the map, and its system.

    Raises
    ------
    SpecError : degrees, and no system to project them to.
    """
    if not len(place) or ("distance" in sheet.columns and "x" not in sheet.columns):
        return place, crs
    wide = np.prod(np.ptp(place, axis=0)) / len(place)
    degrees = sheet.name("x").endswith(("lon", "longitude", "long", "lng")) or (
        len(place) > 2 and 0 < wide < CROWDED and (np.abs(place) <= [180.0, 90.0]).all()
    )
    source = sheet.crs or (DEGREES if degrees else "")
    if not source:
        return place, crs
    position, system = moved(source, crs, place)
    if system != crs or source == DEGREES:
        sheet.said.append(f"{sheet.path.name}: coordinates are read in {source}, used in {system}")
    return position, system


def _with_stems(path: Path, trees: TreeMap) -> TreeMap:
    """The trees with rows at one place joined: basal areas add up, of all else the largest counts.

    Raises
    ------
    SpecError : more rows at one place than a tree has stems.
    """
    place = np.round(trees.position, 3)
    _, first, tree, stems = np.unique(
        place, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    if len(first) == len(trees):
        return trees
    if stems.max() > STEMS:
        raise SpecError(
            str(path),
            f"has {stems.max():,} rows at one place, as of a plot; give the place of each tree, or its "
            "distance and azimuth",
        )
    at, numbers = NUMBERS.index("dbh"), np.full((len(first), len(NUMBERS)), np.nan)
    np.fmax.at(numbers, tree.ravel(), trees.numbers)
    area = np.bincount(tree.ravel(), np.nan_to_num(trees.numbers[:, at]) ** 2)
    numbers[:, at] = np.sqrt(np.where(area > 0, area, np.nan))
    trees_with = "1 tree has" if (stems > 1).sum() == 1 else f"{(stems > 1).sum():,} trees have"
    said = (
        f"{path.name}: {trees_with} several stems ({stems[stems > 1].sum():,} rows at one place each), and "
        "is one tree of the same basal area",
    )
    order = np.argsort(first)
    kept = first[order]
    return replace(
        trees,
        position=trees.position[kept],
        species=trees.species[kept],
        line=trees.line[kept],
        numbers=numbers[order],
        said=(*trees.said, *said),
    )


# ---------------------------------------------------------------------------------- files into cells


def _unpacked(path: Path, size: int) -> None:
    """Refuse a file that unpacks to very much more than itself."""
    most = PACKED * path.stat().st_size + 1_000_000
    if size > most:
        raise SpecError(
            str(path), f"unpacks to more than {most / 1e6:,.0f} MB; save it again without packing"
        )


def _text(path: Path) -> _Sheet:
    data = path.read_bytes()
    if data.startswith(b"\x1f\x8b"):
        with gzip.open(path) as file:
            data = file.read(PACKED * len(data) + 1_000_001)
            _unpacked(path, len(data))
    said, encoding = [], "utf-16-le" if data[1:2] == b"\0" else "utf-8-sig"
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):  # byte order marks
        encoding = "utf-16"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError:
        text = data.decode("cp1252")
        said = [f"{path.name}: is not UTF-8; read as Windows' cp1252"]
    lines = [line for line in text.splitlines() if line.strip() and line[0] != "#"]
    head = lines[0] if lines else ""
    if head.lower().startswith("sep="):  # Excel's own line
        separator, head = head[4:5], ""
    else:
        bare = re.sub(r'"[^"]*"', "", head)
        separator = max(";\t|,", key=bare.count)
        separator = separator if separator in bare else " "
    reader = csv.reader(
        io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True, strict=True
    )
    rows, line = [], 1
    for cells in reader:
        if any(map(str.strip, cells)) and not cells[0].startswith("#"):
            rows.append((line, cells))
        line = reader.line_num + 1
    if rows and not head:
        del rows[0]
    sheet = _checked(path, rows, separator == " " or text.splitlines()[-1:][0][:1] == '"')
    sheet.commas, sheet.said = separator == ",", said
    return sheet


def _checked(path: Path, rows: list[tuple[int, list[str]]], named: bool = False) -> _Sheet:
    """The first row as a header, and rows below it that are as long. named : rows may have names, as R's.

    Raises
    ------
    SpecError : no header; a row that is longer or shorter.
    """
    if not rows:
        raise SpecError(str(path), "is empty; it needs a header with x and y, and a row a tree")
    head = rows.pop(0)[1]
    if named and rows and all(len(cells) == len(head) + 1 and cells[-1] for _, cells in rows):
        head = ["", *head]
    for line, cells in rows:
        if len(cells) < len(head):
            raise SpecError(
                str(path),
                f"row {line} has {len(cells)} values, its header {len(head)}; complete the row",
            )
        if any(map(str.strip, cells[len(head) :])):
            raise SpecError(
                str(path),
                f"row {line} has {len(cells)} values, its header {len(head)}; name every column, and put "
                "semicolons between columns whose numbers have decimal commas",
            )
    return _Sheet(path, head, rows)


def _workbook(path: Path) -> _Sheet:
    openpyxl = library(path, "tables", "openpyxl")
    with zipfile.ZipFile(path) as archive:
        _unpacked(path, sum(entry.file_size for entry in archive.infolist()))
    book = openpyxl.load_workbook(path, read_only=True, data_only=True)
    try:
        names, sheet = book.sheetnames, book.worksheets[0]
        rows = [
            (line, ["" if cell is None else str(cell) for cell in cells])
            for line, cells in enumerate(sheet.iter_rows(values_only=True), 1)
            if any(cell is not None for cell in cells)
        ]
    finally:
        book.close()
    found = _checked(path, rows)
    if len(names) > 1:
        found.said.append(f'{path.name}: the first of {len(names)} sheets is read, "{names[0]}"')
    return found


def _geojson(path: Path) -> _Sheet:
    told = json.loads(path.read_bytes())
    features = [(feature["geometry"], feature["properties"] or {}) for feature in told["features"]]
    named = (told.get("crs") or {}).get("properties", {}).get("name", "")
    return _features(path, features, named)


def _layer(path: Path) -> _Sheet:
    pyogrio, shapely = library(path, "tables", "pyogrio.raw"), library(path, "tables", "shapely")
    told, _, shapes, values = pyogrio.read(path)
    features = [
        (
            shape and json.loads(shapely.to_geojson(shapely.from_wkb(shape))),
            {name: cells[row] for name, cells in zip(told["fields"], values, strict=True)},
        )
        for row, shape in enumerate(shapes)
    ]
    return _features(path, features, told["crs"] or "")


def _features(
    path: Path, features: Sequence[tuple[Mapping[str, Any] | None, Mapping[str, Any]]], crs: str
) -> _Sheet:
    """A sheet of features, each a geometry and its properties; those give way to places and widths."""
    told = []
    for geometry, properties in features:
        place = _shape(geometry) if geometry else {}
        told.append(place | {k: cell for k, cell in properties.items() if k.lower() not in place})
    head = list(dict.fromkeys(["x", "y", *chain.from_iterable(told)]))
    cells = [["" if one.get(name) is None else str(one[name]) for name in head] for one in told]
    return _Sheet(path, head, list(enumerate(cells, 1)), crs)


def _shape(geometry: Mapping[str, Any]) -> dict[str, Any]:
    """The place of a point, or the middle and mean diameter of a polygon."""
    kind, corners = geometry["type"], geometry["coordinates"]
    if "Point" in kind:
        return dict(zip("xy", np.ravel(corners).tolist(), strict=False))
    outlines = [rings[0] for rings in ([corners] if kind == "Polygon" else corners)]
    outline = max(outlines, key=len)
    hull = ConvexHull(np.array([corner[:2] for corner in outline], dtype=np.float64))
    first, *ring = hull.points[hull.vertices]
    middles = (first + ring[:-1] + ring[1:]) / 3  # of a fan of triangles
    area = np.linalg.det(np.stack([ring[:-1] - first, ring[1:] - first], axis=1))
    x, y = np.average(middles, axis=0, weights=area).tolist()
    return {"x": x, "y": y, "crown_width": hull.area / np.pi}  # the perimeter, by Cauchy


READERS = {".xlsx": _workbook, ".xlsm": _workbook, ".geojson": _geojson, ".json": _geojson}
READERS |= dict.fromkeys((".gpkg", ".shp", ".fgb"), _layer)


def _sheet(path: Path) -> _Sheet:
    """Read the cells of a table by the ending of its name, and tell its columns."""
    sheet = READERS.get(path.suffix.lower(), _text)(path)
    sheet.columns = _columns(path, sheet.head)
    return sheet
