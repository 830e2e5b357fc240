"""T20's symbols to a skeleton.

``d`` is an internode and ``g`` a growing tip, both a segment. ``(`` starts a side branch at the current
node and ``[`` lets the axis grow on; ``)`` goes back to the node where they stood. ``+`` starts a branch
at the place symmetric to the previous one, raised by a random height along the axis; it ends with its
parent. A side branch leaves at the branching angle, its symmetric one at the opposite angle, and each
internode on an axis is twisted about it (Tanveer et al. 2020a).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ...base.rng import truncated_normal
from ...spec import Grammar, Jitter
from ..skeleton import Skeleton

CENTRE, SIDE, SYMMETRIC = 0, 1, 2
_ROLE = {ord("["): CENTRE, ord("("): SIDE, ord("+"): SYMMETRIC}
# Symbols whose segments ``)`` goes back from: a symmetric branch ends with its parent in Tanveer et al.
# 2020a, in A20 it has a bracket of its own, and the trunk goes on without one.
_OPENING = {"T20": b"[(", "A20": b"(+"}


def parse(symbols: np.ndarray, dialect: str = "T20") -> tuple[np.ndarray, np.ndarray]:
    """Parent (S,) and role (S,) of every segment of Tanveer et al. 2020a or 2020b symbols, in the order
    they are written.

    Raises
    ------
    ValueError : a bracket closes what was not opened, or a symbol is not Tanveer et al.'s.
    """
    parent: list[int] = []
    role: list[int] = []
    open_nodes: list[int] = []
    node, next_role = -1, CENTRE
    opening = _OPENING[dialect]
    for position, symbol in enumerate(symbols.tolist()):
        if symbol in (100, 103):  # d, g
            parent.append(node)
            role.append(next_role)
            node = len(parent) - 1
        elif symbol == 41:  # )
            if open_nodes:
                node = open_nodes.pop()
            elif position != len(symbols) - 1:
                raise ValueError(f"symbol {position}: ')' closes a branch that was not opened")
        elif symbol in _ROLE:
            next_role = _ROLE[symbol]
            if symbol in opening:
                open_nodes.append(node)
        else:
            raise ValueError(f"symbol {position}: '{chr(symbol)}' is not one of d g ( ) [ +")
    return np.array(parent, dtype=np.int64), np.array(role, dtype=np.int64)


@lru_cache(maxsize=16)
def _lineage(symbols: bytes, dialect: str) -> tuple[np.ndarray, ...]:
    """Parent, role, generation and order (S,) of every segment: one string serves a whole species."""
    parent, role = parse(np.frombuffer(symbols, np.uint8), dialect)
    generation = np.zeros(len(parent), dtype=np.int64)
    order = np.zeros(len(parent), dtype=np.int64)
    for segment in range(1, len(parent)):  # parents come first
        mother = parent[segment]
        generation[segment] = generation[mother] + 1
        order[segment] = order[mother] + (role[segment] != CENTRE)
    for column in (parent, role, generation, order):
        column.setflags(write=False)
    return parent, role, generation, order


def interpret(
    symbols: np.ndarray, grammar: Grammar, jitter: Jitter, rng: np.random.Generator
) -> Skeleton:
    """The skeleton of a T20 string, foot at the origin, growing along +Z.

    All segments of one generation are placed at once. Draws are taken per segment in the order of the
    string, so the skeleton is a function of the string and the stream alone.
    """
    parent, role, generation, order = _lineage(symbols.tobytes(), grammar.dialect)
    count = len(parent)
    draws = {
        name: truncated_normal(rng, count) for name in ("length", "angle", "twist", "lean", "side")
    }
    lift = rng.random(count) * jitter.raise_ratio

    ratio = np.where(role == CENTRE, grammar.centre_ratio, grammar.side_ratio)
    length = np.empty(count)
    radius = np.empty(count)
    heading = np.empty((count, 3))  # H
    left = np.empty((count, 3))  # L, the axis that side branches turn about
    start = np.empty((count, 3))
    end = np.empty((count, 3))

    length[0] = grammar.length * (1 + jitter.length * draws["length"][0])
    radius[0] = grammar.radius
    start[0], end[0] = 0.0, (0.0, 0.0, length[0])
    heading[0], left[0] = (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)

    angle = np.deg2rad(grammar.angle_deg + jitter.angle_deg * draws["angle"])
    twist = np.deg2rad(grammar.twist_deg + jitter.twist_deg * draws["twist"])
    lean = np.deg2rad(jitter.lean_deg)
    centre_of = np.full(count, -1)  # the segment that continues a node's axis
    onward = np.flatnonzero(role == CENTRE)[1:]
    centre_of[parent[onward]] = onward

    for level in range(1, int(generation.max(initial=0)) + 1):
        # A symmetric branch may sit on the axis that goes on: that one comes first.
        for kind in (CENTRE, SIDE, SYMMETRIC):
            s = np.flatnonzero((generation == level) & (role == kind))
            if not len(s):
                continue
            mother = parent[s]
            length[s] = length[mother] * ratio[s] * (1 + jitter.length * draws["length"][s])
            axis, side = heading[mother], left[mother]
            if kind == CENTRE:
                side = _rotate(side, axis, twist[s])
                bent = axis + np.tan(lean) * (
                    draws["lean"][s, None] * side + draws["side"][s, None] * np.cross(axis, side)
                )
                heading[s] = _unit(bent)
                left[s] = _unit(side - _dot(side, heading[s])[:, None] * heading[s])
                radius[s] = radius[mother] * ratio[s]
                start[s] = end[mother]
            else:
                turn = angle[s] if kind == SIDE else -angle[s]
                heading[s] = _rotate(axis, side, turn)
                left[s] = side
                radius[s] = radius[mother] * grammar.radius_ratio
                start[s] = end[mother]
                if kind == SYMMETRIC:
                    onto = centre_of[mother]  # -1 where the axis ends: nothing to be raised along
                    rise = lift[s] * np.where(onto < 0, 0.0, length[onto])
                    start[s] += rise[:, None] * heading[onto]
            end[s] = start[s] + length[s, None] * heading[s]

    return Skeleton(
        start=start,
        end=end,
        radius=np.stack([radius, radius * grammar.centre_ratio], axis=1),
        parent=parent,
        order=order,
        generation=generation,
    )


def _rotate(vectors: np.ndarray, axes: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Vectors (N, 3) turned about unit axes (N, 3) by angles (N,), right-handed (Rodrigues)."""
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    turned: np.ndarray = (
        cos * vectors
        + sin * np.cross(axes, vectors)
        + (1 - cos) * _dot(axes, vectors)[:, None] * axes
    )
    return turned


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    product: np.ndarray = np.einsum("ni,ni->n", a, b)
    return product


def _unit(vectors: np.ndarray) -> np.ndarray:
    unit: np.ndarray = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit
