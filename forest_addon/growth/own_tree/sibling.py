"""One tree of a fitted grammar: generation by generation, all axes of an order rewritten at once.

The axiom is the trunk. A rewriting step puts children on every axis of the last order: on the nodes of
its own production, moved along and turned about it; each child is a member of its letter's class, bent
and scaled to where it stands. ``variety`` 0 leaves all of that out and gives the template itself.
Every draw is a hash of the lineage of what draws it.

What is kept within limits: a piece is lengthened or shortened to at most half as long again; where more
would be needed another piece of its order takes its place; a branch is no thicker than its parent where
it leaves it, and its foot is within the parent's wood.

The nodes of a production are kept in their order. Where an axis is longer or shorter than its template it
has more or fewer of them, evenly (systematic sampling); each is moved by as much as spacing is uneven in
the template. On a trunk the turn from node to node is that of a node near by, so that a spiral stays a
spiral and whorls stay whorls; on other axes children keep their side, above, below, left or right.

A trunk leaves the ground as it does in the template, so that its base lies as flat, and does not lean much
more. A branch is bent about its line; how its foot's slope differs fades along it, and where it would grow
into the ground it goes on level.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.rng import child_keys, keyed_normal, keyed_uniform
from ...base.rows import RowTable
from ...base.runs import Runs, bounds, numbered
from ...base.vectors import zenith_of
from ...spec import Siblings
from ..draw import GOLDEN
from .anatomy import GROUND
from .habit import CHILDREN, PLACES, Habit, Size, radius_at_seat, size_of, trunk_girth
from .lines import Lines, foot_frames, lay, seat_at, sloped, stand_on, walk

JITTER = 0.25  # share of the scatter of spacing by which a node moves
FARTHEST = 0.8  # share of the way to the next node
BASE_SPREAD = 0.06  # of the height of the crown's base
EVEN = 0.8  # mean resultant length of turns from which they are even (Mardia 1972)
TURN_SPREAD = np.deg2rad(12.0)  # of turns that are not even
SIDE_SPREAD = np.deg2rad(12.0)
LOPSIDED = 0.05  # more to one side than in the template
TRIES = 12  # other turns that are drawn where branches stand to one side
NEIGHBOURS = 2  # nodes to either side that a turn is taken from
SWEEP = np.deg2rad(15.0)  # turn of a branch's bends about its line
BEND_SPREAD = 0.15
LEAN = np.deg2rad(2.5)  # of a trunk's slope, towards its tip
MOST_LEAN = np.deg2rad(6.0)  # more than the template's, of a trunk from foot to tip
CALMER = (1.0, 0.5, 0.25, 0.0)  # shares of a trunk's own bends that are tried
SWAY = np.deg2rad(4.0)  # of a level branch's slope at its tip
FADE = 4.0  # how fast a foot's other slope is made up for: e^-4 of it is left at the tip
MOST_SCALE = 1.5  # of a piece's length
INSIDE = 0.6  # of the parent's radius: a foot this near to its axis is within it
CHILD_LENGTH = 0.5  # exponent: how children lengthen with their parent
THICKEST = 0.95  # of the parent there


def place_children(
    habit: Habit,
    piece: np.ndarray,
    key: np.ndarray,
    count: np.ndarray,
    variety: float,
    order: int,
) -> tuple[np.ndarray, ...]:
    """The N children of axes that are these pieces (B,) with these keys (B,).

    count : (B,) factor of their number. order : of the children.

    Returns
    -------
    (N,) the piece that stands there in the template; which of the axes bears each; lineages; seats along the
    axis, as shares; the same, where tables are read; azimuths about the axis.
    """
    slots = habit.slots
    row, owner, _ = slots.of_piece.copy(piece)
    node, limb = slots.node[row], slots.limb[row]
    own_key = child_keys(key[owner], row - slots.of_piece.first[piece[owner]])

    # As many nodes as the axis is long: node i has floor((i + 1 + U)f) - floor((i + U)f).
    begin = keyed_uniform(key, "nodes")[owner] + node
    times = np.floor((begin + 1) * count[owner]) - np.floor(begin * count[owner])
    times = np.where(limb | (count[owner] == 1), 1, times).astype(np.int64)
    row, owner, own_key, copy, times = _repeated(times, row, owner, own_key)
    onward = copy / np.maximum(times, 1)
    at = slots.node[row] + onward  # where along the axis, in nodes

    # One is missing or doubled by chance.
    chance = variety * habit.chance[order]
    drawn = keyed_uniform(own_key, "chance")
    again = 1 - (drawn < chance).astype(np.int64) + (drawn > 1 - chance)
    again[slots.limb[row]] = 1
    row, owner, own_key, twin, _, onward, at = _repeated(again, row, owner, own_key, onward, at)
    onward = onward + np.where(twin > 0, 0.3 + 0.4 * keyed_uniform(own_key, "twin"), 0.0)

    slot, node = slots.piece[row], slots.node[row]
    share = habit.share[slot] + onward * slots.after[row] * (1 - 1e-9)
    of_node = child_keys(child_keys(key[owner], "node"), node)
    z = np.clip(keyed_normal(of_node, "move"), -2.0, 2.0) * variety * habit.scatter[order] * JITTER
    z = np.clip(z, -FARTHEST, FARTHEST)
    share = share + z * np.where(z > 0, slots.after[row], slots.before[row])
    place = share = np.clip(share, 0.0, 1.0)
    if order == 1 and variety > 0:
        low = np.ones(len(key))  # crowns of trunks begin higher or lower; the top stays
        np.minimum.at(low, owner, share)
        wanted = low * np.exp(variety * BASE_SPREAD * np.clip(keyed_normal(key, "base"), -2, 2))
        wanted = np.minimum(wanted, 0.9)[owner]
        part = (share - low[owner]) / np.maximum(1 - low[owner], 1e-9)
        share = wanted + part * (1 - wanted)
    azimuth = habit.anatomy.azimuth[slot]
    if order == 1:
        azimuth = _turned(habit, piece, key, row, owner, at, variety)
    else:
        azimuth = azimuth + variety * SIDE_SPREAD * keyed_normal(own_key, "side")
    azimuth = azimuth + np.where(
        twin > 0, np.pi * (0.4 + 1.2 * keyed_uniform(own_key, "across")), 0
    )
    return slot, owner, own_key, share, place, azimuth


def _repeated(times: np.ndarray, *columns: np.ndarray) -> tuple[np.ndarray, ...]:
    """Rows so many times each: the first three columns, the copy's number, its row's times, the rest.

    The keys, the third column, of further copies are those of children of the first.
    """
    which, copy = numbered(times)
    row, owner, key, *rest = (column[which] for column in columns)
    key = np.where(copy > 0, child_keys(key, copy), key)
    return row, owner, key, copy, times[which], *rest


def _turned(
    habit: Habit,
    piece: np.ndarray,
    key: np.ndarray,
    row: np.ndarray,
    owner: np.ndarray,
    at: np.ndarray,
    variety: float,
) -> np.ndarray:
    """(N,) azimuths about trunks: the turns from node to node added up; limbs stay where they are.

    at : (N,) where along the trunk each one stands, counted in nodes.
    """
    slots, anatomy = habit.slots, habit.anatomy
    azimuth = anatomy.azimuth[slots.piece[row]].copy()
    if variety == 0:
        return azimuth + GOLDEN * (at - slots.node[row])
    for number in range(len(piece)):
        of_trunk = np.flatnonzero(owner == number)
        run = slice(
            slots.of_piece.first[piece[number]],
            slots.of_piece.first[piece[number]] + slots.of_piece.size[piece[number]],
        )
        nodes, opens = np.unique(slots.node[run], return_index=True)
        if len(nodes) < 2 or not len(of_trunk):
            continue
        standing = anatomy.azimuth[slots.piece[run]][opens]  # of the first on each node
        seen, place = np.unique(at[of_trunk], return_inverse=True)  # (M,) nodes that stand
        relative = azimuth[of_trunk] - standing[slots.node[row[of_trunk]]]
        free, reach = ~slots.limb[row[of_trunk]], anatomy.lines.reach()[slots.piece[row[of_trunk]]]
        own = _lopsided(anatomy.azimuth[slots.piece[run]], anatomy.lines.reach()[slots.piece[run]])
        tries = child_keys(np.repeat(key[number : number + 1], TRIES), np.arange(TRIES))
        least, chosen = np.inf, azimuth[of_trunk]
        for attempt in (int(key[number]), *tries.tolist()):
            turned = _turned_nodes(standing, seen, attempt, variety)[place.ravel()]
            drawn = np.where(free, turned + relative, azimuth[of_trunk])
            off = _lopsided(drawn, reach)
            if off < least:
                least, chosen = off, drawn
            if off <= own + LOPSIDED:
                break
        azimuth[of_trunk] = chosen
    return azimuth


def _lopsided(azimuth: np.ndarray, reach: np.ndarray) -> float:
    """Share, 0 .. 1, by which branches of these lengths (N,) stand to one side: their mean resultant."""
    return float(np.abs((reach * np.exp(1j * azimuth)).sum()) / max(reach.sum(), 1e-12))


def _turned_nodes(standing: np.ndarray, seen: np.ndarray, key: int, variety: float) -> np.ndarray:
    """(M,) azimuths of the nodes that stand at ``seen`` (M,), counted in nodes of the template.

    standing : (N,) azimuths of the template's nodes. Where they turn evenly, as a spiral does, they go on
    by the mean turn, each off by what a node near by is off; else turns of nodes near by are added up.
    """
    step = np.diff(standing)
    mean = np.exp(1j * step).mean()
    node = seen.astype(np.int64)
    keys = child_keys(np.full(len(node), key, np.uint64), np.arange(len(node)))
    near = keyed_uniform(keys, "turn") * (2 * NEIGHBOURS + 1) - NEIGHBOURS - 0.5
    other = np.where(keyed_uniform(keys, "near") < variety, np.rint(near), 0).astype(np.int64)
    if abs(mean) > EVEN:
        regular = standing[0] + np.angle(mean) * np.arange(len(standing))
        off = np.angle(np.exp(1j * (standing - regular)))
        source = np.clip(node + other, 0, len(standing) - 1)
        return np.asarray(standing[0] + np.angle(mean) * seen + off[source])
    turn = step[np.clip(node + other, 1, len(step)) - 1]
    turn = turn + variety * TURN_SPREAD * keyed_normal(keys, "turn spread")
    turn[0] = standing[node[0]]
    return np.cumsum(turn)


def lay_trunks(
    key: np.ndarray,
    start: np.ndarray,
    bend: np.ndarray,
    length: np.ndarray,
    first: np.ndarray,
    variety: float,
) -> np.ndarray:
    """Frames (S, 3, 3) of trunks: they leave the ground as in the template, and are bent and lean otherwise
    towards the top, but not much more than it leans.
    """
    plain = lay(bend, first, start)
    most = _leans(plain, length, first) + MOST_LEAN
    owner, number = numbered(np.diff(first))
    part = number / np.diff(first)[owner]
    lean = np.clip(keyed_normal(key, "lean"), -2.0, 2.0)[owner] * part
    chosen = plain.copy()
    open_ones = np.ones(len(first) - 1, dtype=bool)
    for calm in CALMER:
        other = _bent_otherwise(bend, key[owner], part, calm * variety)
        slope = np.clip(zenith_of(plain[:, :, 2]) + calm * variety * LEAN * lean, 0.0, np.pi)
        frame = lay(other, first, start, slope)
        fits = open_ones & (_leans(frame, length, first) <= most)
        fitting = fits[owner]
        chosen[fitting] = frame[fitting]
        open_ones &= ~fits
    return chosen


def _bent_otherwise(
    bend: np.ndarray, key: np.ndarray, part: np.ndarray, variety: float
) -> np.ndarray:
    """Bends (S, 2) turned about the line, by more or less along it, and more or less strong."""
    turn = keyed_normal(key, "sweep") + 1.5 * (part - 0.5) * keyed_normal(key, "swerve")
    cos, sin = np.cos(variety * SWEEP * turn), np.sin(variety * SWEEP * turn)
    turned = np.stack(
        [cos * bend[:, 0] - sin * bend[:, 1], sin * bend[:, 0] + cos * bend[:, 1]], axis=1
    )
    return np.asarray(turned * np.exp(variety * BEND_SPREAD * keyed_normal(key, "bend"))[:, None])


def _leans(frame: np.ndarray, length: np.ndarray, first: np.ndarray) -> np.ndarray:
    """(C,) radians from the vertical, from foot to tip."""
    way = np.add.reduceat(frame[:, :, 2] * length[:, None], first[:-1], axis=0)
    return zenith_of(way)


def _above_ground(
    floor: np.ndarray,
    foot: np.ndarray,
    start: np.ndarray,
    slope: np.ndarray,
    length: np.ndarray,
    first: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (S,) and feet's frames (C, 3, 3) of branches that go on level where they reach the ground.

    floor, foot : (C,) metres below which no knot goes, and of the feet, above the ground.
    """
    slope[first[:-1]] = zenith_of(start[:, :, 2])
    owner, _ = numbered(np.diff(first))
    rise = np.cumsum(length * np.cos(slope))
    base = foot - (rise - length * np.cos(slope))[first[:-1]]
    if (rise + base[owner] >= floor[owner]).all():
        return slope, start
    height = np.maximum(rise + base[owner], floor[owner])
    before = np.concatenate([[0.0], height[:-1]])
    before[first[:-1]] = foot
    level = np.arccos(np.clip((height - before) / np.maximum(length, 1e-12), -1.0, 1.0))
    touched = np.abs(level - slope) > 1e-6
    slope[touched] = level[touched]
    low = np.flatnonzero(touched[first[:-1]])
    start = start.copy()
    start[low] = sloped(start[low], slope[first[:-1][low]])
    return slope, start


@dataclass(frozen=True, eq=False)
class Grown(RowTable):
    """B branches of a tree, order by order.

    piece : (B,) of the template. parent : (B,) branch, -1 for a trunk. order : (B,).
    sign : (B,) -1 where the piece is mirrored. scale : (B,) of its length. key : (B,) lineage.
    share : (B,) seat on the parent. lines : their courses.
    source : (S,) stretch of the template that each stretch is. girth : (S,) scale of its thickness.
    """

    piece: np.ndarray
    parent: np.ndarray
    order: np.ndarray
    sign: np.ndarray
    scale: np.ndarray
    key: np.ndarray
    share: np.ndarray
    lines: Lines
    source: np.ndarray
    girth: np.ndarray


def grow_sibling(habit: Habit, siblings: Siblings, key: int) -> Grown:
    """The branches of one tree.

    key : 64 bits, the lineage of the tree.
    """
    tree = child_keys(np.array([key], np.uint64), "sibling")
    size = size_of(habit, siblings, tree)
    grown = _grow(habit, siblings.variety, size, tree)
    if siblings.height:
        reached = float(grown.lines.knot[:, 2].max())
        grown = _grow(
            habit, siblings.variety, replace(size, stem=size.stem * (size.height / reached)), tree
        )
    return grown


def _grow(habit: Habit, variety: float, size: Size, tree: np.ndarray) -> Grown:
    levels = [_trunks(habit, variety, size, tree)]
    for order in range(1, int(habit.anatomy.order.max(initial=0)) + 1):
        level = _children(habit, variety, size, levels[-1], order)
        if level is None:
            break
        levels.append(level)
    first = bounds(np.array([len(level.piece) for level in levels]))  # of each order, among all
    above = zip(levels[1:], first, strict=False)
    return Grown.joined(
        [levels[0], *(replace(level, parent=level.parent + below) for level, below in above)]
    )


def _trunks(habit: Habit, variety: float, size: Size, tree: np.ndarray) -> Grown:
    """The trunks, turned about the vertical or mirrored: a base that lies flat on the ground still does."""
    anatomy, piece = habit.anatomy, habit.anatomy.trunks
    same = np.repeat(tree, len(piece))
    turn = 2 * np.pi * variety * keyed_uniform(same, "turn")
    sign = _signs(same, variety)
    start = foot_frames(
        np.tile(GROUND, (len(piece), 1, 1)),
        sign * anatomy.azimuth[piece] + turn,
        anatomy.angle[piece],
        sign * anatomy.roll[piece],
        anatomy.carried[piece],
    )
    seat = anatomy.seat.select(piece)
    bearing = sign * (anatomy.azimuth[piece] + seat.aside) + turn
    sideways = np.stack([np.cos(bearing), np.sin(bearing)], axis=1) * seat.away[:, None]
    scale = np.full(len(piece), size.stem)
    return _lay(
        habit,
        variety,
        order=0,
        piece=piece,
        parent=np.full(len(piece), -1),
        sign=sign,
        scale=scale,
        key=child_keys(same, np.arange(len(piece))),
        share=np.zeros(len(piece)),
        start=start,
        foot=np.column_stack([sideways, seat.along]),
        girth=trunk_girth(anatomy, piece, scale, size),
    )


def _children(habit: Habit, variety: float, size: Size, below: Grown, order: int) -> Grown | None:
    """The branches that the axes of the order below bear; None where they bear none."""
    anatomy = habit.anatomy
    count = size.branches if order == 1 else below.scale**CHILDREN
    count = np.broadcast_to(count, below.piece.shape)
    slot, owner, key, share, there, azimuth = place_children(
        habit, below.piece, below.key, count, variety, order
    )
    if not len(slot):
        return None
    piece, table = _class_mates(habit, slot, key, variety), habit.tables[order - 1]
    own = habit.share[piece]
    trend = np.interp(there, PLACES, table.length) / np.interp(own, PLACES, table.length)
    scale = np.clip(trend, 1 / MOST_SCALE, MOST_SCALE)
    scale = scale * np.exp(variety * table.length_spread * keyed_normal(key, "length"))
    scale = scale * (size.crown if order == 1 else below.scale[owner] ** CHILD_LENGTH)
    piece, scale = _fitting(habit, piece, scale, order)

    seat = anatomy.seat.select(slot)  # one that has not moved keeps its own to the bit
    moved = np.flatnonzero(share != habit.share[slot])
    bearer = below.piece[owner[moved]]
    seat.stretch[moved], seat.part[moved] = seat_at(anatomy.lines, bearer, share[moved])
    place, frame, thickness = stand_on(below.lines, owner, seat)
    bearing = below.sign[owner] * azimuth
    angle = anatomy.angle[piece] + np.interp(there, PLACES, table.angle)
    angle = angle - np.interp(own, PLACES, table.angle)
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
    return _lay(
        habit,
        variety,
        order=order,
        piece=piece,
        parent=owner,
        sign=below.sign[owner] * _signs(key, variety),
        scale=scale,
        key=key,
        share=share,
        start=start,
        foot=foot,
        girth=np.stack([base, np.minimum(base, 1.0)], axis=1),
    )


def _signs(key: np.ndarray, variety: float) -> np.ndarray:
    return np.where(keyed_uniform(key, "mirror") < variety / 2, -1.0, 1.0)


def _class_mates(habit: Habit, piece: np.ndarray, key: np.ndarray, variety: float) -> np.ndarray:
    """(N,) for each slot itself, or with this chance a member of its class, itself included.

    Members are dealt out: of a class each comes as often as any other, but for what is left over, so that
    what they bear comes as often as in the template.
    """
    of_class = habit.kind[piece]
    order = np.lexsort((keyed_uniform(key, "member"), of_class))
    size = np.bincount(of_class, minlength=len(habit.of_class.size))
    dealt = np.empty(len(piece), np.int64)
    dealt[order] = np.arange(len(piece)) - np.repeat(np.cumsum(size) - size, size)
    last = np.zeros(len(size))  # what is left over goes to others each time
    last[of_class[order]] = keyed_uniform(key, "deal")[order]
    begin = (last * habit.of_class.size).astype(np.int64)
    rank = (dealt + begin[of_class]) % habit.of_class.size[of_class]
    mate = habit.member[habit.of_class.first[of_class] + rank]
    return np.where(keyed_uniform(key, "mate") < variety, mate, piece)


def _fitting(
    habit: Habit, piece: np.ndarray, scale: np.ndarray, order: int
) -> tuple[np.ndarray, np.ndarray]:
    """Pieces and scales; where a piece would be scaled too far, that of its order nearest in length."""
    far = np.flatnonzero(np.abs(np.log(scale)) > np.log(MOST_SCALE))
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


def _lay(
    habit: Habit,
    variety: float,
    order: int,
    piece: np.ndarray,
    parent: np.ndarray,
    sign: np.ndarray,
    scale: np.ndarray,
    key: np.ndarray,
    share: np.ndarray,
    start: np.ndarray,
    foot: np.ndarray,
    girth: np.ndarray,
) -> Grown:
    """B branches of one order along their courses: trunks but not much more leaning than in the template,
    branches back to their own slope, above the ground.

    parent : (B,) row of the order below. start, foot : (B, 3, 3), (B, 3) frames and places of the feet.
    girth : (B, 2) scale of thickness at foot and tip. The rest as in ``Grown``.
    """
    lines = habit.anatomy.lines
    source, owner, _ = Runs.at(lines.first).copy(piece)
    size = np.diff(lines.first)[piece]
    first = bounds(size)
    rank = np.arange(len(source)) - first[owner]
    length = lines.length[source] * scale[owner]
    bend = habit.anatomy.bend[source] * np.stack([sign[owner], np.ones(len(owner))], axis=1)
    if variety == 0:
        frame = lay(bend, first, start)
    elif order == 0:
        frame = lay_trunks(key, start, bend, length, first, variety)
    else:
        part = rank / size[owner]
        bend = _bent_otherwise(bend, key[owner], part, variety)
        # The piece's own but for how the foot's differs, which fades along it.
        part = part + 0.5 / size[owner]
        own = zenith_of(lines.frame[source][:, :, 2])
        at_foot = zenith_of(start[:, :, 2]) - zenith_of(lines.frame[lines.first[piece]][:, :, 2])
        sway = variety * SWAY * keyed_normal(key, "sway")[owner] * part * np.sin(own)
        slope = np.clip(own + at_foot[owner] * np.exp(-FADE * part) + sway, 0.0, np.pi)
        floor = np.minimum(habit.floor[piece], foot[:, 2])
        slope, start = _above_ground(floor, foot[:, 2], start, slope, length, first)
        frame = lay(bend, first, start, slope)
    knot, of_knot, _ = Runs.at(lines.first + np.arange(len(lines.first))).copy(piece)
    part = (np.arange(len(knot)) - (first[:-1] + np.arange(len(size)))[of_knot]) / size[of_knot]
    low, more = girth[:, 0], girth[:, 1] - girth[:, 0]
    laid = Lines(
        first=first,
        knot=walk(frame, length, first, foot),
        radius=lines.radius[knot] * (low[of_knot] + more[of_knot] * part),
        length=length,
        frame=frame,
    )
    middle = low[owner] + more[owner] * (rank + 0.5) / size[owner]
    orders = np.full(len(piece), order)
    return Grown(piece, parent, orders, sign, scale, key, share, laid, source, middle)
