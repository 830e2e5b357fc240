"""Coordinate reference systems by name, as the WKT that files hold; by pyproj, which Blender lacks."""

from __future__ import annotations

import re
from importlib.util import find_spec
from typing import Any

import numpy as np

from ..spec import SpecError

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

    change = pyproj.Transformer.from_crs("EPSG:4326", known, always_xy=True)
    east, north = change.transform(longitude, latitude)
    factors = pyproj.Proj(known).get_factors(longitude, latitude)
    return east, north, np.asarray(factors.meridian_convergence)


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

    known, wanted = _known(source), _known(target or source)
    if wanted.is_geographic:
        change = pyproj.Transformer.from_crs(known, "EPSG:4326", always_xy=True)
        east, north = (float(value) for value in change.transform(*place.mean(axis=0)))
        zone = (32600 if north >= 0 else 32700) + int((east + 180) // 6 % 60) + 1
        raise SpecError(
            "crs", f'coordinates are degrees; name the system of a map in metres, as "EPSG:{zone}"'
        )
    if not target:
        authority = known.to_authority()
        name = ":".join(authority) if authority else source
        return place * known.axis_info[0].unit_conversion_factor, name
    change = pyproj.Transformer.from_crs(known, wanted, always_xy=True)
    return np.column_stack(change.transform(*place.T)), target


def _known(crs: str) -> Any:
    """Return PROJ's system of this name."""
    import pyproj

    try:
        return pyproj.CRS.from_user_input(crs)
    except pyproj.exceptions.CRSError:
        raise SpecError(
            "crs", f'"{crs}" is no coordinate system that PROJ knows; write it as EPSG:32632'
        ) from None


def wkt_of(crs: str) -> str:
    """The WKT of a coordinate system such as "EPSG:32632", version 1 as LAS 1.4 asks.

    Empty without a name, or without pyproj.

    Raises
    ------
    SpecError : PROJ knows no system of this name.
    """
    if not crs or not can_tell_crs():
        return ""
    known = _known(crs)
    import pyproj

    try:
        return str(known.to_wkt(pyproj.enums.WktVersion.WKT1_GDAL))
    except pyproj.exceptions.CRSError:  # what version 1 has no words for
        return str(known.to_wkt())
