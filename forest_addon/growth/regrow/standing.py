"""Measures of how a sibling stands: lean of its trunks, its lowest corner, and seats of its branches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.vectors import zenith_of
from .anatomy import Anatomy
from .lines import seats_on, stand_on
from .relay import mesh_of
from .sibling import Grown


@dataclass(frozen=True)
class SiblingStanding:
    """Measures of one tree.

    lean : radians between the vertical and the way from foot to tip of the trunk that leans most.
    gap : metres from the foot of a branch to its parent's wood, at most; 0 within.
    thicker : radius of a branch at its foot over its parent's there, at most.
    """

    lean: float
    gap: float
    thicker: float


def standing_of(grown: Grown) -> SiblingStanding:
    """The measures of a grown tree."""
    lines, knots = grown.lines, grown.lines.first + np.arange(len(grown.lines.first))
    feet, tips = lines.knot[knots[:-1]], lines.knot[knots[1:] - 1]
    way = (tips - feet)[grown.order == 0]
    lean = zenith_of(way).max()
    borne = np.flatnonzero(grown.mother >= 0)
    if not len(borne):
        return SiblingStanding(float(lean), 0.0, 0.0)
    seat = seats_on(lines, grown.mother[borne], feet[borne])
    _, _, thick = stand_on(lines, grown.mother[borne], seat)
    gap = np.hypot(seat.away, seat.along) - thick
    thicker = lines.radius[knots[:-1]][borne] / np.maximum(thick, np.finfo(float).tiny)
    return SiblingStanding(float(lean), max(float(gap.max()), 0.0), float(thicker.max()))


def lowest_corner(anatomy: Anatomy, grown: Grown, variety: float) -> float:
    """Metres above the ground of the lowest vertex of a grown tree's mesh."""
    return float(mesh_of(anatomy, grown, variety)[0].vertices[:, 2].min())
