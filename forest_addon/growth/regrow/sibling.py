"""One tree of a fitted grammar: generation by generation, all axes of an order rewritten at once.

The axiom is the trunk. A rewriting step puts children on every axis of the last order: on the nodes of
its own production, moved along and turned about it; each child is a member of its letter's class, bent
and scaled to where it stands. ``variety`` 0 leaves all of that out and gives the template itself.
Every draw is a hash of the lineage of what draws it.

What is kept within limits: a piece is lengthened or shortened to at most half as long again; where more
would be needed another piece of its order takes its place; a branch is no thicker than its parent where
it leaves her, and its foot is within her wood.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.rng import daughter_keys, keyed_normal, keyed_uniform
from ...base.runs import Runs, bounds
from ...spec import Siblings
from .anatomy import GROUND
from .courses import foot_frames, lay, walk
from .fitted import Habit, radius_at_seat
from .laying import Shoots, lay_branches, lay_trunks
from .lines import Lines, Seats, seat_at, stand_on
from .nodes import Placed, place_daughters
from .size import Size, size_of, trunk_girth

MOST_SCALE = 1.5  # of a piece's length
INSIDE = (
    0.6  # of the parent's radius: a foot this near to her axis is within her, whatever her section
)
DAUGHTER_LENGTH = 0.5  # exponent: how children lengthen with their parent
THICKEST = 0.95  # of the parent there


@dataclass(frozen=True, eq=False)
class Grown:
    """B branches of a tree, order by order.

    piece : (B,) of the template. parent : (B,) branch, -1 for a trunk. order : (B,).
    sign : (B,) -1 where the piece is mirrored. scale : (B,) of its length. key : (B,) lineage.
    share : (B,) seat on the parent. lines, bend : their courses.
    source : (S,) stretch of the template that each stretch is. girth : (S,) scale of its thickness.
    """

    piece: np.ndarray
    mother: np.ndarray
    order: np.ndarray
    sign: np.ndarray
    scale: np.ndarray
    key: np.ndarray
    share: np.ndarray
    lines: Lines
    bend: np.ndarray
    source: np.ndarray
    girth: np.ndarray


def grow_sibling(habit: Habit, siblings: Siblings, key: int) -> Grown:
    """The branches of one tree.

    key : 64 bits, the lineage of the tree.
    """
    tree = daughter_keys(np.array([key], np.uint64), "sibling")
    size = size_of(habit, siblings, tree)
    grown = _grow(habit, siblings.variety, size, tree)
    if siblings.height:
        reached = float(grown.lines.knot[:, 2].max())
        grown = _grow(habit, siblings.variety, size.stretched(size.height / reached), tree)
    return grown


def _grow(habit: Habit, variety: float, size: Size, tree: np.ndarray) -> Grown:
    levels = [_lay(habit, variety, _trunks(habit, variety, size, tree), 0)]
    for order in range(1, int(habit.anatomy.order.max(initial=0)) + 1):
        wanted = _daughters(habit, variety, size, levels[-1], order)
        if not len(wanted.piece):
            break
        levels.append(_lay(habit, variety, wanted, order))
    return _joined(levels)


def _trunks(habit: Habit, variety: float, size: Size, tree: np.ndarray) -> Shoots:
    """The trunks, turned about the vertical or mirrored: a base that lies flat on the ground still does."""
    anatomy = habit.anatomy
    piece = anatomy.trunks
    key = daughter_keys(np.repeat(tree, len(piece)), np.arange(len(piece)))
    turn = 2 * np.pi * variety * keyed_uniform(np.repeat(tree, len(piece)), "turn")
    sign = np.repeat(_signs(tree, variety), len(piece))
    start = foot_frames(
        np.tile(GROUND, (len(piece), 1, 1)),
        sign * anatomy.azimuth[piece] + turn,
        anatomy.angle[piece],
        sign * anatomy.roll[piece],
        anatomy.carried[piece],
    )
    seat = anatomy.seat.take(piece)
    bearing = sign * (anatomy.azimuth[piece] + seat.aside) + turn
    sideways = np.stack([np.cos(bearing), np.sin(bearing)], axis=1) * seat.away[:, None]
    scale = np.full(len(piece), size.stem)
    return Shoots(
        piece=piece,
        mother=np.full(len(piece), -1),
        sign=sign,
        scale=scale,
        key=key,
        share=np.zeros(len(piece)),
        start=start,
        foot=np.column_stack([sideways, seat.along]),
        girth=trunk_girth(anatomy, piece, scale, size),
    )


def _daughters(habit: Habit, variety: float, size: Size, below: Grown, order: int) -> Shoots:
    """Return what the axes of the order below bear."""
    anatomy = habit.anatomy
    count = size.branches if order == 1 else below.scale**size.count_exponent
    placed = place_daughters(
        habit, below.piece, below.key, np.broadcast_to(count, below.piece.shape), variety, order
    )
    piece, owner, key = _class_mates(habit, placed, variety), placed.owner, placed.key
    table = habit.tables[order - 1]
    there, own = placed.place, habit.share[piece]
    trend = np.interp(there, table.share, table.length) / np.interp(own, table.share, table.length)
    scale = np.clip(trend, 1 / MOST_SCALE, MOST_SCALE)
    scale = scale * np.exp(variety * table.length_spread * keyed_normal(key, "length"))
    scale = scale * (size.crown if order == 1 else below.scale[owner] ** DAUGHTER_LENGTH)
    piece, scale = _fitting(habit, piece, scale, order)

    seat = _reseated(habit, placed)
    place, frame, thickness = stand_on(below.lines, owner, seat)
    bearing = below.sign[owner] * placed.azimuth
    angle = anatomy.angle[piece] + np.interp(there, table.share, table.angle)
    angle = angle - np.interp(own, table.share, table.angle)
    angle = angle + variety * table.angle_spread * keyed_normal(key, "angle")
    roll = below.sign[owner] * anatomy.roll[piece]
    start = foot_frames(frame, bearing, np.clip(angle, 0.0, np.pi), roll, anatomy.carried[piece])

    radius = radius_at_seat(anatomy)[piece]
    away, off = anatomy.seat.away[piece], anatomy.seat.aside[piece]
    inside = away <= radius
    away = np.where(inside, away / radius * thickness, away + thickness - radius)
    if variety > 0:
        away = np.minimum(away, INSIDE * thickness)
    around = bearing + below.sign[owner] * off
    foot = place + (away * np.cos(around))[:, None] * frame[:, :, 0]
    foot += (away * np.sin(around))[:, None] * frame[:, :, 1]
    if variety == 0:  # else within the wood
        foot += (anatomy.seat.along[piece] * below.scale[owner])[:, None] * frame[:, :, 2]

    stout = anatomy.foot_radius()[piece]
    most = thickness * np.maximum(THICKEST, stout / radius) / stout
    base = np.minimum(scale, most)
    return Shoots(
        piece=piece,
        mother=owner,
        sign=below.sign[owner] * _signs(key, variety),
        scale=scale,
        key=key,
        share=placed.share,
        start=start,
        foot=foot,
        girth=np.stack([base, np.minimum(base, 1.0)], axis=1),
    )


def _reseated(habit: Habit, placed: Placed) -> Seats:
    """Seats of children on their parents' pieces; one that has not moved keeps its own to the bit."""
    seat = habit.anatomy.seat.take(placed.slot)
    moved = np.flatnonzero(placed.share != habit.share[placed.slot])
    stretch, part = seat_at(habit.anatomy.lines, placed.mother[moved], placed.share[moved])
    seat.stretch[moved], seat.part[moved] = stretch, part
    return seat


def _signs(key: np.ndarray, variety: float) -> np.ndarray:
    return np.where(keyed_uniform(key, "mirror") < variety / 2, -1.0, 1.0)


def _class_mates(habit: Habit, placed: Placed, variety: float) -> np.ndarray:
    """(N,) for each slot itself, or with this chance a member of its class, itself included.

    Members are dealt out: of a class each comes as often as any other, but for what is left over, so that
    what they bear comes as often as in the template.
    """
    piece = placed.slot
    of_class = habit.kind[piece]
    order = np.lexsort((keyed_uniform(placed.key, "member"), of_class))
    size = np.bincount(of_class, minlength=len(habit.of_class.size))
    dealt = np.empty(len(piece), np.int64)
    dealt[order] = np.arange(len(piece)) - np.repeat(np.cumsum(size) - size, size)
    last = np.zeros(len(size))  # what is left over goes to others each time
    last[of_class[order]] = keyed_uniform(placed.key, "deal")[order]
    begin = (last * habit.of_class.size).astype(np.int64)
    rank = (dealt + begin[of_class]) % habit.of_class.size[of_class]
    mate = habit.member[habit.of_class.first[of_class] + rank]
    return np.where(keyed_uniform(placed.key, "mate") < variety, mate, piece)


def _fitting(
    habit: Habit, piece: np.ndarray, scale: np.ndarray, order: int
) -> tuple[np.ndarray, np.ndarray]:
    """Pieces and scales; where a piece would be scaled too far, that of its order nearest in length."""
    far = np.flatnonzero(np.abs(np.log(scale)) > np.log(MOST_SCALE))
    if not len(far):
        return piece, scale
    reach = habit.anatomy.lines.reach()
    pool = np.flatnonzero(habit.anatomy.order == order)
    pool = pool[np.argsort(reach[pool], kind="stable")]
    wanted = reach[piece[far]] * scale[far]
    after = np.clip(np.searchsorted(reach[pool], wanted), 1, max(len(pool) - 1, 1))
    after = np.minimum(after, len(pool) - 1)
    before = np.maximum(after - 1, 0)
    nearer = wanted - reach[pool[before]] < reach[pool[after]] - wanted
    piece, scale = piece.copy(), scale.copy()
    piece[far] = pool[np.where(nearer, before, after)]
    scale[far] = wanted / reach[piece[far]]
    return piece, scale


def _lay(habit: Habit, variety: float, wanted: Shoots, order: int) -> Grown:
    """Branches of one order along their courses."""
    lines = habit.anatomy.lines
    source, owner, _ = Runs.at(lines.first).copy(wanted.piece)
    size = np.diff(lines.first)[wanted.piece]
    first = bounds(size)
    rank = np.arange(len(source)) - first[owner]
    length = lines.length[source] * wanted.scale[owner]
    bend = habit.anatomy.bend[source] * np.stack([wanted.sign[owner], np.ones(len(owner))], axis=1)
    if variety == 0:
        frame = lay(bend, first, wanted.start)
    elif order:
        bend, frame = lay_branches(habit, wanted, bend, length, first, source, variety)
    else:
        bend, frame = lay_trunks(wanted, bend, length, first, variety)
    knot_source, knot_owner, _ = Runs.at(lines.first + np.arange(len(lines.first))).copy(
        wanted.piece
    )
    part = (np.arange(len(knot_source)) - (first[:-1] + np.arange(len(size)))[knot_owner]) / size[
        knot_owner
    ]
    low, high = wanted.girth.T
    girth = low[knot_owner] + (high - low)[knot_owner] * part
    middle = low[owner] + (high - low)[owner] * (rank + 0.5) / size[owner]
    laid = Lines(
        first=first,
        knot=walk(frame, length, first, wanted.foot),
        radius=lines.radius[knot_source] * girth,
        length=length,
        frame=frame,
    )
    return Grown(
        piece=wanted.piece,
        mother=wanted.mother,
        order=np.full(len(wanted.piece), order),
        sign=wanted.sign,
        scale=wanted.scale,
        key=wanted.key,
        share=wanted.share,
        lines=laid,
        bend=bend,
        source=source,
        girth=middle,
    )


def _joined(levels: Sequence[Grown]) -> Grown:
    """All orders as one; parents are counted over all of them."""
    sizes = [len(level.piece) for level in levels]
    below = np.concatenate([[0, 0], np.cumsum(sizes)[:-1]])  # first row of the order below
    stretches = np.cumsum([0, *(level.lines.first[-1] for level in levels)])

    def every(name: str) -> np.ndarray:
        return np.concatenate([getattr(level, name) for level in levels])

    def of_lines(name: str) -> np.ndarray:
        return np.concatenate([getattr(level.lines, name) for level in levels])

    firsts = [level.lines.first[:-1] + at for level, at in zip(levels, stretches, strict=False)]
    lines = Lines(
        np.concatenate([*firsts, stretches[-1:]]),
        *(of_lines(name) for name in ("knot", "radius", "length", "frame")),
    )
    mother = [
        np.where(level.mother < 0, -1, level.mother + at)
        for level, at in zip(levels, below, strict=False)
    ]
    rest = ("piece", "order", "sign", "scale", "key", "share", "bend", "source", "girth")
    return Grown(mother=np.concatenate(mother), lines=lines, **{name: every(name) for name in rest})
