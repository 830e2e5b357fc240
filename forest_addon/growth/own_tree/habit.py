"""A stochastic, parametric L-system fitted to one tree: what its axes bear, by order and position.

A piece of wood that bears others is read as a production: an axis of its order puts children on nodes
(children closer together than a quarter of the mean spacing, as in a whorl, share one) at such shares of
its length, azimuths and angles. Pieces that are alike (same order, length within a factor, place on the
parent, slope of the heading) are a class, a letter of the grammar; its members are that letter's
productions and equally likely, so that a tree made by them has, in the mean, as many branches, lengths
and leaves as the one they come from. Tables over the position along the parent (local linear regression
with a Gaussian kernel) say how length, angle and thickness change with it.

Prusinkiewicz & Lindenmayer 1990, section 1.7 and 1.10 (stochastic, parametric L-systems).

The size of a sibling beside its template follows measured exponents of height and crown over the stem, and
the spread within one stand: log H = log H' + h·log(D/D') along a tree's life, log W likewise with w for the
width of the crown, D the diameter at breast height. Exponents by ordinary least squares on logarithms within
each study and species of BAAD (Falster et al. 2015, Ecology 96:1445; CC0), trees over 2 m: 5,665 for heights,
1,843 for crown widths; a genus without at least 50 widths has its group's. ``width_spread`` is what is left
of log W.

Trees of one stand: medians over 16 plots of pine, 654 trees (La Rioja, in the R package FORTLS): log D has a
standard deviation of 0.145, and log H = 0.216·log D + 0.088·z. That is 0.43 of the spread of log H that
BAAD's trees of many stands have at one diameter (0.204); crown widths of one stand were not measured, and are
taken to differ by the same share. Stem, girth and crown follow from age or a given height or diameter, and in
between by chance as trees of one stand differ. A longer stem bears more nodes, not longer internodes alone; a
longer branch more and longer children.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.rng import keyed_normal
from ...base.rows import lengths
from ...base.runs import Runs
from ...spec import Siblings
from .anatomy import Anatomy

NODE = 0.25  # mean spacings within which children share a node
LIMB = 0.5, 0.25  # radii of the trunk there, and at its foot, from which a branch is a limb
ALIKE_LENGTH = 0.45  # logarithm of length
ALIKE_SHARE = 0.15  # of the parent
ALIKE_SLOPE = np.deg2rad(35.0)
MOST_ALIKE = 4  # members of a class
KERNEL = 0.12  # of the parent's length: how far a table looks
PLACES = np.linspace(0.0, 1.0, 33)  # of a table, along the parent from foot to tip
MOST_CHANCE = 0.25
BY_CHANCE = 0.25  # of what pieces are off the means; the rest comes with the pieces themselves
MOST_LENGTH_SPREAD, MOST_ANGLE_SPREAD = 0.1, np.deg2rad(4.0)
FEW = 6.0
MOST_UNEVEN = 0.1  # relative spread of the number of branches of an order, by chance


@dataclass(frozen=True)
class Table:
    """Means at ``PLACES`` along the parent, for pieces of one order.

    length : (P,) of a child over its parent's. angle : (P,) radians.
    length_spread, angle_spread : what is added by chance, relative and radians: a share of what pieces
        are off these means.
    """

    length: np.ndarray
    angle: np.ndarray
    length_spread: float
    angle_spread: float


@dataclass(frozen=True)
class Slots:
    """The children of every piece, from its foot up: N = C - trunks.

    of_piece : which of the N each piece bears. piece : (N,) the child.
    node : (N,) of its parent, from 0. before, after : (N,) share of the parent to the next nodes.
    limb : (N,) whether it is as stout as the trunk that it leaves.
    """

    of_piece: Runs
    piece: np.ndarray
    node: np.ndarray
    before: np.ndarray
    after: np.ndarray
    limb: np.ndarray


@dataclass(frozen=True, eq=False)
class Habit:
    """The grammar of one tree.

    share : (C,) seat of each piece as a share of its parent. slots : what each piece bears.
    of_class, member : classes of pieces that may stand for each other. kind : (C,) class of each.
    chance : by order of the child, that one is missing, and that one is doubled.
    scatter : by order, relative spread of the distance between nodes.
    tables : by order, from order 1 on.
    floor : (C,) metres above the ground below which no knot of a piece goes: so low that leaves do not reach
        into the ground, or as low as it is in the template, as roots are.
    """

    anatomy: Anatomy
    share: np.ndarray
    slots: Slots
    of_class: Runs
    member: np.ndarray
    kind: np.ndarray
    chance: np.ndarray
    scatter: np.ndarray
    tables: tuple[Table, ...]
    floor: np.ndarray


def fit(anatomy: Anatomy) -> Habit:
    """The grammar of a tree."""
    share = anatomy.share()
    slots = _slots(anatomy, share)
    kind = _classes(anatomy, share)
    orders = int(anatomy.order.max(initial=0)) + 1
    spread = [_spread(anatomy, slots, order) for order in range(1, orders)]
    tables = tuple(_table(anatomy, share, order) for order in range(1, orders))
    # (C,) of how low pieces may be laid
    lines, leaves = anatomy.lines, anatomy.foliage
    begin = lines.first[:-1] + np.arange(anatomy.count)
    lowest = np.minimum.reduceat(lines.knot[:, 2], begin)
    hang = np.maximum.reduceat(lines.radius, begin)
    if len(leaves.bearer):
        stock = leaves.stock
        reach = np.maximum.reduceat(lengths(stock.place), stock.vertices.first)
        np.maximum.at(hang, leaves.bearer, reach + leaves.seat.away)
    return Habit(
        anatomy=anatomy,
        share=share,
        slots=slots,
        of_class=Runs.of(np.sort(kind), int(kind.max(initial=-1)) + 1),
        member=np.argsort(kind, kind="stable"),
        kind=kind,
        chance=np.array([0.0, *(chance for chance, _ in spread)]),
        scatter=np.array([0.0, *(scatter for _, scatter in spread)]),
        tables=tables,
        floor=np.asarray(np.minimum(lowest, hang)),
    )


def limbs(anatomy: Anatomy) -> np.ndarray:
    """(C,) whether a piece is a first-level branch nearly as stout as the trunk: a fork of it."""
    foot = anatomy.foot_radius()
    trunk = foot[np.maximum(anatomy.parent, 0)]
    there, at_foot = LIMB
    stout = (foot >= there * radius_at_seat(anatomy)) & (foot >= at_foot * trunk)
    return np.asarray(stout & (anatomy.order == 1))


def radius_at_seat(anatomy: Anatomy) -> np.ndarray:
    """(C,) radius of the parent where each piece sits; infinite on the ground."""
    seat, parent = anatomy.seat, anatomy.parent
    _, radius = anatomy.lines.at(np.maximum(parent, 0), seat.stretch, seat.part)
    return np.where(parent < 0, np.inf, radius)


def _slots(anatomy: Anatomy, share: np.ndarray) -> Slots:
    hanging = np.flatnonzero(anatomy.parent >= 0)
    piece = hanging[np.lexsort((hanging, share[hanging], anatomy.parent[hanging]))]
    parent, place = anatomy.parent[piece], share[piece]
    of_piece = Runs.of(parent, anatomy.count)
    count = len(piece)
    starts = np.zeros(count, dtype=bool)
    starts[of_piece.first[of_piece.size > 0]] = True
    last = (of_piece.first + of_piece.size - 1)[parent]
    span = place[last] - place[of_piece.first[parent]]
    mean = span / np.maximum(of_piece.size[parent] - 1, 1)
    opens = starts | (np.diff(place, prepend=0.0) > NODE * mean)
    node = np.cumsum(opens) - 1  # over all pieces
    middle = np.bincount(node, place) / np.bincount(node)
    owner = parent[opens]
    gap = np.diff(middle)
    inside = np.diff(owner) == 0
    before = np.concatenate([[np.nan], np.where(inside, gap, np.nan)]) if count else middle
    after = np.concatenate([np.where(inside, gap, np.nan), [np.nan]]) if count else middle
    before = np.where(np.isnan(before), middle, before)  # to the foot, and to the tip
    after = np.where(np.isnan(after), 1.0 - middle, after)
    return Slots(
        of_piece=of_piece,
        piece=piece,
        node=node - node[of_piece.first[parent]] if count else node,
        before=before[node],
        after=after[node],
        limb=limbs(anatomy)[piece],
    )


def _spread(anatomy: Anatomy, slots: Slots, order: int) -> tuple[float, float]:
    """Unevenness of the children of an order: the chance that one is missing, the spread of spacing.

    The chance is half the variance of the number on a node over its mean; where nodes bear one each,
    that of a renewal process, the squared coefficient of variation of the spacing.
    """
    of_order = np.flatnonzero(anatomy.order[slots.piece] == order)
    parent = anatomy.parent[slots.piece[of_order]]
    _, first, size = np.unique(
        np.stack([parent, slots.node[of_order]]), axis=1, return_index=True, return_counts=True
    )
    gap = slots.after[of_order][first]
    same = np.diff(parent[first], append=-1) == 0
    pairs = np.flatnonzero(same[:-1] & same[1:])  # a gap and the next of the same parent
    if len(pairs) < 2:
        return 0.0, 0.0
    # Neighbouring gaps are compared, so that spacing that changes along the parent is no spread.
    contrast = np.log(np.maximum(gap[pairs + 1], 1e-6) / np.maximum(gap[pairs], 1e-6))
    scatter = min(float(np.median(np.abs(contrast))) / (0.6745 * np.sqrt(2)), 0.6)
    scatter *= float(np.sqrt(len(pairs) / (len(pairs) + FEW)))  # a few gaps tell little
    uneven = float(np.diff(size)[same[:-1]].var() / 2 / size.mean())
    whorled = size.mean() > 1.5
    chance = (uneven if whorled else scatter**2) / 2
    most = MOST_UNEVEN**2 * len(of_order) / 2  # the number of all goes by sqrt(2 · chance · n)
    return min(chance, most, MOST_CHANCE), scatter


def _classes(anatomy: Anatomy, share: np.ndarray) -> np.ndarray:
    """(C,) class of each piece: cells of length, place and slope, split until all in one are alike."""
    heading = anatomy.lines.frame[anatomy.lines.first[:-1], :, 2]
    feature = np.stack(
        [
            np.log(np.maximum(anatomy.lines.reach(), 1e-9)) / ALIKE_LENGTH,
            share / ALIKE_SHARE,
            np.arcsin(np.clip(heading[:, 2], -1, 1)) / ALIKE_SLOPE,
        ],
        axis=1,
    )
    group = 2 * anatomy.order + limbs(anatomy)
    kind, count = np.empty(anatomy.count, np.int64), 0
    cells = [np.flatnonzero(group == g) for g in np.unique(group)]
    while cells:
        cell = cells.pop()
        extent = np.ptp(feature[cell], axis=0)
        along = int(np.argmax(extent))
        if extent[along] <= 1.0 and len(cell) <= MOST_ALIKE:
            kind[cell], count = count, count + 1
            continue
        ordered = cell[np.argsort(feature[cell, along], kind="stable")]
        cut = len(ordered) // 2
        if extent[along] > 1.0:  # where the widest gap near the middle is
            near = slice(max(1, len(ordered) // 4), max(2, len(ordered) - len(ordered) // 4))
            widest = np.diff(feature[ordered, along])[near.start - 1 : near.stop - 1]
            cut = near.start + int(np.argmax(widest))
        cells += [ordered[:cut], ordered[cut:]]
    return kind


def _table(anatomy: Anatomy, share: np.ndarray, order: int) -> Table:
    of_order = np.flatnonzero(anatomy.order == order)
    parent = anatomy.parent[of_order]
    reach = anatomy.lines.reach()
    d = share[of_order] - PLACES[:, None]  # weights (P, N) of a local linear regression
    weight = np.exp(-((d / KERNEL) ** 2) / 2) + 1e-9
    s0, s1, s2 = weight.sum(1), (weight * d).sum(1), (weight * d * d).sum(1)
    ridge = s2 + 0.05 * KERNEL**2 * s0  # where all lie on one side the slope is held back
    solved = weight * (ridge[:, None] - s1[:, None] * d)
    smooth = solved / (ridge * s0 - s1 * s1)[:, None]
    length = np.log(np.maximum(reach[of_order] / reach[parent], 1e-9))
    means = smooth @ length, smooth @ anatomy.angle[of_order]
    off = [
        float((values - np.interp(share[of_order], PLACES, mean)).std())
        for values, mean in zip((length, anatomy.angle[of_order]), means, strict=True)
    ]
    return Table(
        length=np.exp(means[0]),
        angle=np.clip(means[1], 0.0, np.pi),
        length_spread=min(BY_CHANCE * off[0], MOST_LENGTH_SPREAD),
        angle_spread=min(BY_CHANCE * off[1], MOST_ANGLE_SPREAD),
    )


DBH_SPREAD = 0.145
HEIGHT_WITH_DBH, HEIGHT_SPREAD = 0.216, 0.088
WITHIN_STAND = 0.43
BREAST = 1.3  # metres
NODES = 0.8  # exponent: nodes of the trunk with its length
CHILDREN = 0.7  # exponent: number of children with their parent's length
MOST_SPREAD = 2.0  # standard deviations


ALLOMETRY = {  # exponents of height and of crown width over diameter; spread of log width at one diameter
    "any": (0.666, 0.606, 0.239),
    "broadleaf": (0.598, 0.619, 0.241),
    "conifer": (0.782, 0.596, 0.237),
    "abies": (0.815, 0.494, 0.182),
    "acer": (0.561, 0.619, 0.241),
    "betula": (0.721, 0.619, 0.241),
    "eucalyptus": (0.666, 0.684, 0.214),
    "fagus": (0.578, 0.619, 0.241),
    "larix": (0.819, 0.596, 0.237),
    "picea": (0.844, 0.605, 0.172),
    "pinus": (0.743, 0.701, 0.265),
    "populus": (0.721, 0.619, 0.241),
    "pseudotsuga": (0.790, 0.489, 0.269),
    "quercus": (0.531, 0.619, 0.241),
}
NAMES = {
    "abies": ("abies", "fir"),
    "acer": ("acer", "maple", "sycamore"),
    "betula": ("betula", "birch"),
    "eucalyptus": ("eucalyptus", "eucalypt", "gum"),
    "fagus": ("fagus", "beech"),
    "larix": ("larix", "larch"),
    "picea": ("picea", "spruce"),
    "pinus": ("pinus", "pine"),
    "populus": ("populus", "poplar", "aspen"),
    "pseudotsuga": ("pseudotsuga", "douglas"),
    "quercus": ("quercus", "oak"),
}


def allometry_of(name: str) -> str:
    """Return whose measurements to take for a species of this name; "any" where the name does not tell."""
    words = name.lower().replace("_", "-").split("-")
    for genus, names in NAMES.items():
        if any(word in words for word in names):
            return genus
    return "any"


@dataclass(frozen=True)
class Size:
    """Factors over the template, and the height (m) that is aimed at.

    stem : length of the trunk. girth : diameter at breast height. crown : length of first-level branches.
    branches : number of first-level branches.
    """

    stem: float
    girth: float
    crown: float
    branches: float
    height: float


def size_of(habit: Habit, siblings: Siblings, tree: np.ndarray) -> Size:
    """The size of a tree with the key ``tree`` (1,)."""
    height_law, width_law, width_spread = ALLOMETRY[siblings.allometry]
    height = float(habit.anatomy.lines.knot[:, 2].max())
    girth = siblings.dbh / dbh_of(habit.anatomy) if siblings.dbh else siblings.age
    stem = girth**height_law
    if siblings.height:
        stem = siblings.height / height
        girth = girth if siblings.dbh else stem ** (1 / height_law)
    crown = girth**width_law

    thick, tall, wide = (
        float(np.clip(keyed_normal(tree, name)[0], -MOST_SPREAD, MOST_SPREAD))
        for name in ("dbh", "height", "crown")
    )
    v = siblings.variety
    if not siblings.dbh:
        girth *= _about_one(v * DBH_SPREAD, thick)
    if not siblings.height:
        stem *= _about_one(v * HEIGHT_WITH_DBH * DBH_SPREAD, thick) * _about_one(
            v * HEIGHT_SPREAD, tall
        )
    crown *= _about_one(v * width_law * DBH_SPREAD, thick) * _about_one(
        v * WITHIN_STAND * width_spread, wide
    )
    return Size(stem, girth, crown, branches=stem**NODES, height=stem * height)


def dbh_of(anatomy: Anatomy) -> float:
    """Diameter of the trunk at breast height, or halfway up one that is lower than twice that."""
    return 2 * _at_breast(anatomy, int(anatomy.trunks[0]), 1.0)[1]


def trunk_girth(anatomy: Anatomy, trunks: np.ndarray, scale: np.ndarray, size: Size) -> np.ndarray:
    """(N, 2) factors of thickness at foot and tip, so that breast height comes out right.

    The tip stays as thin as it is, or becomes thinner: a stouter tree has no stouter shoots.
    """
    if size.girth == 1.0 and (scale == 1.0).all():
        return np.ones((len(trunks), 2))
    factors = []
    for trunk, long in zip(trunks.tolist(), scale.tolist(), strict=True):
        share, radius = _at_breast(anatomy, trunk, long)
        wanted = size.girth * _at_breast(anatomy, trunk, 1.0)[1] / radius
        stouter = (wanted - share) / (1 - share), 1.0
        factors.append(stouter if wanted >= 1 else (wanted, wanted))
    return np.array(factors)


def _at_breast(anatomy: Anatomy, trunk: int, scale: float) -> tuple[float, float]:
    """Breast height as a share of a trunk that is so many times as long, and the radius at that share."""
    lines = anatomy.lines
    share = min(BREAST / (float(lines.reach()[trunk]) * scale), 0.5)
    rows = slice(int(lines.first[trunk]) + trunk, int(lines.first[trunk + 1]) + trunk + 1)
    knots = np.linspace(0.0, 1.0, rows.stop - rows.start)
    return share, float(np.interp(share, knots, lines.radius[rows]))


def _about_one(spread: float, z: float) -> float:
    """A lognormal of mean 1."""
    return float(np.exp(spread * z - spread * spread / 2))
