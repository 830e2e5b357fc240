"""Size of a sibling beside its template: measured exponents of height and crown over the stem, and the spread
within one stand.

log H = log H' + h·log(D/D') along a tree's life, log W likewise with w for the width of the crown, D the
diameter at breast height. Exponents by ordinary least squares on logarithms within each study and
species of BAAD (Falster et al. 2015, Ecology 96:1445; CC0), trees over 2 m: 5,665 for heights, 1,843 for
crown widths; a genus without at least 50 widths has its group's. ``width_spread`` is what is left of log W.

Trees of one stand: medians over 16 plots of pine, 654 trees (La Rioja, in the R package FORTLS): log D
has a standard deviation of 0.145, and log H = 0.216·log D + 0.088·z. That is 0.43 of the spread of log H
that BAAD's trees of many stands have at one diameter (0.204); crown widths of one stand were not measured,
and are taken to differ by the same share.

Stem, girth and crown follow from age or a given height or diameter, and in between by chance as trees of
one stand differ. A longer stem bears more nodes, not longer internodes alone; a longer branch
more and longer children.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.rng import keyed_normal
from ...spec import Siblings
from .anatomy import Anatomy
from .habit import Habit

DBH_SPREAD = 0.145
HEIGHT_WITH_DBH, HEIGHT_SPREAD = 0.216, 0.088
WITHIN_STAND = 0.43
BREAST = 1.3  # metres
NODES = 0.8  # exponent: nodes of the trunk with its length
CHILDREN = 0.7  # exponent: number of children with their parent's length
MOST_SPREAD = 2.0  # standard deviations


@dataclass(frozen=True)
class SiblingAllometry:
    """Exponents of height and crown width over diameter, and the spread of log width at one diameter."""

    height: float
    width: float
    width_spread: float


ALLOMETRY = {
    "any": SiblingAllometry(0.666, 0.606, 0.239),
    "broadleaf": SiblingAllometry(0.598, 0.619, 0.241),
    "conifer": SiblingAllometry(0.782, 0.596, 0.237),
    "abies": SiblingAllometry(0.815, 0.494, 0.182),
    "acer": SiblingAllometry(0.561, 0.619, 0.241),
    "betula": SiblingAllometry(0.721, 0.619, 0.241),
    "eucalyptus": SiblingAllometry(0.666, 0.684, 0.214),
    "fagus": SiblingAllometry(0.578, 0.619, 0.241),
    "larix": SiblingAllometry(0.819, 0.596, 0.237),
    "picea": SiblingAllometry(0.844, 0.605, 0.172),
    "pinus": SiblingAllometry(0.743, 0.701, 0.265),
    "populus": SiblingAllometry(0.721, 0.619, 0.241),
    "pseudotsuga": SiblingAllometry(0.790, 0.489, 0.269),
    "quercus": SiblingAllometry(0.531, 0.619, 0.241),
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
    laws = ALLOMETRY[siblings.allometry]
    height, dbh = float(habit.anatomy.lines.knot[:, 2].max()), dbh_of(habit.anatomy)
    girth = siblings.age
    stem = girth**laws.height
    if siblings.dbh:
        girth = siblings.dbh / dbh
        stem = girth**laws.height
    if siblings.height:
        stem = siblings.height / height
        girth = girth if siblings.dbh else stem ** (1 / laws.height)
    crown = girth**laws.width

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
    crown *= _about_one(v * laws.width * DBH_SPREAD, thick) * _about_one(
        v * WITHIN_STAND * laws.width_spread, wide
    )
    return Size(stem, girth, crown, branches=stem**NODES, height=stem * height)


def dbh_of(anatomy: Anatomy) -> float:
    """Diameter of the trunk at breast height, or halfway up one that is lower than twice that."""
    trunk = int(anatomy.trunks[0])
    return 2 * _radius_at(anatomy, trunk, _breast_share(anatomy, trunk, 1.0))


def trunk_girth(anatomy: Anatomy, trunks: np.ndarray, scale: np.ndarray, size: Size) -> np.ndarray:
    """(N, 2) factors of thickness at foot and tip, so that breast height comes out right.

    The tip stays as thin as it is, or becomes thinner: a stouter tree has no stouter shoots.
    """
    if size.girth == 1.0 and (scale == 1.0).all():
        return np.ones((len(trunks), 2))
    factors = []
    for trunk, long in zip(trunks.tolist(), scale.tolist(), strict=True):
        before = _breast_share(anatomy, trunk, 1.0)
        share = _breast_share(anatomy, trunk, long)
        wanted = size.girth * _radius_at(anatomy, trunk, before) / _radius_at(anatomy, trunk, share)
        if wanted >= 1:
            factors.append(((wanted - share) / (1 - share), 1.0))
        else:
            factors.append((wanted, wanted))
    return np.array(factors)


def _breast_share(anatomy: Anatomy, trunk: int, scale: float) -> float:
    reach = float(anatomy.lines.reach()[trunk]) * scale
    return min(BREAST / reach, 0.5)


def _radius_at(anatomy: Anatomy, trunk: int, share: float) -> float:
    lines = anatomy.lines
    rows = slice(int(lines.first[trunk]) + trunk, int(lines.first[trunk + 1]) + trunk + 1)
    knots = np.linspace(0.0, 1.0, rows.stop - rows.start)
    return float(np.interp(share, knots, lines.radius[rows]))


def _about_one(spread: float, z: float) -> float:
    """A lognormal of mean 1."""
    return float(np.exp(spread * z - spread * spread / 2))
