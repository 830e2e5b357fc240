"""Places of trees that are no Poisson process: rows of an orchard, and lists of trees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..base.rng import truncated_normal
from ..spec import Rows, quoted_with_hints
from .inputs import TreeList
from .intensity.functions import IntensityError

MAX_PLACES = 20_000_000


def orchard(rows: Rows, low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Places (N, 2) of an orchard's trees, row by row (Méndez et al.); not cut to the field.

    Raises
    ------
    IntensityError : more than ``MAX_PLACES`` places; says how many.
    """
    heading = np.deg2rad(rows.heading_deg)
    along = np.array([np.cos(heading), np.sin(heading)])
    right = np.array([along[1], -along[0]])
    start = low + np.array(rows.start)
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])]) - start
    first, last = _numbers(rows.rows, rows.row_spacing, corners @ right)
    begin, end = _numbers(rows.trees, rows.tree_spacing, corners @ along)
    count = max(0, last - first) * max(0, end - begin)
    if count > MAX_PLACES:
        raise IntensityError(
            f"the orchard has {count:,} places, more than {MAX_PLACES:,}; widen its spacings"
        )
    row, tree = np.divmod(np.arange(count), max(1, end - begin))
    places = (
        start
        + np.outer((first + row) * rows.row_spacing, right)
        + np.outer((begin + tree) * rows.tree_spacing, along)
    )
    return places + rows.jitter * np.column_stack(
        [truncated_normal(rng, count), truncated_normal(rng, count)]
    )


def _numbers(wanted: int, spacing: float, reach: np.ndarray) -> tuple[int, int]:
    """From which number up to which one lies within the field, or as many as wanted from 0 on."""
    if wanted:
        return 0, wanted
    tidy = 1e-9  # a row on the very edge of the field counts
    return (
        int(np.ceil(reach.min() / spacing - tidy)),
        int(np.floor(reach.max() / spacing + tidy)) + 1,
    )


def trees_of(
    listed: TreeList, names: Sequence[str], every: Sequence[str], source: str
) -> np.ndarray:
    """Return which trees (M,) of a list are of a planting.

    names : what the planting may be called in the list. every : all names of all plantings.

    Raises
    ------
    IntensityError : a position or scale that is not a number or not positive; a species that nobody plants.
    """
    bad = ~np.isfinite(listed.position).all(axis=1)
    if listed.scale is not None:
        bad |= listed.scale <= 0
    if bad.any():
        raise IntensityError(
            f"{source}: tree {int(np.argmax(bad)) + 1} has no finite position or no positive scale"
        )
    if listed.species is None:
        return np.arange(len(listed))
    unknown = sorted(set(listed.species) - set(every))
    if unknown:
        are = "is" if len(unknown) == 1 else "are"
        raise IntensityError(
            f"{source}: the species {quoted_with_hints(unknown, every)} {are} not planted; use one of "
            f"{', '.join(every)}"
        )
    return np.flatnonzero(np.isin(np.array(listed.species), list(names)))
