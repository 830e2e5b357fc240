"""Nodes of a sum over echoes: how many each class of them gets, within one budget of errors for all.

``smoothness`` says how far echoes of a class are off between so many nodes; ``nonuniform`` sums them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .smoothness import LEVELS, Smoothness, numbered

FAINTER = 12  # powers of 4 from the mean, by which echoes of a class are told apart
NOISE = 0.12  # of its bound, that what a table is off by comes to; over many it adds up in squares
IN_PHASE = (
    0.25  # the most of it that was found, twice: over echoes of one shape it adds up as it is
)


@dataclass(frozen=True)
class NodePlan:
    """Plan of a sum.

    level : (M,) index of ``LEVELS``, or their number: directly. error : (M,) of the interpolation.

    reducible : Σ of the errors that more nodes would make smaller.
    """

    level: np.ndarray
    error: np.ndarray
    reducible: float


def planned(smooth: Smoothness, budget: float, count: int) -> NodePlan:
    """Nodes by classes and loudness: of all choices whose errors keep to the budget, the one with the fewest.

    A node more is worth it where it takes most off the error for each echo that is evaluated once more: a
    price of the error, the same for all, is raised until the budget is kept (Everett 1963). Errors below the
    floor of a class do not count, since nodes do not change them. Echoes whose table is too rough for what
    was asked are summed directly, the roughest first.
    """
    mean = float(smooth.size.mean())
    size = np.where(smooth.size > 0, smooth.size, np.inf)
    below = np.frexp(mean / size)[1] // 2  # powers of 4 below the mean
    fainter = np.clip(below, -FAINTER, FAINTER)
    pairs, of_echo = numbered(smooth.kind * (2 * FAINTER + 1) + fainter + FAINTER)
    kind = pairs // (2 * FAINTER + 1)
    number = np.bincount(of_echo, minlength=len(pairs))
    scale = np.bincount(of_echo, smooth.scale, minlength=len(pairs))
    reducible = np.where(smooth.errors > smooth.floor[:, None], smooth.errors, 0.0)[kind]
    nodes = number[:, None] * np.append(LEVELS, count)
    errors = np.append(
        np.where(scale[:, None] > 0, scale[:, None] * reducible, 0.0),
        np.zeros((len(kind), 1)),
        axis=1,
    )
    level = _cheapest(nodes, errors, budget * float(smooth.size.sum()))
    left = float(errors[np.arange(len(kind)), level].sum())
    padded = np.append(smooth.errors, np.zeros((len(smooth.errors), 1)), axis=1)
    own = np.where(_too_rough(smooth, budget), len(LEVELS), level[of_echo])
    own = _together(own, count)
    return NodePlan(own, smooth.scale * padded[smooth.kind, own], left)


def _cheapest(nodes: np.ndarray, errors: np.ndarray, budget: float) -> np.ndarray:
    """(C,) levels of the classes, the fewest Σ nodes (C, L) with Σ errors (C, L) of at most the budget."""
    if not budget > 0:
        return errors.argmin(axis=1)
    low, high = -60.0, 60.0  # of the logarithm of the price
    unit = float(nodes[:, 0].sum()) / budget
    rows = np.arange(len(nodes))
    while high - low > 0.05:
        price = (low + high) / 2
        level = (nodes + unit * math.exp(price) * errors).argmin(axis=1)
        if errors[rows, level].sum() <= budget:
            high = price
        else:
            low = price
    cheapest: np.ndarray = (nodes + unit * math.exp(high) * errors).argmin(axis=1)
    return cheapest


def _too_rough(smooth: Smoothness, budget: float) -> np.ndarray:
    """(M,) whether an echo is one of the roughest, without which the others keep to the budget.

    What tables are off by has no common phase: over many echoes it adds up as squares do. Echoes of one
    shape, wherever they come from, are off by the same, and may be in phase: theirs is added up.
    """
    rough = smooth.scale * smooth.floor[smooth.kind]
    allowed = budget * float(smooth.size.sum())
    if IN_PHASE * float(rough.sum()) <= allowed:
        return np.zeros(len(rough), dtype=bool)
    _, of_echo, count = np.unique(smooth.shape, return_inverse=True, return_counts=True)
    of_shape = np.where(count > 1, IN_PHASE, NOISE) * np.bincount(of_echo, rough)
    order = np.argsort(of_shape)
    fine = np.zeros(len(order), dtype=bool)
    fine[order] = np.cumsum(of_shape[order] ** 2) <= allowed**2
    found: np.ndarray = ~fine[of_echo]
    return found


def _together(level: np.ndarray, count: int) -> np.ndarray:
    """Levels (M,), some raised to the next that is used: each that is used has its grid and its transforms,
    which take about as long as the values of ``count`` echoes.
    """
    echoes = np.bincount(level, minlength=len(LEVELS) + 1)[: len(LEVELS)]
    before = np.append(0, np.cumsum(echoes))
    best, last = [0.0], [0]  # of the echoes up to a level, and the level before that is used
    for here, nodes in enumerate(LEVELS):
        costs = [
            best[below] + (nodes * (before[here + 1] - before[below] + count))
            for below in range(here + 1)
        ]
        least = int(np.argmin(costs))
        some = before[here + 1] > 0
        best.append(float(costs[least]) if some else 0.0)
        last.append(least if some else here)
    raised = np.arange(len(LEVELS) + 1)
    above = int(np.flatnonzero(echoes)[-1]) + 1 if before[-1] else 0
    while above > 0:
        raised[last[above] : above] = above - 1
        above = last[above]
    return raised[level]
