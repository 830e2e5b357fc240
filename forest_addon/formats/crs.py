"""Coordinate reference systems by name, as the WKT that files hold; by pyproj, which Blender lacks."""

from __future__ import annotations

from importlib.util import find_spec

from ..spec import SpecError


def can_tell_crs() -> bool:
    """Return whether pyproj is there, without which files are written without their coordinate system."""
    return find_spec("pyproj") is not None


def wkt_of(crs: str) -> str:
    """The WKT of a coordinate system such as "EPSG:32632", version 1 as LAS 1.4 asks.

    Empty without a name, or without pyproj.

    Raises
    ------
    SpecError : PROJ knows no system of this name.
    """
    if not crs or not can_tell_crs():
        return ""
    import pyproj

    try:
        known = pyproj.CRS.from_user_input(crs)
    except pyproj.exceptions.CRSError:
        raise SpecError(
            "crs", f'"{crs}" is no coordinate system that PROJ knows; write it as EPSG:32632'
        ) from None
    try:
        return str(known.to_wkt(pyproj.enums.WktVersion.WKT1_GDAL))
    except pyproj.exceptions.CRSError:  # what version 1 has no words for
        return str(known.to_wkt())
