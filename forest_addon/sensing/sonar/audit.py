"""Echoes held against the exact sum: random bins of random pings, scatterer by scatterer.

The sum at a bin is made again over everything in range, also what was culled as too weak, with a tolerance
of 0. Errors are shares of Σ max|A|, in which tolerance and cull are given. Where more than MOST scatterers
are in range, those that were heard are summed instead, and the audit says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...spec import Air, Sonar
from ..audit import Audit, sample
from ..rays.caster import RayCaster
from .bands import Band, Grid
from .ping import Echo, heard_from
from .search import Group
from .station import Equipment, Station
from .summation import sum_echoes
from .targets import Targets

MOST = 300_000  # scatterers in range that are all summed
BINS = 4  # of a ping
ROUNDING = 1e-12


def audit_echoes(
    echoes: Sequence[Echo],
    targets: Targets,
    sonar: Sonar,
    air: Air,
    wood: RayCaster | None,
    everything: RayCaster | None,
    equipment: Equipment,
    rng: np.random.Generator,
    seconds: float,
    share: float,
) -> Audit:
    """Of pings that took ``seconds`` together, at a cost of about ``share`` of that.

    wood, everything : casters as of ``ping``.
    """
    first = echoes[0]
    all_of_them = first.leaves + first.others - first.far <= MOST
    chosen = replace(sonar, cull=0.0) if all_of_them else sonar
    band = Band(*sonar.band)
    allowed = max(echo.error_bound + echo.cull_bound for echo in echoes) + ROUNDING

    def batches() -> Iterator[np.ndarray]:
        while True:
            echo = echoes[int(rng.integers(len(echoes)))]
            station = Station(chosen, air, echo.pose, equipment)
            groups = heard_from(station, targets, band, wood, everything).groups
            bins = rng.integers(0, len(echo.frequency), BINS)
            yield np.array([_error(echo, int(k), groups, station, band) for k in bins])

    found = sample(batches(), share * seconds)
    which = "everything in range" if all_of_them else "everything heard"
    bins = sum(len(echo.frequency) for echo in echoes)
    return Audit(
        what=f"bins of the spectrum by the direct sum over {which}",
        checked=len(found.errors),
        error=found.largest,
        rms=found.rms,
        allowed=allowed,
        seconds=seconds,
        exact_seconds=found.seconds_each * bins,
        unit="of all amplitudes",
    )


def _error(echo: Echo, row: int, groups: list[Group], station: Station, band: Band) -> float:
    """The largest error at all ears of one bin, as a share of Σ max|A|."""
    size = sum(_largest(group, station, band) for group in groups)
    if size == 0:
        return float(np.abs(echo.spectra[:, row]).max())
    one = Grid(float(echo.frequency[row]), station.sonar.sample_rate, 1, 1, 1)
    exact = sum_echoes(groups, station, one, 0.0).spectrum[:, 0]
    return float(np.abs(echo.spectra[:, row] - exact).max()) / size


def _largest(group: Group, station: Station, band: Band) -> float:
    """Σ max|A| of a group over some frequencies of the band, at the first ear."""
    frequency = np.append(band.sample()[0], [band.low, band.high])
    wavenumber = 2.0 * np.pi * frequency / station.sound_speed
    size = np.abs(group.seen(station, 0).amplitude(wavenumber))
    return float((size * group.gain(station, 0, frequency)).max(axis=0).sum())
