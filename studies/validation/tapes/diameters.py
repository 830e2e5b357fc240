"""Diameters of the same stems by hand and by scan, and what bark makes of them.

Stems of La Rioja's two lists are matched (``stem_lists``); all are Scots pines. Ours are boles of that
species with bark in relief, taped and scanned (``girths``).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..comparison import Comparison, Interval
from ..stems import BINS, PLOTS, read_plots
from .girths import ScannedStems, scan_plot
from .stem_lists import match_stems

NEAR = 1.0  # cm of bias that count as the same, stated before the run
NEAREST = 1.0  # m from the tripod, where a stem can stand
PARTS = 4  # of the stems by diameter


def matched_stems(folder: Path) -> tuple[np.ndarray, int, list[str]]:
    """(S, 3) range, m, and diameters by hand and by scan, cm, of matched stems; how many there are by chance;
    the plots that could not be matched."""
    given, found = (read_plots(folder / f"tree_{name}.csv") for name in ("field", "tls"))
    rows, chance, left = [], 0, []
    for plot, stems in given.items():
        if plot not in found:
            continue
        scanned = found[plot]
        match = match_stems(stems[:, :2], scanned[:, :2])
        if not match.certain:
            left.append(plot)
            continue
        chance += match.chance
        both = np.column_stack(
            [scanned[match.found, 2], 100 * stems[match.given, 3], 100 * scanned[match.found, 3]]
        )
        rows.append(both[np.isfinite(both).all(axis=1)])
    return np.concatenate(rows), chance, left


def compare_diameters(folder: Path, seed: int) -> list[Comparison]:
    """Bias of scanned diameters of stems with bark, where the plots have theirs."""
    stems, chance, left = matched_stems(folder)
    less = stems[:, 2] - stems[:, 1]
    real, rough = Interval(*_mean(less)), _scanned(folder, seed)
    smooth = _scanned(folder, seed, bark=False)
    ours, found = (100 * (s.fortls - s.tape)[np.isfinite(s.fortls)] for s in (rough, smooth))
    away = rough.range[np.isfinite(rough.fortls)]
    plots = (
        f"{16 - len(left)} plots (mirrored lists: {chance}; plots {', '.join(left)} do not match)"
    )
    words = (
        f"{len(stems)} stems of {plots}, standard deviation {less.std():.1f} cm; by range "
        f"{_by_range(stems[:, 0], less)}; by diameter {_by_diameter(stems)} of it. Ours is FORTLS's diameter "
        f"less the tape's, of {len(ours)} of {len(rough.range)} boles with bark in the places of "
        f"{PLOTS} plots: standard deviation {ours.std():.1f} cm; by range {_by_range(away, ours)}; of round, "
        f"smooth boles {found.mean():+.2f}. A circle by least squares is "
        f"{100 * np.nanmean(rough.circle - rough.tape):+.2f} cm off the tape; the tape is "
        f"{100 * np.mean(rough.tape - rough.area):+.2f} off the diameter of the same area. Within 1 cm."
    )
    return [
        Comparison(
            *("diameter at breast height, scan less hand, same stems", "cm", real),
            Interval(*_mean(ours)),
            bool(abs(ours.mean() - real.value) <= NEAR),
            words=words,
            before=Interval(float(found.mean())),
        )
    ]


def _scanned(folder: Path, seed: int, bark: bool = True) -> ScannedStems:
    """The stems of the first plots, scanned."""
    field = read_plots(folder / "tree_field.csv")
    found = []
    for number, plot in enumerate(list(field)[:PLOTS]):
        stand = field[plot]
        stand = stand[np.isfinite(stand[:, 3]) & (stand[:, 2] > NEAREST)]
        found.append(scan_plot(stand[:, [0, 1, 3]], 1000 * (seed + number), bark))
    return ScannedStems.joined(found)


def _mean(values: np.ndarray) -> tuple[float, float, float]:
    """Mean, and the ends of its 95 % interval."""
    middle, error = float(values.mean()), 1.96 * float(values.std(ddof=1)) / np.sqrt(len(values))
    return middle, middle - error, middle + error


def _by_range(away: np.ndarray, less: np.ndarray) -> str:
    """Means by range in words."""
    number = np.clip(np.digitize(away, BINS[1:-1]), 0, len(BINS) - 2)
    return ", ".join(f"{less[number == k].mean():.1f}" for k in range(len(BINS) - 1)) + " cm"


def _by_diameter(stems: np.ndarray) -> str:
    """Means of the difference over the diameter, %, of quarters of the stems."""
    parts = np.array_split(np.argsort(stems[:, 1]), PARTS)
    share = [100 * (stems[p, 2] - stems[p, 1]).mean() / stems[p, 1].mean() for p in parts]
    return ", ".join(f"{value:.1f}" for value in share) + " %"
