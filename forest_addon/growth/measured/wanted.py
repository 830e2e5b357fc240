"""Measures that a tree is to have: taken from targets and drawn by the allometry of its kind, or refused."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from ...base.rng import keyed_uniform
from ...spec import Allometry, Normal, SpecError, Targets
from ..draw import draw_normal
from ..mesh.blades import Blade
from .allometry import MEASURES, band, draw, measures
from .allometry import middle as measured_middle

TARGETS = ("dbh", *MEASURES)
WIDEST = 2.0  # crowns over heights; the measured ones have up to 1.8
SLENDER = (8.0, 400.0)  # height over diameter that was ever measured
USUAL_DBH = Normal(mean=0.25, sd=0.06)  # metres, where nobody says one
MOST_TIMES = 5.0  # over the largest leaf area that 95 % of the kind have


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


def draw_dbh(targets: Targets | None, keys: np.ndarray) -> np.ndarray:
    """(N,) diameters of trees with keys (N,), metres."""
    spread = targets.dbh if targets is not None and targets.dbh is not None else USUAL_DBH
    return draw_normal(spread, keys, "dbh")


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
    row = drawn(kind, draw_dbh(targets, key), given_by(targets)[None], uniform, where)[0]
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
    dbh = draw_dbh(targets, np.zeros(1, np.uint64))
    if targets.dbh is not None:
        dbh = np.array([targets.dbh.mean])
    middle = np.full((1, len(MEASURES)), 0.5)
    given = given_by(targets)[None]
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
