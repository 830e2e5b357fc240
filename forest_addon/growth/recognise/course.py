"""The course of an axis through slices of a joined tree, without the bulges of its forks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .axes import PieceAxes
from .levels import Slices

WINDOW = 3.0  # radii over which an axis is smoothed


@dataclass(frozen=True)
class Course:
    """Axes without the bulges of their forks, at the slices that are on them."""

    centre: np.ndarray  # (S, 3)
    heading: np.ndarray  # (S, 3) unit
    radius: np.ndarray  # (S,)


def smooth(slices: Slices, axes: PieceAxes) -> Course:
    """The course of every axis: medians of the radius, and centres where that is not exceeded."""
    from scipy.ndimage import median_filter, uniform_filter1d  # here: few runs need it

    centre, radius = slices.centre.copy(), axes.radius.copy()
    heading = np.zeros_like(centre)
    chain = np.flatnonzero(axes.chain)
    order = chain[np.argsort(axes.of_slice[chain], kind="stable")]
    bounds = np.flatnonzero(np.diff(axes.of_slice[order], prepend=-1, append=-2))
    for low, high in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        own = order[low:high]
        if len(own) < 3:
            step = slices.centre[own[-1]] - slices.centre[max(slices.below[own[0]], 0)]
            heading[own] = step
            continue
        window = WINDOW * float(np.median(radius[own])) / slices.width
        window = int(np.clip(2 * np.ceil(window) + 1, 3, 2 * (len(own) // 2) + 1))
        typical = median_filter(radius[own], window, mode="reflect")
        clean = radius[own] <= 1.1 * typical
        place = np.arange(len(own))
        middle = np.stack(
            [np.interp(place, place[clean], x) for x in slices.centre[own][clean].T], axis=1
        )
        short = max(window // 3, 1)
        centre[own] = (
            uniform_filter1d(middle, short, axis=0, mode="nearest") if short > 1 else middle
        )
        radius[own] = typical
        span = min(max(window // 2, 1), len(own) - 1)
        before, after = np.maximum(place - span, 0), np.minimum(place + span, len(own) - 1)
        heading[own] = middle[after] - middle[before]
    heading /= np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-300)
    return Course(centre, heading, radius)


def beginnings(
    slices: Slices, axes: PieceAxes, course: Course
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(A, 3) a place on each axis clear of its fork, (A, 3) its heading there, (A,) its radius."""
    chain = np.flatnonzero(axes.chain)
    order = chain[np.argsort(axes.of_slice[chain], kind="stable")]
    many = np.bincount(axes.of_slice[order], minlength=len(axes))
    first = np.cumsum(many) - many
    middle = order[first + many // 2]
    ahead = np.ceil(2 * course.radius[middle] / slices.width).astype(np.int64)
    clear = order[first + np.minimum(ahead, (many - 1) // 3)]
    return course.centre[clear], course.heading[clear], course.radius[clear]
