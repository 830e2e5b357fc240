"""Number of plausible stands that agree with a recording, what they have in common, and what decides."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from forest_addon.sensing.reverb.directivity import Directivity
from forest_addon.sensing.reverb.forest.transport import Sent

from ..comparison import Comparison, Interval
from .decay import Decay
from .expected import expected_energy
from .stands import EVEN_BY_LOGARITHM, RANGES, Path, PlausibleStand

LAST, PACKETS = 1.8, 1500  # s of sound; packets an octave
NAMED = 4  # properties that matter most, which are named
NEARLY = 1  # measures that a stand may miss and still be named


def judge_agreement(
    stands: Sequence[PlausibleStand],
    path: Path,
    measured: Decay,
    share: float,
    decibels: float,
) -> list[Comparison]:
    """A row an octave, and one of the stands that agree best. share : of T20. decibels : of C50."""
    every = [
        expected_energy(stand, path, measured.band, LAST, PACKETS, _sent(path.source)).decay(
            path.air.speed()
        )
        for stand in stands
    ]
    t20, c50 = (np.array(part) for part in zip(*every, strict=True))
    near = np.abs(t20 / measured.t20 - 1.0) <= share
    clear = np.abs(c50 - measured.c50) <= decibels
    effects = effects_of(stands, np.log(t20))
    found = []
    for n, band in enumerate(measured.band):
        largest = sorted(effects, key=lambda name: -abs(effects[name][n]))[:NAMED]
        words = ", ".join(f"{name} {100 * np.expm1(effects[name][n]):+.0f} %" for name in largest)
        true = float(measured.t20[n])
        found.append(
            Comparison(
                f"Koli, T20 at {band:g} Hz as expected of {len(stands)} stands",
                "s",
                Interval(true, true * (1 - share), true * (1 + share)),
                Interval.of(t20[:, n][np.isfinite(t20[:, n])]),
                None,
                f"{near[:, n].sum()} within {100 * share:.0f} %, C50 of {clear[:, n].sum()} within "
                f"{decibels:g} dB. From the low to the high end of its range each moves T20 by: {words}.",
            )
        )
    return [*found, _best(stands, near.sum(axis=1) + clear.sum(axis=1), 2 * len(measured.band))]


def _sent(source: Directivity) -> Callable[[float], Sent]:
    def of(frequency: float) -> Sent:
        return lambda way: source.around(way[:, 2], frequency) ** 2

    return of


def effects_of(stands: Sequence[PlausibleStand], values: np.ndarray) -> dict[str, np.ndarray]:
    """Change of values (N, B) over the whole range of each property, by least squares."""
    columns = [np.ones(len(stands))]
    for name, ends in RANGES.items():
        value = np.array([getattr(stand, name) for stand in stands])
        if name in EVEN_BY_LOGARITHM:
            value, ends = np.log(value), (np.log(ends[0]), np.log(ends[1]))
        columns.append((value - ends[0]) / (ends[1] - ends[0]) - 0.5)
    found = np.linalg.lstsq(np.column_stack(columns), values, rcond=None)[0]
    return dict(zip(RANGES, found[1:], strict=True))


def _best(stands: Sequence[PlausibleStand], met: np.ndarray, all_of: int) -> Comparison:
    best = [stand for stand, count in zip(stands, met, strict=True) if count >= all_of - NEARLY]
    words = "; ".join(
        f"{name} {np.median([getattr(stand, name) for stand in best]):.3g} "
        f"(all: {np.median([getattr(stand, name) for stand in stands]):.3g})"
        for name in RANGES
        if best
    )
    return Comparison(
        f"Koli, measures of {all_of} that the best of {len(stands)} stands meets",
        "",
        Interval(float(all_of)),
        Interval(float(met.max())),
        None,
        f"{len(best)} stands meet {all_of - NEARLY} or more. Their medians: {words}.",
    )
