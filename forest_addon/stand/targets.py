"""Targets of trees against their measures: reached or not, and whether they are as measured trees are.

A target is met within a millimetre of diameter, and ``CLOSE`` of anything else. The band is that of the
allometry of the planting: between what 5 and 95 % of measured trees of that diameter have.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..growth.measured.allometry import MEASURES, TARGETS, Z90, scores
from ..spec import Allometry

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
    wanted: np.ndarray | None,
    laws: Sequence[Allometry | None],
    missed: Sequence[tuple[str, ...]],
) -> list[TargetsMet]:
    """A finding for each planting whose trees had targets.

    table : of the trees (``tree_table``). species : (N,) plantings. missed : of each tree what its growth
    could not do.
    """
    if wanted is None:
        return []
    found, met = found_in(table), []
    for number, label in enumerate(labels):
        rows = np.flatnonzero((species == number) & np.isfinite(wanted).any(axis=1))
        if not len(rows):
            continue
        law = laws[number] if number < len(laws) else None
        within = None if law is None else in_band(law, found[rows])
        told = Counter(reason for row in rows.tolist() for reason in missed[row])
        reasons = tuple(_counted(reason, count, len(rows)) for reason, count in told.items())
        kind = "" if law is None else law.name
        met.append(TargetsMet(label, kind, wanted[rows], found[rows], within, reasons))
    return met


def _counted(reason: str, count: int, of: int) -> str:
    return reason if count == of else f"{reason} ({count} of {of} trees)"


def sentences(met: TargetsMet) -> Iterator[str]:
    """Return what could not be, by measure."""
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
