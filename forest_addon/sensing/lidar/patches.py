"""Patches that a pulse's light comes from where a surface goes on between its sub-rays.

At grazing incidence a footprint is longer than the pulse, and rays that are farther apart than that would
each make an echo of its own. But the surface goes on between them. Contacts of one pulse that lie on one
smooth surface are a patch, and its light is spread over the patch: with their mean range m and variance V,
both weighted by energy, contact j becomes a Gaussian about m + √(1-κ)·(R_j - m) of variance κV. Mean and
variance of the patch stay what they were, exactly; κ = 4/√n, at most 0.9, is enough for n rays
on a plane to have one crest, near its middle, at any turn of the beam and also without a pulse.

Two contacts are on one smooth surface if their normals agree and if the range changes between them as
the planes of both say. 1/R is linear over a plane, so a plane is one patch at any incidence. Leaves
are no surfaces that go on. Every ray is compared with those 1, 2, 3, 5, 8 … places after it, which in the
golden-angle pattern are its neighbours and some farther away.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from .returns import cosines

SHORT = 0.4  # pulse lengths: what is shorter is one echo at its mean anyway
ALIKE = 0.95  # cosine between the normals of neighbours on one surface
BESIDE = 0.1  # pulse lengths, and BESIDE_SHARE of the way, that a surface may be off a plane
BESIDE_SHARE = 0.2
SPREAD, MOST = 4.0, 0.9  # κ = SPREAD/√n, at most MOST


@dataclass(frozen=True)
class Contacted:
    """C contacts, at most one of a sub-ray: pulse and sub-ray (C,), distance and energy (C,); where their
    rays start and go and normals of the surfaces, (C, 3).
    """

    pulse: np.ndarray
    subray: np.ndarray
    distance: np.ndarray
    energy: np.ndarray
    origin: np.ndarray
    direction: np.ndarray
    normal: np.ndarray


def long(pulse: np.ndarray, distance: np.ndarray, sigma: float) -> np.ndarray:
    """Rows of the contacts (C,) whose pulse reaches farther than one echo; the others need no patches."""
    near = np.full(int(pulse.max(initial=0)) + 1, np.inf)
    far = -near
    np.minimum.at(near, pulse, distance)
    np.maximum.at(far, pulse, distance)
    return np.flatnonzero((far - near > SHORT * sigma)[pulse])


def blurred(contacts: Contacted, subrays: int, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Ranges (C,) of the light of contacts, and its spread (C,) in range, metres.

    subrays : of a pulse. sigma : metres, standard deviation of the pulse.
    """
    at, energy = contacts.distance, contacts.energy
    patch = _patches(contacts, subrays, sigma)
    count = np.bincount(patch)
    some = np.zeros(len(count))
    some[patch] = at  # differences from one of the patch's own ranges lose no digits
    away = at - some[patch]
    whole = np.bincount(patch, energy)
    mean = (np.bincount(patch, energy * away) / whole)[patch]
    variance = (np.bincount(patch, energy * (away - mean) ** 2) / whole)[patch]
    share = np.minimum(SPREAD / np.sqrt(count), MOST)[patch]
    mean += some[patch]
    moved = np.where(count[patch] > 1, mean + np.sqrt(1 - share) * (at - mean), at)
    return moved, np.sqrt(share * variance)


def _patches(contacts: Contacted, subrays: int, sigma: float) -> np.ndarray:
    """(C,) number of the patch that each contact is on."""
    numbers, pulse = np.unique(contacts.pulse, return_inverse=True)
    at = np.full((len(numbers), subrays), -1)
    at[pulse, contacts.subray] = np.arange(len(pulse))
    one, other = _pairs(subrays)
    i, j = at[:, one].ravel(), at[:, other].ravel()
    both = np.flatnonzero((i >= 0) & (j >= 0))
    i, j = i[both], j[both]
    alike = cosines(contacts.normal[i], contacts.normal[j]) > ALIKE
    i, j = i[alike], j[alike]
    near, far = 1 / contacts.distance[i], 1 / contacts.distance[j]
    change = far - near
    expected = (_plane(contacts, i, j) - near + far - _plane(contacts, j, i)) / 2
    off = np.abs(change - expected)
    linked = off <= BESIDE_SHARE * np.abs(change) + BESIDE * sigma * near * far
    links = (np.ones(np.count_nonzero(linked), dtype=bool), (i[linked], j[linked]))
    graph = coo_array(links, shape=(len(pulse), len(pulse)))
    patch: np.ndarray = connected_components(graph, directed=False)[1]
    return patch


def _plane(contacts: Contacted, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """(P,) 1/range at which the rays of contacts j meet the planes of contacts i; below 0: behind."""
    normal = contacts.normal[i]
    foot = contacts.origin[i] - contacts.origin[j]
    foot += contacts.distance[i, None] * contacts.direction[i]
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse: np.ndarray = np.einsum("pk,pk->p", normal, contacts.direction[j]) / np.einsum(
            "pk,pk->p", normal, foot
        )
    return inverse


@cache
def _pairs(subrays: int) -> tuple[np.ndarray, np.ndarray]:
    """Sub-rays that are compared: those that are a Fibonacci number of places apart."""
    steps = [1, 2]
    while steps[-1] < subrays:
        steps.append(steps[-1] + steps[-2])
    one = [np.arange(max(subrays - step, 0)) for step in steps]
    other = [rays + step for rays, step in zip(one, steps, strict=True)]
    return np.concatenate(one), np.concatenate(other)
