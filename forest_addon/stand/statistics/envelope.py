"""Envelopes by simulation: how far a curve strays by chance, and whether the one observed strays farther.

Pointwise, the extremes of S curves hold a further one at a given radius with probability 1 - 2/(S + 1).
Over all radii that is missed far more often, so the global envelope takes the largest deviation of a whole
curve from the mean, in standard deviations of each radius (studentised maximum deviation; Myllymäki et al.
2017, sec. 4.2). Mean and deviation are those of all S + 1 curves, the observed among them, so that the
curves are exchangeable and its level is exact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEVEL = 0.05
SIMULATIONS = 39  # (S + 1)·LEVEL is whole, and the extremes are the pointwise 5 %


@dataclass(frozen=True)
class Envelope:
    """Curves (R,): the observed, the mean, and the pointwise and global envelopes.

    p_value : of the global test, share of the S + 1 curves that deviate as much. simulations : S.
    """

    observed: np.ndarray
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray
    global_low: np.ndarray
    global_high: np.ndarray
    p_value: float
    simulations: int

    @property
    def inside(self) -> bool:
        """Return whether the observed curve stays within the global envelope."""
        return self.p_value > LEVEL


def envelope(observed: np.ndarray, simulated: np.ndarray) -> Envelope:
    """Compare a curve (R,) with simulated ones (S, R).

    Raises
    ------
    ValueError : fewer than 19 simulations, with which nothing is beyond 5 %.
    """
    count = len(simulated)
    if (count + 1) * LEVEL < 1 - 1e-9:
        raise ValueError(f"{count} simulations cannot tell 5 % of chance; use at least 19")
    curves = np.vstack([observed, simulated])
    mean, spread = curves.mean(axis=0), curves.std(axis=0)
    # Where curves hardly differ, rounding is no deviation.
    known = spread > 1e-9 * np.abs(curves).max()
    scale = np.where(known, spread, np.inf)
    deviation = np.abs((curves - mean) / scale).max(axis=1)
    allowed = np.sort(deviation)[::-1][max(int((count + 1) * LEVEL + 1e-9) - 1, 0)]
    reach = allowed * np.where(known, spread, 0.0)
    return Envelope(
        observed=observed,
        mean=mean,
        low=simulated.min(axis=0),
        high=simulated.max(axis=0),
        global_low=mean - reach,
        global_high=mean + reach,
        p_value=float((deviation >= deviation[0]).mean()),
        simulations=count,
    )
