"""Size of one tree beside its template: stem, girth, crown, and how many branches follow.

From age or a given height or diameter by measured allometry (``allometry``), and in between by chance as
trees of one stand differ. A longer stem bears more nodes, not longer internodes alone; a longer branch
more and longer children.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.rng import keyed_normal
from ...spec import Siblings
from .allometry import (
    ALLOMETRY,
    BREAST,
    DBH_SPREAD,
    HEIGHT_SPREAD,
    HEIGHT_WITH_DBH,
    WITHIN_STAND,
)
from .anatomy import Anatomy
from .fitted import Habit

NODES = 0.8  # exponent: nodes of the trunk with its length
DAUGHTERS = 0.7  # exponent: number of children with their parent's length
MOST_SPREAD = 2.0  # standard deviations


@dataclass(frozen=True)
class Size:
    """Factors over the template, and the height (m) that is aimed at.

    stem : length of the trunk. girth : diameter at breast height. crown : length of first-level branches.
    branches : number of first-level branches. count_exponent : of further children.
    """

    stem: float
    girth: float
    crown: float
    branches: float
    height: float
    count_exponent: float = DAUGHTERS

    def stretched(self, factor: float) -> Size:
        """The same with a trunk this many times as long."""
        return replace(self, stem=self.stem * factor)


def size_of(habit: Habit, siblings: Siblings, tree: np.ndarray) -> Size:
    """The size of a tree with the key ``tree`` (1,)."""
    laws = ALLOMETRY[siblings.allometry]
    height, dbh = height_of(habit.anatomy), dbh_of(habit.anatomy)
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


def height_of(anatomy: Anatomy) -> float:
    """Of the wood, metres above the foot."""
    return float(anatomy.lines.knot[:, 2].max())


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
