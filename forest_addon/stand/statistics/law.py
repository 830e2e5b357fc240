"""Do trees stand as their intensity says? The inhomogeneous K and L functions, and the quadrat test.

K(r) counts, about a tree, the others within r, each weighted by 1/λ: for a Poisson process with that λ it
is πr², more where trees keep company, less where they keep apart (Baddeley, Møller & Waagepetersen 2000,
eq. 2). Pairs that the window cannot show are made up for by translation: a pair x_i, x_j counts
1/|W ∩ (W + x_j - x_i)|, which is unbiased. L(r) = √(K/π) has a steadier variance and is r for Poisson.

A tree counts 1/λ in the inhomogeneous K function, so a few trees far out on a hill would outweigh all
others. Pairs are therefore counted within a region where λ is not small, by Kaneko & Gamper's own
definition with that region as the window.

Goodness of fit of a law: L(r) - r in envelopes of simulations of that law, and quadrats.

Every simulation is judged as the trees were: where λ was estimated from the trees, it is estimated again
from each simulation, or the test would find them too much like their own estimate.

Pointwise, the extremes of S curves hold a further one at a given radius with probability 1 - 2/(S + 1).
Over all radii that is missed far more often, so the global envelope takes the largest deviation of a whole
curve from the mean, in standard deviations of each radius (studentised maximum deviation; Myllymäki et al.
2017, sec. 4.2). Mean and deviation are those of all S + 1 curves, the observed among them, so that the
curves are exchangeable and its level is exact.

Clusters and repulsion estimated from a map: minimum contrast, and the pseudolikelihood.

**Clusters**: κ and the spread that make ∫ (K̂^¼ - K^¼)² dr least (Diggle & Gratton 1984), K̂ the
inhomogeneous K function. **Strauss**: for each radius R on a grid, γ that maximises
Π λ(x_i; x) · exp(-∫λ(u; x) du) with λ(u; x) = β λ(u) γ^t(u) (Besag 1977; Baddeley & Turner 2000), t the
trees nearer than R to u, trees and integral over the window less a border of the largest R. For given γ
the best β is closed; R with the largest pseudolikelihood wins.

Law of a map of trees: Poisson with hills, groups (Thomas, Matérn) or repulsion (Strauss), by its test.

The intensity is estimated first; if stands that are drawn from it are like the map (L(r) - r within its
global envelope, quadrats likewise), trees stand by chance and nothing more is fitted. Otherwise groups are
fitted where trees keep company and repulsion where they keep apart, over an even ground and over the hills,
and the first law that the same tests accept is taken, fewest numbers first; if none is accepted, the one with
the largest p. More than ``MANY_HILLS`` hills say that trees come in groups, so groups are tried then too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize, minimize_scalar
from scipy.spatial import cKDTree
from scipy.special import chdtr, chdtrc

from ...base.rng import stream
from ...spec import Clusters, Forest, Planting, Scene, Strauss
from ..compose import Inputs, corners_of, process_of
from ..layouts import k_of_clusters
from ..plan import Stand, draw_places, plan_stand
from .intensity import (
    FittedMixture,
    KernelEstimate,
    Window,
    fit_mixture,
    kernel_estimate,
    overlap_at,
    overlaps,
    refit,
)

NEIGHBOURS = 50  # of a tree, on average, within the largest radius that is chosen by itself
STEPS = 60  # radii that are chosen by themselves
FEWEST = 5.0  # expected trees of a quadrat; those with fewer are pooled (Cochran)
FINE = 256  # points along the longer side by which λ is integrated over quadrats

At = Callable[[np.ndarray], np.ndarray]  # λ (N,) at points (N, 2)


@dataclass(frozen=True)
class KFunction:
    """radius : (R,) metres. value : (R,) K in m². pairs : how many were counted."""

    radius: np.ndarray
    value: np.ndarray
    pairs: int

    @property
    def l_function(self) -> np.ndarray:
        """(R,) L = √(K/π), metres."""
        return np.asarray(np.sqrt(np.maximum(self.value, 0) / np.pi))


@dataclass(frozen=True)
class QuadratTest:
    """Pearson's X² of counts against what λ, scaled to the number of trees, expects.

    count, expected : (rows, columns), row 0 in the south. classes : quadrats, those pooled as one.
    p_value : two-sided; small too when the counts are more even than chance. NaN with one class.
    """

    count: np.ndarray
    expected: np.ndarray
    statistic: float
    classes: int
    p_value: float


def inhomogeneous_k(
    points: np.ndarray,
    intensity: np.ndarray,
    window: Window | Region,
    radius: np.ndarray,
    *,
    renormalise: bool = True,
) -> KFunction:
    """K at radii (R,), rising, from points (N, 2) with λ (N,) at each; use leave-one-out λ if estimated.

    renormalise : divide by Σ_{i≠j} 1/(λ_i λ_j), whose mean is |W|², in place of |W|²: a factor in λ no
    longer matters, and K varies less. Its bias is of the order of 1/n.

    Raises
    ------
    ValueError : λ is not positive at a tree; fewer than two trees.
    """
    if len(points) < 2:
        raise ValueError(f"K needs at least 2 trees, there are {len(points)}")
    if not (np.isfinite(intensity) & (intensity > 0)).all():
        where = points[int(np.argmin(np.where(intensity > 0, np.inf, 0)))]
        raise ValueError(
            f"the intensity is not positive at the tree at ({where[0]:g}, {where[1]:g}); "
            "K needs one that is"
        )
    weight = 1 / intensity
    order = np.argsort(points[:, 0], kind="stable")
    tree = cKDTree(points[order] - points[order[0]])  # far from 0 (UTM), digits stay
    i, j = order[tree.query_pairs(float(radius[-1]), output_type="ndarray")].T
    shift = points[j] - points[i]
    step = np.searchsorted(radius, np.hypot(shift[:, 0], shift[:, 1]))  # the first that reaches it
    share = 2 * weight[i] * weight[j] / window.set_covariance(shift)
    near = step < len(radius)
    counts = np.bincount(step[near], share[near], minlength=len(radius))
    value = np.cumsum(counts, dtype=float)
    if renormalise:
        value *= window.area**2 / (weight.sum() ** 2 - (weight**2).sum())
    return KFunction(radius, value, int(near.sum()))


def choose_radii(points: np.ndarray, window: Window | Region) -> np.ndarray:
    """(``STEPS``,) radii up to a quarter of the shorter side, or to where a tree has ``NEIGHBOURS``."""
    even = np.sqrt(NEIGHBOURS * window.area / (np.pi * max(len(points), 1)))
    largest = min(float(window.extent.min()) / 4, float(np.sqrt(window.area)) / 4, float(even))
    tree = cKDTree(points - points[:1])
    some = tree.data[:: max(1, len(points) // 2000)]
    while len(some) and largest > 1e-6 * window.extent.max():  # less where trees crowd
        if tree.query_ball_point(some, largest, return_length=True).mean() <= NEIGHBOURS + 1:
            break
        largest /= np.sqrt(2)
    return np.linspace(largest / STEPS, largest, STEPS)


def quadrat_test(points: np.ndarray, expected: np.ndarray, window: Window) -> QuadratTest:
    """Test the counts of points (N, 2) in quadrats of equal size against ∫λ over each (rows, columns),
    as ``integrate_by_quadrat`` gives it.
    """
    expected = expected * (len(points) / max(float(expected.sum()), 1e-300))
    rows, columns = expected.shape
    place = ((points - window.low) / window.extent * [columns, rows]).astype(int)
    place = np.minimum(place, [columns - 1, rows - 1])
    number = place[:, 1] * columns + place[:, 0]
    count = np.bincount(number, minlength=rows * columns)
    have, want = _pool(count, expected.ravel())
    statistic = float(((have - want) ** 2 / want).sum())
    above, below = chdtrc(len(want) - 1, statistic), chdtr(len(want) - 1, statistic)
    p_value = 2 * min(above, below) if len(want) > 1 else float("nan")
    return QuadratTest(count.reshape(rows, columns), expected, statistic, len(want), float(p_value))


def choose_quadrats(count: int, window: Window) -> tuple[int, int]:
    """Rows and columns of quadrats, so many that each has ten of ``count`` trees, up to 20 along a side."""
    longest = float(window.extent.max())
    across = np.sqrt(count / 10 * longest**2 / float(np.prod(window.extent)))
    shape = np.maximum(np.rint(np.clip(across, 1, 20) * window.extent / longest), 1).astype(int)
    return int(shape[1]), int(shape[0])


def integrate_by_quadrat(at: At, window: Window, shape: tuple[int, int]) -> np.ndarray:
    """(rows, columns) ∫λ over the part of each quadrat that lies in the window, by the midpoint rule."""
    rows, columns = shape
    fine = int(np.ceil(FINE / max(shape)))
    cover = window.coverage((rows * fine, columns * fine))
    cell = window.extent / [columns * fine, rows * fine]
    mass = at(window.middles(cover.shape)).reshape(cover.shape) * cover * cell.prod()
    return np.asarray(mass.reshape(rows, fine, columns, fine).sum(axis=(1, 3)))


def _pool(count: np.ndarray, expected: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Counts and expectations of classes: quadrats that expect few trees are put together, in the order
    of what they expect, so that each class expects at least ``FEWEST``."""
    order = np.argsort(expected, kind="stable")
    have, want = count[order].astype(float), expected[order]
    few = int(np.searchsorted(want, FEWEST))
    group = (np.cumsum(want[:few]) / FEWEST).astype(int)
    label = np.concatenate([group, np.arange(few, len(want)) + len(want)])
    _, label = np.unique(label, return_inverse=True)
    have, want = np.bincount(label, have), np.bincount(label, want)
    while len(want) > 1 and want.min() < FEWEST:  # a rest joins the class beside it
        rest = int(np.argmin(want))
        other = rest + 1 if rest + 1 < len(want) else rest - 1
        have[other] += have[rest]
        want[other] += want[rest]
        have, want = np.delete(have, rest), np.delete(want, rest)
    return have, want


PIXELS = 256  # along the longer side of the window
SMALLEST = 0.1  # λ within the region, over the mean of λ over trees


@dataclass(frozen=True)
class Region:
    """filled : (rows, columns) bool, pixels that belong, row 0 in the south. low, cell : (2,) metres."""

    filled: np.ndarray
    low: np.ndarray
    cell: np.ndarray

    @property
    def area(self) -> float:
        """m²."""
        return float(self.filled.sum() * self.cell.prod())

    @property
    def extent(self) -> np.ndarray:
        """(2,) sides of its bounding box, metres."""
        rows, columns = (np.flatnonzero(self.filled.any(axis=k)) for k in (1, 0))
        span = np.array([np.ptp(columns) + 1, np.ptp(rows) + 1])
        return np.asarray(span * self.cell)

    def contains(self, points: np.ndarray) -> np.ndarray:
        """(N,) bool of points (N, 2) within the window's bounding box."""
        rows, columns = self.filled.shape
        place = ((points - self.low) / self.cell).astype(int)
        x, y = np.clip(place, 0, [columns - 1, rows - 1]).T
        return np.asarray(self.filled[y, x])

    def set_covariance(self, shift: np.ndarray) -> np.ndarray:
        """(N,) area that it shares with itself moved by shift (N, 2), m²; exact, as between whole pixels
        the overlap of pixels is bilinear."""
        return overlap_at(self._overlaps, self.cell, shift)

    @cached_property
    def _overlaps(self) -> np.ndarray:
        return np.pad(np.rint(overlaps(self.filled)) * self.cell.prod(), 1)


def region_of(at: At, window: Window) -> Region:
    """The pixels wholly within a window where λ is at least a tenth of its mean over trees."""
    columns, rows = np.maximum(np.ceil(PIXELS * window.extent / window.extent.max()), 4).astype(int)
    cell = window.extent / [columns, rows]
    value = at(window.middles((rows, columns))).reshape(rows, columns)
    value = value * (window.coverage((rows, columns)) > 1 - 1e-9)
    mean = float((value**2).sum() / max(value.sum(), 1e-300))
    return Region((value > 0) & (value >= SMALLEST * mean), window.low, cell)


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
    radius, shape = choose_radii(within, region), choose_quadrats(len(points), window)
    drawn = [law.simulate(number) for number in range(simulations)]
    if min(int(region.contains(trees).sum()) for trees in drawn) < 2:
        return None
    known, expected, curves, quadrats = None, np.empty(0), [], []
    for trees in [points, *drawn]:
        intensity, at = law.judge(trees)
        here = region.contains(trees)
        k = inhomogeneous_k(trees[here], intensity[here], region, radius)
        if at is not known:  # a λ that stays the same is integrated once
            known, expected = at, integrate_by_quadrat(at, window, shape)
        curves.append(k.l_function - radius)
        quadrats.append(quadrat_test(trees, expected, window))
    strays = np.array([test.statistic for test in quadrats])
    beyond = min((strays >= strays[0]).mean(), (strays <= strays[0]).mean())
    return Goodness(
        radius=radius,
        excess=envelope(curves[0], np.array(curves[1:])),
        quadrats=quadrats[0],
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


FAINTEST = 100.0  # groups within the largest radius: more add less than 1 % to K
LATTICE = 200  # points along the longer side that the integral is summed over


def fit_clusters(k: KFunction, kind: str = "thomas") -> Clusters:
    """The cluster process whose K is nearest to a measured one.

    Raises
    ------
    ValueError : trees keep apart at every radius, so that there are no clusters to fit.
    """
    excess = k.value - np.pi * k.radius**2
    if excess.max() <= 0:
        raise ValueError("the trees keep apart at all distances; fit strauss instead")
    root = np.maximum(k.value, 0) ** 0.25

    most = np.log(FAINTEST / (np.pi * k.radius[-1] ** 2))

    def bounded(logs: np.ndarray) -> tuple[float, float]:
        groups, spread = np.exp(np.minimum(logs, [most, np.log(2 * k.radius[-1])]))
        return float(groups), float(spread)

    def contrast(logs: np.ndarray) -> float:
        groups, spread = bounded(logs)
        k_of_law = k_of_clusters(k.radius, Clusters(kind=kind, groups=groups, spread=spread))
        return float(np.square(root - k_of_law**0.25).sum())

    tries = [
        minimize(contrast, np.log([1 / excess.max(), share * k.radius[-1]]), method="Nelder-Mead")
        for share in (0.05, 0.2, 0.5)
    ]
    best = min(tries, key=lambda found: found.fun)
    groups, spread = bounded(best.x)
    return Clusters(kind=kind, groups=groups, spread=spread)


def fit_strauss(
    points: np.ndarray, window: Window, radii: np.ndarray, intensity: At | None = None
) -> tuple[Strauss, float]:
    """Radius (of those given) and γ of points (N, 2) in a window, and the logarithm of its pseudolikelihood
    above that of Poisson; γ = 1 and 0 where none is above it.

    intensity : λ (N,) at points, up to a factor; None: the same everywhere.

    Raises
    ------
    ValueError : the border of the largest radius leaves no tree.
    """
    border = float(radii.max())
    side = window.extent.max() / LATTICE
    x, y = (
        np.arange(low + side / 2, high, side)
        for low, high in zip(window.low, window.high, strict=True)
    )
    lattice = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inner, lattice = (p[_clear(p, window, border)] for p in (points, lattice))
    if not len(inner):
        raise ValueError(f"no tree is {border:g} m from the border; use smaller radii")
    tree = cKDTree(points)
    weight = np.ones(len(lattice)) if intensity is None else intensity(lattice)
    best, most = Strauss(radius=border, gamma=1.0), 0.0
    for radius in radii:
        reach = radius * (1 - 1e-12)  # nearer, not as near
        at_trees = tree.query_ball_point(inner, reach, return_length=True) - 1
        at_lattice = tree.query_ball_point(lattice, reach, return_length=True)
        area = np.bincount(at_lattice, weight)
        near = int(at_trees.sum())
        plain = -len(inner) * np.log(area.sum())

        def lost(log_gamma: float, near: int = near, area: np.ndarray = area) -> float:
            mean = (area * np.exp(log_gamma * np.arange(len(area)))).sum()
            return float(len(inner) * np.log(mean) - near * log_gamma)

        gamma, gain = 0.0, -len(inner) * np.log(area[0]) - plain
        if near:
            minimum = minimize_scalar(lost, bounds=(-12.0, 0.0), method="bounded")
            gamma, gain = float(np.exp(float(minimum.x))), -float(minimum.fun) - plain
        if gain > most:
            best, most = Strauss(radius=float(radius), gamma=min(gamma, 1.0)), gain
    return best, most


def _clear(points: np.ndarray, window: Window, border: float) -> np.ndarray:
    """(N,) bool: whether a circle of this radius about a point lies within the window, by 16 points."""
    clear = window.contains(points)
    for angle in np.arange(16) * np.pi / 8:
        rim = points + border * np.array([np.cos(angle), np.sin(angle)])
        clear &= window.contains(rim)
    return clear


LAWS = ("poisson", "thomas", "matern", "strauss")
MANY_HILLS = 5
ACCEPTED = 0.025  # of each of the two tests: a Poisson map is called another in at most 5 %
WEAK = 0.95  # γ of a repulsion that is none
FEWEST_GROUPS = 5.0  # in the window, below which they are hills
WIDEST = 0.25  # spread of a group, in the window's shorter side
RADII = np.linspace(0.1, 1.5, 15)  # of repulsion, in mean distances 1/√λ


@dataclass(frozen=True)
class ChosenLaw:
    """A law of a species' trees.

    name : one of ``LAWS``. estimate : its intensity. planting : what a scene plants by it. goodness : its
    tests; None where there are too few or too many trees to test.
    """

    name: str
    estimate: FittedMixture
    planting: Planting
    goodness: Goodness | None

    @property
    def p_value(self) -> float:
        """The smaller p of its two tests; 0 where nothing can be tested."""
        if self.goodness is None:
            return 0.0
        return min(self.goodness.excess.p_value, self.goodness.quadrat_p_value)


@dataclass(frozen=True)
class MappedSpecies:
    """Trees of one species on a map: points (N, 2), their window, and the field of the scene."""

    name: str
    points: np.ndarray
    window: Window
    field: Forest

    def judge(self, law: str, estimate: FittedMixture, planting: Planting) -> ChosenLaw:
        """Hold the map to stands that this planting draws."""
        process = process_of(planting, self.field, Inputs())

        def simulate(number: int) -> np.ndarray:
            rng = stream(0, "goodness", self.name, number)
            drawn = draw_places(planting, process, rng)
            return drawn[self.window.contains(drawn)]

        goodness = examine(self.points, self.window, law_of(estimate, simulate))
        return ChosenLaw(law, estimate, planting, goodness)


def choose_law(
    mapped: MappedSpecies, by_chance: ChosenLaw, hills: FittedMixture, law: str = "auto"
) -> list[ChosenLaw]:
    """The laws that were tried; the one that is taken comes first.

    by_chance : the Poisson law of the estimate with hills. law : "auto", or one of ``LAWS``.

    Raises
    ------
    ValueError : the law asked for cannot be fitted to these trees.
    """
    settled = by_chance.p_value > ACCEPTED and len(hills.peak) <= MANY_HILLS
    if law == "poisson" or (law == "auto" and (settled or by_chance.goodness is None)):
        return [by_chance]
    tried = [] if law in LAWS else [by_chance]
    best = None
    for candidate in _candidates(mapped, hills, by_chance.planting, law):
        tried.append(candidate)
        if candidate.p_value > ACCEPTED:
            best = candidate
            break
    if not tried:
        wanted = "repulsion" if law == "strauss" else "groups"
        raise ValueError(f"its trees show no {wanted} at any distance; leave --law out")
    best = best or max(tried, key=lambda one: one.p_value)
    return [best, *(one for one in tried if one is not best)]


def _candidates(
    mapped: MappedSpecies, hills: FittedMixture, planting: Planting, law: str
) -> Iterator[ChosenLaw]:
    """Groups or repulsion over an even ground, then over the hills."""
    even = fit_mixture(mapped.points, mapped.window, 0)
    plain = replace(planting, base=0.0, gaussians=())
    grounds = [(even, plain)] + ([(hills, planting)] if len(hills.peak) else [])
    for estimate, ground in grounds:
        region = region_of(estimate.at, mapped.window)
        within = mapped.points[region.contains(mapped.points)]
        if len(within) < 2:
            continue
        k = inhomogeneous_k(within, estimate.at(within), region, choose_radii(within, region))
        for kind in ("thomas", "matern"):
            if law not in ("auto", kind) or not (k.l_function > k.radius).any():
                continue
            clusters = fit_clusters(k, kind)
            few = clusters.groups * mapped.window.area < FEWEST_GROUPS
            if law == "auto" and (few or clusters.spread > WIDEST * mapped.window.extent.min()):
                continue
            planted = replace(ground, layout="clusters", clusters=clusters)
            yield mapped.judge(kind, estimate, planted)
        if law in ("auto", "strauss") and (k.l_function < k.radius).any():
            mean = len(mapped.points) / mapped.window.area
            radii = RADII / np.sqrt(mean)
            radii = radii[radii < mapped.window.extent.min() / 4]
            at = estimate.at if len(estimate.peak) else None
            try:
                strauss, _ = fit_strauss(mapped.points, mapped.window, radii, at)
                planted = replace(ground, layout="strauss", strauss=strauss)
                if strauss.gamma < WEAK:
                    yield mapped.judge("strauss", estimate, planted)
            except ValueError:  # no tree clear of the border; a core too wide to be drawn
                continue
