"""Loads on stems in a stand: the largest turning moment within an hour and how far gusts exceed the mean."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.sway.beams import wood_of_species
from forest_addon.growth.sway.shape import SwayShape
from forest_addon.stand.wind.response import SwayResponse

from ..comparison import Comparison, Interval
from .grown import MeasuredSway, strain, tip_motion

TURNING = 111.7  # kg/m³: the moment over diameter² height speed²
HOUR = np.arange(0.0, 3600.0, 0.5)
LEAF_AREA_INDEX = 4.0


def of_loads(
    trees: Sequence[MeasuredSway],
    shapes: Sequence[SwayShape],
    responses: Sequence[SwayResponse],
    speed: float,
) -> list[Comparison]:
    """Turning moments, gust factors and sway of the tops of conifers in a stand of their like.

    responses : to wind of a speed at the tops, m/s.
    """
    peak, gust, published, lean, sway = [], [], [], [], []
    for tree, shape, response in zip(trees, shapes, responses, strict=True):
        moment = np.linalg.norm(turning_moments(tree, shape, response), axis=1)
        steady = np.linalg.norm(moment_of(tree, shape, response.mean))
        peak.append(moment.max() / (TURNING * tree.dbh**2 * tree.height * speed**2))
        gust.append(moment.max() / steady)
        apart = np.sqrt(2 * shape.leafy.sum() / LEAF_AREA_INDEX) / tree.height
        published.append(gust_factor(apart))
        tops = tip_motion(shape, response, HOUR)
        lean.append(100 * np.linalg.norm(tops.mean(axis=0)) / tree.height)
        sway.append(100 * np.sqrt(tops.var(axis=0).sum()) / tree.height)
    ours, gusts = Interval.of(np.array(peak)), Interval.of(np.array(gust))
    words = (
        f"{len(peak)} conifers at {speed:g} m/s at the tops, one hour each, nothing fitted. 1: the "
        "regression of Hale et al. 2012 on conifers of British stands, its figure as ForestGALES has it "
        "(Locatelli et al. 2022), R² 0.95."
    )
    return [
        Comparison(
            "largest turning moment of conifers within an hour, over 111.7 dbh² h U²",
            "",
            Interval(1.0),
            ours,
            ours.meets(Interval(1.0)),
            words,
        ),
        Comparison(
            "largest turning moment within an hour over the mean one",
            "",
            Interval.of(np.array(published)),
            gusts,
            None,
            "Measured: of wind tunnel and field by spacing over height (Gardiner et al. 1997), deep in a "
            "stand. Ours are of normal gusts; those over real canopies are skewed.",
        ),
        Comparison(
            f"mean lean of conifers' tops at {speed:g} m/s",
            "% of the height",
            None,
            Interval.of(np.array(lean)),
            None,
        ),
        Comparison(
            f"sway of conifers' tops about it at {speed:g} m/s, deviation",
            "% of the height",
            None,
            Interval.of(np.array(sway)),
            None,
        ),
    ]


def gust_factor(spacing: float) -> float:
    """Largest over mean turning moment deep in a stand, by its trees' spacing over their height (Gardiner et
    al.
    1997, as ForestGALES has it, from nine heights on)."""
    s = float(np.clip(spacing, 0.075, 0.45))
    most = 2.7193 * s - 0.061 + (-1.273 * s + 0.9701) * (1.1127 * s + 0.0311) ** 9
    return most / (0.68 * s - 0.0385 + (-0.68 * s + 0.4785) * (1.7239 * s + 0.0316) ** 9)


def turning_moments(tree: MeasuredSway, shape: SwayShape, response: SwayResponse) -> np.ndarray:
    """(T, 2) bending moments of the stem's foot over an hour, N m."""
    return strain(shape, response, HOUR) * _stiffness(tree, shape)


def moment_of(tree: MeasuredSway, shape: SwayShape, amplitude: np.ndarray) -> np.ndarray:
    """(2,) bending moment of the stem's foot at amplitudes (M,), N m."""
    low, high = shape.ends
    length = float(np.linalg.norm(shape.members.end[0] - shape.members.start[0]))
    return np.asarray(amplitude @ (high - low)[0, :, 3:5] / length * _stiffness(tree, shape))


def _stiffness(tree: MeasuredSway, shape: SwayShape) -> float:
    """Bending stiffness of the stem's foot, N m²."""
    species, _ = load_species(find_species(tree.stand_in, Path()))
    wood, radius = wood_of_species(species), float(shape.members.radius[0].mean())
    return wood.modulus * np.pi / 4 * (wood.inside * radius) ** 4
