"""Competition of crowns: neighbours take light from below, and room at the sides.

The crowns that stand about a tree, weighted by a normal kernel of twice its own crown's width and by the
square of their height over its own (light comes from above), cover a share of the ground, κ. The score
(log κ - log κ₀)/s, κ₀ = 1.5, is a part of what crown bases and widths of the tree differ by from the law
of its kind: above 0 the base is higher and the crown narrower than of most measured trees, below 0 lower and
wider. Stands differ in these also by what competition does not tell. Crowns of neighbours overlap little and
grow into gaps between them, no living crown is but a tuft on a pole, none has more leaves than nineteen of
twenty measured ones, and no stand a larger leaf area index than closed ones have.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import ndtr, ndtri

from ..base.rng import keyed_uniform

KERNEL = 1.0  # standard deviation of the kernel over the mean width of crowns
REACH = 2.5  # of those, beyond which neighbours do not count
CLOSED, SPREAD = 1.5, 0.7  # κ₀ and s
MOST = 2.0  # of the score, either way
BASE, WIDTH = 0.65, -0.55  # correlation of the score with residuals of crown base and width
ALONE = (-MOST * WIDTH, -MOST * BASE)  # scores of crown width and base of a tree without neighbours
THINNEST, THICKEST = 0.025, 0.6  # metres, and of the canopy's: diameters of the understorey
# Metres in which numbers of trees by diameter fall by e, as by 1.4 in 5 cm.
FALL = 0.05 / np.log(1.4)
YOUNG = 0.07  # metres of diameter, below which a tree stands under the canopy
OVERLAP = 1.8  # sum of two neighbours' radii over their distance, at most
NARROWEST = 0.6  # of what was drawn, that neighbours may leave of a crown's width
INTO_GAPS = 0.17  # of its width, that a crown with gaps on half its sides is wider than drawn
BESIDE, SIDES = 1.1, 24  # of its radius, where a crown's sides are looked at, and how many of them
SHORTEST = 0.2  # length over the height of its tree that living crowns come near to, and none has
DENSEST = 15.0  # m² of leaves over the m² that a crown covers
MOST_INDEX = (
    8.0  # m² of leaves a m² of ground, which closed stands do not pass, unless their species says
)


def cover(place: np.ndarray, height: np.ndarray, width: np.ndarray) -> np.ndarray:
    """(N,) κ of trees at places (N, 2) with heights and crown widths (N,), metres.

    The stand is taken to go on beyond the rectangle that its trees stand in as it is within.
    """
    if len(place) < 2:
        return np.zeros(len(place))
    a, b, weight, seen = _near(place, width)
    taller = np.clip(height[a] / height[b], 0.2, 3.0) ** 2
    area = np.pi / 4 * width**2
    total = np.bincount(b, weight * area[a] * taller, len(place))
    total += np.bincount(a, weight * area[b] / taller, len(place))
    return np.asarray(total / seen)


def leaf_area_index(place: np.ndarray, width: np.ndarray, leaves: np.ndarray) -> np.ndarray:
    """(N,) m² of leaves a m² of ground about trees at places (N, 2), by the same kernel."""
    if len(place) < 2:
        return np.zeros(len(place))
    a, b, weight, seen = _near(place, width)
    total = np.bincount(b, weight * leaves[a], len(place))
    total += np.bincount(a, weight * leaves[b], len(place))
    return np.asarray((total + leaves / (2 * np.pi * _spread(width) ** 2)) / seen)


def _spread(width: np.ndarray) -> float:
    return max(KERNEL * float(width.mean()), 0.5)


def _near(
    place: np.ndarray, width: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of trees, their weights in 1/m², and the share of the kernel of each tree that lies within."""
    sd = _spread(width)
    a, b = cKDTree(place).query_pairs(REACH * sd, output_type="ndarray").T
    weight = np.exp(-((place[a] - place[b]) ** 2).sum(axis=1) / (2 * sd**2)) / (2 * np.pi * sd**2)
    low, high = place.min(axis=0), place.max(axis=0)
    seen = np.prod(ndtr((high - place) / sd) - ndtr((low - place) / sd), axis=1)
    return a, b, weight, np.maximum(seen, 0.2)


def canopy_of(dbh: np.ndarray) -> np.ndarray:
    """(N,) bool, whether trees of diameters (N,) are of the canopy; all, where all are young."""
    canopy = dbh >= YOUNG
    return np.asarray(canopy if canopy.any() else ~canopy)


def score(
    place: np.ndarray, height: np.ndarray, width: np.ndarray, canopy: np.ndarray
) -> np.ndarray:
    """(N,) of competition, about standard normal in closed stands.

    Young trees, not of the canopy (N,) bool, suffer from it and take nothing from it.
    """
    found = np.zeros(len(place))
    found[canopy] = cover(place[canopy], height[canopy], width[canopy])
    if not canopy.all():
        found[~canopy] = cover(place, height, width)[~canopy]
    found = np.log(np.maximum(found, 1e-3) / CLOSED) / SPREAD
    return np.asarray(np.clip(found, -MOST, MOST))


def competed(uniform: np.ndarray, found: np.ndarray) -> np.ndarray:
    """(N, 4) uniform numbers of ``MEASURES`` with the scores (N,) in those of crown width and base."""
    mixed = uniform.copy()
    for column, weight in ((1, WIDTH), (2, BASE)):
        noise = weight * found + np.sqrt(1 - weight**2) * ndtri(uniform[:, column])
        mixed[:, column] = np.clip(ndtr(noise), 1e-6, 1 - 1e-6)
    return mixed


def site_part(normals: np.ndarray) -> np.ndarray:
    """(4,) normals that the trees of a stand share, by measure, without the part that is competition's."""
    told = np.array([0.0, WIDTH, BASE, 0.0])
    return np.asarray(normals * np.sqrt(1 - told**2))


def suppressed(dbh: np.ndarray, keys: np.ndarray, share: float) -> np.ndarray:
    """(N,) diameters, m, of trees with keys (N,), of which this share stand under the canopy.

    Numbers of trees by diameter fall there exponentially, by the same factor from class to class (de Liocourt
    1898; Meyer 1952, J. For. 50:85), up to a share of the diameter that the tree had in the canopy.
    """
    most = np.maximum(THICKEST * dbh, THINNEST)
    falls = -np.expm1((THINNEST - most) / FALL)
    thin = THINNEST - FALL * np.log1p(-falls * keyed_uniform(keys, "suppressed"))
    return np.where(keyed_uniform(keys, "understorey") < share, thin, dbh)


def apart(place: np.ndarray, width: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(N,) crown widths, those that are free (N,) bool narrower where neighbours stand too near."""
    if len(place) < 2:
        return width
    pairs = cKDTree(place).query_pairs(float(width.max()) / OVERLAP, output_type="ndarray")
    if not len(pairs):
        return width
    a, b = pairs.T
    gap = np.linalg.norm(place[a] - place[b], axis=1)
    room = OVERLAP * gap / ((width[a] + width[b]) / 2)
    factor = np.ones(len(place))
    for side in (a, b):
        np.minimum.at(factor, side, room)
    return np.where(free, width * np.clip(factor, NARROWEST, 1.0), width)


def filled(place: np.ndarray, width: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(N,) crown widths, those that are free (N,) bool wider where gaps are between neighbours.

    Crowns of closed stands grow towards gaps (Muth and Bazzaz 2003, Can. J. For. Res. 33:1323), so that they
    leave less sky than circles drawn at random. A tree with gaps on all sides, or on none, stays as drawn.
    """
    if len(place) < 2:
        return width
    side = 2 * np.pi * np.arange(SIDES) / SIDES
    way = np.column_stack([np.cos(side), np.sin(side)])
    eye = place[:, None] + BESIDE * width[:, None, None] / 2 * way
    a, b = cKDTree(place).query_pairs(BESIDE * float(width.max()), output_type="ndarray").T
    sky = np.ones((len(place), SIDES), dtype=bool)
    for tree, other in ((a, b), (b, a)):
        away = np.linalg.norm(eye[tree] - place[other][:, None], axis=2)
        np.logical_and.at(sky, tree, away > width[other][:, None] / 2)
    gaps = sky.mean(axis=1)
    return np.where(free, width * (1 + 4 * INTO_GAPS * gaps * (1 - gaps)), width)


def bounded(wanted: np.ndarray, free: np.ndarray, most_leaves: np.ndarray) -> np.ndarray:
    """(N, 5) targets whose free ones (N, 4) keep the bounds of crown length and leaf area.

    The odds of a crown's base, q, become q/√(1 + (q/q₀)²), q₀ those of the shortest crown: low bases hardly
    move, and no two trees meet at the bound.
    most_leaves : (N,) m² that 95 % of the kind stay below.
    """
    bounds = wanted.copy()
    height = wanted[:, 1]
    odds = wanted[:, 3] / np.maximum(height - wanted[:, 3], 1e-9)
    odds = odds / np.hypot(1.0, odds * SHORTEST / (1 - SHORTEST))
    base = height * odds / (1 + odds)
    bounds[:, 3] = np.where(free[:, 2], base, wanted[:, 3])
    crown = DENSEST * np.pi / 4 * wanted[:, 2] ** 2
    least = np.minimum(np.minimum(most_leaves, crown), wanted[:, 4])
    bounds[:, 4] = np.where(free[:, 3], least, wanted[:, 4])
    return bounds


def thinned(
    place: np.ndarray, wanted: np.ndarray, free: np.ndarray, most: np.ndarray
) -> np.ndarray:
    """(N,) leaf areas of targets (N, 5); of free trees (N,) smaller where too many stand together.

    most : (N,) leaf area index that closed stands of their species have.
    """
    index = leaf_area_index(place, wanted[:, 2], wanted[:, 4])
    return np.where(
        free, wanted[:, 4] * np.minimum(1, most / np.maximum(index, 1e-9)), wanted[:, 4]
    )
