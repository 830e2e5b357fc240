"""Goodness of fit of a law: L(r) - r in envelopes of simulations of that law, and quadrats.

Every simulation is judged as the trees were: where λ was estimated from the trees, it is estimated again
from each simulation, or the test would find them too much like their own estimate.

Pointwise, the extremes of S curves hold a further one at a given radius with probability 1 - 2/(S + 1).
Over all radii that is missed far more often, so the global envelope takes the largest deviation of a whole
curve from the mean, in standard deviations of each radius (studentised maximum deviation; Myllymäki et al.
2017, sec. 4.2). Mean and deviation are those of all S + 1 curves, the observed among them, so that the
curves are exchangeable and its level is exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...base.rng import stream
from ...spec import Forest, Scene
from ..compose import corners_of, process_of
from ..inputs import Inputs
from ..plan import Stand, plan_stand
from .intensity import FittedMixture, KernelEstimate, Window, kernel_estimate, refit
from .k_function import (
    SMALLEST,
    At,
    QuadratTest,
    Region,
    choose_quadrats,
    choose_radii,
    inhomogeneous_k,
    integrate_by_quadrat,
    quadrat_test,
    region_of,
)

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


Estimate = KernelEstimate | FittedMixture
FEWEST_TREES = 10  # that a test is worth drawing for
MOST_TREES = 200_000
MANY = 20_000  # trees beyond which fewer simulations are made


@dataclass(frozen=True)
class TestedLaw:
    """Law that trees are tested against.

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
    points: np.ndarray, window: Window, law: TestedLaw, simulations: int | None = None
) -> Goodness | None:
    """Test points (N, 2) in a window against a law; None where there are too few to say anything, or so
    many that simulations would take minutes."""
    if not FEWEST_TREES <= len(points) <= MOST_TREES:
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
    judge = _Judge(window, region, law, radius, choose_quadrats(len(points), window))
    judged = [judge(trees) for trees in [points, *drawn]]
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


def law_of_scene(scene: Scene, inputs: Inputs) -> TestedLaw:
    """The law of a scene's Poisson trees: other stands of the same settings, spacing and all, judged by
    the intensity that they are drawn from."""
    drawn = [number for number, p in enumerate(scene.plantings) if p.layout == "poisson"]
    processes = [process_of(scene.plantings[number], scene.forest, inputs) for number in drawn]

    def at(points: np.ndarray) -> np.ndarray:
        return np.asarray(sum((p.at(points) for p in processes), np.zeros(len(points))))

    def simulate(number: int) -> np.ndarray:
        seed = int(stream(scene.seed, "goodness", number).integers(2**62))
        return poisson_trees(scene, plan_stand(seed, scene.forest, scene.plantings, inputs))

    return TestedLaw(simulate, lambda trees: (at(trees), at))


def poisson_trees(scene: Scene, stand: Stand) -> np.ndarray:
    """(N, 2) places of the trees that a Poisson process placed, not rows, a list or a hand."""
    poisson = np.array([p.layout == "poisson" for p in scene.plantings], dtype=bool)
    if not len(stand):
        return np.empty((0, 2))
    return stand.position[poisson[stand.species] & (stand.number >= 0), :2]


def window_of(forest: Forest) -> Window:
    """The field as a window."""
    if forest.polygon:
        return Window(
            tuple(np.array(ring, dtype=float) for ring in (forest.polygon, *forest.holes))
        )
    return Window.rectangle(*corners_of(forest))


def law_of(estimate: Estimate, simulate: Callable[[int], np.ndarray]) -> TestedLaw:
    """The law of an estimate: judged by estimating again, with the same bandwidth or number of hills."""

    def judge(trees: np.ndarray) -> tuple[np.ndarray, At]:
        if isinstance(estimate, FittedMixture):
            fitted = refit(estimate, trees)
            return fitted.at(trees), fitted.at
        smoothed = kernel_estimate(trees, estimate.window, estimate.bandwidth)
        # A tree at the rim, judged by the others alone, must not outweigh them all.
        smallest = SMALLEST * float(smoothed.at(trees).mean())
        return np.maximum(smoothed.leave_one_out, smallest), smoothed.at

    return TestedLaw(simulate, judge)


class _Judge:
    """Makes L(r) - r and the quadrat test of trees; a λ that stays the same is integrated once."""

    def __init__(
        self,
        window: Window,
        region: Region,
        law: TestedLaw,
        radius: np.ndarray,
        shape: tuple[int, int],
    ) -> None:
        self.window, self.region, self.law, self.radius = window, region, law, radius
        self.shape = shape
        self.integrated: tuple[At, np.ndarray] | None = None

    def __call__(self, trees: np.ndarray) -> tuple[np.ndarray, QuadratTest]:
        intensity, at = self.law.judge(trees)
        within = self.region.contains(trees)
        k = inhomogeneous_k(trees[within], intensity[within], self.region, self.radius)
        return k.l_function - self.radius, quadrat_test(trees, self._expected(at), self.window)

    def _expected(self, at: At) -> np.ndarray:
        if self.integrated is None or self.integrated[0] is not at:
            self.integrated = at, integrate_by_quadrat(at, self.window, self.shape)
        return self.integrated[1]
