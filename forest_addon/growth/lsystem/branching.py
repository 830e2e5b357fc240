"""Trees that branch by angles and ratios: Tanveer et al.'s (2020a and 2020b) and Wahed et al.'s after Honda
(1971); and ``skeleton_of``, the one door to every way in which a tree without targets grows.

Tanveer et al.'s symbols bear no numbers and no chance. Tanveer et al. (2020a) write their rule g ->
d(g)[g)+g) and its second iteration d(d(g)[g)+g)[d(g)[g)+g)+d(g)[g)+g). Both follow from axiom ``g)`` and g ->
d(g)[g)+g: the branch that ``+`` starts is closed by the bracket of its parent. Tanveer et al.'s (2020b) rules
are groups d(d)+d) joined by ``[``, one group a whorl: there each ``+`` has a ``)`` of its own.

``d`` is an internode and ``g`` a growing tip, both a segment. ``(`` starts a side branch at the current node
and ``[`` lets the axis grow on; ``)`` goes back to the node where they stood. ``+`` starts a branch at the
place symmetric to the previous one, raised by a random height along the axis. A side branch leaves at the
branching angle, its symmetric one at the opposite angle, and each internode on an axis is twisted about it.

Without templates all of the skeleton is wood. First-level branches are set as often as the grammar's
``copies`` says, each copy turned about the vertical and raised along the trunk. Every growing tip bears nodes
of leaves, each node turned on from the one before it by the fan angle.

In Honda's trees a parent bears children by angle, divergence and ratios, recursively; all branches of a level
are grown at once. A branch is a chain of straight pieces, each bent at random and towards the ground, and its
children leave it at its apex or at random places along it. Per tree are drawn: levels, length and radius of
the trunk, both ratios; per branch: number of children and of leaves, places, angle, twist, crookedness; per
leaf: length, width, angle. A draw is a hash of the lineage of what draws it, so pruning a branch or leaving
leaves off moves nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...base.rng import child_keys, keyed_uniform, truncated_normal
from ...base.runs import numbered
from ...base.vectors import unit
from ...spec import MAX_REACH, Grammar, Honda, Jitter, Leaf, Species
from ..draw import GOLDEN, draw_discrete, draw_normal
from ..mesh.blades import leaves_on_nodes, set_leaves
from ..skeleton import TOUCH, LeafSites, Skeleton, branch_feet, depths, first_level, root_of
from .system import Notation, System, read_system, rewrite, written
from .turtle import find_paths, grow_ruled

CENTRE, SIDE, SYMMETRIC = 0, 1, 2
_ROLE = {ord("["): CENTRE, ord("("): SIDE, ord("+"): SYMMETRIC}
# Symbols whose segments ``)`` goes back from: a symmetric branch ends with its parent in Tanveer et al.
# 2020a; in 2020b it has a bracket of its own, and the trunk goes on without one.
_OPENING = {"tanveer-2020a": b"[(", "tanveer-2020b": b"(+"}
SPREAD = 0.3  # share of its rise by which a copy may sit lower


def system_of_grammar(grammar: Grammar) -> System:
    """The L-system of a species' grammar, Tanveer et al.'s (2020a), or (2020b): a trunk with whorls."""
    axiom, rule = "g)", "g -> d(g)[g)+g"
    if grammar.dialect == "tanveer-2020b":
        axiom, rule = "g", f"g -> {'['.join(['d(d)+d)'] * grammar.whorls)}"
    return read_system(axiom, [rule], notation=Notation(parametric=False))


@lru_cache(maxsize=16)
def string_of(grammar: Grammar) -> np.ndarray:
    """The string of a species' grammar as (S,) uint8 character codes; one of whorls is rewritten once.

    Raises
    ------
    ValueError : the string would be longer than ``system.MAX_SYMBOLS``; says how long.
    """
    most = 1 if grammar.dialect == "tanveer-2020b" else grammar.generations
    codes = rewrite(system_of_grammar(grammar), min(grammar.generations, most)).codes
    codes.setflags(write=False)
    return codes


def parse(symbols: np.ndarray, dialect: str = "tanveer-2020a") -> tuple[np.ndarray, np.ndarray]:
    """Parent (S,) and role (S,) of every segment of a string's symbols, in the order they are written.

    Raises
    ------
    ValueError : a bracket closes what was not opened.
    """
    opens, closes = np.isin(symbols, list(_OPENING[dialect])), symbols == ord(")")
    if closes[-1:].any() and closes.sum() > opens.sum():  # the axiom's own closes nothing
        symbols, opens, closes = symbols[:-1], opens[:-1], closes[:-1]
    command, follows, _, _ = find_paths(opens, closes)
    drawn = np.isin(symbols[command], list(b"dg"))
    # The step that drew the segment on which each step stands, itself where none did.
    stands = root_of(np.where(drawn, -1, follows))
    number = np.append(np.where(drawn, np.cumsum(drawn) - 1, -1), -1)
    before = follows[drawn]
    turned = np.isin(symbols, list(_ROLE))
    last = np.maximum.accumulate(np.where(turned, np.arange(len(symbols)), -1))
    roles = np.zeros(256, np.int64)
    roles[list(_ROLE)] = list(_ROLE.values())
    role = np.where(last < 0, CENTRE, roles[symbols[np.maximum(last, 0)]])
    parent = np.where(before < 0, -1, number[stands[before]])
    return parent, role[command[drawn]]


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
    length, radius = np.empty((2, count))
    heading, left, start, end = np.empty(
        (4, count, 3)
    )  # H; L, the axis that side branches turn about
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
                heading[s] = unit(bent)
                aside = side - np.einsum("ni,ni->n", side, heading[s])[:, None] * heading[s]
                left[s] = unit(aside)
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


def _copied(skeleton: Skeleton, copies: int, key: int) -> Skeleton:
    """The skeleton with further copies of all first-level branches, behind the first."""
    level = first_level(skeleton)
    aloft = np.flatnonzero(level >= 0)
    if copies == 1 or not len(aloft):
        return skeleton
    roots = branch_feet(skeleton)
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
        keys = child_keys(np.full(len(roots), key, np.uint64), np.arange(len(roots)))
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


def _tip_leaves(skeleton: Skeleton, leaf: Leaf, key: int) -> LeafSites:
    """Nodes of leaves along every segment whose end bears nothing, the last node at its end."""
    goes_on = np.zeros(len(skeleton), bool)
    parent = skeleton.parent
    gap = np.abs(skeleton.start - skeleton.end[parent]).max(axis=1)
    goes_on[parent[(parent >= 0) & (gap < TOUCH)]] = True
    tip = np.flatnonzero(~goes_on)
    keys = child_keys(child_keys(np.full(len(tip), key, np.uint64), tip), "leaf")
    along = (skeleton.end - skeleton.start)[tip, None]
    share = ((np.arange(leaf.nodes) + 1) / leaf.nodes)[:, None]
    heading = np.repeat(unit(along), leaf.nodes, axis=1)
    return leaves_on_nodes(leaf, keys, skeleton.start[tip, None] + share * along, heading, tip)


MAX_SEGMENTS = 5_000_000
LEADER = 1 << 32  # a child's number that no other child has


@dataclass(frozen=True)
class _Branches:
    """B branches of one level before they are drawn."""

    key: np.ndarray  # (B,) uint64
    foot: np.ndarray  # (B, 3)
    heading: np.ndarray  # (B, 3)
    across: np.ndarray  # (B, 3) at right angles to the heading; azimuth 0
    length: np.ndarray  # (B,)
    radius: np.ndarray  # (B,) at the foot
    parent: np.ndarray  # (B,) segment that bears it
    order: np.ndarray  # (B,)
    generation: np.ndarray  # (B,) of its first piece


@dataclass(frozen=True)
class _Chains:
    """B drawn branches of P pieces."""

    node: np.ndarray  # (B, P + 1, 3)
    heading: np.ndarray  # (B, P, 3)
    across: np.ndarray  # (B, P, 3)
    first: int  # segment number of the first piece of the first branch


def predict_branches(honda: Honda) -> float:
    """The expected number of branches of a tree."""
    leader = honda.leader_ratio > 0
    weights = honda.levels.weights or (1.0,) * len(honda.levels.values)
    total = 0.0
    for levels, weight in zip(honda.levels.values, weights, strict=True):
        here = branches = 1.0
        for level in range(levels):
            choice = (honda.trunk_daughters if level == 0 else None) or honda.daughters
            here *= float(np.average(choice.values, weights=choice.weights or None)) + leader
            branches += here
        total += branches * weight / sum(weights)
    return total


def grow_honda(honda: Honda, leaf: Leaf, key: int) -> tuple[Skeleton, LeafSites]:
    """The skeleton and leaves of one tree.

    key : 64 bits, the lineage of the tree.

    Raises
    ------
    ValueError : more than ``MAX_SEGMENTS`` segments, or a reach beyond ``MAX_REACH``; says how much.
    """
    tree = child_keys(np.array([key], np.uint64), "honda")
    levels = int(draw_discrete(honda.levels, tree, "levels")[0])
    _refuse_many(predict_branches(honda) * honda.pieces)
    ratio = max(honda.length_ratio.bounds()[1], honda.leader_ratio)
    longest = honda.length.bounds()[1]
    reach = longest * sum(ratio**level for level in range(max(honda.levels.values) + 1))
    if reach > MAX_REACH:
        raise ValueError(
            f"branches would reach {written(reach)} m from the foot, more than {MAX_REACH:g} m; "
            "use a smaller ratio or fewer levels"
        )
    length_ratio = float(draw_normal(honda.length_ratio, tree, "length ratio")[0])
    radius_ratio = float(draw_normal(honda.radius_ratio, tree, "radius ratio")[0])
    here = _Branches(
        key=tree,
        foot=np.zeros((1, 3)),
        heading=np.array([[0.0, 0.0, 1.0]]),
        across=np.array([[1.0, 0.0, 0.0]]),
        length=draw_normal(honda.length, tree, "length"),
        radius=draw_normal(honda.radius, tree, "radius"),
        parent=np.array([-1]),
        order=np.array([0]),
        generation=np.array([0]),
    )
    skeletons, leaves, drawn = [], [], 0
    for level in range(levels + 1):
        chains = _draw(honda, here, drawn)
        radius = here.radius[:, None] * (
            1 + (honda.tip - 1) * np.arange(honda.pieces + 1) / honda.pieces
        )
        skeletons.append(
            Skeleton.of_chains(chains.node, radius, here.parent, here.order, here.generation, drawn)
        )
        drawn += len(skeletons[-1])
        if leaf.on and level > levels - honda.leaf_levels:
            leaves.append(_leaves(honda, leaf, here, chains))
        if level < levels:
            here = _children(honda, here, chains, length_ratio, radius_ratio, level)
            _refuse_many(drawn + len(here.key) * honda.pieces)
    return Skeleton.joined(skeletons), LeafSites.joined([LeafSites.none(), *leaves])


def _refuse_many(segments: float) -> None:
    if segments > MAX_SEGMENTS:
        raise ValueError(
            f"a tree of about {written(segments)} segments, more than {MAX_SEGMENTS:,}; "
            "use fewer levels, daughters or pieces"
        )


def _draw(honda: Honda, here: _Branches, first: int) -> _Chains:
    """Piece by piece, all branches at once: bent to both sides, then towards the ground."""
    count, pieces = len(here.key), honda.pieces
    node = np.empty((count, pieces + 1, 3))
    headings, acrosses = np.empty((2, count, pieces, 3))
    droop = np.where(here.order >= honda.droop_from, honda.droop, 0.0)
    node[:, 0], heading, across = here.foot, here.heading, here.across
    for piece in range(pieces):
        if piece:
            aside = np.cross(heading, across)
            for axis, name in ((across, "crook"), (aside, "crook aside")):
                angle = np.deg2rad(draw_normal(honda.crook_deg, here.key, f"{name} {piece}"))
                heading, across = _turn(heading, axis, angle), _turn(across, axis, angle)
        if droop.any():
            down = np.cross(heading, np.array([0.0, 0.0, -1.0]))
            size = np.linalg.norm(down, axis=1)
            axis = down / np.maximum(size, 1e-12)[:, None]
            # Not past the vertical: a hanging twig hangs.
            angle = np.clip(droop / pieces * size, -np.inf, np.arctan2(size, -heading[:, 2]))
            heading, across = _turn(heading, axis, angle), _turn(across, axis, angle)
        across = unit(across - np.einsum("bi,bi->b", across, heading)[:, None] * heading)
        heading = unit(heading)
        headings[:, piece], acrosses[:, piece] = heading, across
        node[:, piece + 1] = node[:, piece] + (here.length / pieces)[:, None] * heading
    return _Chains(node, headings, acrosses, first)


def _turn(vectors: np.ndarray, axes: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Vectors (B, 3) turned about unit axes, right-handed (Rodrigues)."""
    cos, sin = np.cos(angles)[:, None], np.sin(angles)[:, None]
    along = np.einsum("bi,bi->b", axes, vectors)[:, None] * axes
    return np.asarray(cos * vectors + sin * np.cross(axes, vectors) + (1 - cos) * along)


def _children(
    honda: Honda,
    here: _Branches,
    chains: _Chains,
    length_ratio: float,
    radius_ratio: float,
    level: int,
) -> _Branches:
    """The next level: children of every branch, and its leader."""
    choice = (honda.trunk_daughters if level == 0 else None) or honda.daughters
    born = draw_discrete(choice, here.key, "daughters")
    parent, number = numbered(born)
    key = child_keys(here.key[parent], number)
    share = np.ones(len(parent))
    if honda.sprouting == "along":
        share = honda.bare + (1 - honda.bare) * keyed_uniform(key, "place")
        upwards = np.lexsort((share, parent))  # twists are counted from the foot up
        key, share = key[upwards], share[upwards]
        total = np.cumsum(np.deg2rad(draw_normal(honda.twist_deg, key, "twist")))
        before = np.concatenate([[0.0], total])[np.cumsum(born) - born]
        azimuth = total - np.repeat(before, born)
    else:  # evenly around the tip
        turned = np.deg2rad(draw_normal(honda.twist_deg, here.key, "twist of daughters"))
        azimuth = turned[parent] + 2 * np.pi * number / born[parent]
    angle = np.deg2rad(draw_normal(honda.angle_deg, key, "angle"))
    shorter = 1 - honda.cone * (share - honda.bare) / (1 - honda.bare)
    length = here.length[parent] * length_ratio * np.minimum(shorter, 1.0)
    radius = here.radius[parent] * radius_ratio
    order = here.order[parent] + 1

    if honda.leader_ratio > 0:
        every = np.arange(len(born))
        leader = child_keys(here.key, LEADER)
        parent, share = np.concatenate([parent, every]), np.concatenate([share, np.ones(len(born))])
        key, angle = np.concatenate([key, leader]), np.concatenate([angle, np.zeros(len(born))])
        twist = np.deg2rad(draw_normal(honda.twist_deg, leader, "twist"))
        azimuth = np.concatenate([azimuth, twist])
        length = np.concatenate([length, here.length * honda.leader_ratio])
        radius = np.concatenate([radius, here.radius * honda.tip])
        order = np.concatenate([order, here.order])

    foot, forward, across, piece, segment = _along(chains, parent, share)
    local = here.radius[parent] * (1 + (honda.tip - 1) * share)
    around = np.cos(azimuth)[:, None] * across
    around = around + np.sin(azimuth)[:, None] * np.cross(forward, across)
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return _Branches(
        key=key,
        foot=foot,
        heading=cos * forward + sin * around,
        across=cos * around - sin * forward,  # in the plane of parent and child
        length=length,
        radius=np.minimum(radius, local),  # no thicker than the parent where it leaves it
        parent=segment,
        order=order,
        generation=here.generation[parent] + piece + 1,
    )


def _along(chains: _Chains, branch: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, ...]:
    """Places (N, 3) at shares (N,) of the length of branches (N,), heading and across (N, 3) there, and
    the piece and the segment (N,) that they are on."""
    pieces = chains.heading.shape[1]
    piece = np.minimum((share * pieces).astype(np.int64), pieces - 1)
    part = (share * pieces - piece)[:, None]
    start, end = chains.node[branch, piece], chains.node[branch, piece + 1]
    return (
        start + part * (end - start),
        chains.heading[branch, piece],
        chains.across[branch, piece],
        piece,
        chains.first + branch * pieces + piece,
    )


def _leaves(honda: Honda, leaf: Leaf, here: _Branches, chains: _Chains) -> LeafSites:
    """Evenly along every branch, the last at its very tip."""
    born = draw_discrete(honda.leaves, here.key, "leaves")
    branch, number = numbered(born)
    key = child_keys(child_keys(here.key[branch], "leaf"), number)
    foot, heading, across, _, segment = _along(chains, branch, (number + 1) / born[branch])
    phase = 2 * np.pi * keyed_uniform(here.key, "leaf phase")[branch]
    return set_leaves(leaf, key, foot, heading, across, phase + GOLDEN * number, segment)


def skeleton_of(species: Species, rng: np.random.Generator) -> tuple[Skeleton, LeafSites]:
    """All wood of one tree as segments, and where its leaves sit; foot at the origin, z up.

    Switching leaves off moves no branch.

    Raises
    ------
    ValueError : rules that cannot be read, or a tree that would be too large; says how large.
    """
    key, leaf = int(rng.integers(2**63)), species.leaf
    if species.rules is not None:
        return grow_ruled(species.rules, leaf, key, rng)
    if species.honda is not None:
        return grow_honda(species.honda, leaf, key)
    skeleton = interpret(string_of(species.grammar), species.grammar, species.jitter, rng)
    skeleton = _copied(skeleton, species.grammar.copies, key)
    return skeleton, _tip_leaves(skeleton, leaf, key) if leaf.on else LeafSites.none()
