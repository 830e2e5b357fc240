"""Whether trees could be a draw of a law: L(r) - r in envelopes of simulations of that law, and quadrats.

Every simulation is judged as the trees were: where λ was estimated from the trees, it is estimated again
from each simulation, or the test would find them too much like their own estimate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .envelope import SIMULATIONS, Envelope, envelope
from .kernel import KernelEstimate, kernel_estimate
from .mixture import FittedMixture, refit
from .region import SMALLEST, Region, region_of
from .statistics import At, QuadratTest, choose_radii, inhomogeneous_k, quadrat_test
from .window import Window

Estimate = KernelEstimate | FittedMixture
FEWEST_TREES = 10  # that a test is worth drawing for
MANY = 20_000  # trees beyond which fewer simulations are made


@dataclass(frozen=True)
class Law:
    """What trees are tested against.

    simulate : trees (N, 2) of the law, by the number of the simulation. judge : of trees (N, 2), λ (N,)
    at each and λ as a function of place, both perhaps estimated from those trees.
    """

    simulate: Callable[[int], np.ndarray]
    judge: Callable[[np.ndarray], tuple[np.ndarray, At]]


@dataclass(frozen=True)
class Goodness:
    """radius : (R,) metres. excess : L(r) - r (R,) in its envelopes. quadrats : the quadrat test;
    its p-value is by simulation."""

    radius: np.ndarray
    excess: Envelope
    quadrats: QuadratTest
    quadrat_p_value: float
    trees: int


def examine(
    points: np.ndarray, window: Window, law: Law, simulations: int | None = None
) -> Goodness | None:
    """Test points (N, 2) in a window against a law; None where there are too few to say anything."""
    if len(points) < FEWEST_TREES:
        return None
    if simulations is None:
        simulations = SIMULATIONS if len(points) < MANY else 19
    region = region_of(law.judge(points)[1], window)
    within = points[region.contains(points)]
    if len(within) < FEWEST_TREES:
        return None
    radius = choose_radii(within, region)
    drawn = [law.simulate(number) for number in range(simulations)]
    if min(int(region.contains(trees).sum()) for trees in drawn) < 2:
        return None
    judged = [_judge(trees, window, region, law, radius) for trees in [points, *drawn]]
    curves = np.array([curve for curve, _ in judged])
    quadrats = judged[0][1]
    strays = np.array([test.statistic for _, test in judged])
    beyond = min((strays >= strays[0]).mean(), (strays <= strays[0]).mean())
    return Goodness(
        radius=radius,
        excess=envelope(curves[0], curves[1:]),
        quadrats=quadrats,
        quadrat_p_value=min(1.0, 2 * float(beyond)),
        trees=len(points),
    )


def law_of(estimate: Estimate, simulate: Callable[[int], np.ndarray]) -> Law:
    """The law of an estimate: judged by estimating again, with the same bandwidth or number of hills."""

    def judge(trees: np.ndarray) -> tuple[np.ndarray, At]:
        if isinstance(estimate, FittedMixture):
            fitted = refit(estimate, trees)
            return fitted.at(trees), fitted.at
        smoothed = kernel_estimate(trees, estimate.window, estimate.bandwidth)
        # A tree at the rim, judged by the others alone, must not outweigh them all.
        smallest = SMALLEST * float(smoothed.at(trees).mean())
        return np.maximum(smoothed.leave_one_out, smallest), smoothed.at

    return Law(simulate, judge)


def _judge(
    points: np.ndarray, window: Window, region: Region, law: Law, radius: np.ndarray
) -> tuple[np.ndarray, QuadratTest]:
    """L(r) - r, and the quadrat test."""
    intensity, at = law.judge(points)
    within = region.contains(points)
    k = inhomogeneous_k(points[within], intensity[within], region, radius)
    return k.l_function - radius, quadrat_test(points, at, window)
