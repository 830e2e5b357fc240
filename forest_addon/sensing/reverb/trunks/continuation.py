"""The forest goes on: trunks beyond the modelled field, as dense and as thick as those in it.

The trunks of a field go in, Poisson trunks around it come out (Kaneko & Gamper 2021 fill 1 km² so). The
count in any area outside the field is Poisson with the field's density as its mean, positions are
uniform, and each radius is drawn from the field's trunks.
"""

from __future__ import annotations

import numpy as np

from ....spec import Reverb
from .slices import Trunks

MOST = 20_000_000  # expected trunks; more than memory would like

Field = tuple[tuple[float, float], tuple[float, float]]  # corner with the smallest x and y; extent


def continue_trunks(
    trunks: Trunks,
    field: Field,
    centre: np.ndarray,
    distance: float,
    rng: np.random.Generator,
    clear: np.ndarray | None = None,
) -> Trunks:
    """Trunks outside the field and within ``distance`` metres of ``centre`` (2,).

    field : its corner with the smallest x and y, and its extent along x and y, metres.
    clear : (P, 2) places that no trunk may cover, metres: where the source and the receiver are.

    Raises
    ------
    ValueError : more than ``MOST`` trunks would have to be drawn.
    """
    corner, size = np.asarray(field[0], np.float64), np.asarray(field[1], np.float64)
    within = np.all((trunks.position >= corner) & (trunks.position <= corner + size), axis=1)
    radii = trunks.radius[within]
    expected = len(radii) / float(np.prod(size)) * (2.0 * distance) ** 2
    if expected > MOST:
        raise ValueError(
            f"continuing the forest to {distance:g} m would take {expected:.2g} trunks; "
            "lower continue_to or raise min_radius"
        )
    count = int(rng.poisson(expected))  # in the square around the circle
    position = centre + rng.uniform(-distance, distance, (count, 2))
    radius = radii[rng.integers(0, len(radii), count)] if len(radii) else np.empty(0)
    outside = np.any((position < corner) | (position > corner + size), axis=1)
    near = np.hypot(*(position - centre).T) <= distance
    keep = outside & near
    beyond = Trunks(position[keep], radius[keep], np.full(int(keep.sum()), -1, dtype=np.int64))
    return beyond if clear is None else beyond.clear_of(clear)


def continuation(
    trunks: Trunks,
    reverb: Reverb,
    ends: np.ndarray,
    rng: np.random.Generator | None,
    field: Field | None,
) -> Trunks:
    """The trunks of the forest beyond the field, none of them over the ends (P, 2)."""
    if reverb.continue_to <= 0:
        return trunks.select(np.empty(0, np.int64))
    if rng is None or field is None:
        raise ValueError("continue_to needs a random stream and the field's corner and extent")
    return continue_trunks(trunks, field, ends.mean(axis=0), reverb.continue_to, rng, clear=ends)
