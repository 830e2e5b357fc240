"""Clusters and repulsion estimated from a map: minimum contrast, and the pseudolikelihood.

**Clusters**: κ and the spread that make ∫ (K̂^¼ - K^¼)² dr least (Diggle & Gratton 1984), K̂ the
inhomogeneous K function. **Strauss**: for each radius R on a grid, γ that maximises
Π λ(x_i; x) · exp(-∫λ(u; x) du) with λ(u; x) = β λ(u) γ^t(u) (Besag 1977; Baddeley & Turner 2000), t the
trees nearer than R to u, trees and integral over the window less a border of the largest R. For given γ
the best β is closed; R with the largest pseudolikelihood wins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, minimize_scalar
from scipy.spatial import cKDTree

from ...spec import Clusters, Strauss
from ..layouts import k_of_clusters
from .intensity import Window
from .k_function import At, KFunction

FAINTEST = 100.0  # groups within the largest radius: more add less than 1 % to K
LATTICE = 200  # points along the longer side that the integral is summed over


@dataclass(frozen=True)
class FittedStrauss:
    """strauss : radius and γ. gain : logarithm of the pseudolikelihood above that of Poisson."""

    strauss: Strauss
    gain: float


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
        found = k_of_clusters(k.radius, Clusters(kind=kind, groups=groups, spread=spread))
        return float(np.square(root - found**0.25).sum())

    tries = [
        minimize(contrast, np.log([1 / excess.max(), share * k.radius[-1]]), method="Nelder-Mead")
        for share in (0.05, 0.2, 0.5)
    ]
    best = min(tries, key=lambda found: found.fun)
    groups, spread = bounded(best.x)
    return Clusters(kind=kind, groups=groups, spread=spread)


def fit_strauss(
    points: np.ndarray, window: Window, radii: np.ndarray, intensity: At | None = None
) -> FittedStrauss:
    """Radius (of those given) and γ of points (N, 2) in a window.

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
    best = FittedStrauss(Strauss(radius=border, gamma=1.0), 0.0)
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

        if near:
            found = minimize_scalar(lost, bounds=(-12.0, 0.0), method="bounded")
            log_gamma, gain = float(found.x), -float(found.fun) - plain
        else:
            log_gamma, gain = -np.inf, -len(inner) * np.log(area[0]) - plain
        if gain > best.gain:
            gamma = float(np.exp(log_gamma)) if near else 0.0
            best = FittedStrauss(Strauss(radius=float(radius), gamma=min(gamma, 1.0)), gain)
    return best


def _clear(points: np.ndarray, window: Window, border: float) -> np.ndarray:
    """(N,) bool: whether a circle of this radius about a point lies within the window, by 16 points."""
    clear = window.contains(points)
    for angle in np.arange(16) * np.pi / 8:
        rim = points + border * np.array([np.cos(angle), np.sin(angle)])
        clear &= window.contains(rim)
    return clear
