"""Coordinate reference systems by name, as the WKT that files hold; by pyproj, which Blender lacks."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..spec import SpecError
from ..spec.forest import METRES

EPSG_UNITS = {  # metre, feet international, of the US, of Clarke, of India, yard, kilometre, cm, mm
    9001: METRES["m"],
    9002: METRES["ft"],
    9003: METRES["us-ft"],
    9005: 0.3047972654,
    9080: 0.3047995102,
    9096: 0.9144,
    9036: 1000.0,
    1033: METRES["cm"],
    1025: METRES["mm"],
}
UNITS = METRES | {
    f"{part}{end}": METRES[unit]
    for part, unit in (("", "m"), ("deci", "dm"), ("centi", "cm"), ("milli", "mm"))
    for end in ("metre", "meter", "metres", "meters")
}
GEO_KEYS = {  # of GeoTIFF, by their numbers
    1024: "GTModelTypeGeoKey",
    2048: "GeographicTypeGeoKey",
    3072: "ProjectedCSTypeGeoKey",
    3076: "ProjLinearUnitsGeoKey",
    3077: "ProjLinearUnitSizeGeoKey",
    4096: "VerticalCSTypeGeoKey",
    4099: "VerticalUnitsGeoKey",
}
MODEL, GLOBE, PLANE, UNIT, UNIT_SIZE, HEIGHT, HEIGHT_UNIT = GEO_KEYS
IN_DEGREES, GEOCENTRIC, CODES = 2, 3, range(1024, 32767)  # models; codes that are EPSG's
AWAY = 10.0  # degrees beside a system's area of use, beyond which places are taken for a slip
URN = re.compile(r"urn:ogc:def:crs:(\w+):[^:]*:")


def can_tell_crs() -> bool:
    """Return whether pyproj is there, without which files are written without their coordinate system."""
    return find_spec("pyproj") is not None


def to_map(crs: str, longitude: np.ndarray, latitude: np.ndarray) -> tuple[np.ndarray, ...]:
    """East and north (N,) metres of degrees (N,) in a map's system, and its grid convergence, degrees.

    Raises
    ------
    SpecError : pyproj is not there; PROJ knows no system of this name.
    """
    if not can_tell_crs():
        raise SpecError("crs", "needs pyproj; install it by pip install pyproj")
    known = _known(crs)
    import pyproj

    east, north = moved("EPSG:4326", crs, np.column_stack([longitude, latitude]))[0].T
    factors = pyproj.Proj(known).get_factors(longitude, latitude)
    return east, north, np.asarray(factors.meridian_convergence)


def unit_named(unit: object, otherwise: float) -> float:
    """Metres of a unit of length by its EPSG number or its word, as "US survey foot"; None: otherwise.

    Raises
    ------
    SpecError : a number that is of no unit that is known.
    """
    if unit is None or unit == "":
        return otherwise
    if isinstance(unit, int):
        if unit not in EPSG_UNITS:
            raise SpecError("crs", f"it counts in unit {unit} of EPSG; convert it to metres")
        return EPSG_UNITS[unit]
    word = str(unit).strip().lower()
    if "ft" in word or "foot" in word or "feet" in word:
        return METRES["us-ft" if "us" in word else "ft"]
    return UNITS.get(word, otherwise)


def system_of(
    path: Path, told: str, keys: Mapping[int, Any], otherwise: str = ""
) -> tuple[str, float, float]:
    """Name of a file's coordinate system, and metres of its units on the map and in height.

    told : its WKT. keys : numbers of ``GEO_KEYS``, which count where there is none. otherwise : the system of
    a file that names none.

    Raises
    ------
    SpecError : it is in degrees or not known, or counts in a unit that is not known.
    """
    code = next((keys[key] for key in (PLANE, GLOBE) if keys.get(key) in CODES), None)
    crs = told or (f"EPSG:{code}" if code else otherwise)
    try:
        if not crs and keys.get(MODEL) == IN_DEGREES:
            raise SpecError("crs", "it is in degrees; project it to metres")
        if not crs and keys.get(MODEL) == GEOCENTRIC:
            raise SpecError("crs", "it counts from the middle of the Earth; project it to metres")
        flat, up = metres_of(crs, keys.get(UNIT_SIZE) or unit_named(keys.get(UNIT), 1.0))
        with suppress(SpecError):  # some give a datum for the system of heights
            if code and not told and keys.get(HEIGHT) in CODES:
                flat, up = metres_of(f"{crs}+{keys[HEIGHT]}", flat)
        return crs, flat, unit_named(keys.get(HEIGHT_UNIT), up)
    except SpecError as problem:
        raise SpecError(str(path), f"has a system that cannot be used: {problem.problem}") from None


def metres_of(crs: str, otherwise: float = 1.0) -> tuple[float, float]:
    """Metres of a system's units along x and y, and of its heights; those of a plane system are as its plane.

    otherwise : of a system without a name, and where pyproj is missing.

    Raises
    ------
    SpecError : PROJ knows no system of this name, or it counts in degrees; names the nearest in metres.
    """
    if not crs or not can_tell_crs():
        return otherwise, otherwise
    known = _known(crs)
    axes = known.axis_info
    if not axes or known.is_geographic or known.is_geocentric or "degree" in axes[0].unit_name:
        raise SpecError(
            "crs",
            f'"{short(crs)}" is in degrees, or counts from the middle of the Earth, and not in metres on a '
            f"map; take {nearest_metric(crs)}",
        )
    flat = axes[0].unit_conversion_factor
    return flat, axes[2].unit_conversion_factor if len(axes) > 2 else flat


def nearest_metric(crs: str) -> str:
    """The name of the system in metres that is most like one: its twin in metres, else the UTM zone of the
    middle of its area."""
    import pyproj

    known = _known(crs)
    flat = known.sub_crs_list[0] if known.is_compound else known
    area = flat.area_of_use
    plain = flat.name.split(" (")[0].split(" + ")[0]
    for one in pyproj.database.query_crs_info(
        auth_name="EPSG", pj_types=pyproj.enums.PJType.PROJECTED_CRS
    ):
        same = flat.is_projected and one.name == plain and not one.deprecated
        if same and metres_of(f"EPSG:{one.code}")[0] == 1.0:  # a twin may be in links
            return f"EPSG:{one.code}"
    if area is None or ((area.east - area.west) % 360.0 or 360.0) > 60:
        return "a UTM zone, such as EPSG:32632"
    return metric_near((area.west + area.east) / 2, (area.south + area.north) / 2)


def metric_near(longitude: float, latitude: float) -> str:
    """The UTM zone of a place in degrees."""
    zone = int((longitude + 180) // 6) % 60 + 1
    return f"EPSG:{(32600 if latitude >= 0 else 32700) + zone}"


def in_metres(crs: str, place: np.ndarray) -> str:
    """The name of a system, or of its twin in metres, which has the same metres (2,); empty if none has."""
    if not crs or not can_tell_crs():
        return crs
    if not np.allclose(metres_of(crs), 1.0, rtol=0, atol=1e-9):
        twin = nearest_metric(crs)
        return twin if twin.startswith("EPSG:") and same_place(crs, twin, place) else ""
    known = _known(crs)
    names = [part.to_authority() for part in known.sub_crs_list or [known]]
    if not all(names):
        return crs
    return ":".join(names[0]) + "".join(f"+{code}" for _, code in names[1:])


def same_place(one: str, other: str, place: np.ndarray) -> bool:
    """Return whether metres (2,) in one system are the same metres in another, to a metre and a half; True
    where either is not named."""
    if one == other or not one or not other or not can_tell_crs():
        return True
    there, _ = moved(one, other, np.reshape(place, (1, 2)) / metres_of(one)[0])
    return bool(np.linalg.norm(there - place) < 1.5)


def short(crs: str) -> str:
    """The name of a system: of WKT the first in quotes."""
    return crs.split('"')[1] if '"' in crs else crs


def moved(source: str, target: str, place: np.ndarray) -> tuple[np.ndarray, str]:
    """Places (N, 2) of one system as metres of another, or without a target of their own; and its name.

    Raises
    ------
    SpecError : degrees and no map to project them to; pyproj is needed and not there; an unknown system.
    """
    source = URN.sub(r"\1:", source)
    if source == target:
        return place, target
    if not can_tell_crs():
        raise SpecError("crs", f'is "{target}", not {source}; without pyproj it must be the same')
    import pyproj

    known = _known(source)
    east, north = place.mean(axis=0) if len(place) else (0.0, 0.0)
    if not target and known.is_geographic:
        raise SpecError(
            "crs",
            f'coordinates are degrees; name a system in metres, as "{metric_near(east, north)}" at '
            f"{north:.3g} north and {east:.3g} east: --crs of a command, crs of a scene",
        )
    if not target:
        authority, metres = known.to_authority(), metres_of(source)[0]
        return place * metres, ":".join(authority) if authority and metres == 1 else ""
    change = pyproj.Transformer.from_crs(known, _known(target), always_xy=True)
    if known.is_geographic:
        refuse_far(target, place, in_degrees=True)
    return metres_of(target)[0] * np.array(change.transform(*place.T)).T, target


def refuse_far(
    crs: str, place: np.ndarray, in_degrees: bool = False, what: str = "coordinates"
) -> None:
    """Refuse places (N, 2), in metres of a system or in degrees, whose middle is far from where it is used.

    what : they are, in words.

    Raises
    ------
    SpecError : says where they are.
    """
    if not crs or not can_tell_crs() or not len(place):
        return
    import pyproj

    known = _known(crs)
    area, (x, y) = known.area_of_use, place.mean(axis=0)
    east, north = x, y
    if not in_degrees:
        change = pyproj.Transformer.from_crs(known, "EPSG:4326", always_xy=True)
        east, north = change.transform(*(np.array([x, y]) / metres_of(crs)[0]))
    if area is None:
        return
    wide = ((area.east - area.west) % 360.0 or 360.0) + 2 * AWAY
    near = np.isfinite([east, north]).all() and (east - area.west + AWAY) % 360.0 <= wide
    if not near or not area.south - AWAY < north < area.north + AWAY:
        names = "latitude and longitude" if in_degrees else "north and east"
        raise SpecError(
            "crs",
            f"{what} of {x:,.7g} east and {y:,.7g} north are far from where {crs} is used; exchange "
            f"them if they are {names}, or name another system",
        )


def _known(crs: str) -> Any:
    """Return PROJ's system of this name."""
    import pyproj

    try:
        return pyproj.CRS.from_user_input(crs)
    except pyproj.exceptions.CRSError:
        raise SpecError(
            "crs",
            f'"{" ".join(crs.split())[:80]}" is no coordinate system that PROJ knows; write it as EPSG:32632',
        ) from None


def wkt_of(crs: str) -> str:
    """The WKT of a coordinate system such as "EPSG:32632", version 1 as LAS 1.4 asks.

    Empty without a name, or without pyproj.

    Raises
    ------
    SpecError : PROJ knows no system of this name, or it does not count in metres; names one that does.
    """
    if not crs or not can_tell_crs():
        return ""
    known = _known(crs)
    flat, up = metres_of(crs)
    if not np.allclose((flat, up), 1.0, rtol=0, atol=1e-9):
        raise SpecError(
            "crs",
            f'"{crs}" counts in {known.axis_info[0 if flat != 1 else 2].unit_name}, and coordinates are '
            f"written in metres; take {nearest_metric(crs)}",
        )
    import pyproj

    try:
        return str(known.to_wkt(pyproj.enums.WktVersion.WKT1_GDAL))
    except pyproj.exceptions.CRSError:  # what version 1 has no words for
        return str(known.to_wkt())
