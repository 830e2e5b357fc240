"""Tanveer et al.'s (2020a and 2020b) trees: their L-systems, the skeleton of a string, and trees without
templates.

Symbols bear no numbers and no chance. Tanveer et al. (2020a) write their rule g -> d(g)[g)+g) and its second
iteration d(d(g)[g)+g)[d(g)[g)+g)+d(g)[g)+g). Both follow from axiom ``g)`` and g -> d(g)[g)+g: the branch
that ``+`` starts is closed by the bracket of its parent. Tanveer et al.'s (2020b) rules are groups d(d)+d)
joined by ``[``, one group a whorl: there each ``+`` has a ``)`` of its own.

``d`` is an internode and ``g`` a growing tip, both a segment. ``(`` starts a side branch at the current node
and ``[`` lets the axis grow on; ``)`` goes back to the node where they stood. ``+`` starts a branch at the
place symmetric to the previous one, raised by a random height along the axis. A side branch leaves at the
branching angle, its symmetric one at the opposite angle, and each internode on an axis is twisted about it.

Without templates all of the skeleton is wood. First-level branches are set as often as the grammar's
``copies`` says, each copy turned about the vertical and raised along the trunk. Every growing tip bears nodes
of leaves, each node turned on from the one before it by the fan angle.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ...base.rng import daughter_keys, keyed_uniform, truncated_normal
from ...spec import Grammar, Jitter, Species
from ..mesh.blades import across, set_leaves
from ..skeleton import TOUCH, LeafSites, Skeleton, depths, first_level, root_of
from .system import Notation, System, read_system, rewrite
from .turtle import find_paths

CENTRE, SIDE, SYMMETRIC = 0, 1, 2
_ROLE = {ord("["): CENTRE, ord("("): SIDE, ord("+"): SYMMETRIC}
# Symbols whose segments ``)`` goes back from: a symmetric branch ends with its parent in Tanveer et al.
# 2020a; in 2020b it has a bracket of its own, and the trunk goes on without one.
_OPENING = {"T20": b"[(", "A20": b"(+"}
SPREAD = 0.3  # share of its rise by which a copy may sit lower


def system_of_grammar(grammar: Grammar) -> System:
    """The L-system of a species' grammar, Tanveer et al.'s (2020a), or (2020b): a trunk with whorls."""
    axiom, rule = "g)", "g -> d(g)[g)+g"
    if grammar.dialect == "A20":
        axiom, rule = "g", f"g -> {'['.join(['d(d)+d)'] * grammar.whorls)}"
    return read_system(axiom, [rule], notation=Notation(parametric=False))


def string_of(grammar: Grammar) -> np.ndarray:
    """The string of a species' grammar as (S,) uint8 character codes; one of whorls is rewritten once.

    Raises
    ------
    ValueError : the string would be longer than ``system.MAX_SYMBOLS``; says how long.
    """
    most = 1 if grammar.dialect == "A20" else grammar.generations
    return rewrite(system_of_grammar(grammar), min(grammar.generations, most)).codes


def parse(symbols: np.ndarray, dialect: str = "T20") -> tuple[np.ndarray, np.ndarray]:
    """Parent (S,) and role (S,) of every segment of a string's symbols, in the order they are written.

    Raises
    ------
    ValueError : a bracket closes what was not opened, or a symbol is none of these.
    """
    other = np.flatnonzero(~np.isin(symbols, list(b"dg()[+")))
    if len(other):
        symbol = chr(symbols[other[0]])
        raise ValueError(f"symbol {other[0]}: '{symbol}' is not one of d g ( ) [ +")
    opens, closes = np.isin(symbols, list(_OPENING[dialect])), symbols == ord(")")
    if closes[-1:].any() and closes.sum() > opens.sum():  # the axiom's own closes nothing
        symbols, opens, closes = symbols[:-1], opens[:-1], closes[:-1]
    paths = find_paths(opens, closes)
    drawn = np.isin(symbols[paths.command], list(b"dg"))
    # The step that drew the segment on which each step stands, itself where none did.
    stands = root_of(np.where(drawn, -1, paths.before))
    number = np.append(np.where(drawn, np.cumsum(drawn) - 1, -1), -1)
    before = paths.before[drawn]
    turned = np.isin(symbols, list(_ROLE))
    last = np.maximum.accumulate(np.where(turned, np.arange(len(symbols)), -1))
    roles = np.zeros(256, np.int64)
    roles[list(_ROLE)] = list(_ROLE.values())
    role = np.where(last < 0, CENTRE, roles[symbols[np.maximum(last, 0)]])
    parent = np.where(before < 0, -1, number[stands[before]])
    return parent, role[paths.command[drawn]]


@lru_cache(maxsize=16)
def _lineage(symbols: bytes, dialect: str) -> tuple[np.ndarray, ...]:
    """Parent, role, generation and order (S,) of every segment: one string serves a whole species."""
    parent, role = parse(np.frombuffer(symbols, np.uint8), dialect)
    columns = parent, role, depths(parent), depths(parent, role != CENTRE)
    for column in columns:
        column.setflags(write=False)
    return columns


def interpret(
    symbols: np.ndarray, grammar: Grammar, jitter: Jitter, rng: np.random.Generator
) -> Skeleton:
    """The skeleton of a string, foot at the origin, growing along +Z.

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
            below = parent[s]
            length[s] = length[below] * ratio[s] * (1 + jitter.length * draws["length"][s])
            axis, side = heading[below], left[below]
            if kind == CENTRE:
                side = _rotate(side, axis, twist[s])
                bent = axis + np.tan(lean) * (
                    draws["lean"][s, None] * side + draws["side"][s, None] * np.cross(axis, side)
                )
                heading[s] = bent / np.linalg.norm(bent, axis=1, keepdims=True)
                aside = side - np.einsum("ni,ni->n", side, heading[s])[:, None] * heading[s]
                left[s] = aside / np.linalg.norm(aside, axis=1, keepdims=True)
                radius[s] = radius[below] * ratio[s]
                start[s] = end[below]
            else:
                turn = angle[s] if kind == SIDE else -angle[s]
                heading[s] = _rotate(axis, side, turn)
                left[s] = side
                radius[s] = radius[below] * grammar.radius_ratio
                start[s] = end[below]
                if kind == SYMMETRIC:
                    onto = centre_of[below]  # -1 where the axis ends: nothing to be raised along
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
    along = np.einsum("ni,ni->n", axes, vectors)[:, None]
    return np.asarray(cos * vectors + sin * np.cross(axes, vectors) + (1 - cos) * along * axes)


def grow_whole(species: Species, key: int, rng: np.random.Generator) -> tuple[Skeleton, LeafSites]:
    """The skeleton and leaves of one tree without templates."""
    grammar = species.grammar
    skeleton = interpret(string_of(grammar), grammar, species.jitter, rng)
    skeleton = _copied(skeleton, grammar.copies, key)
    return skeleton, _tip_leaves(skeleton, species, key) if species.leaf.on else LeafSites.none()


def _copied(skeleton: Skeleton, copies: int, key: int) -> Skeleton:
    """The skeleton with further copies of all first-level branches, behind the first."""
    level = first_level(skeleton)
    aloft = np.flatnonzero(level >= 0)
    if copies == 1 or not len(aloft):
        return skeleton
    roots = aloft[np.unique(level[aloft], return_index=True)[1]]
    trunk = skeleton.parent[roots]  # the segment that each first-level branch leaves
    onward = np.full(len(skeleton), -1)
    stem = np.flatnonzero((skeleton.order == 0) & (skeleton.parent >= 0))
    onward[skeleton.parent[stem]] = stem
    follows = onward[trunk] >= 0
    axis = np.where(
        follows[:, None], skeleton.end[onward[trunk]] - skeleton.start[onward[trunk]], 0.0
    )
    parts = [skeleton]
    for copy in range(1, copies):
        keys = daughter_keys(np.full(len(roots), key, np.uint64), np.arange(len(roots)))
        share = copy / copies * (1 - SPREAD * keyed_uniform(keys, f"rise {copy}"))
        foot = skeleton.start[roots]
        raised = foot + share[:, None] * axis
        turn = np.pi * copy / copies
        cos, sin = np.cos(turn), np.sin(turn)
        matrix = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        owner = level[aloft]
        number = np.full(len(skeleton), -1)
        number[aloft] = sum(map(len, parts)) + np.arange(len(aloft))
        first = skeleton.order[np.maximum(skeleton.parent[aloft], 0)] == 0
        bearer = np.where(follows, onward[trunk], trunk)[owner]
        parts.append(
            Skeleton(
                start=(skeleton.start[aloft] - foot[owner]) @ matrix.T + raised[owner],
                end=(skeleton.end[aloft] - foot[owner]) @ matrix.T + raised[owner],
                radius=skeleton.radius[aloft],
                parent=np.where(first, bearer, number[skeleton.parent[aloft]]),
                order=skeleton.order[aloft],
                generation=skeleton.generation[aloft],
            )
        )
    return Skeleton.joined(parts)


def _tip_leaves(skeleton: Skeleton, species: Species, key: int) -> LeafSites:
    """Nodes of leaves along every segment whose end bears nothing, the last node at its end."""
    leaf = species.leaf
    goes_on = np.zeros(len(skeleton), bool)
    parent = skeleton.parent
    gap = np.abs(skeleton.start - skeleton.end[parent]).max(axis=1)
    goes_on[parent[(parent >= 0) & (gap < TOUCH)]] = True
    tip = np.flatnonzero(~goes_on)
    each = leaf.nodes * leaf.per_node
    segment = np.repeat(tip, each)
    number = np.tile(np.arange(each), len(tip))
    node, side = number // leaf.per_node, number % leaf.per_node
    keys = daughter_keys(np.full(len(segment), key, np.uint64), segment)
    keys = daughter_keys(daughter_keys(keys, "leaf"), number)
    along = skeleton.end[segment] - skeleton.start[segment]
    foot = skeleton.start[segment] + ((node + 1) / leaf.nodes)[:, None] * along
    heading = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    azimuth = 2 * np.pi * side / leaf.per_node + np.deg2rad(leaf.fan_deg) * node
    return set_leaves(leaf, keys, foot, heading, across(heading), azimuth, segment)
