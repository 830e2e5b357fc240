"""Trees of a stand that are to measure something: targets of each, and which variant stands for it.

A tree's targets are what its list or its planting says, the rest drawn by the allometry of its kind from a
stream of its own; one part is the stand's, as studies differ, one is what neighbours leave (``competition``).
No more trees than variants: each is grown for itself. More: trees of like proportions share a variant
(k-means over log H/D, W/D, leaf area/D², the odds of the base, and less so log D, each over its measured
spread, and how far the crown stands aside), which is grown to the targets of the one nearest to their
middle. A tree is its variant in the size at which the stem, 1.3 m up, has its diameter, exactly.

Trees set by hand take part in none of this beside trees that are drawn: each is one of the variants that
those have, in the size of its own diameter, so that nothing else changes where one is set.

Targets of trees against their measures: reached or not, and whether they are as measured trees are.

A target is met within a millimetre of diameter, and ``CLOSE`` of anything else. The band is that of the
allometry of the planting: between what 5 and 95 % of measured trees of that diameter have.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from ..base.rng import child_keys, first_key, keyed_uniform, stream
from ..base.vectors import azimuth_of
from ..growth.measured.allometry import (
    BREAST,
    MEASURES,
    TARGETS,
    Z90,
    Kind,
    Wanted,
    band,
    draw_dbh,
    drawn,
    given_by,
    middle,
    scores,
    stem_profile,
    suppressed,
)
from ..growth.skeleton import Skeleton
from ..spec import Allometry, Planting, SpecError, Species
from .competition import (
    BASE,
    MOST_INDEX,
    WIDTH,
    aside,
    bounded,
    canopy_of,
    competed,
    filled,
    score,
    thinned,
)
from .compose import Inputs, TreeList
from .layouts import told_of
from .plan import Stand, chosen_of

ROUNDS = 40
SITE = np.arange(4)  # what the trees of a stand share, by measure
SPREADS = np.array([0.2, 0.25, 0.8, 0.4])  # of residuals, where no allometry tells them
PLAIN = Planting.__dataclass_fields__["scale"].default  # scales that nobody asked for
TIMES, FEW = 2.0, 5  # over the largest diameter measured of a kind; trees that tell a unit
MISTAKEN = (  # units, and what they make of diameters and heights
    ("heights in feet taken for metres", 1.0, 0.3048),
    ("heights in decimetres taken for metres", 1.0, 0.1),
    ("diameters in inches taken for centimetres", 2.54, 1.0),
    ("diameters in millimetres taken for centimetres", 0.1, 1.0),
    ("diameters in centimetres taken for millimetres", 10.0, 1.0),
)
DBH_SPREAD = 0.2  # of log D, within which proportions hardly change
ASIDE_SPREAD = 0.2  # radii aside of a stem, likewise


@dataclass(frozen=True)
class MeasuredTrees:
    """The stand with its variants chosen, and what is wanted.

    trees : (N, 5) targets, NaN of trees that have none. variants : by (planting, variant).
    laws : the allometry of each planting that has targets, None of others. ignored : sentences about
    measures that a list gives and nobody asked for.
    """

    stand: Stand
    trees: np.ndarray
    variants: dict[tuple[int, int], Wanted]
    laws: tuple[Allometry | None, ...] = ()
    ignored: tuple[str, ...] = ()


def with_targets(
    seed: int,
    stand: Stand,
    plantings: Sequence[Planting],
    names: Sequence[str],
    species: Sequence[tuple[Species, object]],
    inputs: Inputs,
) -> MeasuredTrees:
    """Say what every tree is to measure, and choose variants.

    Raises
    ------
    SpecError : targets that contradict each other, or that nothing tells.
    """
    groups, ignored = _groups(seed, stand, plantings, names, species, inputs)
    variants: dict[tuple[int, int], Wanted] = {}
    laws: list[Allometry | None] = [None] * len(plantings)
    wanted = np.broadcast_to(np.nan, (len(stand), 5))
    if not groups:
        return MeasuredTrees(stand, wanted, variants, tuple(laws), tuple(ignored))
    wanted, variant, scale = wanted.copy(), stand.variant.copy(), stand.scale.copy()
    site = scipy.special.ndtri(
        keyed_uniform(child_keys(np.repeat(first_key(seed, "site"), 4), SITE), "site")
    )
    site *= np.sqrt(1 - np.array([0.0, WIDTH, BASE, 0.0]) ** 2)  # without what is competition's
    competition = _scores(stand, groups)
    for group in groups:
        rows, law = group.rows, group.law
        laws[group.number] = law
        uniform = competed(group.uniform, competition[rows])
        where = f"plantings[{group.number}]"
        wanted[rows] = drawn(law, group.dbh, group.given, uniform, where, site)
    lean, rotation = np.zeros((len(stand), 2)), stand.rotation.copy()
    rows = np.flatnonzero(np.isfinite(wanted[:, 0]))
    grows = np.zeros(len(stand), dtype=bool)
    for group in groups:
        listed = _list_of(plantings[group.number], inputs)
        turned = None if listed is None else listed.rotation
        told = turned is not None and bool(np.isfinite(turned).any())
        grows[group.rows] = species[group.number][0].crown is not None and not told
    grows &= stand.number >= 0
    canopy = canopy_of(wanted[rows, 0])
    height, width = wanted[rows, 1:3].T
    lean[rows] = aside(stand.position[rows, :2], height, width, canopy)
    lean *= grows[:, None]
    off = np.linalg.norm(lean, axis=1)
    rotation[off > 0] = azimuth_of(lean[off > 0])
    for rows, free in _free(wanted, groups, 1):
        place = stand.position[rows, :2] + lean[rows] * wanted[rows, 2:3] / 2
        height, width = wanted[rows, 1:3].T
        wanted[rows, 2] = filled(place, height, width, free)
    for group in groups:
        if group.law is not None:
            most, free = band(group.law, group.dbh)[1, :, 3], np.isnan(group.given)
            wanted[group.rows] = bounded(wanted[group.rows], free, most)
    plans = [kind.architecture for kind, _ in species]
    most = np.array([MOST_INDEX if plan is None else plan.leaf_area_index for plan in plans])
    index = most[stand.species] if len(most) else np.empty(0)
    for rows, free in _free(wanted, groups, 3):
        wanted[rows, 4] = thinned(stand.position[rows, :2], wanted[rows], free, index[rows])
    for group in groups:
        rows, number = group.rows, group.number
        rng = stream(seed, "stand", names[number], "variants")
        many = plantings[number].variants
        label, chosen = groups_of(wanted[rows], many, group.law, rng, off[rows])
        variant[rows], scale[rows] = label, 1.0
        models = wanted[rows[chosen]]
        for k, row in enumerate(rows[chosen].tolist()):
            variants[number, k] = Wanted(*[*wanted[row].tolist(), float(off[row])])
        rows = np.flatnonzero((stand.species == number) & (stand.number < 0))
        if len(rows):
            asked = told_of(plantings[number], stand.number[rows], "variant")
            variant[rows], wanted[rows] = _like(asked, variant[rows], models, group, rows, wanted)
            scale[rows] = 1.0
    sized = replace(stand, variant=variant, scale=scale, rotation=rotation)
    return MeasuredTrees(sized, wanted, variants, tuple(laws), tuple(ignored))


def _like(
    asked: np.ndarray,
    label: np.ndarray,
    models: np.ndarray,
    group: _MeasuredGroup,
    rows: np.ndarray,
    wanted: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Variants (M,) and targets (M, 5) of trees set by hand: as the variant that somebody chose, the one that
    their group has given them, or the one nearest in diameter, in the size that gives them theirs.

    asked, label : (M,) variants that were chosen, NaN for none, and that the group gave. models : (K, 5).
    """
    alone = bool(group.rows[0] == rows[0])  # nothing is drawn: they are the group
    dbh = wanted[rows, 0] if alone else group.by_hand
    near = np.abs(np.log(dbh[:, None] / models[:, 0])).argmin(axis=1)
    chosen = np.isfinite(asked)
    took = np.where(chosen, np.nan_to_num(asked) % len(models), label if alone else near)
    took = took.astype(np.int64)
    size = dbh / models[took, 0]
    scaled = models[took] * size[:, None] ** np.array([1, 1, 1, 1, 2])
    own = alone & ~chosen
    return took, np.where(own[:, None], wanted[rows], scaled)


@dataclass(frozen=True)
class _MeasuredGroup:
    """The R trees of a planting with targets: their rows, diameters (R,), measures given (R, 4), NaN for
    none, and uniform numbers (R, 4) that the others are drawn by. by_hand : (M,) diameters of trees beside
    them that were set by hand.
    """

    number: int
    law: Allometry | None
    rows: np.ndarray
    dbh: np.ndarray
    given: np.ndarray
    uniform: np.ndarray
    by_hand: np.ndarray


def _groups(
    seed: int,
    stand: Stand,
    plantings: Sequence[Planting],
    names: Sequence[str],
    species: Sequence[tuple[Species, object]],
    inputs: Inputs,
) -> tuple[list[_MeasuredGroup], list[str]]:
    """Plantings whose trees are to measure something, and sentences about what lists say in vain."""
    groups, ignored = list[_MeasuredGroup](), list[str]()
    for number, planting in enumerate(plantings):
        kind, own = species[number][1], species[number][0].targets
        targets = planting.targets or own
        if targets is None:
            listed = listed_measures(number, names, plantings, inputs)
            told = [
                name
                for name, column in zip(TARGETS, listed.T, strict=True)
                if np.isfinite(column).any()
            ]
            if told:
                ignored.append(
                    f"{names[number]}: its list gives {' and '.join(told)}, which count "
                    "only with [plantings.targets]; the trees have the sizes of their species"
                )
            continue
        rows = np.flatnonzero(stand.species == number)
        hand = rows[stand.number[rows] < 0]
        alone = len(hand) == len(rows)
        rows = rows if alone else rows[stand.number[rows] >= 0]
        if planting.scale != PLAIN:
            ignored.append(
                f"{names[number]}: scale has no effect, as its trees are grown to measure; give targets"
            )
        if not len(rows):
            continue
        law = inputs.allometries.get(planting.targets.allometry) if planting.targets else None
        if law is None and isinstance(kind, Kind):
            law = kind.allometry
        key = first_key(seed, "stand", names[number], "measures")
        keys = child_keys(np.repeat(key, len(rows)), stand.number[rows])
        given = np.tile(given_by(targets), (len(rows), 1))
        dbh = draw_dbh(targets, keys, law if planting.targets else None, given)
        dbh = planting.age * suppressed(dbh, keys, targets.understorey)
        mine = planting.age * draw_dbh(
            targets, child_keys(np.repeat(key, len(hand)), stand.number[hand])
        )
        said = told_of(planting, stand.number[hand], "diameter")
        hands = np.where(np.isfinite(said), said, mine)
        dbh = hands if alone else dbh
        listed = listed_measures(number, names, plantings, inputs)
        if len(listed) and not alone:
            told = listed[stand.number[rows]]
            gaps = [
                f"{many:,} without {name}"
                for name, many in zip(TARGETS, np.isnan(told[:, :2]).sum(axis=0), strict=False)
                if 0 < many < len(rows)
            ]
            what = f"of the {len(rows):,} trees of its list, {' and '.join(gaps)}, which is drawn"
            ignored += [f"{names[number]}: {what}"] if gaps else []
            if law is not None:
                _refuse_units(planting.trees or names[number], law, told)
            given = np.where(np.isfinite(told[:, 1:]), told[:, 1:], given)
            if planting.targets is None or planting.targets.dbh is None:
                some = np.isfinite(told[:, 1:]).any(axis=1)
                dbh[some] = draw_dbh(None, keys[some], law, given[some])
            known = np.isfinite(told[:, 0])
            dbh = np.where(known, told[:, 0], dbh)
            if targets.understorey and known.all():
                ignored.append(
                    f"{names[number]}: understorey has no effect, as its list gives every diameter"
                )
        if law is not None:
            _refuse_thick(f"plantings[{number}]", law, np.append(dbh, hands))
        uniform = np.stack([keyed_uniform(keys, name) for name in MEASURES], axis=1)
        groups.append(_MeasuredGroup(number, law, rows, dbh, given, uniform, hands))
    return groups, ignored


def _refuse_thick(source: str, law: Allometry, dbh: np.ndarray, column: str = "") -> None:
    """Refuse diameters far beyond those of all measured trees of a kind.

    Raises
    ------
    SpecError : says which unit would make sense.
    """
    most = TIMES * max(getattr(law, name).dbh[1] for name in MEASURES)
    largest = np.nanmax(dbh, initial=0.0)
    if largest > most:
        raise SpecError(
            source,
            f"has a dbh of {largest:.3g} m, {largest / most * TIMES:.2g} times the largest measured of "
            f"{law.name}; were it centimetres, it would be {largest / 100:.3g} m{column}",
        )


def _refuse_units(source: str, law: Allometry, told: np.ndarray) -> None:
    """Refuse a table whose trees (N, 5) measure what none of their kind do, and as they would in other units.

    Raises
    ------
    SpecError : says which unit would make sense.
    """
    _refuse_thick(source, law, told[:, 0], ", and dbh_cm in the header")
    both = np.isfinite(told[:, :2]).all(axis=1)
    if both.sum() < FEW:
        return
    d, h = told[both, :2].T
    spread = (law.height.high - law.height.low) / (2 * Z90)
    off = float(np.median(np.log(h) - middle(law.height, d)))
    for words, thick, tall in MISTAKEN:
        right = float(np.median(np.log(h * tall) - middle(law.height, d * thick)))
        if abs(off) > 3.5 * spread and abs(right) < spread:
            raise SpecError(
                source,
                f"half of its trees are {np.exp(off):.2g} times as high as {law.name} with their dbh; were "
                f"there {words}, it would make sense; say the unit in the header",
            )


def _scores(stand: Stand, groups: Sequence[_MeasuredGroup]) -> np.ndarray:
    """(N,) competition of all trees that are to measure something; 0 of others."""
    found, size = np.zeros(len(stand)), np.full((len(stand), 3), np.nan)  # dbh, height, width
    for group in groups:
        if group.law is not None:
            laws = [getattr(group.law, name) for name in MEASURES[:2]]
            middles = np.column_stack([np.exp(middle(law, group.dbh)) for law in laws])
            given = group.given[:, :2]
            size[group.rows, 0] = group.dbh
            size[group.rows, 1:] = np.where(np.isfinite(given), given, middles)
    rows = np.flatnonzero(np.isfinite(size[:, 0]))
    if len(rows):
        dbh, height, width = np.ascontiguousarray(size[rows].T)
        found[rows] = score(stand.position[rows, :2], height, width, canopy_of(dbh))
    return found


def _free(
    wanted: np.ndarray, groups: Sequence[_MeasuredGroup], measure: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows (M,) of trees with targets, in the canopy and below it, and whether a measure, one of
    ``MEASURES``, is free of each (M,).
    """
    free = np.zeros(len(wanted), dtype=bool)
    for group in groups:
        free[group.rows] = np.isnan(group.given[:, measure]) & (group.law is not None)
    rows = np.flatnonzero(np.isfinite(wanted[:, 0]))
    canopy = canopy_of(wanted[rows, 0])
    for some in (rows[canopy], rows[~canopy]):
        if len(some):
            yield some, free[some]


def groups_of(
    wanted: np.ndarray,
    most: int,
    law: Allometry | None,
    rng: np.random.Generator,
    off: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Trees (N, 5) in at most so many groups: the group (N,) of each, and a tree that stands for each.

    off : (N,) radii that crowns stand aside of their stems; None: none does.
    """
    count = len(wanted)
    if count <= most:
        return np.arange(count), np.arange(count)
    from scipy.cluster.vq import kmeans2

    d, h, w, b, area = wanted.T
    spread = SPREADS
    if law is not None:
        laws = [getattr(law, name) for name in MEASURES]
        spread = np.array([(each.high - each.low) / (2 * Z90) for each in laws])
    features = np.column_stack(
        [np.log(h / d), np.log(w / d), np.log(b / (h - b)), np.log(area / d**2)]
    )
    beside = np.zeros(count) if off is None else off / ASIDE_SPREAD
    features = np.column_stack([features / spread, np.log(d) / DBH_SPREAD, beside])
    centres, group = kmeans2(features, most, iter=30, minit="++", rng=rng)
    used, group = np.unique(group, return_inverse=True)
    far = np.linalg.norm(features - centres[used][group], axis=1)
    models = np.array(
        [np.flatnonzero(group == k)[np.argmin(far[group == k])] for k in range(len(used))]
    )
    return group, models


def scales_for(skeleton: Skeleton, dbh: np.ndarray) -> np.ndarray:
    """(N,) sizes at which a tree's stem has these diameters (N,) 1.3 m above the ground, metres."""
    z, d = stem_profile(skeleton)
    scale = np.ones(len(dbh))
    for _ in range(ROUNDS):
        scale = np.sqrt(scale * dbh / np.maximum(np.interp(BREAST / scale, z, d), 1e-9))
    return scale


def dbh_at(skeleton: Skeleton, along: np.ndarray, across: np.ndarray | None = None) -> np.ndarray:
    """(N,) diameters at breast height, metres, of a tree in sizes (N,) along the vertical, and across it
    where they are others; 0 where it does not reach it.
    """
    z, d = stem_profile(skeleton)
    if not len(z):
        return np.zeros(len(along))
    height = BREAST / np.maximum(along, 1e-300)
    wide = along if across is None else across
    return np.asarray(np.where(height <= z[-1], wide * np.interp(height, z, d), 0.0))


def listed_measures(
    number: int, names: Sequence[str], plantings: Sequence[Planting], inputs: Inputs
) -> np.ndarray:
    """(M, 5) the measures of a planting's list, no rows where it has none."""
    listed = _list_of(plantings[number], inputs)
    if listed is None or listed.measures is None:
        return np.empty((0, 5))
    return listed.measures[chosen_of(number, names, plantings, listed)]


def _list_of(planting: Planting, inputs: Inputs) -> TreeList | None:
    """The list that a planting's trees are of, where it is of one."""
    named = planting.layout == "list"
    return inputs.lists.get(planting.trees or planting.collection) if named else None


UNITS = {"dbh": "m", "height": "m", "crown_width": "m", "crown_base": "m", "leaf_area": "m²"}
COLUMNS = {name: f"{name}_{'m2' if name == 'leaf_area' else 'm'}" for name in TARGETS}
DBH_CLOSE = 1e-3  # metres
CLOSE = 0.05  # relative


@dataclass(frozen=True)
class TargetsMet:
    """The trees of one planting that had targets.

    kind : of whose allometry the band is, empty where there is none. wanted, found : (N, 5) in the order of
    ``TARGETS``. within : (N, 4) in the band, of ``MEASURES``; None without a band.
    reasons : sentences of what could not be, and of how many trees.
    """

    label: str
    kind: str
    wanted: np.ndarray
    found: np.ndarray
    within: np.ndarray | None
    reasons: tuple[str, ...] = ()

    @property
    def off(self) -> np.ndarray:
        """(N, 5) relative differences."""
        return np.asarray(np.abs(self.found / self.wanted - 1))

    @property
    def reached(self) -> np.ndarray:
        """(N, 5) which targets are met."""
        return reached(self.wanted, self.found)


def reached(wanted: np.ndarray, found: np.ndarray) -> np.ndarray:
    """(N, 5) which of these targets (N, 5) are met; false of those that are NaN."""
    close = np.abs(found - wanted) <= CLOSE * np.abs(wanted)
    close[:, 0] = np.abs(found[:, 0] - wanted[:, 0]) <= DBH_CLOSE
    return np.asarray(close)


def found_in(table: Mapping[str, Sequence[object]]) -> np.ndarray:
    """(N, 5) what the trees of a table measure."""
    return np.column_stack([np.array(table[COLUMNS[name]], dtype=float) for name in TARGETS])


def in_band(law: Allometry, found: np.ndarray) -> np.ndarray:
    """(N, 4) whether trees (N, 5) measure what nine of ten measured trees of their diameter do."""
    with np.errstate(divide="ignore", invalid="ignore"):
        z = scores(law, np.maximum(found[:, 0], 1e-9), found[:, 1:])
    return np.asarray(np.abs(z) <= Z90 * (1 + 1e-6))


def not_met(wanted: np.ndarray, found: np.ndarray) -> list[str]:
    """(N,) the names of the targets that are not met, of each tree."""
    missed = np.isfinite(wanted) & ~reached(wanted, found)
    return [" ".join(np.array(TARGETS)[row]) for row in missed]


def targets_met(
    table: Mapping[str, Sequence[object]],
    species: np.ndarray,
    labels: Sequence[str],
    wanted: np.ndarray,
    laws: Sequence[Allometry | None],
    missed: Sequence[tuple[str, ...]],
) -> list[TargetsMet]:
    """A finding for each planting whose trees had targets.

    table : of the trees (``tree_table``). species : (N,) plantings. missed : of each tree what its growth
    could not do.
    """
    found, met = found_in(table), []
    for number, label in enumerate(labels):
        rows = np.flatnonzero((species == number) & np.isfinite(wanted).any(axis=1))
        if not len(rows):
            continue
        law = laws[number]
        within = None if law is None else in_band(law, found[rows])
        told = Counter(reason for row in rows.tolist() for reason in missed[row])
        of = len(rows)
        reasons = tuple(
            reason if count == of else f"{reason} ({count} of {of} trees)"
            for reason, count in told.items()
        )
        kind = "" if law is None else law.name
        met.append(TargetsMet(label, kind, wanted[rows], found[rows], within, reasons))
    return met


def sentences(met: TargetsMet) -> Iterator[str]:
    """Sentences on what could not be, by measure."""
    missed = ~met.reached
    for column, name in enumerate(TARGETS):
        count = int(missed[:, column].sum())
        if count:
            limit = "1 mm" if name == "dbh" else f"{CLOSE:.0%}"
            yield (
                f"{met.label}: {name} of {count:,} of {len(missed):,} trees is off its target by more than "
                f"{limit}."
            )
    for reason in met.reasons:
        yield f"{met.label}: {reason}."


def facts_of(met: TargetsMet) -> dict[str, str]:
    """Target and reached by measure, in words."""
    facts = {}
    for column, name in enumerate(TARGETS):
        wanted, found, off = met.wanted[:, column], met.found[:, column], met.off[:, column]
        text = f"{_span(wanted)} → {_span(found)} {UNITS[name]}"
        if name == "dbh":
            text += f", off by at most {1e3 * np.abs(found - wanted).max():.2g} mm"
        else:
            text += f", off by {np.median(off):.1%}, at most {off.max():.1%}"
        if met.within is not None and name in MEASURES:
            text += f"; {met.within[:, column - 1].mean():.0%} in the band"
        facts[f"{met.label}: {name.replace('_', ' ')}"] = text
    if met.within is not None:
        facts[f"{met.label}: all four in the band"] = f"{met.within.all(axis=1).mean():.0%}"
    return facts


def record(met: TargetsMet) -> dict[str, object]:
    """The same for run.json."""
    measures: dict[str, object] = {}
    for column, name in enumerate(TARGETS):
        wanted, found = met.wanted[:, column], met.found[:, column]
        one: dict[str, object] = {
            "target": _three(wanted),
            "reached": _three(found),
            "off_median": float(np.median(met.off[:, column])),
            "off_most": float(met.off[:, column].max()),
            "not_met": int((~met.reached[:, column]).sum()),
        }
        if met.within is not None and name in MEASURES:
            one["within_band"] = float(met.within[:, column - 1].mean())
        measures[name] = one
    told: dict[str, object] = {
        "trees": len(met.wanted),
        "allometry": met.kind,
        "measures": measures,
    }
    if met.within is not None:
        told["all_within_band"] = float(met.within.all(axis=1).mean())
    return told | {"reasons": list(met.reasons)}


def _span(values: np.ndarray) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:.3g}" if np.isclose(low, high, rtol=5e-3) else f"{low:.3g}-{high:.3g}"


def _three(values: np.ndarray) -> list[float]:
    """Smallest, middle, largest."""
    return [float(values.min()), float(np.median(values)), float(values.max())]
