"""Trees in groups: inhomogeneous Neyman-Scott processes.

Centres of groups are a homogeneous Poisson process of κ a square metre, also around the field; each group
scatters its trees about its centre by a normal law (Thomas 1949) or evenly within a disc (Matérn 1960).
Every tree stays with chance λ(x)/max λ, so that their mean is the planting's intensity λ and the K function
is that of the homogeneous process (Waagepetersen 2007):

    Thomas: K(r) = πr² + (1 - exp(-r²/4σ²))/κ.
    Matérn: K(r) = πr² + h(r/2R)/κ, h the law of the distance of two points in a disc.
"""

from __future__ import annotations

import numpy as np

from ..spec import Clusters
from .intensity.functions import IntensityError
from .poisson import MAX_POINTS
from .process import Process

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
        share = _within_disc(radius / (2 * clusters.spread))
    return np.asarray(np.pi * radius**2 + share / clusters.groups)


def _within_disc(z: np.ndarray) -> np.ndarray:
    """The chance that two even points of a disc are nearer than z times its diameter."""
    z = np.minimum(z, 1.0)
    root = np.sqrt(1 - z**2)
    bent = (8 * z**2 - 4) * np.arccos(z) - 2 * np.arcsin(z) + 4 * z * root**3 - 6 * z * root
    return np.asarray(2 + bent / np.pi)
