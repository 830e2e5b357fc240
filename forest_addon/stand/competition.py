"""Competition of crowns: neighbours take light from below, and room at the sides.

The crowns that stand about a tree, weighted by a normal kernel of twice its own crown's width and by the
square of their height over its own (light comes from above), cover a share of the ground, κ. The score
(log κ - log κ₀)/s, κ₀ = 1.5, is a part of what crown bases and widths of the tree differ by from the law
of its kind: above 0 the base is higher and the crown narrower than of most measured trees, below 0 lower and
wider. Stands differ in these also by what competition does not tell. Crowns of neighbours grow into gaps
between them, and overlap by what the widths of trees in stands make: nothing else narrows them. No living
crown is but a tuft on a pole, none has more leaves than nineteen of twenty measured ones, and no stand a
larger leaf area index than closed ones have. A crown stands aside of its stem, towards the light
(``aside``): its variant is grown so, and the tree is turned to where the light is.
"""

from __future__ import annotations

import numpy as np
import scipy

Pairs = tuple[np.ndarray, np.ndarray]
KERNEL = 1.0  # standard deviation of the kernel over the mean width of crowns
REACH = 2.5  # of those, beyond which neighbours do not count
CLOSED, SPREAD = 1.5, 0.7  # κ₀ and s
MOST = 2.0  # of the score, either way
BASE, WIDTH = 0.65, -0.55  # correlation of the score with residuals of crown base and width
ALONE = (-MOST * WIDTH, -MOST * BASE)  # scores of crown width and base of a tree without neighbours
YOUNG = 0.07  # metres of diameter, below which a tree stands under the canopy
INTO_GAPS = 0.17  # of its width, that a crown with gaps on half its sides is wider than drawn
BESIDE, SIDES = 1.1, 24  # of its radius, where a crown's sides are looked at, and how many of them
WAYS = np.stack([f(2 * np.pi * np.arange(SIDES) / SIDES) for f in (np.cos, np.sin)], axis=1)
AROUND = (0.5, 0.8, 1.05, 1.3, 1.5)  # of its radius, where it looks for light
CLAIMS = 1.2  # of its radius, as far as a neighbour holds light back
SHADES = 0.6  # of a tree's height, that neighbours have which hold light back
FARTHEST = 0.6  # of its radius, that a crown's middle stands aside of its stem
SHORTEST = 0.2  # length over the height of its tree that living crowns come near to, and none has
DENSEST = 15.0  # m² of leaves over the m² that a crown covers
MOST_INDEX = (
    8.0  # m² of leaves a m² of ground, which closed stands do not pass, unless their species says
)


def cover(place: np.ndarray, height: np.ndarray, width: np.ndarray) -> np.ndarray:
    """(N,) κ of trees at places (N, 2) with heights and crown widths (N,), metres.

    The stand is taken to go on beyond the rectangle that its trees stand in as it is within.
    """
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
    a, b = scipy.spatial.cKDTree(place).query_pairs(REACH * sd, output_type="ndarray").T
    weight = np.exp(-((place[a] - place[b]) ** 2).sum(axis=1) / (2 * sd**2)) / (2 * np.pi * sd**2)
    low, high = place.min(axis=0), place.max(axis=0)
    seen = np.prod(
        scipy.special.ndtr((high - place) / sd) - scipy.special.ndtr((low - place) / sd), axis=1
    )
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
    logarithm = np.zeros(len(place))
    logarithm[canopy] = cover(place[canopy], height[canopy], width[canopy])
    if not canopy.all():
        logarithm[~canopy] = cover(place, height, width)[~canopy]
    logarithm = np.log(np.maximum(logarithm, 1e-3) / CLOSED) / SPREAD
    return np.asarray(np.clip(logarithm, -MOST, MOST))


def competed(uniform: np.ndarray, found: np.ndarray) -> np.ndarray:
    """(N, 4) uniform numbers of ``MEASURES`` with the scores (N,) in those of crown width and base."""
    mixed = uniform.copy()
    for column, weight in ((1, WIDTH), (2, BASE)):
        noise = weight * found + np.sqrt(1 - weight**2) * scipy.special.ndtri(uniform[:, column])
        mixed[:, column] = np.clip(scipy.special.ndtr(noise), 1e-6, 1 - 1e-6)
    return mixed


def claimants(place: np.ndarray, height: np.ndarray, width: np.ndarray, share: float) -> Pairs:
    """(M,) trees, and (M,) neighbours of each that may hold light back from within so many of its radii."""
    reach = (share + CLAIMS) * float(width.max()) / 2
    a, b = scipy.spatial.cKDTree(place).query_pairs(reach, output_type="ndarray").T
    tree, other = np.concatenate([a, b]), np.concatenate([b, a])
    apart_by = np.linalg.norm(place[tree] - place[other], axis=1)
    near = apart_by < (share * width[tree] + CLAIMS * width[other]) / 2
    near &= height[other] >= SHADES * height[tree]
    return tree[near], other[near]


def unclaimed(
    eye: np.ndarray, place: np.ndarray, width: np.ndarray, pairs: Pairs, share: float
) -> np.ndarray:
    """(N, SIDES) whether points (N, SIDES, 2), so many radii from the middles (N, 2) of crowns, are nearer in
    radii to none of the neighbours, ``claimants``."""
    tree, other = pairs
    free = np.ones(eye.shape[:2], dtype=bool)
    away = np.linalg.norm(eye[tree] - place[other][:, None], axis=2)
    np.logical_and.at(free, tree, away >= min(share, CLAIMS) * width[other][:, None] / 2)
    return free


def aside(
    place: np.ndarray, height: np.ndarray, width: np.ndarray, canopy: np.ndarray
) -> np.ndarray:
    """(N, 2) how far crowns of trees at places (N, 2) stand aside of their stems, in their radii.

    Crowns are displaced away from large and near neighbours, towards light (Muth and Bazzaz 2003, Can. J.
    For. Res. 33:1323): here to the mean place of what neighbours of the canopy (N,) bool leave of the area
    about a tree. Where that ends with the rectangle of the canopy, the opposite side does not count either.
    """
    low, high = place[canopy].min(axis=0), place[canopy].max(axis=0)
    tree, other = claimants(place, height, width, AROUND[-1])
    pairs = tree[canopy[other]], other[canopy[other]]
    shift = np.zeros((len(place), 2))
    for share in AROUND:
        eye = place[:, None] + share * width[:, None, None] / 2 * WAYS
        seen = ((eye >= low) & (eye <= high)).all(axis=2)
        seen &= np.roll(seen, SIDES // 2, axis=1)
        shift += share**2 * (unclaimed(eye, place, width, pairs, share) & seen) @ WAYS
    shift /= SIDES * sum(AROUND)
    size = np.linalg.norm(shift, axis=1, keepdims=True)
    shift *= np.minimum(1.0, FARTHEST / np.maximum(size, 1e-9))
    return np.where(size > 1e-6, shift, 0.0)


def filled(
    place: np.ndarray, height: np.ndarray, width: np.ndarray, free: np.ndarray
) -> np.ndarray:
    """(N,) crown widths, those that are free (N,) bool wider where gaps are between neighbours.

    Crowns of closed stands grow towards gaps, so that they leave less sky than circles drawn at random. A
    tree with gaps on all sides, or on none, stays as drawn.
    """
    eye = place[:, None] + BESIDE * width[:, None, None] / 2 * WAYS
    pairs = claimants(place, height, width, BESIDE)
    gaps = unclaimed(eye, place, width, pairs, BESIDE).mean(axis=1)
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
