"""Results as tables of pandas and datasets of xarray, with units as attributes.

Both libraries are the extra ``analysis``; they are imported when a table is asked for. Positions are in the
scene's own coordinates, as everywhere within a session; the attributes say the offset and the coordinate
system of a written file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..results.coordinates import Offset
from ..results.kind import Finding
from ..results.kinds import labelled_of
from ..spec import Sensor, SpecError

MISSING = 'is not installed; pip install "forest-sensing[analysis]"'


def dataset_of(sensor: Sensor, found: Finding, about: Mapping[str, Any]) -> Any:
    """An ``xarray.Dataset`` of what a sensor found; every variable has its unit in ``attrs["units"]``.

    about : its own attributes.

    Raises
    ------
    SpecError : xarray is not installed.
    """
    try:
        import xarray
    except ImportError:
        raise SpecError("xarray", MISSING) from None
    variables, coordinates = (
        {
            name: (dims, values, {"units": unit} if unit else {})
            for name, (dims, values, unit) in part.items()
        }
        for part in labelled_of(sensor, found)
    )
    return xarray.Dataset(variables, coordinates, about)


def frame_of(sensor: Sensor, found: Finding, about: Mapping[str, Any]) -> Any:
    """A ``pandas.DataFrame`` of what a sensor found, a row a point or sample; ``attrs`` has units by column.

    A result of several dimensions has its coordinates as columns. about : further attributes.

    Raises
    ------
    SpecError : pandas is not installed; or xarray, for a result of several dimensions.
    """
    try:
        import pandas
    except ImportError:
        raise SpecError("pandas", MISSING) from None
    variables, coordinates = labelled_of(sensor, found)
    every = {**variables, **coordinates}
    if len({dims for dims, *_ in every.values()}) == 1 and not coordinates:
        made = pandas.DataFrame({name: values for name, (_, values, _) in every.items()})
    else:
        made = dataset_of(sensor, found, {}).to_dataframe().reset_index()
    units = {name: unit for name, (_, _, unit) in every.items() if unit and name in made}
    made.attrs = {"units": units, **about}
    return made


def facts_of(sensor: Sensor, offset: Offset, seconds: float) -> dict[str, Any]:
    """Attributes of a table: which sensor, what to add for the map, how long it took."""
    return {
        "sensor": sensor.name,
        "kind": sensor.kind,
        "offset_m": list(offset),
        "crs": offset.crs,
        "seconds": seconds,
    }
