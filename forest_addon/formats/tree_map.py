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

import json
import math
import re
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from ..spec import SpecError
from .crs import moved, refuse_far
from .foreign import guarded, library
from .table import (
    ANGLES,
    AREAS,
    LENGTHS,
    TITLES,
    Sheet,
    read_text,
    refuse_unpacked,
    sheet_of,
    words_of,
)

PLACES = (  # names of x and y, the first pair that a table has
    *("x y", "xutm yutm", "utmx utmy", "utme utmn", "adjeasting adjnorthing", "easting northing"),
    *("east north", "gx gy", "px py", "pointx pointy", "xcoord ycoord", "coordx coordy"),
    *("utmost utmnord", "utmeasting utmnorthing", "utmrechtswert utmhochwert", "ostutm nordutm"),
    *("eastingutm northingutm", "eastutm northutm", "eutm nutm"),
    *("xkoordinate ykoordinate", "koordinatex koordinatey", "xkoord ykoord"),
    *("rechtswert hochwert", "ostwert nordwert", "xl93 yl93", "xlambert93 ylambert93", "est nord"),
    *("ost nord", "este norte", "leste norte", "coordenadax coordenaday", "eastings northings"),
    *("longitud latitud", "longitudine latitudine", "utmeast utmnorth"),
    *("rechts hoch", "gausskrugerrechts gausskrugerhoch", "gkrechts gkhoch"),
    *("e n", "longitude latitude", "lon lat", "long lat", "lng lat"),
    *("decimallongitude decimallatitude", "longitudedeg latitudedeg", "londeg latdeg"),
)
COLUMNS = {
    "species": "species kind planting sp spp spcode speciescode scientificname taxonid treespecies "
    "symbol speciessymbol commonname baumart artname art spcd "
    "espar essence espece especie specie tradslag puulaji "
    "boomsoort gatunek drevina порода 树种 樹種",
    "ring": "ring part",
    "status": "status treestatus plantstatus dfstatus statuscd zustand etat dead tot mort "
    "alive live lebend vivant estado stato situacao tillstand stan muerto morto vivo dod dood",
    "zone": "utmzone zoneutm",
    "plot": "plot plotid",
    "subplot": "subplot subp",
    "census": "census year invyr measyear jahr annee aufnahmejahr",
    "scale": "scale",
    "rotation": "rotation turn",
    "dbh": "dbh bhd d13 d130 dhp dap stemdiameter dia diam diameter durchmesser diametre "
    "brusthohendurchmesser brusthoehendurchmesser diameterbreastheight diametro "
    "brosthojdsdiameter lapimitta piersnica vycetnitloustka диаметр 胸径 胸高直径",
    "girth": "gbh cbh girth circumference circ c13 c130 umfang circonference "
    "circunferencia cap circonferenza omtrek omkrets obwod obvod",
    "height": "height h ht hoehe hohe baumhohe baumhoehe hauteur htot treeheight totalheight actualht "
    "altura altezza hojd pituus hoogte wysokosc vyska højde высота 树高 樹高",
    "crown_width": "crownwidth crowndiameter crowndiam maxcrowndiameter kronendurchmesser "
    "kronenbreite crownspread diametrehouppier",
    "crown_radius": "crownradius crownrad kronenradius",
    "crown_area": "crownarea convhullarea kronenflache",
    "crown_base": "crownbase crownbaseheight basecrownheight heightcrownbase hcb kronenansatz "
    "kronenansatzhohe",
    "leaf_area": "leafarea blattflache",
    "distance": "horizontaldistance hdist distance dist stemdistance entfernung distanz dpr "
    "distancia distanza afstand avstand odleglosc",
    "azimuth": "azimuth azimut stemazimuth azi az bearing azpr acimut azymut",
}
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
GROUPS = ("plot", "subplot", "census")  # of trees that may not stand together
TEXTS = ("species", "ring", "status", "zone", *GROUPS)
NUMBERS = ("scale", "rotation", "dbh", "height", "crown_width", "crown_base", "leaf_area")
SAID = ("species", *NUMBERS)  # that a longer name may mean
NOTHING = (-999.0, -9999.0, -99999.0)  # the same in numbers
GONE = (  # without accents; with letters of ForestGEO and numbers of FIA
    "dead|standing dead|dead standing|dead fallen|snag|downed|removed|missing|lost|stump|cut|felled|"
    "fallen|harvested|tot|stehend tot|liegend tot|totholz|abgestorben|gefallt|mort|morte|mort sur pied|"
    "mort au sol|chablis|chandelle|souche|muerto|muerta|muerto en pie|tocon|morto|morta|morto in piedi|"
    "dood|dode|dod|kuollut|martwe|martwy|martwa|d|g|m|2|3"
)
YES = ("1", "true", "t", "yes", "y", "ja", "oui", "si", "sim", "wahr", "vrai", "x", "dead")
NO = ("0", "false", "f", "no", "n", "nein", "non", "nao", "falsch", "faux", "dead")
LIVING = (
    "alive",
    "live",
    "lebend",
    "vivant",
    "vivante",
    "vivo",
    "viva",
    "levend",
    "levande",
    "zywe",
)
MOST = 500_000_000  # bytes of a table
LIKE = 0.8  # of a column's name, beyond which it is a slip of the keyboard
STEMS = 50  # rows at one place that may be one tree
REACH = 200.0  # m from the middle of a plot, that half its trees are within
FEW = 4  # azimuths that do not lie in the first 6 degrees by chance
FAR = 1e5  # m from the origin of a map
CROWDED = 0.02  # m² a tree, below which numbers that may be degrees are degrees
DEGREES = "EPSG:4326"


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
    found = {key: sheet.numbers(key) for key in (*NUMBERS, "girth", "crown_area", "crown_radius")}
    found["dbh"] = np.fmax(found["dbh"], found["girth"] / np.pi)
    found["crown_width"] = np.fmax(found["crown_width"], 2 * found["crown_radius"])
    found["crown_width"] = np.fmax(found["crown_width"], 2 * np.sqrt(found["crown_area"] / np.pi))
    line = np.array([line for line, _ in sheet.rows], dtype=np.int64)
    groups = [*zip(*map(sheet.texts, GROUPS), strict=True)]
    species = np.array([name.removesuffix(".0") for name in sheet.texts("species")], dtype=np.str_)
    numbers = np.column_stack([found[key] for key in NUMBERS]).reshape(-1, len(NUMBERS))
    here = np.isfinite(position).all(axis=1)
    told = [text.partition(",")[0].removesuffix(".0") for text in sheet.texts("status")]
    told = [" ".join(words_of(text)) for text in told]
    if others := sorted({*told} - {*GONE.split("|"), *YES, *NO, *LIVING, "", "a", "l", "p", "v"})[
        :STEMS
    ]:
        sheet.said.append(f"{path.name}: taken for living: status {', '.join(others)}")
    words = dict.fromkeys(
        ["dead", "tot", "mort", "muerto", "morto", "dod", "dood"], YES
    ) | dict.fromkeys(LIVING, NO)
    alive = ~np.isin(told, words.get(sheet.name("status"), GONE.split("|")))
    if len({*sheet.texts("zone")} - {""}) > 1:
        raise SpecError(str(path), "has trees of several UTM zones; give each zone its own table")
    if np.nanmax(np.abs(found["rotation"]), initial=0.0) > 2 * np.pi + 1e-9:
        raise SpecError(
            str(path), "has rotations of more than a turn; call the column rotation_deg or _gon"
        )
    for key in GROUPS:
        if (many := len({*sheet.texts(key)})) > 1:
            name = sheet.head[sheet.columns[key][0]].strip()
            sheet.said.append(f"{path.name}: rows of {many} values of {name} are taken together")
    for rows, what in ((~here, "without x or y"), (here & ~alive, "of dead trees")):
        if rows.any():
            count = "1 row" if rows.sum() == 1 else f"{rows.sum():,} rows"
            sheet.said.append(f"{path.name}: left out {count} {what}")
    keep = np.flatnonzero(here & alive)
    position, crs = _projected(sheet, position[keep], crs)
    count = "1 tree" if len(keep) == 1 else f"{len(keep):,} trees"
    said = (f"{count} of {path.name}: {columns}", *sheet.said)
    trees = TreeMap(position, species[keep], line[keep], numbers[keep], said, crs)
    joined = _with_stems(
        path, trees, [groups[row] for row in keep], [sheet.rows[row] for row in keep]
    )
    return replace(joined, said=(*joined.said, *_into_each_other(path, joined)))


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
    whole = {"".join(words_of(name)): at for at, name in enumerate(head)}
    usual = USUAL | (FIA if FIA_OWN & set(whole) else {})
    column = partial(column_of, path, head, usual)
    columns = {key: one for key, names in COLUMNS.items() if (one := column(key, names.split()))}
    pairs = pairs_of(path, head)
    both = next(filter(all, pairs), None)
    if both:
        columns |= {axis: one for axis, one in zip("xy", both, strict=True) if one}
    elif not {"distance", "azimuth"} <= set(columns):
        axis, asked = ("y", "y") if any(x for x, _ in pairs) else ("x", "x, another y")
        shown = ", ".join(filter(HEADING.fullmatch, head))
        there = f", only {shown}; call one of them {asked}" if shown else f"; name one {axis}"
        raise SpecError(str(path), f"has no column {axis}{there}, or give distance and azimuth")
    if {"treeid", "z"} <= set(whole) and not {"height", "scale"} & set(columns):
        columns["height"] = (whole["z"], 1.0, "")  # tree tops of lidR
    return columns


def pairs_of(path: Path, head: Sequence[str]) -> list[list[tuple[int, float, str] | None]]:
    """Columns of x and y by each of ``PLACES``."""
    return [[column_of(path, head, {}, "x", [name]) for name in pair.split()] for pair in PLACES]


def column_of(
    path: Path, head: Sequence[str], usual: Mapping[str, str], key: str, names: Sequence[str]
) -> tuple[int, float, str] | None:
    """Place of the column with the first of these names, its unit in ours and the unit's name; None without
    one.
    """
    units = {"": 1.0} if key in TEXTS else UNITS.get(key, LENGTHS)
    plain = [words_of(name) for name in head]
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


def _words(sheet: Sheet) -> str:
    """Say which columns were taken for what, and which were not used."""
    aside = ("ring", "zone", *GROUPS)
    columns = {key: one for key, one in sheet.columns.items() if key not in aside}
    taken = [
        f"{key} = {sheet.head[at].strip()}"
        + ("" if unit in ("", *words_of(sheet.head[at])) else f" ({unit})")
        for key, (at, _, unit) in sorted(columns.items(), key=lambda item: item[1][0])
    ]
    used = {at for at, *_ in columns.values()}
    left = [name.strip() for at, name in enumerate(sheet.head) if at not in used and name.strip()]
    missing = {word: key for key in {*COLUMNS} - {*sheet.columns} for word in COLUMNS[key].split()}
    for name in left:
        whole = "".join(words_of(name))
        begun = [w for w in missing if w[2:] and whole.startswith(w) and missing[w] in SAID]
        near = get_close_matches(whole, [w for w in missing if w[3:]], 1, LIKE) or begun[:1]
        meant = f"{sheet.path.name}: column {name} is not used; did you mean {{}}?"
        sheet.said += [meant.format(missing[word]) for word in near]
    return ", ".join(taken) + (f"; not used: {', '.join(left)}" if left else "")


def _position(sheet: Sheet) -> np.ndarray:
    """(N, 2) places in the file's own units made metres: x and y, or what distance and azimuth say of them.

    Raises
    ------
    SpecError : an azimuth of more than a turn; several plots without their centres.
    """
    place = np.column_stack([sheet.numbers("x"), sheet.numbers("y")])
    if not {"distance", "azimuth"} <= set(sheet.columns):
        return place
    distance, azimuth = sheet.numbers("distance"), sheet.numbers("azimuth")
    unit = sheet.columns["azimuth"][2]
    if "x" in sheet.columns:  # of each tree, unless many have the same: a plot's
        if len(np.unique(place, axis=0)) > 0.5 * len(place):
            return place
    elif len({*zip(*map(sheet.texts, ("plot", "subplot")), strict=True)}) > 1:
        raise SpecError(
            str(sheet.path), "has trees of several plots; give columns x and y of their centres"
        )
    else:
        place = np.zeros_like(place)
    if np.nanmin(distance, initial=0.0) < 0:
        raise SpecError(str(sheet.path), "has distances below 0; give each as a length from 0 on")
    if np.isfinite(distance).any() and np.nanmedian(distance) > REACH:
        raise SpecError(
            str(sheet.path),
            f"has distances of {np.nanmedian(distance):,.4g} m in the median, which no plot is wide; say the "
            "unit in the header, as distance_cm",
        )
    if np.nanmax(azimuth, initial=0.0) > 2 * np.pi + 1e-9:
        raise SpecError(
            str(sheet.path), "has azimuths above 360 degrees; call the column azimuth_gon"
        )
    if len(azimuth) >= FEW and 0 < np.nanmax(azimuth) <= np.radians(2 * np.pi) and unit != "rad":
        raise SpecError(
            str(sheet.path), "has no azimuth above 6.3; call the column azimuth_rad or azimuth_gon"
        )
    sheet.said.append(
        f"x and y follow from distance, taken as horizontal, and azimuth in {unit or 'deg'}, clockwise from "
        "the map's north (not the magnetic one)"
    )
    return place + distance[:, None] * np.column_stack([np.sin(azimuth), np.cos(azimuth)])


def _projected(sheet: Sheet, place: np.ndarray, crs: str) -> tuple[np.ndarray, str]:
    """Places (N, 2) in metres of the map, and its system.

    Raises
    ------
    SpecError : degrees, and no system to project them to.
    """
    if not len(place) or ("distance" in sheet.columns and "x" not in sheet.columns):
        return place, crs
    wide = np.ptp(place, axis=0).max() ** 2 / len(place)
    degrees = re.search("lon|lng", sheet.name("x")) or (
        0 < wide < CROWDED and (np.abs(place) <= [180.0, 90.0]).all()
    )
    source = sheet.crs or (DEGREES if degrees else "")
    if not source:
        east, north = np.abs(np.median(place, axis=0))
        if crs:
            refuse_far(crs, place)
        elif east > north > FAR:
            sheet.said.append(
                f"{sheet.path.name}: x, {east:,.0f} m, is taken for east and y, {north:,.0f} m, for north; "
                "exchange the names if it is the other way round"
            )
        return place, crs
    position, system = moved(source, crs, place)
    if system != crs or source != system:
        sheet.said.append(
            f"{sheet.path.name}: coordinates are read in {source}, used in {system or 'its metres'}"
        )
    return position, system


def _with_stems(
    path: Path,
    trees: TreeMap,
    groups: Sequence[tuple[str, ...]],
    rows: Sequence[tuple[int, list[str]]],
) -> TreeMap:
    """The trees with rows at one place joined: basal areas add up, of all else the largest counts.

    groups : (N,) plot, subplot and census of each row. rows : (N,) their lines and cells.

    Raises
    ------
    SpecError : more rows at one place than a tree has stems, or of different plots or censuses; a row that is
    there twice.
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
    if len({*zip(tree.ravel().tolist(), groups, strict=True)}) > len(first):
        raise SpecError(
            str(path),
            "has rows of several plots or years at one place; give each its own table, or each plot its "
            "coordinates",
        )
    lines: dict[tuple[str, ...], int] = {}
    for line, cells in rows:
        before = lines.setdefault(tuple(cells), line)
        if before != line:
            raise SpecError(
                str(path),
                f"row {line} is row {before} again, cell for cell; remove it, or number the stems of a tree "
                "in a column of their own",
            )
    at, numbers = NUMBERS.index("dbh"), np.full((len(first), len(NUMBERS)), np.nan)
    np.fmax.at(numbers, tree.ravel(), trees.numbers)
    area = np.bincount(tree.ravel(), np.nan_to_num(trees.numbers[:, at]) ** 2)
    numbers[:, at] = np.sqrt(np.where(area > 0, area, np.nan))
    several, count = int((stems > 1).sum()), stems[stems > 1].sum()
    what = "1 tree has" if several == 1 else f"{several:,} trees have"
    said = (
        f"{path.name}: {what} several stems ({count:,} rows in all at one place each), and counts as one of "
        "the same basal area",
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


def _into_each_other(path: Path, trees: TreeMap) -> list[str]:
    """A sentence on trees that stand nearer to their nearest than the radii of both trunks reach."""
    radius = np.append(trees.numbers[:, NUMBERS.index("dbh")] / 2, np.nan)  # the last of no tree
    apart, nearest = scipy.spatial.cKDTree(trees.position).query(trees.position, k=[2])
    close = np.flatnonzero(apart[:, 0] < radius[:-1] + radius[nearest[:, 0]]).tolist()
    pairs = sorted({(*sorted((row, int(nearest[row, 0]))), apart[row, 0]) for row in close})
    rows = [f"{trees.line[a]} and {trees.line[b]} ({gap:.2g} m)" for a, b, gap in pairs[:STEMS]]
    said = (
        f"{path.name}: trees stand nearer to each other than their trunks are thick, pairs in all "
        f"{len(pairs):,}: rows {', '.join(rows)}; did you mean one tree each?"
    )
    return [said] if pairs else []


# ---------------------------------------------------------------------------------- files into cells


def _is_head(path: Path, cells: Sequence[str]) -> bool:
    """Return whether cells are names of columns that tell where trees stand."""
    way = (column_of(path, cells, {}, key, COLUMNS[key].split()) for key in ("distance", "azimuth"))
    return any(map(all, pairs_of(path, cells))) or all(way)


def _workbook(path: Path) -> Sheet:
    """The first sheet of a workbook with columns that tell places.

    Raises
    ------
    SpecError : none has; a formula that was never computed.
    """
    openpyxl = library(path, "tables", "openpyxl")
    book, formulas = (
        openpyxl.load_workbook(path, read_only=True, data_only=computed)
        for computed in (True, False)
    )
    names = [sheet.title for sheet in book.worksheets]
    try:
        for name in names:
            rows = []
            sheets = (each[name].iter_rows(values_only=True) for each in (book, formulas))
            for line, (cells, told) in enumerate(zip(*sheets, strict=True), 1):
                if any(a is None and str(b)[:1] == "=" for a, b in zip(cells, told, strict=True)):
                    raise SpecError(
                        str(path),
                        f'row {line} of "{name}" has a formula without its result; open and save it in a '
                        "spreadsheet",
                    )
                if any(cell is not None for cell in cells):
                    rows.append((line, ["" if cell is None else str(cell) for cell in cells]))
            if len(names) == 1 or any(_is_head(path, cells) for _, cells in rows[:TITLES]):
                break
        else:
            raise SpecError(
                str(path),
                "has no sheet with columns x and y, or distance and azimuth; its sheets are "
                + ", ".join(names),
            )
    finally:
        book.close()
        formulas.close()
    found = sheet_of(path, rows, partial(_is_head, path))
    if len(names) > 1:
        found.said.append(f'{path.name}: of {len(names)} sheets "{name}" is read')
    return found


def _geojson(path: Path) -> Sheet:
    told = json.loads(path.read_bytes())
    features = [
        (feature["geometry"], feature["properties"] or {})
        for feature in told.get("features", [told])
    ]
    named = (told.get("crs") or {}).get("properties", {}).get("name", "")
    return _features(path, features, named)


def _layer(path: Path) -> Sheet:
    pyogrio, shapely = library(path, "tables", "pyogrio"), library(path, "tables", "shapely")
    beside = (path.with_suffix(ending) for ending in (".dbf", ".DBF"))
    if path.suffix.lower() == ".shp" and not any(map(Path.is_file, beside)):
        raise SpecError(
            str(path), "has no .dbf beside it, which says what trees are; copy all its files"
        )
    layers = [(kind or "", name) for name, kind in pyogrio.list_layers(path)]
    name = next((name for kind, name in layers if "Point" in kind), layers[0][1])
    unsaid = path.suffix.lower() in (".shp", ".zip") and not path.with_suffix(".cpg").is_file()
    try:
        told, _, shapes, values = pyogrio.raw.read(
            path, layer=name, encoding="UTF-8" if unsaid else None
        )
    except UnicodeDecodeError:
        told, _, shapes, values = pyogrio.raw.read(path, layer=name)
    features = [
        (
            shape and json.loads(shapely.to_geojson(shapely.from_wkb(shape))),
            {name: cells[row] for name, cells in zip(told["fields"], values, strict=True)},
        )
        for row, shape in enumerate(shapes)
    ]
    sheet = _features(path, features, told["crs"] or "")
    sheet.said += [f'{path.name}: of {len(layers)} layers "{name}" is read'] * (len(layers) > 1)
    if told["encoding"] != "UTF-8":  # GDAL's guess, where nothing says what letters are
        sheet.said.append(f"{path.name}: is not UTF-8; read as {told['encoding']}")
    return sheet


def _archive(path: Path) -> Sheet:
    """The one table in a zip, whatever folder of it holds it, or the layers of several shapefiles.

    Raises
    ------
    SpecError : it holds none, or several.
    """
    with zipfile.ZipFile(path) as archive, tempfile.TemporaryDirectory() as folder:
        names = [
            n for n in archive.namelist() if Path(n).suffix.lower() in INSIDE and "/." not in n
        ]
        if len(names) > 1 and {name.lower()[-4:] for name in names} == {".shp"}:
            return _layer(path)
        if len(names) != 1:
            held = f"tables {', '.join(names)}" if names else "no table"
            raise SpecError(str(path), f"holds {held}; unpack it and name one file of trees")
        stem = names[0].rpartition(".")[0].lower()  # as of all files of a shapefile
        beside = [one for one in archive.infolist() if one.filename.lower().startswith(f"{stem}.")]
        if sum(one.file_size for one in beside) > MOST:
            raise SpecError(
                str(path), f"holds more than {MOST / 1e6:.0f} MB; unpack it, give a part"
            )
        archive.extractall(folder, beside)
        try:
            sheet = _sheet(Path(folder) / names[0])
        except SpecError as problem:
            raise SpecError(f"{path}: {names[0]}", problem.problem) from None
    return replace(sheet, path=path)


SHAPES = {"Point": 3, "MultiPoint": 1, "Polygon": math.inf, "MultiPolygon": math.inf}  # most parts


def _features(path: Path, features: Sequence[tuple[Any, Mapping[str, Any]]], crs: str) -> Sheet:
    """A sheet of features, each a geometry and its properties; those give way to places and widths."""
    told = []
    for geometry, properties in features:
        there = geometry.get("coordinates", [0, 1]) if geometry else None
        if there and (geometry["type"] not in SHAPES or len(there) > SHAPES[geometry["type"]]):
            raise SpecError(
                str(path),
                f"has a {geometry['type']}; give trees as points, each its own, or crowns as polygons",
            )
        place = _shape(geometry) if there and there != [[]] else {}
        told.append(place | {k: cell for k, cell in properties.items() if k.lower() not in place})
    head = list(dict.fromkeys(["x", "y", *chain.from_iterable(told)]))
    cells = [["" if one.get(name) is None else str(one[name]) for name in head] for one in told]
    return Sheet(path, head, list(enumerate(cells, 1)), crs)


def _shape(geometry: Mapping[str, Any]) -> dict[str, Any]:
    """The place of a point, or the middle and mean diameter of a polygon."""
    kind, corners = geometry["type"], geometry["coordinates"]
    if "Point" in kind:
        return dict(zip("xy", np.ravel(corners).tolist(), strict=False))
    outlines = [rings[0] for rings in ([corners] if kind == "Polygon" else corners)]
    outline = max(outlines, key=len)
    hull = scipy.spatial.ConvexHull(np.array([corner[:2] for corner in outline], dtype=np.float64))
    first, *ring = hull.points[hull.vertices]
    middles = (first + ring[:-1] + ring[1:]) / 3  # of a fan of triangles
    area = np.linalg.det(np.stack([ring[:-1] - first, ring[1:] - first], axis=1))
    x, y = np.average(middles, axis=0, weights=area).tolist()
    return {"x": x, "y": y, "crown_width": hull.area / np.pi}  # the perimeter, by Cauchy


READERS = {".xlsx": _workbook, ".xlsm": _workbook, ".geojson": _geojson, ".json": _geojson}
READERS |= dict.fromkeys((".gpkg", ".shp", ".fgb"), _layer)
INSIDE = (*READERS, ".csv", ".tsv", ".txt")  # of a zip
READERS |= {".zip": _archive}
UNREAD = (
    *(".xls", ".ods", ".parquet", ".dbf", ".kml", ".kmz", ".gpx", ".pdf", ".doc", ".docx"),
    *(".mat", ".rds", ".db", ".sqlite", ".gdb", ".tab", ".dxf"),
)


def _sheet(path: Path) -> Sheet:
    """Read the cells of a table by the ending of its name, and tell its columns."""
    ending = path.suffix.lower()
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            refuse_unpacked(path, sum(entry.file_size for entry in archive.infolist()))
    if ending in UNREAD:
        raise SpecError(
            str(path), f"is a kind of table that is not read, {ending}; save it as .csv or .xlsx"
        )
    sheet = READERS[ending](path) if ending in READERS else read_text(path, partial(_is_head, path))
    sheet.columns, sheet.nothing = _columns(path, sheet.head), NOTHING
    return sheet
