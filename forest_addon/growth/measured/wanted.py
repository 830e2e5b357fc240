"""Measures that a tree is to have, taken from targets and drawn by the allometry of its kind, or refused; and
the measures of a grown tree, as a forester takes them, by the definitions of the tables of measured ones.

Diameter: of the stem 1.3 m above the ground. Height: of the highest point. Base of the crown: where the
lowest branch that bears leaves leaves the stem. Width: the mean diameter of the crown seen from above,
over all directions, from the outermost leaf to the outermost leaf: the mean caliper of a convex hull is
its perimeter over π (Cauchy).
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ...base.rng import keyed_uniform
from ...spec import Allometry, Normal, SpecError, Species, Targets
from ..draw import draw_normal
from ..mesh.blades import Blade
from ..mesh.leaves import Leaves
from ..skeleton import LeafSites, Skeleton, first_level
from .allometry import MEASURES, band, draw, draw_diameters, measures
from .allometry import middle as measured_middle

TARGETS = ("dbh", *MEASURES)
WIDEST = 2.0  # crowns over heights; the measured ones have up to 1.8
SLENDER = (8.0, 400.0)  # height over diameter that was ever measured
USUAL_DBH = Normal(mean=0.25, sd=0.06)  # metres, where nobody says one
MOST_TIMES = 5.0  # over the largest leaf area that 95 % of the kind have
BREAST = 1.3  # metres
MANY = 2000  # points, of which an inner hull is made first


@dataclass(frozen=True)
class Kind:
    """Files of a species that is grown to measure: its allometry, and its own leaf or None."""

    allometry: Allometry | None
    blade: Blade | None = None


@dataclass(frozen=True)
class Wanted:
    """Targets of one tree, metres and m²."""

    dbh: float
    height: float
    crown_width: float
    crown_base: float
    leaf_area: float

    def row(self) -> np.ndarray:
        """(5,) in the order of ``TARGETS``."""
        return np.array(astuple(self))


def given_by(targets: Targets | None) -> np.ndarray:
    """(4,) the measures that targets say, NaN where they say none."""
    said = np.array([getattr(targets, name, 0.0) for name in MEASURES], dtype=float)
    return np.where(said > 0, said, np.nan)


def drawn(
    kind: Allometry | None,
    dbh: np.ndarray,
    given: np.ndarray,
    uniform: np.ndarray,
    where: str,
    stand: np.ndarray | None = None,
) -> np.ndarray:
    """(N, 5) targets of trees in the order of ``TARGETS``: what is given (N, 4), the rest drawn.

    stand : (4,) what its trees share, as ``draw`` takes it.

    Raises
    ------
    SpecError : something is not given and there is no allometry; targets that contradict each other.
    """
    if kind is None:
        missing = np.isnan(given).any(axis=0)
        if missing.any():
            name = MEASURES[int(np.argmax(missing))]
            raise SpecError(
                where,
                f"{name} is not given and no allometry tells it; name one of assets/allometry",
            )
        found = given
    else:
        found = draw(kind, dbh, given, uniform, stand)
    for row, told in zip(np.column_stack([dbh, found]), np.isfinite(given), strict=True):
        refuse_contradictions(Wanted(*row), kind, where, told=bool(told.any()))
    return np.column_stack([dbh, found])


def draw_dbh(
    targets: Targets | None,
    keys: np.ndarray,
    kind: Allometry | None = None,
    given: np.ndarray | None = None,
) -> np.ndarray:
    """(N,) diameters of trees with keys (N,), metres: as the targets say, else as trees of the kind have them
    that measure what is given (N, 4).
    """
    if targets is not None and targets.dbh is not None:
        return draw_normal(targets.dbh, keys, "dbh")
    dbh = draw_normal(USUAL_DBH, keys, "dbh")
    if kind is not None and given is not None:
        told = np.isfinite(given).any(axis=1)
        dbh[told] = draw_diameters(kind, given[told], keyed_uniform(keys[told], "dbh"))
    return dbh


def one_tree(
    targets: Targets, kind: Allometry | None, where: str, rng: np.random.Generator
) -> Wanted:
    """The targets of a tree that stands for its species.

    Raises
    ------
    SpecError : they contradict each other.
    """
    key = rng.integers(2**63, size=1).astype(np.uint64)
    uniform = np.stack([keyed_uniform(key, name) for name in MEASURES], axis=1)
    given = given_by(targets)[None]
    row = drawn(kind, draw_dbh(targets, key, kind, given), given, uniform, where)[0]
    return Wanted(*row.tolist())


def typical_tree(
    targets: Targets,
    kind: Allometry | None,
    where: str,
    score: tuple[float, float] | None = None,
) -> Wanted:
    """Targets of a species' middle tree: of the mean diameter, and in all else the median given that.

    score : normal scores of its crown's width and base, None: the medians.

    Raises
    ------
    SpecError : they contradict each other.
    """
    middle, given = np.full((1, len(MEASURES)), 0.5), given_by(targets)[None]
    dbh = draw_dbh(targets, np.zeros(1, np.uint64))
    if targets.dbh is not None:
        dbh = np.array([targets.dbh.mean])
    elif kind is not None and np.isfinite(given).any():
        dbh = draw_diameters(kind, given, middle[0, :1])
    if score is not None and kind is not None:
        height = given[:, :1] / np.exp(measured_middle(kind.height, dbh))
        found = measures(kind, dbh, np.array([[0.0, score[0], score[1], 0.0]]))
        found[:, 2] *= np.where(np.isfinite(height[:, 0]), height[:, 0], 1.0)
        free = np.isnan(given) & np.array([[False, True, True, False]])
        given = np.where(free, found, given)
    return Wanted(*drawn(kind, dbh, given, middle, where)[0].tolist())


def refuse_contradictions(
    wanted: Wanted, kind: Allometry | None, where: str, told: bool = True
) -> None:
    """Say which targets no tree can have together, and by how much.

    Raises
    ------
    SpecError : they contradict each other.
    """
    w = wanted
    if w.height <= 1.3:
        raise SpecError(
            where,
            f"a height of {w.height:.3g} m does not reach 1.3 m, where dbh is measured; give more",
        )
    if w.crown_base >= w.height:
        raise SpecError(
            where,
            f"crown_base {w.crown_base:.3g} m lies {w.crown_base - w.height:.2g} m above the height "
            f"{w.height:.3g} m; give a lower one",
        )
    if w.crown_width > WIDEST * w.height:
        raise SpecError(
            where,
            f"crown_width {w.crown_width:.3g} m is {w.crown_width / w.height:.2g} times the height "
            f"{w.height:.3g} m; no tree has more than {WIDEST:g} times",
        )
    slender = w.height / w.dbh
    if told and not SLENDER[0] <= slender <= SLENDER[1]:
        raise SpecError(
            where,
            f"height {w.height:.3g} m is {slender:.3g} times the dbh {w.dbh:.3g} m; trees have "
            f"{SLENDER[0]:g} to {SLENDER[1]:g} times",
        )
    if kind is not None:
        most = MOST_TIMES * float(band(kind, np.array([w.dbh]))[1, 0, 3])
        if w.leaf_area > most:
            raise SpecError(
                where,
                f"leaf_area {w.leaf_area:.4g} m² is {w.leaf_area / most * MOST_TIMES:.3g} times what 95 % "
                f"of {kind.name} with a dbh of {w.dbh:.3g} m have; give at most {most:.3g} m²",
            )


def fitted_template(species: Species, wanted: Wanted) -> Species:
    """The species with settings that make its trees as tall and as thick as wanted."""
    if species.siblings is not None:
        sized = species.siblings.changed(age=1.0, height=wanted.height, dbh=wanted.dbh)
        return species.changed(siblings=sized)
    return species


def dbh_of(skeleton: Skeleton) -> float:
    """Diameter of the stem at breast height, metres; 0 of a tree that does not reach it."""
    stem = np.flatnonzero(skeleton.order == 0)
    low, high = skeleton.start[stem, 2], skeleton.end[stem, 2]
    across = np.flatnonzero((low <= BREAST) & (high >= BREAST) & (high > low))
    if not len(across):
        return 0.0
    share = (BREAST - low[across]) / (high[across] - low[across])
    r = skeleton.radius[stem[across]]
    return 2 * float((r[:, 0] + share * (r[:, 1] - r[:, 0])).max())


def stem_profile(skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Heights (P,) ascending and diameters (P,) of the stem, metres."""
    stem = np.flatnonzero(skeleton.order == 0)
    z = np.concatenate([skeleton.start[stem, 2], skeleton.end[stem, 2]])
    d = 2 * np.concatenate([skeleton.radius[stem, 0], skeleton.radius[stem, 1]])
    up = np.lexsort((-d, z))
    return z[up], d[up]


def crown_base_of(skeleton: Skeleton, segment: np.ndarray) -> float:
    """Height of the lowest first-level branch that bears leaves, on segments (L,), metres."""
    bears = np.zeros(len(skeleton) + 1, dtype=bool)  # the last for leaves that nothing bears
    bears[segment] = True
    bears = bears[:-1]
    return lowest_branch(skeleton, first_level(skeleton)[bears]) if bears.any() else 0.0


def lowest_branch(skeleton: Skeleton, branch: np.ndarray) -> float:
    """Height of the lowest of first-level branches (L,), metres; without any, of the stem's lowest node."""
    level = first_level(skeleton)
    leafy = np.unique(branch[branch >= 0])
    if not len(leafy):
        return 0.0
    parent = np.maximum(skeleton.parent, 0)
    foot = np.flatnonzero((level >= 0) & ((level != level[parent]) | (skeleton.parent < 0)))
    foot = foot[np.isin(level[foot], leafy)]
    return float(skeleton.start[foot, 2].min())


def crown_of(skeleton: Skeleton, leaves: Leaves, grafted: bool) -> tuple[float, float]:
    """Mean diameter of a crown seen from above, of its leaves or else of the wood, and height of its base,
    metres.

    The base is where the lowest branch with leaves leaves the stem; of a grafted tree its lowest leaf.
    """
    if not len(leaves):
        return width_of(skeleton.end), 0.0
    reach = 0.5 * leaves.length[:, None] * leaves.axis
    width = width_of(np.concatenate([leaves.centre - reach, leaves.centre + reach]))
    if grafted:
        return width, float(leaves.centre[:, 2].min())
    return width, lowest_branch(skeleton, leaves.branch)


def width_of(points: np.ndarray) -> float:
    """Mean diameter of points (N, 2 or 3) seen from above, over all directions, metres."""
    if len(points) < 3:
        return 0.0
    flat = points[:, :2]
    try:
        if len(flat) > MANY:  # what lies within the hull of some cannot be on that of all
            some = ConvexHull(flat[:: len(flat) // MANY])
            middle = some.points[some.vertices].mean(axis=0)
            inner = -float((some.equations[:, :2] @ middle + some.equations[:, 2]).max())
            x, y = flat[:, 0] - middle[0], flat[:, 1] - middle[1]
            flat = flat[x * x + y * y >= (0.999 * inner) ** 2]
        return float(ConvexHull(flat).area) / np.pi  # in the plane "area" is the perimeter
    except QhullError:  # all in a line
        return 2 * float(np.linalg.norm(np.ptp(flat, axis=0))) / np.pi


def leaf_tips(sites: LeafSites) -> np.ndarray:
    """(L, 3) where leaves end."""
    return np.asarray(sites.foot + sites.length[:, None] * sites.direction)
