"""Echoes held against the exact sum: random bins of random pings, scatterer by scatterer.

The sum at a bin is made again with a tolerance of 0, over everything in range, also what was culled as too
weak, where that fits the time; else over what was heard, and the audit says so. Errors are shares of
Σ max|A|, in which tolerance and cull are asked for.
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
BINS = 4  # of a ping whose scatterers have to be looked for
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
    band = Band(*sonar.band)
    culled = sonar.cull > 0 and _affordable(echoes, share)

    def batches() -> Iterator[np.ndarray]:
        while True:
            echo = echoes[int(rng.integers(len(echoes)))]
            station = Station(replace(sonar, cull=0.0), air, echo.pose, equipment)
            groups = echo.groups
            if culled:
                groups = heard_from(station, targets, band, wood, everything).groups
            bins = rng.integers(0, len(echo.frequency), BINS if culled else 1)
            yield np.array([_error(echo, int(k), groups, station) for k in bins])

    found = sample(batches(), share * seconds)
    which = "everything heard" if sonar.cull > 0 and not culled else "everything in range"
    bins = sum(len(echo.frequency) for echo in echoes)
    return Audit(
        what=f"bins of the spectrum by the direct sum over {which}",
        checked=len(found.errors),
        error=found.largest,
        rms=found.rms,
        allowed=sonar.tolerance + (sonar.cull if culled else 0.0) + ROUNDING,
        seconds=seconds,
        exact_seconds=found.seconds_each * bins,
        unit="of all amplitudes",
    )


def _affordable(echoes: Sequence[Echo], share: float) -> bool:
    """Whether looking for all that one ping could hear fits into a share of the time of all pings."""
    first = echoes[0]
    in_range = first.leaves + first.others - first.far
    heard = sum(len(group) for group in first.groups)
    return in_range <= MOST and in_range <= share * len(echoes) * max(heard, 1)


def _error(echo: Echo, row: int, groups: list[Group], station: Station) -> float:
    """The largest error at all ears of one bin, as a share of Σ max|A|."""
    one = Grid(float(echo.frequency[row]), station.sonar.sample_rate, 1, 1, 1)
    exact = sum_echoes(groups, station, one, 0.0).spectrum[:, 0]
    apart = np.abs(echo.spectra[:, row] - exact)
    return float((apart / np.where(echo.size > 0, echo.size, 1.0)).max())
