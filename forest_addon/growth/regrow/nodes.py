"""Nodes of axes, where their children stand: moved along and turned about the axis.

The nodes of a production are kept in their order. Where an axis is longer or shorter than its template it
has more or fewer of them, evenly (systematic sampling); each is moved by as much as spacing is uneven in
the template. On a trunk the turn from node to node is that of a node near by, so that a spiral stays a
spiral and whorls stay whorls; on other axes children keep their side, above, below, left or right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.rng import daughter_keys, keyed_normal, keyed_uniform
from .fitted import Habit

JITTER = 0.25  # share of the scatter of spacing by which a node moves
FARTHEST = 0.8  # share of the way to the next node
BASE_SPREAD = 0.06  # of the height of the crown's base
EVEN = 0.8  # mean resultant length of turns from which they are even (Mardia 1972)
TURN_SPREAD = np.deg2rad(12.0)  # of turns that are not even
SIDE_SPREAD = np.deg2rad(12.0)
GOLDEN = np.pi * (3 - np.sqrt(5))
LOPSIDED = 0.05  # more to one side than in the template
TRIES = 12  # other turns that are drawn where branches stand to one side
NEIGHBOURS = 2  # nodes to either side that a turn is taken from


@dataclass(frozen=True)
class Placed:
    """N children.

    slot : (N,) the piece that stands there in the template. parent : (N,) the piece that bears it there.
    owner : (N,) which of the axes bears it. key : (N,) lineage.
    share : (N,) seat along the axis. place : (N,) the same, where tables are read.
    azimuth : (N,) about the axis.
    """

    slot: np.ndarray
    mother: np.ndarray
    owner: np.ndarray
    key: np.ndarray
    share: np.ndarray
    place: np.ndarray
    azimuth: np.ndarray


def place_daughters(
    habit: Habit,
    piece: np.ndarray,
    key: np.ndarray,
    count: np.ndarray,
    variety: float,
    order: int,
) -> Placed:
    """The children of axes that are these pieces (B,) with these keys (B,).

    count : (B,) factor of their number. order : of the children.
    """
    slots = habit.slots
    row, owner, _ = slots.of_piece.copy(piece)
    node, limb = slots.node[row], slots.limb[row]
    own_key = daughter_keys(key[owner], row - slots.of_piece.first[piece[owner]])

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
    of_node = daughter_keys(daughter_keys(key[owner], "node"), node)
    z = np.clip(keyed_normal(of_node, "move"), -2.0, 2.0) * variety * habit.scatter[order] * JITTER
    z = np.clip(z, -FARTHEST, FARTHEST)
    share = share + z * np.where(z > 0, slots.after[row], slots.before[row])
    place = share = np.clip(share, 0.0, 1.0)
    if order == 1 and variety > 0:
        share = _moved_base(share, owner, key, variety)
    azimuth = habit.anatomy.azimuth[slot]
    if order == 1:
        azimuth = _turned(habit, piece, key, row, owner, at, variety)
    else:
        azimuth = azimuth + variety * SIDE_SPREAD * keyed_normal(own_key, "side")
    azimuth = azimuth + np.where(
        twin > 0, np.pi * (0.4 + 1.2 * keyed_uniform(own_key, "across")), 0
    )
    return Placed(slot, piece[owner], owner, own_key, share, place, azimuth)


def _repeated(times: np.ndarray, *columns: np.ndarray) -> tuple[np.ndarray, ...]:
    """Rows so many times each: the first three columns, the copy's number, its row's times, the rest.

    The keys, the third column, of further copies are those of children of the first.
    """
    which = np.repeat(np.arange(len(times)), times)
    copy = np.arange(len(which)) - np.repeat(np.cumsum(times) - times, times)
    row, owner, key, *rest = (column[which] for column in columns)
    key = np.where(copy > 0, daughter_keys(key, copy), key)
    return row, owner, key, copy, times[which], *rest


def _moved_base(
    share: np.ndarray, owner: np.ndarray, key: np.ndarray, variety: float
) -> np.ndarray:
    """Shares of trunks whose crowns begin higher or lower; the top stays."""
    low = np.ones(len(key))
    np.minimum.at(low, owner, share)
    wanted = low * np.exp(variety * BASE_SPREAD * np.clip(keyed_normal(key, "base"), -2, 2))
    wanted = np.minimum(wanted, 0.9)
    part = (share - low[owner]) / np.maximum(1 - low[owner], 1e-9)
    return np.asarray(wanted[owner] + part * (1 - wanted[owner]))


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
        mine = np.flatnonzero(owner == number)
        run = slice(
            slots.of_piece.first[piece[number]],
            slots.of_piece.first[piece[number]] + slots.of_piece.size[piece[number]],
        )
        nodes, opens = np.unique(slots.node[run], return_index=True)
        if len(nodes) < 2 or not len(mine):
            continue
        standing = anatomy.azimuth[slots.piece[run]][opens]  # of the first on each node
        seen, place = np.unique(at[mine], return_inverse=True)  # (M,) nodes that stand
        relative = azimuth[mine] - standing[slots.node[row[mine]]]
        free, reach = ~slots.limb[row[mine]], anatomy.lines.reach()[slots.piece[row[mine]]]
        own = _lopsided(anatomy.azimuth[slots.piece[run]], anatomy.lines.reach()[slots.piece[run]])
        tries = daughter_keys(np.repeat(key[number : number + 1], TRIES), np.arange(TRIES))
        least, chosen = np.inf, azimuth[mine]
        for attempt in (int(key[number]), *tries.tolist()):
            turned = _turned_nodes(standing, seen, attempt, variety)[place.ravel()]
            drawn = np.where(free, turned + relative, azimuth[mine])
            off = _lopsided(drawn, reach)
            if off < least:
                least, chosen = off, drawn
            if off <= own + LOPSIDED:
                break
        azimuth[mine] = chosen
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
    keys = daughter_keys(np.full(len(node), key, np.uint64), np.arange(len(node)))
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
