"""Axes of a joined tree: which slices of it follow one another as a trunk or a branch.

At a fork the axis goes on as the child that is thickest and straightest a few radii on, where slices
are clean of the fork itself; the others begin axes of their own. What ends before it is three times as
long as thick, or within its parent's bark, is a bump and no branch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .levels import Slices

NEAR, FAR = 1.0, 4.0  # radii beyond a fork between which a child is judged
SLENDER = 3.0  # radii that a branch is long at least
CLEAR = 0.5  # radii of its parent that it reaches beyond the fork at least
SHORTEST = 4  # bands
MOST_STEPS = 200  # bands looked ahead
STRAIGHT = 1.0  # weight of straightness against thickness


@dataclass(frozen=True)
class PieceAxes:
    """A axes of sliced pieces; an axis comes after its parent.

    of_slice : (S,) axis of each slice. parent : (A,) axis it begins on, -1 for that of a root.
    fork : (A,) slice of the parent that it begins on, -1.
    radius : (S,) root mean square distance of the surface from the axis.
    chain : (S,) whether a slice is on its axis, and no bump beside it.
    """

    of_slice: np.ndarray
    mother: np.ndarray
    fork: np.ndarray
    radius: np.ndarray
    chain: np.ndarray

    def __len__(self) -> int:
        return len(self.mother)


def find_axes(slices: Slices) -> PieceAxes:
    """Follow the slices of all pieces from their roots to the tips."""
    mass, top = _carried(slices)
    onward = _heaviest(slices, mass)
    radius = radii(slices, onward)
    kid, fork = _daughters(slices)
    reach = (top[kid] - slices.band[fork]) * slices.width
    own = _walk(onward, kid, (top[kid] - slices.band[kid]) // 2)
    first = onward[fork] == kid
    branch = (reach > SLENDER * radius[own]) & (reach > CLEAR * radius[fork])
    branch &= top[kid] - slices.band[fork] > SHORTEST
    real = branch | first
    kid, fork, first = kid[real], fork[real], first[real]

    score = _likeness(slices, onward, radius, kid, fork)
    order = np.lexsort((-score, fork))
    leads = np.zeros(len(kid), dtype=bool)
    leads[order[np.diff(fork[order], prepend=-1) > 0]] = True
    onward = onward.copy()
    onward[fork[leads]] = kid[leads]
    radius = radii(slices, onward)
    return _number(slices, onward, set_of(kid[~leads], len(slices)), radius)


def set_of(members: np.ndarray, count: int) -> np.ndarray:
    """(count,) whether each is a member."""
    inside = np.zeros(count, dtype=bool)
    inside[members] = True
    return inside


def _carried(slices: Slices) -> tuple[np.ndarray, np.ndarray]:
    """(S,) what each slice and all above it hold, and (S,) the highest band above it."""
    mass, top = slices.weight.copy(), slices.band.copy()
    for low, high in reversed(_runs(slices.band)):
        below = slices.below[low:high]
        has = below >= 0
        np.add.at(mass, below[has], mass[low:high][has])
        np.maximum.at(top, below[has], top[low:high][has])
    return mass, top


def _runs(band: np.ndarray) -> list[tuple[int, int]]:
    """First and last of the slices of every band, from the lowest up."""
    bounds = np.flatnonzero(np.diff(band, prepend=-1, append=band[-1] + 1))
    return list(zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True))


def _daughters(slices: Slices) -> tuple[np.ndarray, np.ndarray]:
    """Slices above forks, and the forks below them."""
    above = np.bincount(slices.below[slices.below >= 0], minlength=len(slices))
    kid = np.flatnonzero((slices.below >= 0) & (above[slices.below] > 1))
    return kid, slices.below[kid]


def _heaviest(slices: Slices, mass: np.ndarray) -> np.ndarray:
    """(S,) the slice above each that carries most, itself at a tip."""
    onward = np.arange(len(slices))
    upper = np.flatnonzero(slices.below >= 0)
    upper = upper[np.argsort(mass[upper], kind="stable")]
    onward[slices.below[upper]] = upper  # the last one stays
    return onward


def _walk(step: np.ndarray, start: np.ndarray, many: np.ndarray) -> np.ndarray:
    """Return where one is after so many steps."""
    at = start.copy()
    for taken in range(int(many.max(initial=0))):
        going = many > taken
        at[going] = step[at[going]]
    return at


def radii(slices: Slices, onward: np.ndarray) -> np.ndarray:
    """(S,) root mean square distance of what slices hold from the axis through them."""
    down = np.where(slices.below < 0, np.arange(len(slices)), slices.below)
    rough = np.sqrt(np.trace(slices.spread, axis1=1, axis2=2))
    steps = np.clip(np.ceil(rough / slices.width), 1, MOST_STEPS).astype(np.int64)
    everything = np.arange(len(slices))
    heading = slices.centre[_walk(onward, everything, steps)]
    heading = heading - slices.centre[_walk(down, everything, steps)]
    heading /= np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-300)
    along = np.einsum("si,sij,sj->s", heading, slices.spread, heading)
    return np.asarray(np.sqrt(np.maximum(rough**2 - along, 0.0)))


def _likeness(
    slices: Slices, onward: np.ndarray, radius: np.ndarray, kid: np.ndarray, fork: np.ndarray
) -> np.ndarray:
    """(K,) how much a child looks like the parent going on."""
    bands = radius[fork] / slices.width
    near = np.clip(np.ceil(NEAR * bands), 1, MOST_STEPS).astype(np.int64)
    far = np.clip(np.ceil(FAR * bands), 2, 2 * MOST_STEPS).astype(np.int64)
    down = np.where(slices.below < 0, np.arange(len(slices)), slices.below)
    a = _walk(onward, kid, near)
    b = _walk(onward, a, far - near)
    middle = _walk(onward, a, (far - near) // 2)
    before, earlier = _walk(down, fork, near), _walk(down, fork, far)
    ahead, behind = (
        slices.centre[b] - slices.centre[a],
        slices.centre[before] - slices.centre[earlier],
    )
    turn = np.einsum("ki,ki->k", ahead, behind)
    turn /= np.maximum(np.linalg.norm(ahead, axis=1) * np.linalg.norm(behind, axis=1), 1e-300)
    thick = np.median(radius[np.stack([a, middle, b])], axis=0)
    return np.asarray(thick * (1 + STRAIGHT * turn) + 1e-9 * radius[fork])


def _number(
    slices: Slices, onward: np.ndarray, begins: np.ndarray, radius: np.ndarray
) -> PieceAxes:
    """Axes from the roots up; what is neither led on to nor begins an axis is its parent's."""
    of_slice = np.full(len(slices), -1)
    mother: list[int] = []
    fork: list[int] = []
    begins = begins | (slices.below < 0)
    for low, high in _runs(slices.band):
        below = slices.below[low:high]
        new = np.flatnonzero(begins[low:high])
        of_slice[low:high] = of_slice[below]
        of_slice[low + new] = len(mother) + np.arange(len(new))
        mother += np.where(below[new] < 0, -1, of_slice[below[new]]).tolist()
        fork += below[new].tolist()
    chain = begins | (onward[slices.below] == np.arange(len(slices)))
    for low, high in _runs(slices.band):  # nor what stands on a bump
        chain[low:high] &= begins[low:high] | chain[slices.below[low:high]]
    return PieceAxes(of_slice, np.array(mother), np.array(fork), radius, chain)
