"""Height, crown and leaf area of trees from the diameters of their stems, each with residuals of its own.

log y = a + b·x + c·x², x = log(D/0.2 m), plus a residual that is normal on either side of 0 with its own
spread, so that it goes through the 5, 50 and 95 % points of the measured ones; a law goes on straight
beyond the diameters that were measured. Of the crown base y is base/(height - base), so that a crown always
has a length. Residuals of a tree are correlated as measured (a Gaussian copula), cut at 1.9 standard
deviations; what is known of a tree counts for what is drawn of it (conditional normal). Where the diameter
is what is not known, it is drawn given the rest: by Bayes, beforehand every log D as likely as any other, and
rarer beyond the largest that was measured.

Leaf areas of measured conifers are half of all their surface, whichever way a study counted them. The mean
shadow of a needle over all directions is a quarter of its surface (Cauchy 1841), so that half of the surface
(Chen & Black 1992) is the one-sided area of a flat leaf that hides as much. BAAD (Falster et al. 2015) keeps
what each study gave: all of the surface, or the outline that a scanner saw. Half of the surface is 1/0.778
outlines of a pine's needle and 1.14 of other conifers' (Barclay & Goodman 2000, as BAAD's authors convert
theirs, github.com/RemkoDuursma/baadanalysis).

Which study counted how is told by BAAD's metadata, but for these. Monserud1999: the table holds all of the
surface by mistake (BAAD's issue 226). Maguire1998: from the same hand and marked as outlines, but 10.4 m²/kg,
where outlines of spruce needles are 3.5 to 6 (Hager & Sterba 1985: 5.0 ± 1.7); taken as all of the surface.
Reid2004: marked as all of the surface, but scanned, and 2.8 m²/kg where all of the same species' surface is
6.1 (Garber2005); taken as outlines. OHara1995: all of the surface by its author's own word in BAAD's review;
its diameters are inches, in which sapwood fits into the stems and in centimetres does not.

A kind is fitted to a table of measured trees. Columns of species, type, DBH, height, crown width, crown base
and leaf area go in. Laws are ordinary least squares on logarithms, the curve only where enough trees tell it,
moved to the median of the residuals; their 5 and 95 % points and their correlations are those of the trees
themselves. What too few trees of a species tell is taken from its genus, its functional type, or all trees,
and the law says so. Leaf areas above 1 m² a cm² of stem are left out: at 40 m²/ha of stems they would make a
leaf area index above 40. Those of conifers are half of their needles' surface. How much of the spread is
found within one study, as in a stand, is told where five studies measured eight trees or more.

What a tree is to measure is taken from targets, drawn by the allometry of its kind, or refused. A grown tree
is measured as a forester does it, by the definitions of those tables. Diameter: of the stem 1.3 m above the
ground. Height: of the highest point. Base of the crown: where the lowest branch that bears leaves leaves the
stem. Width: the mean diameter of the crown seen from above, over all directions, from the outermost leaf to
the outermost leaf: the mean caliper of a convex hull is its perimeter over π (Cauchy).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from ...base.rng import keyed_uniform
from ...spec import Allometry, Law, Normal, SpecError, Targets
from ...spec.species import DBH
from ..draw import draw_normal
from ..mesh.blades import Blade
from ..mesh.leaves import Leaves
from ..skeleton import LeafSites, Skeleton, branch_feet, first_level, stem_radii

MEASURES = ("height", "crown_width", "crown_base", "leaf_area")  # columns, in this order
Z90 = 1.6448536269514722  # 90 % of a normal lie within ± this
LIMIT = 1.9  # standard deviations at which residuals are cut
DIAMETERS = np.log(np.geomspace(0.005, 4.0, 401))  # log m, among which a tree's is looked for
HEIGHTS = np.linspace(-LIMIT, LIMIT, 25)  # normal scores, likewise
RARER = 4.0  # power of D with which trees thicker than those measured are rarer
FAR = 1e3  # how unlikely residuals beyond the limit are, in squares of standard deviations
AT_ONCE = 500  # trees
PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
HALF_OVER_OUTLINE = {"Pinus": 1 / 0.778, "": 1.14}
WAYS = ("half", "all", "outline")
# How a study counted, and for genera of which otherwise.
COUNTED: dict[str, str | dict[str, str]] = {
    "Aspinwall2013": "outline",
    "Burger1953": "all",
    "Garber2005": {"Abies": "outline", "Pinus": "all"},
    "Hagihara1993": "outline",
    "Iijima1991": "outline",
    "Maguire1998": "all",
    "Monserud1999": "all",
    "Mori1991": "outline",
    "Nakagaki1983": "outline",
    "Nishioka1982": "outline",
    "OHara1995": "all",
    "OHara2014": "outline",
    "Reid2004": "outline",
    "Roberts2003": "outline",
    "Satoo1974a": "outline",
    "Satoo1974d": "outline",
    "Tanao1982": "outline",
    "Vanninen2005": "all",
    "Yamaji1991": "outline",
    "Yoda1978": "outline",
}
DIAMETER_UNITS = {"OHara1995": 2.54}  # of centimetres, what a study calls one
ENOUGH = 30  # trees that a law, or a correlation, is fitted to
ENOUGH_CURVE = 100
STUDIES, OF_STUDY = 5, 8  # studies, and trees of each, that tell how trees of one differ
MOST_LEAVES = 1e4  # m² a m² of the stem's cross section
WIDE = 0.5  # of the range of log D of its heights, for a law to hold for a kind
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


def middle(law: Law, dbh: np.ndarray) -> np.ndarray:
    """(N,) log y that half the trees of these diameters (N,), metres, lie below."""
    x = np.log(np.asarray(dbh, dtype=float) / DBH)
    inside = np.clip(x, *np.log(np.array(law.dbh) / DBH))
    slope = law.slope + 2 * law.curve * inside
    return np.asarray(
        law.intercept + law.slope * inside + law.curve * inside**2 + slope * (x - inside)
    )


def band(kind: Allometry, dbh: np.ndarray) -> np.ndarray:
    """(2, N, 4) what 5 % of measured trees of these diameters (N,) lie below, and above, in ``MEASURES``.

    The crown's base is that of a tree of the law's own height.
    """
    z = np.full((len(dbh), 4), Z90)
    high = measures(kind, dbh, z * [0, 1, 1, 1])
    low = measures(kind, dbh, -z * [0, 1, 1, 1])
    high[:, 0], low[:, 0] = measures(kind, dbh, z)[:, 0], measures(kind, dbh, -z)[:, 0]
    return np.stack([low, high])


def measures(kind: Allometry, dbh: np.ndarray, z: np.ndarray) -> np.ndarray:
    """(N, 4) the measures of trees of these diameters (N,) with normal scores (N, 4)."""
    measured = np.empty(z.shape)
    for column, name in enumerate(MEASURES):
        law: Law = getattr(kind, name)
        score = z[:, column]
        measured[:, column] = np.exp(
            middle(law, dbh) + np.where(score < 0, -law.low, law.high) * score / Z90
        )
    measured[:, 2] *= measured[:, 0] / (1 + measured[:, 2])
    return measured


def scores(kind: Allometry, dbh: np.ndarray, given: np.ndarray) -> np.ndarray:
    """(N, 4) normal scores of what is given (N, 4) of trees of these diameters; NaN stays NaN.

    The crown's base needs a height; where that is not given either, the law's counts.
    """
    height = np.where(np.isfinite(given[:, 0]), given[:, 0], np.exp(middle(kind.height, dbh)))
    normal_scores = np.full(given.shape, np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        for column, name in enumerate(MEASURES):
            law: Law = getattr(kind, name)
            value = given[:, column]
            if name == "crown_base":
                value = value / (height - value)
            residual = np.log(value) - middle(law, dbh)
            normal_scores[:, column] = Z90 * np.where(
                residual < 0, -residual / law.low, residual / law.high
            )
    return normal_scores


def draw_diameters(kind: Allometry, given: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    """(N,) diameters of trees given what else is known of them (N, 4), NaN what is not, by (N,) numbers
    between 0 and 1.
    """
    found = np.empty(len(given))
    before = np.exp(RARER * np.minimum(np.log(kind.height.dbh[1]) - DIAMETERS, 0))
    for rows in _alike(np.isfinite(given)):
        dbh = np.tile(np.exp(DIAMETERS), (len(rows), 1))
        density = _density(kind, dbh, given[rows]).sum(axis=0) * before
        found[rows] = np.exp(_drawn(DIAMETERS, density, uniform[rows]))
    return found


def _density(kind: Allometry, dbh: np.ndarray, given: np.ndarray) -> np.ndarray:
    """(H, N, G) how likely what is known of trees (N, 4), of each the same, is at diameters (N, G), but for a
    factor of each tree. H is 1, or the number of ``HEIGHTS`` where a crown's base is known and no height.
    """
    told = np.isfinite(given[0])
    alone = bool(told[2] and not told[0])
    told[0] |= alone
    precision = np.linalg.inv(correlation_matrix(kind)[np.ix_(told, told)])
    sides = np.array([(-getattr(kind, n).low, getattr(kind, n).high) for n in MEASURES])
    if alone:  # a step of its score, not of its height
        sides[0] = 1.0
    each, rows = dbh.ravel(), np.repeat(given, dbh.shape[1], axis=0)
    densities = []
    for height in HEIGHTS if alone else (0.0,):
        if alone:
            rows[:, 0] = measures(kind, each, np.tile([height, 0, 0, 0], (len(each), 1)))[:, 0]
        z = scores(kind, each, rows)[:, told]
        log = -0.5 * np.einsum("ni,ij,nj->n", z, precision, z)
        log -= FAR * (np.maximum(np.abs(z) - LIMIT, 0) ** 2).sum(axis=1)
        log -= np.log(np.where(z < 0, *sides[told].T)).sum(axis=1)
        if told[2]:  # a step of the base, not of its odds
            log -= np.log1p(-np.minimum(rows[:, 2] / rows[:, 0], 1 - 1e-9))
        densities.append(np.nan_to_num(log, nan=-1e9).reshape(dbh.shape))
    density = np.stack(densities)
    return np.asarray(np.exp(density - density.max(axis=(0, 2), keepdims=True)))


def _drawn(at: np.ndarray, density: np.ndarray, uniform: np.ndarray) -> np.ndarray:
    """(N,) numbers with densities (N, G) at (G,), by inversion."""
    below = scipy.integrate.cumulative_trapezoid(density, axis=1, initial=0)
    rows = zip(uniform * below[:, -1], below, strict=True)
    return np.array([np.interp(share, each, at) for share, each in rows])


def _alike(known: np.ndarray) -> Iterator[np.ndarray]:
    """Rows of trees of which the same is known (N, 4), some at a time."""
    for pattern in np.unique(known, axis=0):
        rows = np.flatnonzero((known == pattern).all(axis=1))
        yield from (rows[k : k + AT_ONCE] for k in range(0, len(rows), AT_ONCE))


def draw(
    kind: Allometry,
    dbh: np.ndarray,
    given: np.ndarray,
    uniform: np.ndarray,
    stand: np.ndarray | None = None,
) -> np.ndarray:
    """(N, 4) the measures of trees: those given (N, 4) as they are, the others, NaN, drawn.

    uniform : (N, 4) numbers between 0 and 1, from the stream of each tree. stand : (4,) normals that
    the trees of a stand share, by which they differ as studies do (``Law.within``); None: of many stands.
    """
    given = given.copy()
    for rows in _alike(np.isfinite(given)):
        if np.isfinite(given[rows[0], 2]) and np.isnan(given[rows[0], 0]):
            density = _density(kind, dbh[rows, None], given[rows])[..., 0].T
            z = np.zeros((len(rows), 4))
            z[:, 0] = _drawn(HEIGHTS, density, uniform[rows, 0])
            given[rows, 0] = measures(kind, dbh[rows], z)[:, 0]
    known = np.isfinite(given)
    z = np.clip(scores(kind, dbh, given), -4, 4)
    noise = scipy.special.ndtri(uniform)
    own = np.array([getattr(kind, name).within for name in MEASURES])
    matrix = correlation_matrix(kind)
    for pattern in np.unique(known, axis=0):
        rows = np.flatnonzero((known == pattern).all(axis=1))
        told, free = np.flatnonzero(pattern), np.flatnonzero(~pattern)
        if not len(free):
            continue
        inner, across = matrix[np.ix_(told, told)], matrix[np.ix_(free, told)]
        weight = across @ np.linalg.pinv(inner)
        left = matrix[np.ix_(free, free)] - weight @ across.T
        value, vector = np.linalg.eigh(left)
        # The symmetric root: noise of a measure stays that measure's (competition is in it), whatever
        # signs and order the eigenvectors come in.
        root = (vector * np.sqrt(np.maximum(value, 0.0))) @ vector.T
        drawn = noise[np.ix_(rows, free)] @ root.T
        if stand is not None:
            drawn = own[free] * drawn + np.sqrt(1 - own[free] ** 2) * (root @ stand[free])
        z[np.ix_(rows, free)] = _cut(z[np.ix_(rows, told)] @ weight.T + drawn)
    drawn_measures = measures(kind, dbh, z)
    share = drawn_measures[:, 2] / drawn_measures[:, 0]
    drawn_measures = np.where(known, given, drawn_measures)
    narrow = np.minimum(drawn_measures[:, 1], WIDEST * drawn_measures[:, 0])  # of a broken stem
    drawn_measures[:, 1] = np.where(known[:, 1], drawn_measures[:, 1], narrow)
    base = share * drawn_measures[:, 0]  # of the height that the tree has
    drawn_measures[:, 2] = np.where(known[:, 2], given[:, 2], base)
    return drawn_measures


def correlation_matrix(kind: Allometry) -> np.ndarray:
    """(4, 4) correlation of residuals, the nearest that numbers of several tables allow."""
    matrix = np.eye(4)
    for (a, b), value in zip(PAIRS, kind.correlation, strict=True):
        matrix[a, b] = matrix[b, a] = value
    values, vectors = np.linalg.eigh(matrix)
    matrix = (vectors * np.maximum(values, 1e-6)) @ vectors.T
    size = np.sqrt(np.diag(matrix))
    return np.asarray(matrix / np.outer(size, size))


def _cut(z: np.ndarray) -> np.ndarray:
    """Normals to normals within ±``LIMIT``, by inversion."""
    low, high = scipy.special.ndtr(-LIMIT), scipy.special.ndtr(LIMIT)
    return np.asarray(scipy.special.ndtri(low + (high - low) * scipy.special.ndtr(z)))


def half_of_surface(
    area: np.ndarray, species: np.ndarray, pft: np.ndarray, study: np.ndarray, way: np.ndarray
) -> np.ndarray:
    """(N,) leaf areas (N,) as half of the surface.

    pft : (N,) functional types of BAAD; those of broadleaves (ending in A) are left. way : (N,) one of
    ``WAYS`` where the table tells it, or empty: by ``COUNTED``, half of the surface for others.

    Raises
    ------
    SpecError : a way is none of these.
    """
    for row in np.flatnonzero(~np.isin(way, ("", *WAYS))):
        raise SpecError(
            "leaf_area_is", f'row {row + 2}: "{way[row]}" is none of {", ".join(WAYS)}; correct it'
        )
    factor = np.ones(len(area))
    for row in np.flatnonzero(np.char.endswith(pft, "G") | (way != "")):
        genus = str(species[row]).partition(" ")[0]
        counted = COUNTED.get(str(study[row]), "half")
        told = counted if isinstance(counted, str) else counted.get(genus, "half")
        outline = HALF_OVER_OUTLINE.get(genus, HALF_OVER_OUTLINE[""])
        factor[row] = {"half": 1.0, "all": 0.5, "outline": outline}[str(way[row]) or told]
    return area * factor


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
        logarithm = np.log(value)
    return np.where(np.isfinite(logarithm), logarithm, np.nan)


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


TARGETS = ("dbh", *MEASURES)
WIDEST = 2.0  # crowns over heights; the measured ones have up to 1.8
SLENDER = (8.0, 400.0)  # height over diameter that was ever measured
USUAL_DBH = Normal(mean=0.25, sd=0.06)  # metres, where nobody says one
MOST_TIMES = 5.0  # over the largest leaf area that 95 % of the kind have
BREAST = 1.3  # metres
THINNEST, THICKEST = 0.025, 0.6  # metres, and of the canopy's: diameters of the understorey
# Metres in which numbers of trees by diameter fall by e, as by 1.4 in 5 cm.
FALL = 0.05 / np.log(1.4)
MANY = 2000  # points, of which an inner hull is made first


@dataclass(frozen=True)
class Kind:
    """Files of a species that is grown to measure: its allometry, and its own leaf or None."""

    allometry: Allometry | None
    blade: Blade | None = None


@dataclass(frozen=True)
class Wanted:
    """Targets of one tree, metres and m².

    aside : radii that its crown, where it is widest, stands aside of its stem, along x.
    """

    dbh: float
    height: float
    crown_width: float
    crown_base: float
    leaf_area: float
    aside: float = 0.0


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
        completed = given
    else:
        completed = draw(kind, dbh, given, uniform, stand)
    for row, told in zip(np.column_stack([dbh, completed]), np.isfinite(given), strict=True):
        refuse_contradictions(Wanted(*row), kind, where, told=bool(told.any()))
    return np.column_stack([dbh, completed])


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


def suppressed(dbh: np.ndarray, keys: np.ndarray, share: float) -> np.ndarray:
    """(N,) diameters, m, of trees with keys (N,), of which this share stand under the canopy.

    Numbers of trees by diameter fall there exponentially, by the same factor from class to class (de Liocourt
    1898; Meyer 1952, J. For. 50:85), up to a share of the diameter that the tree had in the canopy.
    """
    most = np.maximum(THICKEST * dbh, THINNEST)
    falls = -np.expm1((THINNEST - most) / FALL)
    thin = THINNEST - FALL * np.log1p(-falls * keyed_uniform(keys, "suppressed"))
    return np.where(keyed_uniform(keys, "understorey") < share, thin, dbh)


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
    half, given = np.full((1, len(MEASURES)), 0.5), given_by(targets)[None]
    dbh = draw_dbh(targets, np.zeros(1, np.uint64))
    if targets.dbh is not None:
        dbh = np.array([targets.dbh.mean])
    elif kind is not None and np.isfinite(given).any():
        dbh = draw_diameters(kind, given, half[0, :1])
    if score is not None and kind is not None:
        height = given[:, :1] / np.exp(middle(kind.height, dbh))
        medians = measures(kind, dbh, np.array([[0.0, score[0], score[1], 0.0]]))
        medians[:, 2] *= np.where(np.isfinite(height[:, 0]), height[:, 0], 1.0)
        free = np.isnan(given) & np.array([[False, True, True, False]])
        given = np.where(free, medians, given)
    return Wanted(*drawn(kind, dbh, given, half, where)[0].tolist())


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


def dbh_of(skeleton: Skeleton) -> float:
    """Diameter of the stem at breast height, metres; 0 of a tree that does not reach it."""
    return 2 * float(stem_radii(skeleton, BREAST).max(initial=0.0))


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
    leafy = np.unique(branch[branch >= 0])
    foot = branch_feet(skeleton)[leafy]
    return float(skeleton.start[foot, 2].min()) if len(leafy) else 0.0


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
            some = scipy.spatial.ConvexHull(flat[:: len(flat) // MANY])
            middle = some.points[some.vertices].mean(axis=0)
            inner = -float((some.equations[:, :2] @ middle + some.equations[:, 2]).max())
            x, y = flat[:, 0] - middle[0], flat[:, 1] - middle[1]
            flat = flat[x * x + y * y >= (0.999 * inner) ** 2]
        perimeter = float(scipy.spatial.ConvexHull(flat).area)  # so it is called in the plane
        return perimeter / np.pi
    except scipy.spatial.QhullError:  # all in a line
        return 2 * float(np.linalg.norm(np.ptp(flat, axis=0))) / np.pi


def leaf_tips(sites: LeafSites) -> np.ndarray:
    """(L, 3) where leaves end."""
    return np.asarray(sites.foot + sites.length[:, None] * sites.direction)
