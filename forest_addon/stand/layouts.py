"""Poisson processes: an intensity on a rectangular field, the number of trees it expects, exact samples.

∫λ is closed where the intensity knows it, else summed over the cells of a quadtree by Gauss-Legendre
quadrature, with an error that is stated.

Hills are sampled by component: each is a Poisson number of normal points over the whole plane; what falls
outside the field, or a mask, is dropped. By superposition and restriction the rest is exactly the process
on the field (Tanveer et al. 2020a; Kingman, Poisson Processes, ch. 2). Any other intensity is thinned: a
homogeneous process under a true bound in every cell of a quadtree, of which a point stays with chance
λ/bound (Lewis and Shedler 1979). A bound that is violated stops the work, because the sample would be
wrong.

Places of trees that are no Poisson process: rows, lists, groups, trees apart, trees set by hand.

**By hand**: what somebody decided, trees set and discs kept free, beside what a planting draws. What is
drawn is drawn as without them, so setting, moving or removing one tree moves no other. A tree set by hand
has a number below 0 (-1 for the first), and its own streams for what its planting does not say.

**Stems**, trees that are cylinders only, are a binomial process: exactly as many as asked for, evenly at
random over the field, as the forests of Kaneko & Gamper (2021); groups of them have streams of their own,
keyed by their number.

**Groups**: inhomogeneous Neyman-Scott processes. Centres of groups are a homogeneous Poisson process of κ a
square metre, also around the field; each group scatters its trees about its centre by a normal law (Thomas
1949) or evenly within a disc (Matérn 1960). Every tree stays with chance λ(x)/max λ, so that their mean is
the planting's intensity λ and the K function is that of the homogeneous process (Waagepetersen 2007):

    Thomas: K(r) = πr² + (1 - exp(-r²/4σ²))/κ.
    Matérn: K(r) = πr² + h(r/2R)/κ, h the law of the distance of two points in a disc.

**Trees apart**: the Strauss process (Strauss 1975), with γ = 0 a hard core.

Its density against a Poisson process is Π β(x_i) · γ^s, s the pairs nearer than R. It is drawn by births
and deaths (Geyer & Møller 1994) in cells at least R wide: cells of one of four colours do not see each
other, so all of a colour take a step at once, each by Metropolis's ratio with |cell| and its own trees.

Trees at the edge of the field would have no neighbours beyond it and be too many (3 % in a hectare), so the
process runs on around the field, with the intensity of the nearest place in it.

A planting says the mean intensity λ, not β. With w = (1 - γ)πR²λ,

    log β = log λ + w + (1 - γ) w² P(w, γ):

λ exp(w) is the Poisson-saddlepoint approximation (Baddeley & Nair 2012), P is fitted to the means of long
runs of this process over 100 R by 100 R, up to βR² = 100 (a hard core: 48).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial.chebyshev import chebval2d

from ..base.rng import stream, truncated_normal
from ..growth.draw import draw_normal
from ..spec import Clearing, Clusters, Forest, Planting, Rows, Stems, Strauss
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
        closed = self.intensity.closed_integral(self.low, self.high)
        whole = (
            quadrature(self.intensity, self.low, self.high) if closed is None else Integral(closed)
        )
        return Integral(self.factor * whole.value, self.factor * whole.error)

    @property
    def expected(self) -> float:
        """∫λ over the whole field."""
        return self.total.value

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


@dataclass(frozen=True)
class _Components:
    """λ = (constant + hills) within masks."""

    constant: float
    hills: Mixture
    masks: tuple[Mask, ...]


def sample(
    process: Process,
    rng: np.random.Generator,
    exactly: int | None = None,
    most: int = MAX_POINTS,
) -> np.ndarray:
    """Points (N, 2) of the process; N is Poisson with mean ∫λ, or ``exactly`` that many, each with
    density λ/∫λ.

    Raises
    ------
    IntensityError : more than ``most`` points would be drawn; says how many. λ is zero everywhere,
    and some are wanted. λ is negative or not a number somewhere, or exceeds its own bound; says where.
    """
    wanted = process.expected if exactly is None else float(exactly)
    if not wanted <= most:
        raise IntensityError(
            f"the intensity asks for {wanted:,.0f} trees, more than {most:,}; "
            "lower the peaks or the expected number"
        )
    if exactly and process.expected <= 0:
        raise IntensityError(f"{exactly} trees cannot stand where the intensity is zero; raise it")
    components = _components(process.intensity, process.factor)
    if components is not None:
        area = float(np.prod(process.high - process.low))
        drawn = components.constant * area + components.hills.whole().sum()
        if drawn <= max(WASTE * process.expected, 1e5):
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
    points = np.concatenate(clouds) if len(clouds) > 1 else clouds[0]
    return _within(points, components, process)


def _components_of(
    components: _Components, process: Process, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Points within the field out of ``count`` independent ones of the mixture, in random order."""
    flat = components.constant * float(np.prod(process.high - process.low))
    share = np.cumsum([flat, *components.hills.whole()])
    which = np.searchsorted(share / share[-1], rng.random(count), "right")
    points = rng.uniform(process.low, process.high, (count, 2))
    for k, (centre, width) in enumerate(
        zip(components.hills.centre, components.hills.width, strict=True)
    ):
        of_hill = which == k + 1
        points[of_hill] = _hill(centre, width, int(of_hill.sum()), rng)
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
    inside = (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
    points = points if inside.all() else points[inside]
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
            raise IntensityError(
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
        components = [_components(part, factor) for part in intensity.parts]
        plain = [part for part in components if part is not None and not part.masks]
        if len(plain) < len(components):
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


def orchard(rows: Rows, low: np.ndarray, high: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Places (N, 2) of an orchard's trees, row by row (Méndez et al.); not cut to the field.

    Raises
    ------
    IntensityError : more than ``MAX_POINTS`` places; says how many.
    """
    heading = np.deg2rad(rows.heading_deg)
    along = np.array([np.cos(heading), np.sin(heading)])
    right = np.array([along[1], -along[0]])
    start = low + np.array(rows.start)
    corners = np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])]) - start
    first, last = _numbers(rows.rows, rows.row_spacing, corners @ right)
    begin, end = _numbers(rows.trees, rows.tree_spacing, corners @ along)
    count = max(0, last - first) * max(0, end - begin)
    if count > MAX_POINTS:
        raise IntensityError(
            f"the orchard has {count:,} places, more than {MAX_POINTS:,}; widen its spacings"
        )
    row, tree = np.divmod(np.arange(count), max(1, end - begin))
    places = (
        start
        + np.outer((first + row) * rows.row_spacing, right)
        + np.outer((begin + tree) * rows.tree_spacing, along)
    )
    return places + rows.jitter * np.column_stack(
        [truncated_normal(rng, count), truncated_normal(rng, count)]
    )


def _numbers(wanted: int, spacing: float, reach: np.ndarray) -> tuple[int, int]:
    """First and last number within the field, or as many as wanted from 0 on."""
    if wanted:
        return 0, wanted
    tidy = 1e-9  # a row on the very edge of the field counts
    return (
        int(np.ceil(reach.min() / spacing - tidy)),
        int(np.floor(reach.max() / spacing + tidy)) + 1,
    )


def told_of(planting: Planting, numbers: np.ndarray, name: str) -> np.ndarray:
    """(M,) what trees set by hand, by their numbers (M,), say of themselves; NaN where nothing."""
    values = [getattr(tree, name) for tree in planting.by_hand]
    told = np.array([np.nan if value is None else value for value in values], dtype=float)
    return np.asarray(told[-1 - numbers])


def is_cleared(place: np.ndarray, clearings: Sequence[Clearing]) -> np.ndarray:
    """(N,) bool, which places (N, 2) lie within a clearing, its edge included."""
    cleared = np.zeros(len(place), dtype=bool)
    for disc in clearings:
        apart = place - np.array(disc.position)
        cleared |= (apart**2).sum(axis=1) <= disc.radius**2
    return cleared


def plant_stems(
    seed: int, forest: Forest, groups: Sequence[Stems]
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (N, 2) and radii (N,) in metres of all groups."""
    positions, radii = [np.empty((0, 2))], [np.empty(0)]
    low = np.array(forest.origin)
    for number, group in enumerate(groups):
        place = stream(seed, "stems", number, "place")
        positions.append(place.uniform(low, low + forest.size, (group.count, 2)))
        keys = stream(seed, "stems", number, "radius").integers(2**63, size=group.count)
        radii.append(draw_normal(group.radius, keys.astype(np.uint64), "radius"))
    return np.concatenate(positions), np.concatenate(radii)


REACH = 6.0  # deviations beyond which no tree of a group is looked for: 1e-8 of them


def sample_clusters(process: Process, clusters: Clusters, rng: np.random.Generator) -> np.ndarray:
    """Points (N, 2) of the process on its field; their mean intensity is λ.

    Raises
    ------
    IntensityError : more groups or trees than can be drawn; says how many.
    """
    highest = process.factor * float(
        process.intensity.bounds(process.low[None], process.high[None])[1][0]
    )
    margin = clusters.spread * (REACH if clusters.kind == "thomas" else 1.0)
    low, high = process.low - margin, process.high + margin
    area = float(np.prod(high - low))
    for what, count in (("groups", clusters.groups * area), ("trees", highest * area)):
        if not count <= MAX_POINTS:
            raise IntensityError(
                f"clusters would draw {count:,.0f} {what}, more than {MAX_POINTS:,}; lower the peaks "
                "of the intensity, or groups"
            )
    centre = low + (high - low) * rng.random((rng.poisson(clusters.groups * area), 2))
    trees = np.repeat(centre, rng.poisson(highest / clusters.groups, len(centre)), axis=0)
    if clusters.kind == "thomas":
        trees = trees + clusters.spread * rng.standard_normal(trees.shape)
    else:
        away, angle = np.sqrt(rng.random(len(trees))), 2 * np.pi * rng.random(len(trees))
        trees = trees + clusters.spread * np.stack(
            [away * np.cos(angle), away * np.sin(angle)], axis=1
        )
    kept = rng.random(len(trees)) * highest < process.at(trees)
    return np.asarray(trees[kept])


def k_of_clusters(radius: np.ndarray, clusters: Clusters) -> np.ndarray:
    """K (R,) at radii, m²."""
    if clusters.kind == "thomas":
        share = -np.expm1(-((radius / (2 * clusters.spread)) ** 2))
    else:
        z = np.minimum(radius / (2 * clusters.spread), 1.0)
        root = np.sqrt(1 - z**2)
        bent = (8 * z**2 - 4) * np.arccos(z) - 2 * np.arcsin(z) + 4 * z * root**3 - 6 * z * root
        share = (
            2 + bent / np.pi
        )  # that two even points of a disc are nearer than z times its diameter
    return np.asarray(np.pi * radius**2 + share / clusters.groups)


Activity = Callable[[np.ndarray], np.ndarray]
EDGE = 3.0  # radii around the field that are run too and cut off: trees at its edge have neighbours
SWEEPS = 100  # steps of each cell for each tree that it may hold
DENSEST = (  # γ, and w that is known there; a hard core's is 0.6 trees in R² (random packing: 0.70)
    (0.0, 0.001, 0.01, 0.03, 0.1, 0.3, 0.6, 0.8, 0.9, 0.95, 0.99, 1.0),
    (1.885, 1.95, 2.2, 2.4, 2.8, 3.17, 3.2, 2.9, 2.47, 2.0, 1.05, 0.0),
)
WIDEST = 3.3  # w as far as P is fitted
P = np.array(  # Chebyshev polynomials of 2w/3.3 - 1, down, and of 2 γ^{1/4} - 1, across
    [
        [0.4555, -0.3872, 0.1773, -0.0433, 0.0095, 0.0320],
        [0.1188, -0.4439, 0.2322, -0.2607, 0.1462, -0.1242],
        [0.0872, -0.1312, 0.2042, -0.0752, 0.0194, 0.0408],
        [-0.0212, -0.0175, 0.0251, -0.1079, 0.0749, -0.0562],
    ]
)
FAR = 1e150  # where a place of the table without a tree is
MOST_CELLS = 2_000_000
RIGHT, UP = np.repeat([0, 1, 2], 3), np.tile([0, 1, 2], 3)  # a cell and its neighbours in the table


def sample_strauss(process: Process, strauss: Strauss, rng: np.random.Generator) -> np.ndarray:
    """Points (N, 2) of the process on its field, whose mean intensity is λ within 1 %.

    Raises
    ------
    IntensityError : more trees than keep apart so far, or more cells than can be held.
    """
    highest = process.factor * float(
        process.intensity.bounds(process.low[None], process.high[None])[1][0]
    )
    repelled = (1 - strauss.gamma) * np.pi * highest
    densest = float(np.interp(strauss.gamma, *DENSEST))
    if repelled * strauss.radius**2 > densest:
        raise IntensityError(
            f"{highest:g} trees/m² cannot keep {strauss.radius:g} m apart with gamma = "
            f"{strauss.gamma:g}; lower the intensity, raise gamma or make radius at most "
            f"{np.sqrt(densest / repelled):.3g} m"
        )

    def activity(points: np.ndarray) -> np.ndarray:
        inside = np.clip(points, process.low, process.high)
        return activity_of(process.at(inside), strauss)

    mean = process.expected / float(np.prod(process.high - process.low))
    edge = EDGE * strauss.radius
    trees = run_births_and_deaths(
        activity, mean, process.low - edge, process.high + edge, strauss, rng
    )
    return trees[((trees >= process.low) & (trees < process.high)).all(axis=1)]


def activity_of(intensity: np.ndarray, strauss: Strauss) -> np.ndarray:
    """(N,) β of a mean intensity λ (N,)."""
    free = 1 - strauss.gamma
    w = free * np.pi * strauss.radius**2 * intensity
    more = chebval2d(2 * w / WIDEST - 1, np.full_like(w, 2 * strauss.gamma**0.25 - 1), P)
    return np.asarray(intensity * np.exp(w + free * w**2 * more))


def run_births_and_deaths(
    activity: Activity,
    mean: float,
    low: np.ndarray,
    high: np.ndarray,
    strauss: Strauss,
    rng: np.random.Generator,
) -> np.ndarray:
    """Points (N, 2) of the Strauss process of this β on a rectangle.

    mean : about how many trees a square metre will hold; it says how long to run.
    """
    if mean <= 0:
        return np.empty((0, 2))
    side = max(strauss.radius, 1 / np.sqrt(mean))
    shape = np.maximum(np.floor((high - low) / side), 1).astype(int)
    if shape.prod() > MOST_CELLS:
        raise IntensityError(
            f"{shape.prod():,} cells are more than {MOST_CELLS:,}; make the field smaller"
        )
    table = _Table(low, (high - low) / shape, shape, strauss, activity)
    steps = int(np.ceil(SWEEPS * max(1.0, mean * float(np.prod((high - low) / shape)))))
    for _ in range(steps):
        for column in (0, 1):
            for row in (0, 1):
                column_of, row_of = np.mgrid[column : shape[0] : 2, row : shape[1] : 2]
                table.step(column_of.ravel(), row_of.ravel(), rng)
    return table.points()


class _Table:
    """Trees by cell: ``place`` (columns + 2, rows + 2, room, 2) and how many of them are there."""

    def __init__(
        self,
        low: np.ndarray,
        cell: np.ndarray,
        shape: np.ndarray,
        strauss: Strauss,
        activity: Activity,
    ) -> None:
        self.low, self.cell, self.area = low, cell, float(np.prod(cell))
        self.near, self.gamma, self.activity = strauss.radius**2, strauss.gamma, activity
        self.place = np.full((*(shape + 2), 8, 2), FAR)
        self.count = np.zeros(shape + 2, np.int64)

    def points(self) -> np.ndarray:
        """(N, 2) all trees."""
        there = np.arange(self.place.shape[2]) < self.count[:, :, None]
        return self.place[there]

    def step(self, column: np.ndarray, row: np.ndarray, rng: np.random.Generator) -> None:
        """A birth or a death in every one of these cells, of which no two are neighbours."""
        birth, chance = rng.random(len(column)) < 0.5, rng.random(len(column))
        self._bear(column[birth], row[birth], chance[birth], rng)
        some = ~birth & (self.count[column + 1, row + 1] > 0)
        self._fell(column[some], row[some], chance[some], rng)

    def _bear(
        self, column: np.ndarray, row: np.ndarray, chance: np.ndarray, rng: np.random.Generator
    ) -> None:
        born = self.low + (np.stack([column, row], axis=1) + rng.random((len(row), 2))) * self.cell
        count = self.count[column + 1, row + 1]
        ratio = self._density(born, column, row, 0) * self.area / (count + 1)
        take = chance < ratio
        column, row, born, count = column[take], row[take], born[take], count[take]
        if len(count) and count.max() >= self.place.shape[2]:
            more = np.full_like(self.place, FAR)
            self.place = np.concatenate([self.place, more], axis=2)
        self.place[column + 1, row + 1, count] = born
        self.count[column + 1, row + 1] += 1

    def _fell(
        self, column: np.ndarray, row: np.ndarray, chance: np.ndarray, rng: np.random.Generator
    ) -> None:
        count = self.count[column + 1, row + 1]
        which = (rng.random(len(count)) * count).astype(np.int64)
        tree = self.place[column + 1, row + 1, which]
        density = self._density(tree, column, row, 1) * self.area
        take = chance * density < count
        column, row, which, last = column[take] + 1, row[take] + 1, which[take], count[take] - 1
        self.place[column, row, which] = self.place[column, row, last]
        self.place[column, row, last] = FAR
        self.count[column, row] = last

    def _density(
        self, points: np.ndarray, column: np.ndarray, row: np.ndarray, itself: int
    ) -> np.ndarray:
        """β(x) γ^t of points (M, 2), t the others nearer than R."""
        most = int(self.count.max(initial=0))
        around = self.place[column[:, None] + RIGHT, row[:, None] + UP, :most]
        x, y = (around[..., axis] - points[:, None, None, axis] for axis in (0, 1))
        near = (x * x + y * y < self.near).sum(axis=(1, 2)) - itself
        return np.asarray(self.activity(points) * float(self.gamma) ** near)
