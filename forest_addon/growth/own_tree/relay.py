r"""The mesh of a tree whose branches have been laid: pieces bent along their courses, leaves hung on them.

A vertex v = p + q, with p on the line of its piece, goes to p' + A q: p' is as far along the line as it is
laid, A the weighted mean of F' D Fᵀ over its own stretch and the nearer next, with the frames F in the
template and F' where they are laid, and scales D = diag(girth, ±girth, length) (-1: mirrored). Where
nothing is bent that is exact, and what hangs on the line hangs on the mesh, however it is bent.
Leaves are moved as they are, whatever their branch is scaled by; a longer branch bears more of them.

The string of such a tree is in the notation of ABOP, as far as it has been rewritten. After 0 generations it
is the letter of the trunk, A(class, length, diameter). Each generation rewrites every such letter into the
axis that it stands for, with the letters of its children in brackets; the last sets the leaves. ``\``, ``&``
and ``\`` bring the turtle into a child's frame (the angles of Euler, as z, x, z), ``f`` takes it from the
parent's axis to the child's foot.

The turtle's left, up and heading are N, B and T of ``anatomy``; it starts upright.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...base.rng import child_keys, keyed_normal, keyed_uniform
from ...base.runs import numbered
from ...base.trimesh import TriMesh, join
from ...base.vectors import cross_rows, zenith_of
from ..mesh.leaves import Leaves
from ..skeleton import Skeleton, depths, root_of
from .anatomy import GROUND, OFF, Anatomy, hold
from .habit import Habit
from .lines import Seats, seat_at, seats_on, share_of, stand_on
from .sibling import Grown

LEAF_SIZE = 0.10  # relative spread
LEAF_TURN = np.deg2rad(12.0)
LEAF_SHIFT = 0.3  # of the distance from leaf to leaf along the branch
BLOCK = 1 << 17  # vertices that are moved at once
Hung = tuple[int, float, str]  # stretch of the axis, how far along it, text
LEAST = 1e-7  # metres and degrees that are left out
FULL_TURN = 360.0
SUNK = 0.1  # of the way from bark to axis, that corners are moved in


@dataclass(frozen=True)
class HungLeaves:
    """L leaves of a tree: leaf of the template, branch, seat on it, size, turn about the branch."""

    source: np.ndarray
    branch: np.ndarray
    seat: Seats
    size: np.ndarray
    turn: np.ndarray


def mesh_of(anatomy: Anatomy, grown: Grown, variety: float) -> tuple[TriMesh, Leaves, np.ndarray]:
    """Wood and leaves of a tree in one mesh, the truth of the leaves, and (L, 3) where they hang.

    Corners of a limb's lowest ring that are off its bearer's mesh are moved into it.
    """
    wood, _ = _carried_in(anatomy, grown, _wood(anatomy, grown))
    leaves, truth, foot = _leaves(anatomy, grown, hang_leaves(anatomy, grown, variety), variety > 0)
    return join([wood, leaves]), truth, foot


def farthest_off(anatomy: Anatomy, grown: Grown) -> float:
    """The largest distance between a vertex and where it was in the template, metres."""
    wood, leaves = anatomy.wood.stock, anatomy.foliage.stock
    vertex, owner, _ = wood.vertices.copy(grown.piece)
    held = anatomy.wood.stretch[vertex], anatomy.wood.part[vertex]
    was = anatomy.lines.at(grown.piece[owner], *held)[0] + wood.place[vertex]
    moved = _wood(anatomy, grown).vertices - was
    hung = hang_leaves(anatomy, grown, 0.0)
    vertex, leaf, _ = leaves.vertices.copy(hung.source)
    was = leaves.place[vertex] + anatomy.foliage.foot[hung.source][leaf]
    fell = _leaves(anatomy, grown, hung, False)[0].vertices - was
    every = np.concatenate([moved, fell])
    return float(np.sqrt(np.einsum("vi,vi->v", every, every).max(initial=0.0)))


def skeleton_of_grown(grown: Grown) -> Skeleton:
    """All wood of a tree as segments, the trunk's first."""
    lines = grown.lines
    line = lines.line
    knot = np.arange(len(lines.length)) + line
    inner = np.arange(len(lines.length)) > lines.first[line]
    bearer = np.maximum(grown.parent, 0)
    seat, _ = seat_at(lines, bearer, grown.share)
    foot = np.where(grown.parent < 0, -1, lines.first[bearer] + seat)
    parent = np.where(inner, np.arange(len(line)) - 1, foot[line])
    return Skeleton(
        start=lines.knot[knot],
        end=lines.knot[knot + 1],
        radius=np.stack([lines.radius[knot], lines.radius[knot + 1]], axis=1),
        parent=parent,
        order=grown.order[line],
        generation=depths(parent),
    )


def _wood(anatomy: Anatomy, grown: Grown) -> TriMesh:
    wood, lines = anatomy.wood, grown.lines
    mesh, vertex, owner, of_triangle = wood.stock.copy(grown.piece, grown.sign < 0)
    knot = np.arange(len(lines.length)) + lines.line
    start, way = lines.knot[knot], lines.knot[knot + 1] - lines.knot[knot]
    scales = [grown.girth, grown.girth * grown.sign[lines.line], grown.scale[lines.line]]
    # By stretch, how what is around it is turned and scaled.
    matrix = (lines.frame * np.stack(scales, axis=1)[:, None]) @ np.swapaxes(
        anatomy.lines.frame[grown.source], 1, 2
    )
    after = np.minimum(np.arange(len(matrix)) + 1, (lines.first[1:] - 1)[lines.line])
    onward = matrix[after] - matrix
    place = np.empty((len(vertex), 3))
    for begin in range(0, len(vertex), BLOCK):
        rows = slice(begin, begin + BLOCK)
        of, first = vertex[rows], lines.first[owner[rows]]
        on, bone = first + wood.stretch[of], first + wood.bone[of]
        turn = onward[bone] * wood.weight[of, None, None] + matrix[bone]
        foot = way[on] * wood.part[of, None] + start[on]
        place[rows] = _turned_about(foot, turn, wood.stock.place[of])
    return replace(mesh, vertices=place, order=grown.order.astype(np.int8)[of_triangle])


def _turned_about(foot: np.ndarray, turn: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Feet (N, 3), and offsets (N, 3) from them turned and scaled by (N, 3, 3), column after column."""
    for k in range(3):
        foot = foot + turn[:, :, k] * offset[:, k, None]
    return foot


def _carried_in(anatomy: Anatomy, grown: Grown, wood: TriMesh) -> tuple[TriMesh, np.ndarray]:
    """Wood whose lowest rings are within what bears them; (B,) metres that the farthest corner was off."""
    stock = anatomy.wood.stock
    vertex, owner, _ = stock.vertices.copy(grown.piece)
    _, of_triangle, _ = stock.triangles.copy(grown.piece)
    ring = np.flatnonzero(anatomy.wood.ring[vertex] & (grown.parent[owner] >= 0))
    far, place = np.zeros(len(grown.piece)), wood.vertices.copy()
    for order in range(1, int(grown.order.max(initial=0)) + 1):  # bearers before what they bear
        row = ring[grown.order[owner[ring]] == order]
        bearer = grown.parent[owner[row]]
        bark, off, axis = hold(grown.lines, bearer, place[row], place, wood.triangles, of_triangle)
        np.maximum.at(far, owner[row], off)
        moved = off > OFF
        place[row[moved]] = (bark + SUNK * (axis - bark))[moved]
    return replace(wood, vertices=place), far


def hang_leaves(anatomy: Anatomy, grown: Grown, variety: float) -> HungLeaves:
    """The leaves of all branches: as many times those of their pieces as they are longer."""
    foliage, lines = anatomy.foliage, anatomy.lines
    row, branch, _ = foliage.of_piece.copy(grown.piece)
    rank = row - foliage.of_piece.first[grown.piece[branch]]
    key = child_keys(child_keys(grown.key[branch], "leaf"), rank)
    times = np.floor(grown.scale[branch] + keyed_uniform(key, "times"))
    times = np.where(grown.scale[branch] == 1, 1, times).astype(np.int64)
    which, copy = numbered(times)
    row, branch, key = row[which], branch[which], key[which]
    key = np.where(copy > 0, child_keys(key, copy), key)

    seat = foliage.seat.select(row)
    piece = grown.piece[branch]
    share = share_of(lines, piece, seat)
    each = 1.0 / np.maximum(foliage.of_piece.size[piece], 1)
    shift = variety * LEAF_SHIFT * (2 * keyed_uniform(key, "shift") - 1)
    shift = np.where(copy > 0, keyed_uniform(key, "further") - 0.5, shift) * each
    moved = np.flatnonzero((shift != 0) & (share < 1) & (share > 0))  # at a tip it stays
    share[moved] = np.clip(share[moved] + shift[moved], 0.0, 1.0)
    seat.stretch[moved], seat.part[moved] = seat_at(lines, piece[moved], share[moved])
    turn = variety * LEAF_TURN * keyed_normal(key, "turn")
    turn = np.where(copy > 0, np.pi * (0.4 + 1.2 * keyed_uniform(key, "turn")), turn)
    size = 1 + variety * LEAF_SIZE * np.clip(keyed_normal(key, "size"), -2, 2)
    return HungLeaves(row, branch, seat, size, turn)


def outline_of(anatomy: Anatomy, grown: Grown, variety: float) -> tuple[Skeleton, Leaves, float]:
    """A tree without its mesh: its wood in segments, the truth of its leaves, and its height in metres."""
    hung = hang_leaves(anatomy, grown, variety)
    foot, matrix = feet_of_leaves(anatomy, grown, hung, variety > 0)
    truth = _truth(anatomy, grown, hung, foot, matrix * hung.size[:, None, None])
    highest = grown.lines.knot[:, 2].max(initial=0.0)
    highest = max(highest, (truth.centre[:, 2]).max(initial=0.0))
    return skeleton_of_grown(grown), truth, float(highest)


def _leaves(
    anatomy: Anatomy, grown: Grown, hung: HungLeaves, varied: bool
) -> tuple[TriMesh, Leaves, np.ndarray]:
    foliage = anatomy.foliage
    source, branch = hung.source, hung.branch
    foot, matrix = feet_of_leaves(anatomy, grown, hung, varied)
    matrix = matrix * hung.size[:, None, None]
    mesh, vertex, leaf, of_triangle = foliage.stock.copy(source, grown.sign[branch] < 0)
    mesh.leaf[:] = of_triangle
    mesh = replace(
        mesh,
        vertices=_turned_about(foot[leaf], matrix[leaf], foliage.stock.place[vertex]),
        order=grown.order.astype(np.int8)[branch][of_triangle],
    )
    return mesh, _truth(anatomy, grown, hung, foot, matrix), foot


def _truth(
    anatomy: Anatomy, grown: Grown, hung: HungLeaves, foot: np.ndarray, matrix: np.ndarray
) -> Leaves:
    """The measures of hung leaves, from where they hang and how they are turned and scaled."""
    foliage, source = anatomy.foliage, hung.source
    own = foliage.truth
    number = np.where(grown.order == 1, np.cumsum(grown.order == 1) - 1, -1)  # -1 for trunks
    first_level = number[root_of(np.where(grown.order > 1, grown.parent, -1))]
    turn = matrix / hung.size[:, None, None]
    return Leaves(
        centre=foot + np.einsum("nij,nj->ni", matrix, (own.centre - foliage.foot)[source]),
        normal=np.einsum("nij,nj->ni", turn, own.normal[source]),
        axis=np.einsum("nij,nj->ni", turn, own.axis[source]),
        length=own.length[source] * hung.size,
        width=own.width[source] * hung.size,
        radius=own.radius[source] * hung.size,
        branch=first_level[hung.branch].astype(np.int32),
    )


def feet_of_leaves(
    anatomy: Anatomy, grown: Grown, hung: HungLeaves, varied: bool
) -> tuple[np.ndarray, np.ndarray]:
    """(L, 3) where leaves hang, and (L, 3, 3) how each is turned from its template.

    varied : whether branches are bent otherwise than in the template.

    A leaf keeps its distance to the bark, and inside the wood its share of the radius.
    """
    foliage, lines = anatomy.foliage, anatomy.lines
    own = foliage.seat.select(hung.source)
    _, was, thick = stand_on(lines, foliage.bearer[hung.source], own)
    place, frame, thickness = stand_on(grown.lines, hung.branch, hung.seat)
    thick = np.maximum(thick, np.finfo(float).tiny)
    outside = own.away > thick
    away = np.where(outside, own.away + (thickness - thick), own.away / thick * thickness)
    sign = grown.sign[hung.branch]
    around = sign * own.aside + hung.turn
    foot = place + (away * np.cos(around))[:, None] * frame[:, :, 0]
    foot += (away * np.sin(around))[:, None] * frame[:, :, 1]
    foot += own.along[:, None] * frame[:, :, 2]
    # Turned about the branch by ``turn``, mirrored across B.
    cos, sin = np.cos(hung.turn), np.sin(hung.turn)
    turned = np.empty_like(frame)
    turned[:, :, 0] = cos[:, None] * frame[:, :, 0] + sin[:, None] * frame[:, :, 1]
    turned[:, :, 1] = sign[:, None] * (
        -sin[:, None] * frame[:, :, 0] + cos[:, None] * frame[:, :, 1]
    )
    turned[:, :, 2] = frame[:, :, 2]
    matrix = turned @ np.swapaxes(was, 1, 2)
    if varied:
        matrix = _facing(matrix, foliage.truth.normal[hung.source])
    return foot, matrix


def _facing(matrix: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(L, 3, 3) turned by the least turn that gives each leaf the inclination of its template.

    A leaf keeps to the light whatever way its branch is bent.
    """
    now = np.einsum("nij,nj->ni", matrix, normal)
    flat = np.hypot(now[:, 0], now[:, 1])
    some = flat > 1e-9
    level = np.hypot(normal[:, 0], normal[:, 1]) / np.where(some, flat, 1.0)
    to = np.stack([now[:, 0] * level, now[:, 1] * level, normal[:, 2]], axis=1)
    to[~some] = now[~some]
    axis, cosine = cross_rows(now, to), np.einsum("ni,ni->n", now, to)
    cross = np.zeros((len(now), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -axis[:, 2], axis[:, 1], -axis[:, 0]
    cross -= np.swapaxes(cross, 1, 2)
    turn = np.eye(3) + cross + cross @ cross / np.maximum(1 + cosine, 1e-9)[:, None, None]
    return np.asarray(turn @ matrix)


def standing_of(grown: Grown) -> tuple[float, float, float]:
    """Measures of one tree.

    Returns
    -------
    Radians between the vertical and the way from foot to tip of the trunk that leans most; metres from the
    foot of a branch to its parent's wood, at most, 0 within; radius of a branch at its foot over its parent's
    there, at most.
    """
    lines, knots = grown.lines, grown.lines.first + np.arange(len(grown.lines.first))
    feet, tips = lines.knot[knots[:-1]], lines.knot[knots[1:] - 1]
    lean = float(zenith_of((tips - feet)[grown.order == 0]).max())
    borne = np.flatnonzero(grown.parent >= 0)
    if not len(borne):
        return lean, 0.0, 0.0
    seat = seats_on(lines, grown.parent[borne], feet[borne])
    _, _, thick = stand_on(lines, grown.parent[borne], seat)
    gap = np.hypot(seat.away, seat.along) - thick
    thicker = lines.radius[knots[:-1]][borne] / np.maximum(thick, np.finfo(float).tiny)
    return lean, max(float(gap.max()), 0.0), float(thicker.max())


def hold_rings(anatomy: Anatomy, grown: Grown) -> tuple[np.ndarray, np.ndarray]:
    """Hold the lowest rings of B branches' meshes against the wood that bears them.

    Returns
    -------
    (B,) metres that the ring's farthest corner is off as laid, 0 inside; and once what was off by more than
    ``OFF`` has been moved in.
    """
    wood, far = _carried_in(anatomy, grown, _wood(anatomy, grown))
    return far, _carried_in(anatomy, grown, wood)[1]


def lowest_corner(anatomy: Anatomy, grown: Grown, variety: float) -> float:
    """Metres above the ground of the lowest vertex of a grown tree's mesh."""
    return float(mesh_of(anatomy, grown, variety)[0].vertices[:, 2].min())


def write_string(habit: Habit, grown: Grown, variety: float, generations: int) -> str:
    """The string after so many generations; one more than the deepest order has the leaves too."""
    parts: dict[int, list[Hung]] = {}
    orders, lines = int(grown.order.max(initial=0)) + 1, grown.lines
    if generations > orders:
        for branch, hung in _hung_texts(habit.anatomy, grown, variety):
            parts.setdefault(branch, []).append(hung)
    stretch, part, off = _seats(grown)
    for branch in range(len(grown.piece) - 1, -1, -1):  # children come after their parents
        order, parent = int(grown.order[branch]), int(grown.parent[branch])
        if order > generations:
            continue
        own, first = parts.pop(branch, []), lines.first[branch]
        if order < generations:
            text = _axis(grown, branch, own)
        else:
            reach = lines.length[first : lines.first[branch + 1]].sum()
            kind, diameter = habit.kind[grown.piece[branch]], 2 * lines.radius[first + branch]
            text = f"{chr(ord('A') + min(order, 20))}({kind},{reach:.6g},{diameter:.6g})"
        # Symbols that bring the turtle from the parent's axis into the branch's frame.
        frame = GROUND if parent < 0 else lines.frame[lines.first[parent] + stretch[branch]]
        text = _moved(off[branch]) + _turned(frame.T @ lines.frame[first]) + text
        opened = f"[{text}]" if parent >= 0 or (grown.parent < 0).sum() > 1 else text
        seat = int(stretch[branch]), float(part[branch])
        parts.setdefault(parent, []).append((*seat, opened))
    return "".join(text for _, _, text in parts.get(-1, []))


def generations_of(habit: Habit) -> int:
    """Number of times that a string is rewritten until the leaves are set."""
    return int(habit.anatomy.order.max(initial=0)) + 2


def _axis(grown: Grown, branch: int, hanging: list[Hung]) -> str:
    """The steps of an axis with what hangs on it."""
    lines = grown.lines
    rows = range(int(lines.first[branch]), int(lines.first[branch + 1]))
    hanging = sorted(hanging, key=lambda hung: hung[:2])
    out, next_one = [], 0
    for number, row in enumerate(rows):
        out.append(_turned(lines.frame[row - 1].T @ lines.frame[row]) if number else "")
        knot = row + branch
        out.append(f"!({lines.radius[knot] + lines.radius[knot + 1]:.6g})")
        at = 0.0
        while next_one < len(hanging) and hanging[next_one][0] == number:
            part = hanging[next_one][1]
            out += [_step("F", (part - at) * lines.length[row]), hanging[next_one][2]]
            at, next_one = part, next_one + 1
        out.append(_step("F", (1.0 - at) * lines.length[row]))
    return "".join(out)


def _seats(grown: Grown) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Seats of branches: stretch and part of the parent, (B, 3) from its axis to the foot in its frame."""
    lines = grown.lines
    foot = lines.knot[lines.first[:-1] + np.arange(len(grown.piece))]
    borne = np.flatnonzero(grown.parent >= 0)
    seats = seats_on(lines, grown.parent[borne], foot[borne])
    stretch, part = np.zeros(len(foot), np.int64), np.zeros(len(foot))
    stretch[borne], part[borne] = seats.stretch, seats.part
    off = foot.copy()  # on the ground, in its frame
    off[borne] = np.stack(
        [seats.away * np.cos(seats.aside), seats.away * np.sin(seats.aside), seats.along], axis=1
    )
    return stretch, part, off


def _hung_texts(anatomy: Anatomy, grown: Grown, variety: float) -> Iterator[tuple[int, Hung]]:
    """The branch of every leaf, and how it hangs there."""
    hung = hang_leaves(anatomy, grown, variety)
    foot, matrix = feet_of_leaves(anatomy, grown, hung, variety > 0)
    own = anatomy.foliage.truth
    heading = np.einsum("nij,nj->ni", matrix, own.axis[hung.source])
    outward = np.einsum("nij,nj->ni", matrix, (own.centre - anatomy.foliage.foot)[hung.source])
    heading *= np.where(np.einsum("ni,ni->n", heading, outward) < 0, -1.0, 1.0)[:, None]
    up = np.einsum("nij,nj->ni", matrix, own.normal[hung.source])
    frame = np.stack([np.cross(up, heading), up, heading], axis=2)
    line = hung.branch
    place, bearer, _ = stand_on(grown.lines, line, hung.seat)
    off = np.einsum("nij,ni->nj", bearer, foot - place)
    for row in range(len(line)):
        size = f"~({own.length[hung.source[row]] * hung.size[row]:.6g},"
        size += f"{own.width[hung.source[row]] * hung.size[row]:.6g})"
        text = f"[{_moved(off[row])}{_turned(bearer[row].T @ frame[row])}{size}]"
        yield int(line[row]), (int(hung.seat.stretch[row]), float(hung.seat.part[row]), text)


def _moved(off: np.ndarray) -> str:
    """Move the turtle to a place (3,) in its frame; the frame stays."""
    away = float(np.hypot(off[0], off[1]))
    text = _step("f", float(off[2]))
    if away > LEAST:
        around = float(np.rad2deg(np.arctan2(off[1], off[0]))) + 90.0
        text += f"{_turn(chr(92), around)}&(90)f({away:.6g})&(-90){_turn(chr(92), -around)}"
    return text


def _turned(matrix: np.ndarray) -> str:
    """Turn the turtle into a frame (3, 3) given in its present one."""
    angle = float(np.arctan2(np.hypot(matrix[0, 2], matrix[1, 2]), matrix[2, 2]))
    if np.rad2deg(angle) < LEAST:
        return _turn("\\", float(np.rad2deg(np.arctan2(matrix[1, 0], matrix[0, 0]))))
    before = float(np.rad2deg(np.arctan2(matrix[0, 2], -matrix[1, 2])))
    after = float(np.rad2deg(np.arctan2(matrix[2, 0], matrix[2, 1])))
    return _turn("\\", before) + _turn("&", float(np.rad2deg(angle))) + _turn("\\", after)


def _turn(symbol: str, degrees: float) -> str:
    degrees = (degrees + FULL_TURN / 2) % FULL_TURN - FULL_TURN / 2
    return f"{symbol}({degrees:.9g})" if abs(degrees) > LEAST else ""


def _step(symbol: str, length: float) -> str:
    return f"{symbol}({length:.9g})" if abs(length) > LEAST else ""
