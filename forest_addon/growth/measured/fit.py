"""A table of measured trees to the allometry of a kind.

Columns of species, type, DBH, height, crown width, crown base and leaf area go in. Laws are ordinary least
squares on logarithms, the curve only where enough trees tell it, moved to the median of the residuals; their
5 and 95 % points and their correlations are those of the trees themselves. What too few trees of a species
tell is taken from its genus, its functional type, or all trees, and the law says so. Leaf areas above
1 m² a cm² of stem are left out: at 40 m²/ha of stems they would make a leaf area index above 40. Those of
conifers are half of their needles' surface (``studies``). How much of
the spread is found within one study, as in a stand, is told where five studies measured eight trees or more.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...spec import Allometry, Law, SpecError
from ...spec.allometry import DBH
from .allometry import MEASURES, PAIRS, middle

ENOUGH = 30  # trees that a law, or a correlation, is fitted to
ENOUGH_CURVE = 100
STUDIES, OF_STUDY = 5, 8  # studies, and trees of each, that tell how trees of one differ
MOST_LEAVES = 1e4  # m² a m² of the stem's cross section
WIDE = (
    0.5  # of the range of log D that its heights were measured over, for a law to hold for a kind
)
TYPES = {
    "deciduous broadleaf": "DA",
    "evergreen broadleaf": "EA",
    "deciduous conifer": "DG",
    "evergreen conifer": "EG",
}
# Kind: functional type that stands in where too few trees were measured.
KINDS = {
    "Abies": "EG",
    "Acer": "DA",
    "Betula": "DA",
    "Corylus": "DA",
    "Eucalyptus": "EA",
    "Fagus": "DA",
    "Larix": "DG",
    "Malus": "DA",
    "Picea abies": "EG",
    "Pinus sylvestris": "EG",
    "Populus": "DA",
    "Pseudotsuga menziesii": "EG",
    "Quercus": "DA",
    **TYPES,
}


def fit_kind(name: str, table: Mapping[str, np.ndarray], source: str) -> Allometry:
    """Fit a species, genus or functional type.

    table : columns (N,) ``species``, ``pft``, ``dbh`` and ``MEASURES``, SI units, NaN where not measured.

    Raises
    ------
    SpecError : no tree of the kind was measured, and no type is known for it.
    """
    groups = groups_of(name, table)
    laws: dict[str, Law] = {}
    for measure in MEASURES:
        for group, rows in groups.items():
            law = _law(table, measure, rows)
            if law is not None:
                own = "" if group == name else group
                laws[measure] = law.changed(of=own, within=_within(table, measure, groups, rows))
                break
        else:
            raise SpecError(
                name, f"{measure} of fewer than {ENOUGH} trees was measured; use another table"
            )
    correlation = [
        next(
            (
                round(value, 3)
                for rows in groups.values()
                if (value := _correlation(table, MEASURES[a], MEASURES[b], rows)) is not None
            ),
            0.0,
        )
        for a, b in PAIRS
    ]
    return Allometry(name=name, source=source, correlation=tuple(correlation), **laws)


def groups_of(name: str, table: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Trees (N,) bool of the kind, and of what may stand in for it, the nearest first.

    Raises
    ------
    SpecError : the kind is not known and not in the table.
    """
    species, kinds = table["species"], table["pft"]
    words = name.split()
    groups: dict[str, np.ndarray] = {}
    if name not in TYPES:
        start = np.char.startswith
        groups = {" ".join(words[:k]): start(species, " ".join(words[:k])) for k in (len(words), 1)}
        own = groups[words[0]]
        if not own.any() and name not in KINDS:
            raise SpecError(name, "is not in the table; check its name")
        letters, counts = np.unique(kinds[own], return_counts=True)
        kind = KINDS.get(name) or KINDS.get(words[0]) or str(letters[np.argmax(counts)])
    else:
        kind = TYPES[name]
    called = {code: words for words, code in TYPES.items()}
    if kind in called:
        groups[called[kind]] = kinds == kind
        groups["broadleaf" if kind[1] == "A" else "conifer"] = np.char.endswith(kinds, kind[1])
    groups["all trees"] = np.ones(len(species), dtype=bool)
    return groups


def residuals(table: Mapping[str, np.ndarray], measure: str, law: Law) -> np.ndarray:
    """(N,) residuals of log y, NaN where it was not measured."""
    return np.asarray(_log(table, measure) - middle(law, table["dbh"]))


def _log(table: Mapping[str, np.ndarray], measure: str) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        value = table[measure]
        if measure == "crown_base":
            value = value / (table["height"] - value)
        if measure == "leaf_area":
            stem = np.pi / 4 * table["dbh"] ** 2
            value = np.where(value <= MOST_LEAVES * stem, value, np.nan)
        found = np.log(value)
    return np.where(np.isfinite(found), found, np.nan)


def _law(table: Mapping[str, np.ndarray], measure: str, rows: np.ndarray) -> Law | None:
    y = _log(table, measure)
    used = rows & np.isfinite(y) & (table["dbh"] > 0)
    if used.sum() < ENOUGH:
        return None
    x, y = np.log(table["dbh"][used] / DBH), y[used]
    if np.ptp(x) < WIDE * np.ptp(np.log(table["dbh"][rows & (table["dbh"] > 0)])):
        return None
    degree = 2 if len(x) >= ENOUGH_CURVE else 1
    terms = np.zeros(3)
    terms[: degree + 1] = np.polynomial.polynomial.polyfit(x, y, degree)
    ends = terms[1] + 2 * terms[2] * np.array([x.min(), x.max()])
    if degree == 2 and measure != "crown_base" and (ends <= 0).any():  # no tree shrinks as it grows
        terms[:2], terms[2] = np.polynomial.polynomial.polyfit(x, y, 1), 0.0
    left = y - np.polynomial.polynomial.polyval(x, terms)
    low, half, high = np.quantile(left, [0.05, 0.5, 0.95])
    terms[0] += half
    return Law(
        intercept=round(float(terms[0]), 4),
        slope=round(float(terms[1]), 4),
        curve=round(float(terms[2]), 4),
        low=round(float(low - half), 4),
        high=round(float(high - half), 4),
        dbh=(float(table["dbh"][used].min()), float(table["dbh"][used].max())),
        trees=int(used.sum()),
    )


def _within(
    table: Mapping[str, np.ndarray],
    measure: str,
    groups: Mapping[str, np.ndarray],
    own: np.ndarray,
) -> float:
    """Standard deviation of residuals within studies over that of all, of the first group that can tell."""
    if "study" not in table:
        return 1.0
    for rows in groups.values():
        law = _law(table, measure, rows) if (rows | ~own).all() else None
        if law is None:
            continue
        left = residuals(table, measure, law)
        used = rows & np.isfinite(left)
        _, study, trees = np.unique(table["study"][used], return_inverse=True, return_counts=True)
        value = left[used]
        many = (trees >= OF_STUDY)[study]
        if (trees >= OF_STUDY).sum() < STUDIES:
            continue
        apart = value - (np.bincount(study, value) / trees)[study]
        free = many.sum() - (trees >= OF_STUDY).sum()
        share = np.sqrt((apart[many] ** 2).sum() / free) / value.std()
        return round(float(np.clip(share, 0.2, 1.0)), 3)
    return 1.0


def _correlation(table: Mapping[str, np.ndarray], a: str, b: str, rows: np.ndarray) -> float | None:
    left = []
    for measure in (a, b):
        law = _law(table, measure, rows)
        if law is None:
            return None
        left.append(residuals(table, measure, law))
    both = rows & np.isfinite(left[0]) & np.isfinite(left[1])
    if both.sum() < ENOUGH:
        return None
    return float(np.corrcoef(left[0][both], left[1][both])[0, 1])
