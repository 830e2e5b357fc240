"""The wood of a tree that fills its crown: scaffold, branches by space colonisation, twigs, radii of pipes.

Branches grow into the crown by space colonisation (Runions, Lane & Prusinkiewicz 2007).

Points strewn in the envelope of a crown attract branches. Each point pulls at the node that is nearest to
it; a node that is pulled grows by one step in the mean direction of its points; points that a node has come
near are gone. Only nodes that are new can be nearer than those before, so each round asks a tree (k-d) of
the new ones alone, and the whole costs about as many queries as there are points and rounds.

The scaffold is stem and limbs by the architectural model of the species. With apical control a leader goes to
the top; limbs stand in whorls of a year, weaker ones between them, and the lower a whorl, the more of it has
been shed. Without, the stem divides: a few heavy limbs rise from low on it to places that are spread evenly
under the dome of the crown, each divides again, and weaker limbs of any length stand on the stem between
them. Their numbers and lengths are those of broadleaves of 11 to 26 m in a forest (L1-Tree, Feng et al.
2024). A limb is a cubic Bézier curve from its angle at the stem to the elevation of its tip, a little
crooked. Twigs and what bears them grow from the limbs by space colonisation, of a stem that divides at every
fifth node of a limb, so that branches part again and again instead of standing in rows.

Twigs stand on the thin branches, and leaves on twigs, as many as the leaf area asks for. Radii follow from
the pipe model: what a stem bears decides how thick it is, and it ends at its DBH. r^n is proportional to the
number of twigs above (Shinozaki et al. 1964; n = 2 is da Vinci's rule). Below the crown the pipes of branches
that are gone stay in the stem, so that it tapers there too; at the ground it widens into its roots by
exp(-z/1.5 r). The factor follows from the diameter at breast height, exactly.

Dead branches stand below the living crown: what shade has killed and wind has not yet taken (self-pruning).
They stand where whorls stood (or anywhere, where a stem has none), are fewer and shorter towards the ground,
where they have been dead the longest and died on a smaller tree, and are broken: a third are stubs. All of it
hangs on the segments of the stem, after the living wood, and bears no leaves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...base.rng import child_keys, keyed_normal, keyed_uniform
from ...base.runs import numbered, sums
from ...base.vectors import azimuth_of, cross_rows, unit
from ...spec import Architecture, Crown, Leaf
from ..draw import GOLDEN, draw_normal
from ..mesh.blades import across, set_leaves
from ..skeleton import LeafSites, Skeleton, depths
from .allometry import Wanted, dbh_of

STEP, KILL = 0.55, 0.8  # over the mean distance of points
MOST_ROUNDS = 400
ALIKE = 0.98  # cosine between two steps of one node that are the same branch
THICK_AT = 0.5  # metres of diameter for which the numbers of limbs are given
SHED = 1.4  # power of the diameter with which weaker limbs become fewer
EVERY = 5  # nodes of a limb from one branch to the next, of a stem that divides
WEAK_ANGLE = 68.0  # degrees
LAST_FORK = 0.72  # of the crown's length, where the last heavy limb leaves
STEEPER = 45.0  # degrees that the highest heavy limb is steeper than the lowest
KINKS = np.arange(3, 7)  # half waves of a limb's bends
FULLEST = 0.9  # of the crown's radius that heavy limbs reach
FORKED_TOP = 0.82  # of the crown's length, where a stem that divides ends
FLARE = np.array([0.1, 0.3, 0.6, 1.0, 1.6])  # diameters above the ground where a stem has nodes
APART = 0.45  # metres between nodes of a limb, at most 14 of them
MOST_NODES = 14
FEW_TIPS = 5  # a segment bears twigs if at most so many branches end beyond it
TAPER, SHORTEST = 6.0, 0.35  # mean twigs below the top where twigs are whole; length of the topmost
SPARSEST = 0.2  # twigs a metre of branch at the top, over those below
TURN = np.deg2rad(60.0)  # by which an axis goes on at most


@dataclass(frozen=True)
class Nodes:
    """N nodes of a tree's axes, a parent before its children.

    place : (N, 3) metres. parent : (N,) int64, -1 for the foot. trunk : (N,) bool, of the first stem.
    """

    place: np.ndarray
    parent: np.ndarray
    trunk: np.ndarray


def outline(crown: Crown, share: np.ndarray) -> np.ndarray:
    """(N,) radius of the crown over its largest, at shares (N,) of its length from the base up."""
    above = np.clip((share - crown.widest) / (1 - crown.widest), 0, 1)
    below = np.clip((crown.widest - share) / max(crown.widest, 1e-9), 0, 1)
    return np.asarray(
        np.where(
            share >= crown.widest, 1 - above**crown.top, 0.15 + 0.85 * (1 - below**crown.underside)
        )
    )


def colonise(
    crown: Crown,
    height: float,
    base: float,
    width: float,
    rng: np.random.Generator,
    scaffold: tuple[Nodes, np.ndarray] | None = None,
    aside: float = 0.0,
) -> Nodes:
    """The axes of a tree whose crown reaches from ``base`` to ``height`` and is ``width`` wide, metres.

    aside : radii that its middle is off the stem, along x. scaffold : its stem and limbs, and which of
    their nodes (N,) bear branches; None: a stem alone.
    """
    count = round(crown.points / (1 - crown.gaps)) if scaffold else crown.points
    points = _points(crown, (height, base, width), count, rng)
    points[:, 0] += aside * width / 2 * outline(crown, (points[:, 2] - base) / (height - base))
    span = height - base
    volume = np.pi * (width / 2) ** 2 * span * 0.45
    if scaffold is not None and crown.gaps:
        limbs, bearing = scaffold
        # Those that are nearest to limbs, so that the sky shows between limbs.
        away, _ = scipy.spatial.cKDTree(limbs.place[~limbs.trunk | bearing]).query(points)
        points = points[np.sort(np.argsort(away, kind="stable")[: crown.points])]
        volume *= 1 - crown.gaps
    apart = (volume / max(len(points), 1)) ** (1 / 3)
    step, kill = STEP * apart, KILL * apart
    if scaffold is None:
        stem = _trunk(crown, height, base, step, rng)
        along = np.arange(-1, len(stem) - 1)
        # Below the crown the stem bears nothing: its nodes attract no points.
        bearing = stem[:, 2] >= base - 1e-9
        scaffold = Nodes(stem, along, np.ones(len(stem), dtype=bool)), bearing
    given, bearing = scaffold
    every, parent, number = given.place, [given.parent], np.flatnonzero(bearing)
    fresh = every[number]
    near = np.full(len(points), np.inf)
    owner = np.zeros(len(points), dtype=np.int64)
    steps = np.zeros_like(every)  # the last step of each node, so that none is taken twice
    for _ in range(MOST_ROUNDS):
        if not len(points) or not len(fresh):
            break
        distance, nearest_new = scipy.spatial.cKDTree(fresh).query(points)
        nearer = distance < near
        near = np.where(nearer, distance, near)
        owner = np.where(nearer, number[nearest_new], owner)
        kept = near > kill
        points, near, owner = points[kept], near[kept], owner[kept]
        if not len(points):
            break
        pull = (points - every[owner]) / near[:, None]
        grown, which = np.unique(owner, return_inverse=True)
        way = sums(which, pull, len(grown))  # what pulls from opposite sides alike pulls nowhere
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
        way += crown.crook * rng.standard_normal(way.shape)
        way[:, 2] += crown.rise
        way = unit(way)
        again = np.einsum("ni,ni->n", way, steps[grown]) > ALIKE
        stuck = np.isin(owner, grown[again])  # between two points it would step for ever
        points, near, owner = points[~stuck], near[~stuck], owner[~stuck]
        grown, way = grown[~again], way[~again]
        steps[grown] = way
        fresh = every[grown] + step * way
        number = len(every) + np.arange(len(fresh))
        parent.append(grown)
        every = np.concatenate([every, fresh])
        steps = np.concatenate([steps, np.zeros_like(fresh)])
    trunk = np.zeros(len(every), dtype=bool)
    trunk[: len(given.trunk)] = given.trunk
    return Nodes(every, np.concatenate(parent).astype(np.int64), trunk)


def _points(
    crown: Crown, size: tuple[float, float, float], count: int, rng: np.random.Generator
) -> np.ndarray:
    """(A, 3) points in the envelope, at random but none in a gap or a clump: strata by volume.

    size : the tree's height, its crown's base and width, metres.
    """
    height, base, width = size
    shares = (np.arange(64) + 0.5) / 64
    weight = np.cumsum(outline(crown, shares) ** 2)
    at = (np.arange(count) + rng.random(count)) / count
    share = np.interp(at, np.concatenate([[0.0], weight / weight[-1]]), np.linspace(0, 1, 65))
    inner = rng.random(count) ** (0.5 * (1 - 0.7 * crown.shell))
    radius = width / 2 * outline(crown, share) * inner
    azimuth = 2 * np.pi * ((np.arange(count) * 0.618034) % 1 + 0.3 * rng.random(count))
    return np.column_stack(
        [radius * np.cos(azimuth), radius * np.sin(azimuth), base + share * (height - base)]
    )


def _trunk(
    crown: Crown, height: float, base: float, step: float, rng: np.random.Generator
) -> np.ndarray:
    """(T, 3) the first stem, from the ground to where it divides."""
    top = base + max(crown.leader, 0.02) * 0.97 * (height - base)
    below = np.linspace(0.0, base, max(2, int(np.ceil(base / max(step, 0.25))) + 1))
    above = np.linspace(base, top, max(2, int(np.ceil((top - base) / step)) + 1))[1:]
    return stem_line(crown, np.concatenate([below, above]), height, rng)


def stem_line(
    crown: Crown, z: np.ndarray, height: float, rng: np.random.Generator, divides: bool = False
) -> np.ndarray:
    """(T, 3) a stem at heights (T,), metres; straight, but for a slow sweep.

    divides : it is no leader, and as crooked as a scanned beech: 4 cm (root mean square) off a straight line
    over 10 m, where a scanned pine is 1.7 cm off.
    """
    sway = (0.2 if divides else 0.06) * crown.crook * height * rng.standard_normal((2, 2))
    t = (z / height)[:, None]
    aside = sway[0] * t**2 + 0.5 * sway[1] * np.sin(2 * np.pi * t) * t
    return np.column_stack([aside, z])


def scaffold_of(
    plan: Architecture,
    crown: Crown,
    size: tuple[float, float, float, float],
    rng: np.random.Generator,
    aside: float = 0.0,
) -> tuple[Nodes, np.ndarray]:
    """Nodes of stem and limbs, and (N,) bool, those that branches may grow from.

    size : height, height of the crown's base, its width, diameter at breast height, metres. aside : as
    ``colonise`` takes it; limbs on that side are longer, so that circles about the stem stay circles.
    """
    height, base, _, _ = size
    heavy = 0  # limbs that the stem divides into; none with a leader, as any has when it is young
    if plan.fork < 1 and size[3] >= plan.control:
        heavy = max(1, round(plan.limbs * (size[3] / THICK_AT) ** plan.growth))
    parts = [(_weak if heavy else _whorled)(plan, crown, size, rng)]
    if heavy:
        parts.append(_forked(plan, crown, size, heavy, rng))
    leader = max(crown.leader, 0.02) if plan.fork >= 1 else 1.0
    top = base + (FORKED_TOP if heavy else leader * 0.97) * (height - base)
    feet = np.concatenate([foot for foot, _ in parts])
    low = np.linspace(0.0, base, max(2, int(np.ceil(base / 0.6)) + 1))
    low = np.concatenate([low, np.minimum(FLARE * size[3], base)])
    high = np.linspace(base, top, max(2, int(np.ceil((top - base) / 0.5)) + 1))
    z = np.unique(np.round(np.concatenate([low, high, np.minimum(feet, top)]), 4))
    stem = stem_line(crown, z, height, rng, heavy > 0)
    place, parent = [stem], [np.arange(-1, len(stem) - 1)]
    count = len(stem)
    for foot, path in parts:
        if len(foot):
            on = np.searchsorted(z, np.round(np.minimum(foot, top), 4))
            made = _nodes_of(stem[on], on, path, crown.crook, count, rng)
            place.append(made[0])
            parent.append(made[1])
            count += len(made[0])
    if heavy and plan.divide > 0:
        made = _divided(plan, crown, size, made, count - len(place[-1]), rng)
        place.append(made[0])
        parent.append(made[1])
    on, number = np.concatenate(parent).astype(np.int64), np.arange(sum(map(len, place)))
    trunk = number < len(stem)
    bearing = ~trunk
    if heavy:
        bearing &= (number % EVERY == 0) | ~np.isin(number, on)
    bearing[len(stem) - 1] = True
    node = np.concatenate(place)
    node[:, 0] += aside * np.hypot(node[:, 0], node[:, 1])
    return Nodes(node, on, trunk), bearing


def _whorled(
    plan: Architecture,
    crown: Crown,
    size: tuple[float, float, float, float],
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Feet (K,) and curves (K, 4, 3) of whorls of a year from the crown's base up, and of the weaker
    branches between them."""
    height, base, _, _ = size
    span = height - base
    years = max(3, round(span / plan.shoot))
    level = base + span * np.arange(years) / years
    level[1:] += 0.15 * span / years * (rng.random(years - 1) - 0.5)
    share = (level - base) / span
    drawn = np.clip(plan.whorl.mean + plan.whorl.sd * rng.standard_normal(years), 1, None)
    left = 1 - plan.shed * (1 - share) ** 2
    count = np.maximum(1, np.round(drawn * left)).astype(int)
    of, within = numbered(count)
    azimuth = GOLDEN * of + 2 * np.pi * (within + 0.5 * rng.random(len(of))) / count[of]
    reach = 0.78 + 0.22 * rng.random(len(of))
    foot = level[of] + 0.02 * span / years * within
    foot[0] = base
    small = rng.poisson(plan.between * drawn)
    gap = np.repeat(np.arange(years), small)
    inner = np.minimum(level[gap] + span / years * (0.1 + 0.8 * rng.random(len(gap))), height - 0.1)
    foot = np.concatenate([foot, inner])
    azimuth = np.concatenate([azimuth, 2 * np.pi * rng.random(len(gap))])
    reach = np.concatenate([reach, 0.3 + 0.35 * rng.random(len(gap))])
    up = np.clip((foot - base) / span, 0, 1)
    angle = plan.angle_deg.mean + up * (plan.top_angle_deg - plan.angle_deg.mean)
    angle = np.deg2rad(angle + plan.angle_deg.sd * rng.standard_normal(len(foot)))
    tip = np.deg2rad(plan.tip_deg + up * (90 - plan.top_angle_deg - plan.tip_deg))
    return foot, _paths(crown, size, foot, azimuth, reach, np.clip(angle, 0.1, 2.2), tip)


def _weak(
    plan: Architecture,
    crown: Crown,
    size: tuple[float, float, float, float],
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Feet (K,) and curves (K, 4, 3) of weaker limbs of a stem that divides; the lowest stands at the
    crown's base."""
    height, base, _, dbh = size
    span = height - base
    count = max(1, round(plan.weak * (THICK_AT / dbh) ** SHED * 0.8 * span))
    foot = base + 0.8 * span * (np.arange(count) + 0.8 * rng.random(count)) / count
    foot[0] = base
    azimuth = GOLDEN * np.arange(count) + rng.random(count)
    reach = 0.1 + 0.4 * rng.random(count)
    angle = np.deg2rad(WEAK_ANGLE + 8 * rng.standard_normal(count))
    tip = np.full(count, np.deg2rad(min(plan.tip_deg, 25.0)))
    return foot, _paths(crown, size, foot, azimuth, reach, np.clip(angle, 0.3, 1.9), tip)


def _paths(
    crown: Crown,
    size: tuple[float, float, float, float],
    foot: np.ndarray,
    azimuth: np.ndarray,
    share: np.ndarray,
    angle: np.ndarray,
    tip: np.ndarray,
) -> np.ndarray:
    """The curves (K, 4, 3) of limbs, from their feet: control points of Bézier's.

    foot : (K,) heights, metres. share : (K,) of the crown's radius at the height of the tip, that a limb
    reaches. angle : (K,) to the stem, and tip : (K,) elevation at the end, radians.
    """
    height, base, width, _ = size
    span = height - base
    rise = np.tan((np.pi / 2 - angle + tip) / 2)
    reach = np.full(len(foot), 0.3 * width / 2)
    for _ in range(6):
        at = np.clip((foot + reach * rise - base) / span, 0.0, 0.985)
        reach = (reach + share * width / 2 * outline(crown, at)) / 2
    up = np.clip(foot + reach * rise, 0.3 * foot, height - 0.03 * span) - foot
    end = np.column_stack([reach, up])
    chord = np.hypot(*end.T)[:, None] / 3
    leave = np.column_stack([np.sin(angle), np.cos(angle)])
    arrive = np.column_stack([np.cos(tip), np.sin(tip)])
    flat = np.stack([np.zeros_like(end), chord * leave, end - chord * arrive, end], axis=1)
    around = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    return np.concatenate([flat[:, :, :1] * around[:, None], flat[:, :, 1:]], axis=2)


def _forked(
    plan: Architecture,
    crown: Crown,
    size: tuple[float, float, float, float],
    count: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Feet (K,) and curves (K, 4, 3) of the limbs that a stem divides into, the outermost first."""
    height, base, width, _ = size
    span = height - base
    onward = (np.arange(count) + 0.7 * rng.random(count)) / count  # the lowest is the outermost
    wide = FULLEST * (1 - 0.75 * onward**1.3) * (0.8 + 0.2 * rng.random(count))
    wide[0] *= 0.6 + 0.25 * rng.random()  # the first division makes two stems
    level = _dome(crown, wide) * (0.8 + 0.18 * rng.random(count))
    azimuth = GOLDEN * np.arange(count) + 0.9 * rng.random(count) + 2 * np.pi * rng.random()
    start = np.clip(plan.fork + (LAST_FORK - plan.fork) * onward**1.1, 0, level - 0.12)
    foot = base + span * np.maximum(start, 0.0)
    end = np.column_stack(
        [
            wide * width / 2 * np.cos(azimuth),
            wide * width / 2 * np.sin(azimuth),
            base + span * level - foot,
        ]
    )
    steep = STEEPER * (onward - 0.4)  # limbs from low on the stem spread, the upper ones rise
    angle = plan.angle_deg.mean - steep + plan.angle_deg.sd * rng.standard_normal(count)
    angle = np.deg2rad(np.clip(angle, 15.0, 100.0))
    azimuth = azimuth + 0.5 * rng.standard_normal(count)  # they set out to another side
    around = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    leave = np.column_stack([around * np.sin(angle)[:, None], np.cos(angle)])
    tip = plan.tip_deg + steep + 12.0 * rng.standard_normal(count)
    tip = np.deg2rad(np.clip(tip, -30.0, 85.0))
    azimuth = azimuth_of(end) + 0.4 * rng.standard_normal(count)
    around = np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    arrive = np.column_stack([around * np.cos(tip)[:, None], np.sin(tip)])
    chord = np.linalg.norm(end, axis=1, keepdims=True)
    zero = np.zeros_like(end)
    return foot, np.stack([zero, 0.4 * chord * leave, end - 0.3 * chord * arrive, end], axis=1)


def _dome(crown: Crown, wide: np.ndarray) -> np.ndarray:
    """(K,) share of the crown's length at which its upper side is so wide, of its largest radius."""
    inner = np.clip(1 - wide, 0, 1) ** (1 / crown.top)
    return np.asarray(crown.widest + (1 - crown.widest) * inner)


def _divided(
    plan: Architecture,
    crown: Crown,
    size: tuple[float, float, float, float],
    limbs: tuple[np.ndarray, np.ndarray, np.ndarray],
    first: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Divide heavy limbs, as of ``_nodes_of``, into curves to places beside their tips.

    first : number of the limbs' first node.
    """
    height, base, width, _ = size
    place, _, starts = limbs
    count = len(starts)
    ends = np.append(starts[1:], len(place)) - 1
    each = np.maximum(0, rng.poisson(plan.divide, count))
    of = np.repeat(np.arange(count), each)
    along = 0.3 + 0.5 * rng.random(len(of))
    at = (starts[of] + along * (ends[of] - starts[of])).astype(int)
    tip = place[ends[of]]
    azimuth, wide = azimuth_of(tip), np.hypot(tip[:, 0], tip[:, 1]) / (width / 2)
    side = np.where(np.arange(len(of)) % 2 == 0, 1.0, -1.0)
    azimuth = azimuth + side * (0.4 + 0.5 * rng.random(len(of))) * 2.4 / np.sqrt(count)
    wide = np.clip(wide * (0.7 + 0.45 * rng.random(len(of))), 0.05, FULLEST)
    level = _dome(crown, wide) * (0.8 + 0.17 * rng.random(len(of)))
    end = np.column_stack([np.cos(azimuth), np.sin(azimuth)]) * (wide * width / 2)[:, None]
    end = np.column_stack([end, base + (height - base) * level]) - place[at]
    end[:, 2] = np.maximum(end[:, 2], 0.1)
    before = place[np.maximum(at - 1, starts[of])]
    leave = place[at] - before + 1e-9 * end
    leave /= np.maximum(np.linalg.norm(leave, axis=1, keepdims=True), 1e-9)
    chord = np.linalg.norm(end, axis=1, keepdims=True)
    leave = 0.6 * leave + 0.4 * end / chord
    path = np.stack([0 * end, 0.35 * chord * leave, 0.7 * end, end], axis=1)
    return _nodes_of(place[at], first + at, path, crown.crook, first + len(place), rng)


def _nodes_of(
    foot: np.ndarray,
    on: np.ndarray,
    path: np.ndarray,
    crook: float,
    first: int,
    rng: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes (M, 3) along curves (K, 4, 3) from feet (K, 3), their parents (M,), where each starts (K,).

    on : (K,) nodes that the curves start from. first : number of the first node made here.
    """
    chord = np.linalg.norm(path[:, 3], axis=1)
    many = np.clip(np.ceil(chord / APART), 2, MOST_NODES).astype(int)
    of, within = numbered(many)
    t = ((within + 1) / many[of])[:, None]
    p1, p2, p3 = (path[of, k] for k in (1, 2, 3))
    place = 3 * t * (1 - t) ** 2 * p1 + 3 * t**2 * (1 - t) * p2 + t**3 * p3
    sway = 0.12 * crook * chord[:, None] * rng.standard_normal((2, len(foot), 3))
    place = place + sway[0][of] * np.sin(np.pi * t) + sway[1][of] * np.sin(2 * np.pi * t) / 2
    bends = 0.3 * crook * chord[:, None] * rng.standard_normal((len(KINKS), len(foot), 3))
    for bend, waves in zip(bends, KINKS, strict=True):
        place = place + bend[of] * np.sin(waves * np.pi * t) / waves**1.5
    parent = first + np.arange(len(of)) - 1
    parent[within == 0] = on
    return foot[of] + place, parent, np.flatnonzero(within == 0)


@dataclass(frozen=True)
class Twigs:
    """T twigs: where each leaves its segment, where it ends, and which segment that is."""

    start: np.ndarray  # (T, 3)
    end: np.ndarray
    segment: np.ndarray  # (T,)
    key: np.ndarray  # (T,) uint64


def seat_twigs(
    crown: Crown, skeleton: Skeleton, tips: np.ndarray, count: int, key: np.ndarray
) -> Twigs:
    """Set twigs evenly along all thin segments, fewer where short branches crowd below the top.

    tips : (S,) branches that end beyond each segment. key : (1,) lineage of the tree.
    """
    bearing = np.flatnonzero(tips <= FEW_TIPS)  # also the top of the stem
    if not len(bearing):
        bearing = np.flatnonzero(tips <= max(FEW_TIPS, tips.min()))
    way = skeleton.end[bearing] - skeleton.start[bearing]
    length = np.sqrt(np.einsum("si,si->s", way, way))
    below = skeleton.end[:, 2].max() - skeleton.end[bearing, 2]
    thinned = np.clip(below / (TAPER * crown.twig.mean), SPARSEST, 1.0)
    reach = np.cumsum(length * thinned)
    keys = child_keys(np.repeat(key, count), np.arange(count))
    at = (np.arange(count) + keyed_uniform(keys, "twig place")) / count * reach[-1]
    pick = np.minimum(np.searchsorted(reach, at, side="right"), len(bearing) - 1)
    share = 1 - (reach[pick] - at) / np.diff(reach, prepend=0.0)[pick]
    segment = bearing[pick]
    heading = way[pick] / length[pick, None]
    start = skeleton.start[segment] + np.clip(share, 0, 1)[:, None] * way[pick]
    side = across(heading)
    azimuth = GOLDEN * np.arange(count) + 0.5 * keyed_uniform(keys, "twig turn")
    angle = np.deg2rad(draw_normal(crown.twig_angle_deg, keys, "twig angle"))[:, None]
    around = np.cos(azimuth)[:, None] * side
    around += np.sin(azimuth)[:, None] * cross_rows(heading, side)
    direction = np.cos(angle) * heading + np.sin(angle) * around
    direction[:, 2] += crown.rise - crown.hang
    length = draw_normal(crown.twig, keys, "twig length")
    room = skeleton.end[:, 2].max() - start[:, 2]  # to the top, where twigs are of this year
    length = length * np.clip(room / (TAPER * crown.twig.mean), SHORTEST, 1.0)
    end = start + length[:, None] * unit(direction)
    return Twigs(start, end, segment, keys)


def with_twigs(skeleton: Skeleton, twigs: Twigs, radius: float) -> Skeleton:
    """The skeleton and its twigs, a segment each."""
    count = len(twigs.segment)
    order = skeleton.order[twigs.segment] + 1
    return Skeleton(
        start=np.concatenate([skeleton.start, twigs.start]),
        end=np.concatenate([skeleton.end, twigs.end]),
        radius=np.concatenate([skeleton.radius, np.tile([radius, 0.6 * radius], (count, 1))]),
        parent=np.concatenate([skeleton.parent, twigs.segment]),
        order=np.concatenate([skeleton.order, order]),
        generation=np.concatenate([skeleton.generation, skeleton.generation[twigs.segment] + 1]),
    )


def leaves_on(leaf: Leaf, twigs: Twigs, first: int, count: int, stalk: bool) -> LeafSites:
    """Leaves along twigs, evenly, the last at the tip.

    first : segment number of the first twig. stalk : a shoot at a twig's tip goes on along it.
    """
    many = len(twigs.segment)
    each = np.full(many, count // many)
    each[: count - each.sum()] += 1
    twig, number = numbered(each)
    share = 1 - number / np.maximum(each[twig], 1) * 0.85
    way = twigs.end - twigs.start
    heading = unit(way)
    foot = twigs.start[twig] + share[:, None] * way[twig]
    keys = child_keys(twigs.key[twig], number)
    azimuth = GOLDEN * number + 2 * np.pi * keyed_uniform(twigs.key, "leaf phase")[twig]
    side = across(heading)
    sites = set_leaves(leaf, keys, foot, heading[twig], side[twig], azimuth, first + twig)
    if not stalk:
        return sites
    direction = np.where((number == 0)[:, None], heading[twig], sites.direction)
    up = cross_rows(direction, across(direction))
    return replace(sites, direction=direction, up=up)


def borne(parent: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(N,) what each of N things bears itself and by all that descend from it; parents come first."""
    total = own.astype(float).copy()
    depth = depths(parent)
    by_depth = np.argsort(-depth, kind="stable")
    edges = np.flatnonzero(np.diff(depth[by_depth], prepend=-1))
    for first, last in zip(edges, [*edges[1:], len(parent)], strict=True):
        rows = by_depth[first:last]
        rows = rows[parent[rows] >= 0]
        np.add.at(total, parent[rows], total[rows])
    return total


def orders_of(nodes: Nodes, total: np.ndarray) -> np.ndarray:
    """(N,) branching order: an axis goes on to what bears most and turns least, the stem to its top.

    Where every child turns away by more than ``TURN`` the axis ends.
    """
    count = len(nodes.parent)
    parent = np.maximum(nodes.parent, 0)
    way = nodes.place - nodes.place[parent]
    length = np.linalg.norm(way, axis=1)
    turn = np.einsum("ni,ni->n", way, way[parent]) / np.maximum(length * length[parent], 1e-12)
    turn = np.where(length[parent] > 0, turn, 1.0)
    rank = total * ((1 + turn) / 2) ** 2 + np.where(nodes.trunk, total.max() + 1, 0)
    up = np.lexsort((rank, nodes.parent))  # of each parent the last is the one that goes on
    last = np.ones(count, dtype=bool)
    last[:-1] = np.diff(nodes.parent[up]) != 0
    goes_on = np.zeros(count, dtype=bool)
    goes_on[up[last]] = True
    goes_on &= nodes.trunk | (turn > np.cos(TURN))
    return depths(nodes.parent, ~goes_on)


def skeleton_of_nodes(nodes: Nodes, total: np.ndarray) -> Skeleton:
    """Segments between nodes, without radii yet; segment k ends at node k + 1."""
    order = orders_of(nodes, total)[1:]
    parent = nodes.parent[1:]
    return Skeleton(
        start=nodes.place[parent],
        end=nodes.place[1:],
        radius=np.zeros((len(parent), 2)),
        parent=parent - 1,
        order=order,
        generation=depths(nodes.parent)[1:] - 1,
    )


def with_radii(skeleton: Skeleton, total: np.ndarray, crown: Crown, dbh: float) -> Skeleton:
    """The skeleton with the radii of its pipes.

    total : (S,) twigs that each segment bears. dbh : that it ends at, metres.
    """
    base = skeleton.start[skeleton.order == 1, 2].min(initial=np.inf)
    stem, z = skeleton.order == 0, skeleton.start[:, 2]
    gone = crown.disused / (1 - crown.disused) * np.clip(1 - z / max(base, 1e-9), 0, 1)
    own = np.maximum(total, 0.3) * (1 + np.where(stem, gone, 0.0))
    flare = 1 + crown.flare * np.exp(-np.maximum(z, 0) / max(1.5 * (dbh / 2), 1e-9))
    low = own ** (1 / crown.pipe) * np.where(stem, flare, 1.0)
    # An axis narrows along a segment to where it goes on; its last segment to half.
    high = 0.5 * low
    parent = skeleton.parent
    on = np.flatnonzero((parent >= 0) & (skeleton.order == skeleton.order[np.maximum(parent, 0)]))
    high[parent[on]] = low[on]
    radius = np.stack([low, np.minimum(high, low)], axis=1)
    drawn = replace(skeleton, radius=radius)
    own_dbh = dbh_of(drawn)
    factor = dbh / own_dbh if own_dbh > 0 else dbh / (2 * float(radius.max()))
    radius = np.maximum(radius * factor, crown.twig_radius)
    return replace(skeleton, radius=radius)


def scaled_to(skeleton: Skeleton, dbh: float) -> Skeleton:
    """A skeleton whose radii are changed in proportion until the stem has this diameter at breast height."""
    own_dbh = dbh_of(skeleton)
    return replace(skeleton, radius=skeleton.radius * (dbh / own_dbh)) if own_dbh > 0 else skeleton


PIECES = 4  # of a dead branch
STUBS, STUB = 0.3, (0.06, 0.25)  # share of branches that are broken off short, and how short
THICKEST, THINNEST = 0.02, 0.0012  # metres of radius
LONGEST = 3.0  # metres
SIDE = 0.35  # length of a side branch over that of what bears it


def with_dead(wood: Skeleton, plan: Architecture, wanted: Wanted, key: np.ndarray) -> Skeleton:
    """The tree with its dead branches.

    key : (1,) uint64, their lineage.
    """
    dead = plan.dead
    base = wanted.crown_base
    low = base * (1 - dead.down)
    count = round(dead.density * (base - low) * (1 - dead.decay * dead.down / 2))
    if count < 1 or not (wood.order == 0).any():
        return wood
    keys = child_keys(np.repeat(key, count), np.arange(count))
    rank = (np.arange(count) + keyed_uniform(keys, "height")) / count
    depth = np.linspace(0.0, dead.down, 65)  # below the crown's base, as a share of it
    share = depth * (1 - dead.decay * depth / 2)
    depth = np.interp(rank, share / share[-1], depth)
    z = base * (1 - depth)
    if plan.fork >= 1:  # whorls of years long gone
        level = base - plan.shoot * np.round((base - z) / plan.shoot)
        z = np.where(level > 0.1, level + 0.03 * keyed_normal(keys, "whorl"), z)
    z = np.clip(z, min(0.1, 0.5 * base), 0.98 * base)
    on, foot, radius = _on_stem(wood, z)
    # Crowns keep their proportions: when its base was here, the whole crown was smaller by that.
    whole = dead.length * wanted.crown_width / 2 * (1 - depth)
    length = whole * (1 - dead.decay * depth) * (0.4 + 0.6 * keyed_uniform(keys, "length"))
    stub = keyed_uniform(keys, "broken") < STUBS
    short = STUB[0] + (STUB[1] - STUB[0]) * keyed_uniform(keys, "stub")
    length = np.clip(length * np.where(stub, short, 1.0), 0.03, LONGEST) + radius
    thick = np.minimum(dead.radius * radius, THICKEST) * (0.6 + 0.5 * keyed_uniform(keys, "girth"))
    thick = np.clip(thick, THINNEST, 0.7 * radius)
    azimuth = 2 * np.pi * keyed_uniform(keys, "azimuth")
    angle = np.deg2rad(draw_normal(dead.angle_deg, keys, "angle"))
    heading = np.column_stack(
        [np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)]
    )
    branches = _bent(foot, heading, length, thick, keys, PIECES)
    ones = np.ones(count, dtype=np.int64)
    parts = [wood, Skeleton.of_chains(*branches, on, ones, wood.generation[on] + 1, len(wood))]
    line, bearer = _sides(branches, keys, dead.twigs)
    if len(bearer):
        twos, after = np.full(len(bearer), 2), parts[1].generation[bearer] + 1
        on, first = len(wood) + bearer, len(wood) + len(parts[1])
        parts.append(Skeleton.of_chains(*line, on, twos, after, first))
    both = Skeleton.joined(parts)
    return replace(both, dead=np.arange(len(both)) >= len(wood))


def _on_stem(wood: Skeleton, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Segment of the stem (N,), place (N, 3) and radius (N,) there at heights (N,)."""
    stem = np.flatnonzero(wood.order == 0)
    stem = stem[np.argsort(wood.start[stem, 2], kind="stable")]
    pick = np.clip(np.searchsorted(wood.start[stem, 2], z, side="right") - 1, 0, len(stem) - 1)
    on = stem[pick]
    rise = np.maximum(wood.end[on, 2] - wood.start[on, 2], 1e-9)
    share = np.clip((z - wood.start[on, 2]) / rise, 0, 1)
    place = wood.start[on] + share[:, None] * (wood.end[on] - wood.start[on])
    radius = wood.radius[on, 0] + share * (wood.radius[on, 1] - wood.radius[on, 0])
    return on, place, radius


def _bent(
    foot: np.ndarray,
    heading: np.ndarray,
    length: np.ndarray,
    thick: np.ndarray,
    keys: np.ndarray,
    pieces: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (N, pieces + 1, 3) and radii (N, pieces + 1) of branches, crooked, thinner to a broken tip."""
    nodes, way = [foot], heading
    for piece in range(pieces):
        turn = [keyed_normal(keys, f"bend {axis} {piece}") for axis in range(3)]
        way = unit(way + 0.14 * np.column_stack(turn))
        nodes.append(nodes[-1] + (length / pieces)[:, None] * way)
    place = np.stack(nodes, axis=1)
    place[:, :, 2] = np.maximum(place[:, :, 2], 0.03)
    narrow = 1 - 0.65 * np.linspace(0, 1, pieces + 1)
    return place, np.maximum(thick[:, None] * narrow, 0.6 * THINNEST)


def _sides(
    branches: tuple[np.ndarray, np.ndarray], keys: np.ndarray, each: float
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Side branches, and the segment that bears each, counted from the first of the branches."""
    place, radius = branches
    pieces = place.shape[1] - 1
    way = np.diff(place, axis=1)
    length = np.linalg.norm(way, axis=2).sum(axis=1)
    many = np.floor(each * length + keyed_uniform(keys, "sides")).astype(int)
    of, number = numbered(many)
    own = child_keys(keys[of], number)
    at = (0.25 + 0.7 * keyed_uniform(own, "place")) * pieces
    piece = np.minimum(at.astype(int), pieces - 1)
    part = (at - piece)[:, None]
    foot = place[of, piece] * (1 - part) + place[of, piece + 1] * part
    along = unit(way[of, piece])
    aside = cross_rows(along, across(along))
    turn = 2 * np.pi * keyed_uniform(own, "turn")[:, None]
    out = np.cos(turn) * across(along) + np.sin(turn) * aside
    heading = unit(along + (0.7 + 0.6 * keyed_uniform(own, "lean"))[:, None] * out)
    long = SIDE * length[of] * (0.3 + 0.9 * keyed_uniform(own, "length"))
    thick = np.maximum(0.5 * radius[of, piece], THINNEST)
    line = _bent(foot, heading, long, thick, own, 2)
    return line, of * pieces + piece
