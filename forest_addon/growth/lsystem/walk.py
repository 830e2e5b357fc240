"""The general turtle: commands to a skeleton, all that is equally far from the root at once.

A turtle's state is a place, a frame (heading H, left L, up U, kept as a quaternion), a diameter and the
segment drawn last. Each step makes a new state of the one before it on its path, so the steps of one
level of ``paths`` are worked through together, whatever branches they stand in. Tropism is ABOP's:
after each segment the heading turns towards T by e·|H × T|, about H × T (section 2.1, p. 58).
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ..skeleton import LeafSites, Skeleton
from .dialect import DRAW, LEAF, LEVEL, MOVE, Commands
from .paths import Paths, find_paths
from .steps import Steps, join_commands, product
from .word import GrammarError

_PARALLEL = 1e-12  # |H × T| below which a heading counts as parallel: no bend, no roll


@dataclass(frozen=True)
class Bend:
    """Tropism: direction T (ABOP: its length counts) and elasticity e in radians."""

    direction: tuple[float, float, float] = (0.0, 0.0, -1.0)
    elasticity: float = 0.0


@dataclass(frozen=True)
class Walk:
    """Drawing of a turtle; lengths in its own unit.

    skeleton : its segments, in the order of the string.
    leaves : length and width NaN where the string says none.
    branch, leaf_branch : (S,), (L,) brackets that a segment and a leaf stand in.
    parent : (B,) branch that each branch leaves.
    """

    skeleton: Skeleton
    leaves: LeafSites
    branch: np.ndarray
    leaf_branch: np.ndarray
    mother: np.ndarray


def walk(commands: Commands, diameter: float, bend: Bend | None = None) -> Walk:
    """Walk a turtle from the origin along +Z, its left towards +X.

    Raises
    ------
    GrammarError : brackets do not match, or a diameter is negative.
    """
    bend = bend or Bend()
    steps = join_commands(commands)
    paths = find_paths(steps.opens, steps.closes)
    steps = _open_only(steps, paths.command)
    kind, number, outline = steps.kind, steps.number, steps.outline
    drawn = (kind == DRAW) & (outline < 0)
    states = _states(steps, drawn, paths, diameter, bend)
    if (states.diameter < 0).any():
        raise GrammarError("a diameter is negative; make it 0 or larger")

    segment = np.flatnonzero(drawn)
    leaf = np.flatnonzero(((kind == LEAF) & (outline < 0)) | _begins(outline))
    leaves = LeafSites(
        foot=states.place[leaf],
        direction=states.heading(leaf),
        up=states.up(leaf),
        length=np.where(kind[leaf] == LEAF, number[leaf, 0], np.nan),
        width=np.where(kind[leaf] == LEAF, number[leaf, 1], np.nan),
        segment=states.last[leaf],
    )
    _measure_outlines(leaves, leaf, outline, states)
    start = states.place[paths.before[segment]] if len(segment) else np.empty((0, 3))
    start[paths.before[segment] < 0] = 0.0
    radius = states.drawn_diameter[segment] / 2
    skeleton = Skeleton(
        start=start,
        end=states.place[segment],
        radius=np.stack([radius, radius], axis=1),
        parent=states.mother[segment],
        order=states.order[segment],
        generation=states.generation[segment],
    )
    return Walk(skeleton, leaves, paths.branch[segment], paths.branch[leaf], paths.mother)


@dataclass(frozen=True)
class _States:
    """The turtle after each of P steps."""

    turn: np.ndarray  # (4, P) quaternion from its frame to the world
    place: np.ndarray  # (P, 3)
    diameter: np.ndarray  # (P,)
    drawn_diameter: np.ndarray  # (P,) of the segment that a step draws
    last: np.ndarray  # (P,) the segment drawn last
    mother: np.ndarray  # (P,) the one before it
    order: np.ndarray  # (P,)
    generation: np.ndarray  # (P,)

    def heading(self, which: np.ndarray) -> np.ndarray:
        """(N, 3)"""
        return _heading(self.turn[:, which]).T

    def up(self, which: np.ndarray) -> np.ndarray:
        """(N, 3)"""
        return _up(self.turn[:, which]).T

    def left(self, which: np.ndarray) -> np.ndarray:
        """(N, 3)"""
        return np.cross(self.up(which), self.heading(which))


def _open_only(steps: Steps, command: np.ndarray) -> Steps:
    """The steps without closing brackets."""
    return Steps(
        **{
            field.name: getattr(steps, field.name)[..., command]
            if field.name != "number"
            else steps.number[command]
            for field in fields(Steps)
        }
    )


def _states(steps: Steps, drawn: np.ndarray, paths: Paths, diameter: float, bend: Bend) -> _States:
    """Level by level, in arrays sorted by level; place 0 is the turtle before all steps."""
    count = len(steps.kind)
    by_level = np.argsort(paths.level, kind="stable")
    slot = np.empty(count + 1, np.int64)  # where each step's state is; the last is "none before"
    slot[by_level] = np.arange(1, count + 1)
    slot[count] = 0
    before = slot[paths.before[by_level]]
    own = (np.cumsum(drawn) - 1)[by_level]  # number of the segment that a step draws
    kind, number, drawn = steps.kind[by_level], steps.number[by_level], drawn[by_level]
    local, factor, offset = steps.turn[:, by_level], steps.factor[by_level], steps.offset[by_level]
    branch = paths.branch[by_level]

    reach = np.where((kind == DRAW) | (kind == MOVE), number[:, 0], 0.0)
    levels_left = kind == LEVEL
    bends = drawn & (reach != 0) & (bend.elasticity != 0)
    tropism = np.asarray(bend.direction, np.float64)

    turn = np.zeros((4, count + 1))
    turn[0, 0] = 1.0
    place = np.zeros((3, count + 1))
    width = np.full(count + 1, diameter)
    last = np.full(count + 1, -1)
    mother = np.full(count + 1, -1)
    last_branch = np.full(count + 1, -1)
    order = np.zeros(count + 1, np.int64)
    generation = np.full(count + 1, -1)

    ends = np.searchsorted(paths.level[by_level], np.arange(int(paths.level.max(initial=-1)) + 2))
    for begin, end in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        here, new, old = slice(begin, end), slice(begin + 1, end + 1), before[begin:end]
        turned = product(turn[:, old], local[:, here])
        rolls = np.flatnonzero(levels_left[here])
        if len(rolls):
            turned[:, rolls] = _level(turned[:, rolls])
        place[:, new] = place[:, old] + reach[here] * _heading(turned)
        bent = np.flatnonzero(bends[here])
        if len(bent):
            turned[:, bent] = _bend(turned[:, bent], tropism, bend.elasticity)
        turn[:, new] = turned
        width[new] = width[old] * factor[here] + offset[here]

        draws, before_it = drawn[here], last[old]
        mother[new] = before_it
        last[new] = np.where(draws, own[here], before_it)
        leaves_axis = (before_it >= 0) & (last_branch[old] != branch[here])
        order[new] = order[old] + (draws & leaves_axis)
        generation[new] = generation[old] + draws
        last_branch[new] = np.where(draws, branch[here], last_branch[old])

    given = np.where(kind == DRAW, number[:, 1], np.nan)
    drawn_width = np.where(np.isnan(given), width[1:], given)
    back = slot[:count]
    return _States(
        turn=turn[:, back],
        place=np.ascontiguousarray(place[:, back].T),
        diameter=width[back],
        drawn_diameter=drawn_width[back - 1],
        last=last[back],
        mother=mother[back],
        order=order[back],
        generation=generation[back],
    )


def _heading(q: np.ndarray) -> np.ndarray:
    """(3, N) the image of the turtle's z; the norm is divided out, so rounding cannot build up."""
    w, x, y, z = q
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    image = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), ww - xx - yy + zz])
    return np.asarray(image / (ww + xx + yy + zz))


def _up(q: np.ndarray) -> np.ndarray:
    """(3, N) the image of its y."""
    w, x, y, z = q
    ww, xx, yy, zz = w * w, x * x, y * y, z * z
    image = np.stack([2 * (x * y - w * z), ww - xx + yy - zz, 2 * (y * z + w * x)])
    return np.asarray(image / (ww + xx + yy + zz))


def _level(q: np.ndarray) -> np.ndarray:
    """Rolled about the heading until left is horizontal, V × H; a vertical heading keeps its roll."""
    heading, up = _heading(q), _up(q)
    left = np.cross(up, heading, axis=0)
    wanted = np.stack([-heading[1], heading[0], np.zeros(q.shape[1])])
    length = np.hypot(wanted[0], wanted[1])
    # left -> cos·left + sin·up, right-handed about the heading
    angle = np.arctan2((up * wanted).sum(axis=0), (left * wanted).sum(axis=0))
    half = np.where(length > 1e-9, angle, 0.0) / 2
    zero = np.zeros_like(half)
    return product(q, np.stack([np.cos(half), zero, zero, np.sin(half)]))


def _bend(q: np.ndarray, tropism: np.ndarray, elasticity: float) -> np.ndarray:
    """Turned towards the tropism by elasticity·|H × T|; a heading along it, or against it, stays."""
    axis = np.cross(_heading(q), tropism, axis=0)
    size = np.sqrt((axis * axis).sum(axis=0))
    half = elasticity * size / 2
    axis = axis / np.maximum(size, _PARALLEL)
    return product(np.concatenate([np.cos(half)[None], np.sin(half) * axis]), q)


def _begins(outline: np.ndarray) -> np.ndarray:
    """(P,) whether an outline begins at a step."""
    found = np.zeros(len(outline), bool)
    numbers, first = np.unique(outline, return_index=True)
    found[first[numbers >= 0]] = True
    return found


def _measure_outlines(
    leaves: LeafSites, leaf: np.ndarray, outline: np.ndarray, states: _States
) -> None:
    """Fill in length and width of leaves that were walked: their extents along and across."""
    walked = np.flatnonzero(outline[leaf] >= 0)
    if not len(walked):
        return
    row = np.full(int(outline.max()) + 1, -1)
    row[outline[leaf[walked]]] = walked
    inside = np.flatnonzero(outline >= 0)
    owner = row[outline[inside]]
    offset = states.place[inside] - leaves.foot[owner]
    left = states.left(leaf)
    for out, axis in ((leaves.length, leaves.direction), (leaves.width, left)):
        along = np.einsum("ni,ni->n", offset, axis[owner])
        low, high = np.zeros(len(leaf)), np.zeros(len(leaf))
        np.minimum.at(low, owner, along)
        np.maximum.at(high, owner, along)
        out[walked] = (high - low)[walked]
