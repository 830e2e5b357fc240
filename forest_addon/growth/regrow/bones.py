"""The stretches by which a piece of wood is bent: few, and where its mesh can bend.

A recognised centreline has many knots, evenly spaced. Kept are as many as it is bent, each moved to the
nearest place along the line where the piece has vertices. Between two rings of a tube there are none, so
its mesh runs straight there and so does the line; what hangs on the line then hangs on the mesh. A piece
with two rings is one stretch and stays straight.
"""

from __future__ import annotations

import numpy as np

from ...base.runs import bounds
from ..recognise.recognise import Recognition
from .lines import Lines, nearest

STRAIGHT = np.deg2rad(12.0)  # of bend that one stretch stands for
OFF_AXIS = 0.1  # radii that a chord may be off its line
FEWEST = 4  # stretches of a branch
THINNEST = 1e-5  # metres, of what a coarse mesh leaves no thickness
SHORTEST = 0.02  # of a line's length; nearer knots are one


def find_bones(
    found: Recognition, place: np.ndarray, origin: np.ndarray, metres: float
) -> tuple[Lines, np.ndarray, np.ndarray, np.ndarray]:
    """Lines from foot to tip, without frames yet, and where vertices are along them.

    place : (V, 3) vertices of the wood, metres from the origin.

    Returns
    -------
    The lines; (S, 3) unit directions of their stretches; (V,) stretch of its line that each vertex is on;
    (V,) how far along it, 0 .. 1.
    """
    owner = found.wood.piece_of_vertex.astype(np.int64)
    whole = _from_foot_to_tip(found, origin, metres)
    stretch, part = nearest(whole, owner, place)
    along = _along(whole, owner, stretch, np.clip(part, 0.0, 1.0))
    line, share = _knots(whole, owner, along, trunk=found.parent < 0)
    size = np.bincount(line, minlength=len(whole.first) - 1)
    lines, direction = _through(*_at(whole, line, share), bounds(size))

    # Lines and vertices are laid one behind the other, so that one search does for all.
    spread = line + np.clip(share, 0.0, 0.999999)
    knot = np.searchsorted(spread, owner + np.clip(along, 0.0, 0.999999), side="right") - 1
    first = lines.first[owner] + owner
    knot = np.clip(knot, first, first + np.diff(lines.first)[owner] - 1)
    step = np.maximum(share[knot + 1] - share[knot], np.finfo(float).tiny)
    return lines, direction, knot - first, np.clip((along - share[knot]) / step, 0.0, 1.0)


def _from_foot_to_tip(found: Recognition, origin: np.ndarray, metres: float) -> Lines:
    """The recognised lines, all knots, each from its foot on."""
    first = found.lines.first
    size = np.diff(first)
    owner = np.repeat(np.arange(len(size)), size)
    rank = np.arange(first[-1]) - first[owner]
    backwards = found.hierarchy.foot_end[owner] == 1
    row = first[owner] + np.where(backwards, size[owner] - 1 - rank, rank)
    knot = (found.lines.knot[row] - origin) * metres
    radius = np.maximum(found.lines.radius[row] * metres, THINNEST)
    return _through(knot, radius, first.astype(np.int64))[0]


def _through(knot: np.ndarray, radius: np.ndarray, first: np.ndarray) -> tuple[Lines, np.ndarray]:
    """Lines through knots, of which line c has first[c] .. first[c + 1] - 1; and (S, 3) directions."""
    size = np.diff(first)
    owner = np.repeat(np.arange(len(size)), size)
    inner = np.ones(len(knot), dtype=bool)
    inner[first[1:] - 1] = False
    way = (knot[1:] - knot[:-1])[inner[:-1]]
    length = np.linalg.norm(way, axis=1)
    direction = way / np.maximum(length, np.finfo(float).tiny)[:, None]
    broken = length < 1e-9  # no direction of its own: the line's
    whole = (knot[first[1:] - 1] - knot[first[:-1]])[owner[inner]]
    whole /= np.maximum(np.linalg.norm(whole, axis=1, keepdims=True), np.finfo(float).tiny)
    direction[broken] = whole[broken]
    direction[np.linalg.norm(direction, axis=1) < 0.5] = (0.0, 0.0, 1.0)
    return Lines(bounds(size - 1), knot, radius, length, np.empty((0, 3, 3))), direction


def _shares(lines: Lines) -> np.ndarray:
    """(S + C,) of every knot, how far along its line it is, 0 .. 1."""
    line = np.repeat(np.arange(len(lines.first) - 1), np.diff(lines.first) + 1)
    gone = np.zeros(len(line))
    gone[np.arange(len(lines.length)) + lines.line + 1] = lines.length
    total = np.cumsum(gone)
    begin = total[lines.first[:-1] + np.arange(len(lines.first) - 1)]
    reach = np.maximum(lines.reach(), np.finfo(float).tiny)
    return np.asarray(np.clip((total - begin[line]) / reach[line], 0.0, 1.0))


def _along(lines: Lines, line: np.ndarray, stretch: np.ndarray, part: np.ndarray) -> np.ndarray:
    """(N,) share of their line at which places are."""
    share = _shares(lines)
    knot = lines.first[line] + stretch + line
    return np.asarray(share[knot] + part * (share[knot + 1] - share[knot]))


def _at(lines: Lines, line: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Knots (N, 3) and radii (N,) at shares of lines, both ascending."""
    of_knot = np.repeat(np.arange(len(lines.first) - 1), np.diff(lines.first) + 1)
    place, wanted = 2.0 * of_knot + _shares(lines), 2.0 * line + share  # rises from line to line
    knot = np.stack([np.interp(wanted, place, axis) for axis in lines.knot.T], axis=1)
    return knot, np.interp(wanted, place, lines.radius)


def _knots(
    lines: Lines, owner: np.ndarray, along: np.ndarray, trunk: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Line and share of every knot that is kept, ascending."""
    count = len(lines.first) - 1
    wanted = _enough(lines, trunk)
    line = np.repeat(np.arange(count), wanted + 1)
    rank = np.arange(len(line)) - bounds(wanted + 1)[line]
    share = rank / wanted[line]
    # To the nearest place with vertices; 2 apart from line to line, and ends of lines are places too.
    ends = np.arange(count)
    places = np.sort(np.concatenate([2.0 * owner + along, 2.0 * ends, 2.0 * ends + 1.0]))
    aim = 2.0 * line + share
    after = np.clip(np.searchsorted(places, aim), 1, len(places) - 1)
    low, high = places[after - 1], places[after]
    snapped = np.where(aim - low <= high - aim, low, high) - 2.0 * line
    inside = (rank > 0) & (rank < wanted[line])
    share = np.where(inside, np.clip(snapped, 0.0, 1.0), share)
    apart = np.diff(share, prepend=-1.0) > SHORTEST
    kept = ~inside | (apart & (share < 1.0 - SHORTEST))
    return line[kept], share[kept]


def _enough(lines: Lines, trunk: np.ndarray) -> np.ndarray:
    """(C,) stretches that a line needs: all of trunks, else as it is bent.

    A line of length l that bends by b in all is off n chords by about l·b/(8n²).
    """
    size, line = np.diff(lines.first), lines.line
    knot = np.arange(len(lines.length)) + line
    way = (lines.knot[knot + 1] - lines.knot[knot]) / np.maximum(lines.length, 1e-12)[:, None]
    bent = np.arccos(np.clip(np.einsum("ni,ni->n", way[1:], way[:-1]), -1.0, 1.0))
    within = line[1:] == line[:-1]
    total = np.bincount(line[1:][within], bent[within], len(size))
    thin = np.add.reduceat(lines.radius, lines.first[:-1] + np.arange(len(size))) / (size + 1)
    off = np.sqrt(total * lines.reach() / (8 * OFF_AXIS * np.maximum(thin, 1e-9)))
    wanted = np.ceil(np.maximum(np.maximum(total / STRAIGHT, off), FEWEST)).astype(np.int64)
    return np.where(trunk, size, np.minimum(wanted, size))
