"""Poisson processes: an intensity on a rectangular field, the number of trees it expects, exact samples.

∫λ is closed where the intensity knows it, else summed over the cells of a quadtree by Gauss-Legendre
quadrature, with an error that is stated.

Hills are sampled by component: each is a Poisson number of normal points over the whole plane; what falls
outside the field, or a mask, is dropped. By superposition and restriction the rest is exactly the process
on the field (Tanveer et al. 2020a; Kingman, Poisson Processes, ch. 2). Any other intensity is thinned: a
homogeneous process under a true bound in every cell of a quadtree, of which a point stays with chance
λ/bound (Lewis and Shedler 1979). A bound that is violated stops the work, because the sample would be
wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .intensity.functions import (
    Constant,
    Intensity,
    Mask,
    Mixture,
    Product,
    QuadtreeCells,
    Sum,
    refine,
)
from .intensity.surface import IntensityError

CELLS = 20_000  # that the integral of an intensity without a closed form is summed over, at least


@dataclass(frozen=True)
class Integral:
    """A number of trees and how far it may be off; 0 for a closed form."""

    value: float
    error: float = 0.0


@dataclass(frozen=True)
class Process:
    """intensity : λ. low, high : (2,) corners of the field, metres. factor : multiplies λ."""

    intensity: Intensity
    low: np.ndarray
    high: np.ndarray
    factor: float = 1.0

    def at(self, points: np.ndarray) -> np.ndarray:
        """λ (N,) at points (N, 2); zero outside the field."""
        inside = ((points >= self.low) & (points <= self.high)).all(axis=1)
        return np.where(inside, self.factor * self.intensity.at(points), 0.0)

    @cached_property
    def total(self) -> Integral:
        """∫λ over the field."""
        return self.integral(self.low, self.high)

    def integral(self, low: np.ndarray, high: np.ndarray) -> Integral:
        """∫λ over a rectangle; what lies outside the field counts nothing."""
        low, high = np.maximum(low, self.low), np.minimum(high, self.high)
        if (high <= low).any():
            return Integral(0.0)
        closed = self.intensity.closed_integral(low, high)
        found = Integral(closed) if closed is not None else quadrature(self.intensity, low, high)
        return Integral(self.factor * found.value, self.factor * found.error)

    def expected(self, low: np.ndarray | None = None, high: np.ndarray | None = None) -> float:
        """∫λ over a rectangle within the field, by default the whole of it."""
        if low is None and high is None:
            return self.total.value
        return self.integral(
            self.low if low is None else low, self.high if high is None else high
        ).value

    def scaled(self, factor: float) -> Process:
        """λ times a factor."""
        made = replace(self, factor=self.factor * factor)
        total = self.__dict__.get("total")
        if total is not None:  # no need to integrate again
            made.__dict__["total"] = Integral(total.value * factor, total.error * factor)
        return made


def quadrature(intensity: Intensity, low: np.ndarray, high: np.ndarray) -> Integral:
    """∫λ over a rectangle by 3 x 3 Gauss points in every cell of a quadtree.

    The stated error compares with 2 x 2 points: by the sums, which differ where λ bends, and by three
    standard errors of the cells, whose errors are random where an edge of a mask or a pixel crosses them.
    """
    cells = refine(intensity, low, high, 0.0, 1 / CELLS)
    fine, coarse = (_gauss(intensity, cells.low, cells.high, order) for order in (3, 2))
    apart = fine - coarse
    return Integral(
        float(fine.sum()), float(abs(apart.sum()) + 3 * np.sqrt(np.square(apart).sum()))
    )


def _gauss(intensity: Intensity, low: np.ndarray, high: np.ndarray, order: int) -> np.ndarray:
    """(C,) ∫λ over cells by order x order points."""
    places, weights = np.polynomial.legendre.leggauss(order)
    total = np.zeros(len(low))
    middle, half = (low + high) / 2, (high - low) / 2
    for x, wx in zip(places, weights, strict=True):
        for y, wy in zip(places, weights, strict=True):
            total += wx * wy * intensity.at(middle + half * [x, y])
    return total * half.prod(axis=1)


MAX_POINTS = 20_000_000
SPARE = 32.0  # candidates that a cell may waste; cutting it costs about as much
ROUNDING = 1e-9  # room above a bound for the rounding of sums and products
MAX_ROUND = 4_000_000  # candidates drawn at once where a number of points is wanted
WASTE = 10.0  # points drawn by component over points kept, above which cells are the better way


class BoundViolation(IntensityError):
    """λ was larger than its bound: the sample would not be exact."""


@dataclass(frozen=True)
class _Components:
    """λ = (constant + hills) within masks."""

    constant: float
    hills: Mixture
    masks: tuple[Mask, ...]


def sample(process: Process, rng: np.random.Generator, exactly: int | None = None) -> np.ndarray:
    """Points (N, 2) of the process; N is Poisson with mean ∫λ, or ``exactly`` that many, each with
    density λ/∫λ.

    Raises
    ------
    IntensityError : more than ``MAX_POINTS`` points would be drawn; says how many. λ is zero everywhere,
    and some are wanted. λ is negative or not a number somewhere; says where.
    BoundViolation : λ exceeds its own bound; says where and by how much.
    """
    wanted = process.expected() if exactly is None else float(exactly)
    if not wanted <= MAX_POINTS:
        raise IntensityError(
            f"the intensity asks for {wanted:,.0f} trees, more than {MAX_POINTS:,}; "
            "lower the peaks or the expected number"
        )
    if exactly and process.expected() <= 0:
        raise IntensityError(f"{exactly} trees cannot stand where the intensity is zero; raise it")
    components = _components(process.intensity, process.factor)
    if components is not None:
        area = float(np.prod(process.high - process.low))
        drawn = components.constant * area + components.hills.whole().sum()
        if drawn <= max(WASTE * process.expected(), 1e5):
            if exactly is None:
                return _by_component(components, process, rng)
            return _repeat(lambda n: _components_of(components, process, n, rng), exactly)
    intensity = Product((process.intensity,), process.factor)
    cells = refine(intensity, process.low, process.high, SPARE)
    cells = cells.select(cells.upper > 0)
    if exactly is None:
        counts = rng.poisson(cells.upper * (1 + ROUNDING) * cells.area)
        return _thin(intensity, cells, np.repeat(np.arange(len(cells)), counts), rng)
    chance = np.cumsum(cells.upper * cells.area)
    chance /= chance[-1]

    def more(count: int) -> np.ndarray:
        return _thin(intensity, cells, np.searchsorted(chance, rng.random(count), "right"), rng)

    return _repeat(more, exactly)


def _by_component(
    components: _Components, process: Process, rng: np.random.Generator
) -> np.ndarray:
    flat = components.constant * float(np.prod(process.high - process.low))
    clouds = [rng.uniform(process.low, process.high, (rng.poisson(flat), 2))]
    hills = components.hills
    for mean, centre, width in zip(hills.whole(), hills.centre, hills.width, strict=True):
        clouds.append(_hill(centre, width, rng.poisson(mean), rng))
    return _within(np.concatenate(clouds), components, process)


def _components_of(
    components: _Components, process: Process, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Those of ``count`` independent points of the mixture that lie within, in random order."""
    flat = components.constant * float(np.prod(process.high - process.low))
    share = np.cumsum([flat, *components.hills.whole()])
    which = np.searchsorted(share / share[-1], rng.random(count), "right")
    points = rng.uniform(process.low, process.high, (count, 2))
    for k, (centre, width) in enumerate(
        zip(components.hills.centre, components.hills.width, strict=True)
    ):
        mine = which == k + 1
        points[mine] = _hill(centre, width, int(mine.sum()), rng)
    return _within(points, components, process)


def _hill(
    centre: np.ndarray, width: np.ndarray, count: int, rng: np.random.Generator
) -> np.ndarray:
    points = rng.standard_normal((count, 2))
    points *= width / np.sqrt(2)
    points += centre
    return points


def _within(points: np.ndarray, components: _Components, process: Process) -> np.ndarray:
    x, y = points.T
    (x0, y0), (x1, y1) = process.low, process.high
    points = points[(x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)]
    for mask in components.masks:
        points = points[mask.at(points) > 0]
    return points


def _thin(
    intensity: Intensity, cells: QuadtreeCells, cell: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Candidates, one in each cell of ``cell`` (M,), thinned to λ over their bound."""
    points = rng.random((len(cell), 2))
    points *= (cells.high - cells.low)[cell]
    points += cells.low[cell]
    np.minimum(points, cells.high[cell], out=points)  # rounding must not leave the cell
    value, bound = intensity.at(points), (cells.upper * (1 + ROUNDING))[cell]
    bad = ~((value >= 0) & (value <= bound))
    if bad.any():
        k = int(np.argmax(bad))
        x, y = points[k].tolist()
        if value[k] > bound[k]:
            raise BoundViolation(
                f"the intensity at ({x:.6g}, {y:.6g}) is {value[k]:.6g} trees/m², above its bound of "
                f"{bound[k]:.6g}; its bounds() is wrong, so no sample would be exact"
            )
        raise IntensityError(
            f"the intensity at ({x:.6g}, {y:.6g}) is {value[k]:g} trees/m²; it must be 0 or larger"
        )
    return points[rng.random(len(cell)) * bound < value]


def _repeat(draw: Callable[[int], np.ndarray], exactly: int) -> np.ndarray:
    """The first ``exactly`` points of independent draws."""
    parts, have, drawn = [np.empty((0, 2))], 0, 0
    while have < exactly:
        kept = max(have, 1) / max(drawn, 1)
        count = int(min(1.1 * (exactly - have) / kept, MAX_ROUND)) + 64
        parts.append(draw(count))
        have, drawn = have + len(parts[-1]), drawn + count
    return np.concatenate(parts)[:exactly]


def _components(intensity: Intensity, factor: float) -> _Components | None:
    """λ as hills and a constant within masks; None where it is something else."""
    none = Mixture(np.empty(0), np.empty((0, 2)), np.empty((0, 2)))
    if isinstance(intensity, Constant):
        return _Components(factor * intensity.value, none, ())
    if isinstance(intensity, Mixture):
        return _Components(
            0.0, Mixture(factor * intensity.peak, intensity.centre, intensity.width), ()
        )
    if isinstance(intensity, Sum):
        found = [_components(part, factor) for part in intensity.parts]
        plain = [part for part in found if part is not None and not part.masks]
        if len(plain) < len(found):
            return None
        hills = [part.hills for part in plain] or [none]
        joined = Mixture(
            *(np.concatenate([getattr(h, n) for h in hills]) for n in ("peak", "centre", "width"))
        )
        return _Components(sum(part.constant for part in plain), joined, ())
    if isinstance(intensity, Product):
        masks = tuple(part for part in intensity.parts if isinstance(part, Mask))
        others = [part for part in intensity.parts if not isinstance(part, Mask)]
        if len(others) != 1:
            return None
        inner = _components(others[0], factor * intensity.factor)
        return (
            None if inner is None else _Components(inner.constant, inner.hills, inner.masks + masks)
        )
    return None
