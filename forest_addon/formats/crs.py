"""Coordinate reference systems by name, as the WKT that files hold; by pyproj, which Blender lacks."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import numpy as np

from ..spec import SpecError


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
