"""Positions of trees: mapped stands against stands drawn anew from processes that were fitted to them.

The L function of a map is held to the global envelope (5 %) of 39 stands of the same law: Poisson, of one
intensity or one that goes with covariates, groups (Thomas), and repulsion (Strauss). The law whose envelope
leaves the map least far out is shown.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from ..inside import (
    FAINT,
    INK,
    LEAF_GREEN,
    RED,
    SIMULATIONS,
    Constant,
    Envelope,
    Process,
    RasterIntensity,
    Window,
    blank_figure,
    envelope,
    fit_clusters,
    fit_strauss,
    inhomogeneous_k,
    read_tree_map,
    sample,
    sample_clusters,
    sample_strauss,
    save_figure,
    stream,
)
from .run import Comparison, Interval, Picture

TITLE = "Stands: where trees stand"
SUMMARY = """\
Measured: four maps of trees from the R package spatstat.data: *Beilschmiedia* on Barro Colorado (bei, with
its terrain), longleaf pines, young Finnish pines and Norway spruces. *Simpler model* is a Poisson
process; *simulated* the process that serves best. Values are L(r) - r at the radius where
the map strays farthest from it, with the global 5 % envelope of 39 drawn stands.
"""
TERMS = """\
What is fitted to a map and then drawn is held to the same map, by the very statistic that groups are fitted
by: to lie inside says that the process can serve, not that it is the cause. Intensities are not estimated
again from each drawn stand, which makes the test somewhat lenient. `[[plantings]] layout = "clusters"` and
`"strauss"` plant these.
"""


@dataclass(frozen=True)
class Map:
    """A mapped stand: corners of its window, the largest radius, and what is known of it."""

    name: str
    low: tuple[float, float]
    high: tuple[float, float]
    reach: float
    words: str


MAPS = (
    Map("bei", (0, 0), (1000, 500), 60, "3,604 trees on terrain"),
    Map("longleaf", (0, 0), (200, 200), 30, "584 pines of all ages"),
    Map("finpines", (-5, -8), (5, 2), 2.5, "126 young pines"),
    Map("spruces", (0, 0), (56, 38), 9, "134 spruces of a tended stand"),
)
# Its name, what was fitted, its intensity, and what draws trees by it.
Law = tuple[str, str, Process, Callable[[np.random.Generator], np.ndarray]]


@dataclass(frozen=True)
class Judged:
    """A law's name and what was fitted, in words, and the map's L(r) - r in its envelope."""

    name: str
    words: str
    excess: Envelope


def validate(data: Path, out: Path, arguments: argparse.Namespace) -> list[Comparison]:
    """A row a map, and one picture of all."""
    found, drawn = [], []
    for stand in MAPS:
        points = read_tree_map(data / "stands" / f"{stand.name}.csv").position
        radius = np.linspace(stand.reach / 40, stand.reach, 40)
        covariates = terrain(data / "stands" / "bei_terrain.npz") if stand.name == "bei" else None
        laws = judge(stand, points, radius, covariates, arguments.seed)
        best = max(laws, key=lambda law: (law.excess.p_value, -_strays(law.excess).max()))
        drawn.append((stand, radius, laws[0], best))
        found.append(_row(stand, radius, laws, best))
    picture = Picture(
        _draw(drawn, out / "stand.png"),
        "L(r) - r of the maps (black) in the global 5 % envelopes of a Poisson process (grey) and of the "
        "process that serves best (green): above 0 trees keep company, below 0 they keep apart.",
    )
    return [*found[:-1], replace(found[-1], pictures=(picture,))]


def terrain(path: Path) -> np.ndarray:
    """(2, rows, columns) elevation and slope of the pixels between the corners of a grid of heights."""
    with np.load(path) as kept:
        height, x, y = kept["elevation_m"], kept["x_m"], kept["y_m"]
    along_y, along_x = np.gradient(height, y, x)
    return np.stack([_between(height), _between(np.hypot(along_x, along_y))])


def judge(
    stand: Map, points: np.ndarray, radius: np.ndarray, covariates: np.ndarray | None, seed: int
) -> list[Judged]:
    """The map under each law, Poisson of one intensity first."""
    window = Window.rectangle(stand.low, stand.high)
    process = even = Process(Constant(len(points) / window.area), window.low, window.high)
    laws: list[Law] = [("Poisson", "", even, partial(sample, even))]
    prefix = ""
    if covariates is not None:
        fit = fit_covariates(points, covariates, window)
        rate = RasterIntensity(fit.pixels[::-1].copy(), window.low, window.extent, "terrain")
        process, prefix = Process(rate, window.low, window.high), "terrain, "
        terms = ", ".join(
            f"{b:.3g} ± {1.96 * e:.2g}"
            for b, e in zip(fit.coefficient[1:], fit.error[1:], strict=True)
        )
        words = f"log λ by elevation and slope: {terms}"
        laws.append(("terrain", words, process, partial(sample, process)))
    k = inhomogeneous_k(points, process.at(points), window, radius)
    if (k.l_function > radius).any():
        groups = fit_clusters(k)
        words = f"{groups.groups * 1e4:.3g} groups/ha, σ = {groups.spread:.3g} m"
        draw = partial(sample_clusters, process, groups)
        laws.append((prefix + "clusters", words, process, draw))
    if covariates is None:
        strauss, _ = fit_strauss(points, window, np.linspace(0.05, 0.6, 12) * stand.reach)
        if strauss.gamma < 0.95:
            words = f"R = {strauss.radius:.3g} m, γ = {strauss.gamma:.2g}"
            laws.append(("strauss", words, process, partial(sample_strauss, process, strauss)))
    return [_under(law, points, window, radius, seed) for law in laws]


def _under(law: Law, points: np.ndarray, window: Window, radius: np.ndarray, seed: int) -> Judged:
    name, words, process, draw = law

    def excess(trees: np.ndarray) -> np.ndarray:
        k = inhomogeneous_k(trees, process.at(trees), window, radius)
        return np.asarray(k.l_function - radius)

    drawn = [excess(draw(stream(seed, "validate stand", name, n))) for n in range(SIMULATIONS)]
    return Judged(name, words, envelope(excess(points), np.array(drawn)))


def _between(corners: np.ndarray) -> np.ndarray:
    return (corners[1:, 1:] + corners[1:, :-1] + corners[:-1, 1:] + corners[:-1, :-1]) / 4


def _strays(excess: Envelope) -> np.ndarray:
    """(R,) distances of a map from the mean of a law, in the law's global reach."""
    half = np.maximum(excess.global_high - excess.mean, 1e-300)
    return np.asarray(np.abs(excess.observed - excess.mean) / half)


def _row(stand: Map, radius: np.ndarray, laws: list[Judged], best: Judged) -> Comparison:
    k = int(np.argmax(_strays(best.excess)))
    said = "; ".join(
        f"{law.name}{f' ({law.words})' if law.words else ''} p = {law.excess.p_value:.3g}"
        for law in laws
    )
    return Comparison(
        f"{stand.name}, L - r at {radius[k]:.3g} m by {best.name}",
        "m",
        Interval(float(best.excess.observed[k])),
        _interval(best.excess, k),
        best.excess.inside,
        words=f"{stand.words}: {said}.",
        before=_interval(laws[0].excess, k) if best is not laws[0] else None,
    )


def _interval(excess: Envelope, k: int) -> Interval:
    low, high = float(excess.global_low[k]), float(excess.global_high[k])
    return Interval(float(excess.mean[k]), low, high)


def _draw(drawn: list[tuple[Map, np.ndarray, Judged, Judged]], path: Path) -> Path:
    figure = blank_figure((11, 3.0))
    for number, (stand, radius, plain, best) in enumerate(drawn):
        axes = figure.add_subplot(1, len(drawn), number + 1)
        for law, colour in ((plain, FAINT), (best, LEAF_GREEN)):
            e = law.excess
            axes.fill_between(
                radius, e.global_low, e.global_high, color=colour, alpha=0.5, lw=0, label=law.name
            )
        inside = best.excess.inside
        axes.plot(radius, best.excess.observed, color=INK if inside else RED, label="map")
        axes.set(title=f"{stand.name}, p = {best.excess.p_value:.2g}", xlabel="r, m")
        axes.legend(fontsize=7)
        if number == 0:
            axes.set_ylabel("L(r) - r, m")
    return save_figure(figure, path)


# An intensity from rasters of covariates: log λ(x) = b₀ + Σ b_k z_k(x), by maximum likelihood.
#
# Trees are counted in the pixels of the covariates, and λ is even within one: Poisson regression, solved by
# Newton's steps (Berman & Turner 1992 with pixels as quadrature). Rows of rasters go from south to north.


STEPS = 50
DONE = 1e-10


@dataclass(frozen=True)
class LogLinear:
    """coefficient, error : (K + 1,) b and standard errors, by a Poisson process's information.

    pixels : (rows, columns) λ, trees/m², row 0 in the south.
    """

    coefficient: np.ndarray
    error: np.ndarray
    pixels: np.ndarray
    window: Window

    def at(self, points: np.ndarray) -> np.ndarray:
        """λ (N,) at points (N, 2): that of their pixel."""
        return np.asarray(self.pixels[_pixel(points, self.window, self.pixels.shape)])


def fit_covariates(points: np.ndarray, covariates: np.ndarray, window: Window) -> LogLinear:
    """λ of points (N, 2) from covariates (K, rows, columns) over the whole rectangle of the window.

    Raises
    ------
    ValueError : covariates that say the same, or one that is the same everywhere.
    """
    number, *shape = covariates.shape
    z = covariates.reshape(number, -1)
    middle, spread = z.mean(axis=1), z.std(axis=1)
    design = np.vstack([np.ones(z.shape[1]), (z - middle[:, None]) / spread[:, None]])
    if not np.isfinite(design).all() or np.linalg.matrix_rank(design @ design.T) <= number:
        raise ValueError(
            "the covariates do not differ from each other or from a constant; drop one"
        )
    row, column = _pixel(points, window, tuple(shape))
    count = np.bincount(row * shape[1] + column, minlength=z.shape[1])
    area = window.area / z.shape[1]
    b = np.zeros(number + 1)
    b[0] = np.log(max(len(points), 1) / window.area)
    for _ in range(STEPS):
        mean = area * np.exp(design.T @ b)
        information = (design * mean) @ design.T
        step = np.linalg.solve(information, design @ (count - mean))
        b += np.clip(step, -1, 1)
        if np.abs(step).max() < DONE:
            break
    error = np.sqrt(np.diag(np.linalg.inv(information)))
    pixels = np.exp(design.T @ b).reshape(shape)
    slope = b[1:] / spread
    return LogLinear(
        coefficient=np.concatenate([[b[0] - slope @ middle], slope]),
        error=np.concatenate([[error[0]], error[1:] / spread]),
        pixels=pixels,
        window=window,
    )


def _pixel(
    points: np.ndarray, window: Window, shape: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = shape
    place = ((points - window.low) / window.extent * [columns, rows]).astype(int)
    column, row = np.clip(place, 0, [columns - 1, rows - 1]).T
    return row, column
