"""Sub-rays of a beam: rays of equal energy that together are a Gaussian beam at every range.

The intensity across the beam is exp(-2 r²/w²) with w(R)² = w₀² + (R·θ/2)², the radius at 1/e² of a beam
of exit radius w₀ and full divergence θ (Siegman 1986, 17.1). Each sub-ray is a straight line on a
hyperboloid of that shape, so that straight rays keep the curved envelope exactly: it starts at
r·w₀·(cos φ, sin φ) and turns away at right angles to that, by r·θ/2·(-sin φ, cos φ) (skew rays: Steier
1966, Appl. Opt. 5, 1229). With different divergences along both axes the two widths are exact, and the
ellipse may be turned a little where the beam changes from its exit to its far field.

The N rays share the beam into rings of equal energy, one ray a ring at its root-mean-square radius; from
ring to ring they turn by the golden angle (Vogel 1979), and the whole by a random angle a pulse. The few
rays of a small N then are moved a little, so that their centre is the beam's and their second moments
are exact along every axis: a plane is at its range at any incidence, and as wide as the closed form says.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.special import xlogy

from ...base.rng import keyed_uniform
from ...base.rows import RowTable
from ...spec import Beam
from .cloud import cosines
from .pattern import Pulses

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


def radii(subrays: int) -> np.ndarray:
    """(N,) distances from the axis, in units of w, from the axis outwards; one ray is on the axis.

    The share of energy outside r is q = exp(-2 r²); the mean of r² = -ln(q)/2 over a ring is closed.
    """
    if subrays == 1:
        return np.zeros(1)
    edge = 1 - np.arange(subrays + 1) / subrays
    inside = (edge - xlogy(edge, edge)) / 2  # the integral of -ln(q)/2
    return np.sqrt(np.maximum(-np.diff(inside) * subrays, 0.0))


@cache
def places(subrays: int) -> np.ndarray:
    """(N, 2) where rays cross the beam, in units of w, from the axis outwards."""
    if subrays == 1:
        return np.zeros((1, 2))
    angle = GOLDEN_ANGLE * np.arange(subrays)
    place = radii(subrays)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    place -= place.mean(axis=0)
    moments, axes = np.linalg.eigh(place.T @ place / subrays)
    if subrays == 2:  # on a line
        moments[:] = moments.sum() / 2
    place = place @ (axes * (0.5 / np.sqrt(moments))) @ axes.T  # w is two standard deviations
    place = place[np.argsort(np.hypot(*place.T), kind="stable")]
    place.flags.writeable = False
    return place


@dataclass(frozen=True)
class BeamFrames(RowTable):
    """P beams whose sub-rays, at (x, y) of ``places``, start at origin + x·exit_x + y·exit_y and go along
    axis + x·turn_x + y·turn_y; all (P, 3).
    """

    origin: np.ndarray
    axis: np.ndarray
    exit_x: np.ndarray
    exit_y: np.ndarray
    turn_x: np.ndarray
    turn_y: np.ndarray


def frames(pulses: Pulses, beam: Beam, keys: np.ndarray) -> BeamFrames:
    """The frames of P pulses.

    keys : (P,) uint64 keys of the pulses, for the turn of each.
    """
    turn = 2 * np.pi * keyed_uniform(keys, "footprint")
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    along, across = np.array(beam.divergence_mrad) * 0.5e-3
    u, v = pulses.across, np.cross(pulses.direction, pulses.across)
    exit_radius = beam.exit_diameter / 2
    return BeamFrames(
        origin=pulses.origin,
        axis=pulses.direction,
        exit_x=exit_radius * (cos * u + sin * v),
        exit_y=exit_radius * (cos * v - sin * u),
        turn_x=across * cos * v - along * sin * u,
        turn_y=-along * cos * u - across * sin * v,
    )


def spread(pulses: Pulses, beam: Beam, keys: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P·N, 3) origins and unit directions of the sub-rays of P pulses, pulse by pulse.

    keys : (P,) uint64 keys of the pulses, for the turn of each.
    """
    if beam.subrays == 1:
        return pulses.origin, pulses.direction
    return sub_rays(frames(pulses, beam, keys), beam.subrays)


def sub_rays(beams: BeamFrames, subrays: int) -> tuple[np.ndarray, np.ndarray]:
    """(P·N, 3) origins and unit directions of the N sub-rays of P beams, beam by beam."""
    return rays_at(beams, *places(subrays).T)  # before the turn of each pulse


def rays_at(beams: BeamFrames, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P·N, 3) origins and unit directions of rays of P beams at (N,), (N,) across them, beam by beam."""
    origin = _placed(beams.origin, beams.exit_x, x, beams.exit_y, y)
    way = _placed(beams.axis, beams.turn_x, x, beams.turn_y, y)
    way /= np.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
    return origin.T, way.T


def reach(beam: Beam) -> tuple[float, float]:
    """Metres that a sub-ray starts at most beside the axis, and radians that it turns from it at most."""
    widest = float(np.hypot(*places(beam.subrays).T).max())
    return widest * beam.exit_diameter / 2, widest * max(beam.divergence_mrad) * 0.5e-3


def _placed(
    start: np.ndarray, a: np.ndarray, x: np.ndarray, b: np.ndarray, y: np.ndarray
) -> np.ndarray:
    """(3, P·N) start + a·x + b·y of vectors (P, 3) and numbers (N,), each coordinate in one piece."""
    places = np.empty((3, len(a), len(x)))
    for axis, place in enumerate(places):
        np.multiply(a[:, axis, None], x, out=place)
        place += b[:, axis, None] * y
        place += start[:, axis, None]
    return places.reshape(3, -1)


# Patches that a pulse's light comes from where a surface goes on between its sub-rays.
#
# At grazing incidence a footprint is longer than the pulse, and rays that are farther apart than that would
# each make an echo of its own. But the surface goes on between them. Contacts of one pulse that lie on one
# smooth surface are a patch, and its light is spread over the patch: with their mean range m and variance
# V, both weighted by energy, contact j becomes a Gaussian about m + √(1-κ)·(R_j - m) of variance κV. Mean
# and variance of the patch stay what they were, exactly; κ = 4/√n, at most 0.9, is enough for n rays on a
# plane to have one crest, near its middle, at any turn of the beam and also without a pulse. Of more than a
# hundred rays some lie alone far out; for these κ = L²/(L² + 4V), with L from the nearest to the farthest:
# then all lie within two widths, and there is one crest (Popoviciu, see ``waveform``).
#
# Two contacts are on one smooth surface if their normals agree and if the range changes between them as the
# planes of both say. 1/R is linear over a plane, so a plane is one patch at any incidence. Leaves are no
# surfaces that go on. Every ray is compared with those 1, 2, 3, 5, 8 … places after it, which in the
# golden-angle pattern are its neighbours and some farther away.


SHORT = 0.4  # pulse lengths: what is shorter is one echo at its mean anyway
ALIKE = 0.95  # cosine between the normals of neighbours on one surface
BESIDE = 0.1  # pulse lengths, and BESIDE_SHARE of the way, that a surface may be off a plane
BESIDE_SHARE = 0.2
SPREAD, MOST = 4.0, 0.9  # κ = SPREAD/√n, at most MOST
MANY = 100  # contacts of a patch, beyond which that does not do


@dataclass(frozen=True)
class ContactedBeams:
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


def goes_on_long(pulse: np.ndarray, distance: np.ndarray, sigma: float) -> np.ndarray:
    """Rows of the contacts (C,) whose pulse reaches farther than one echo; the others need no patches."""
    near = np.full(int(pulse.max(initial=0)) + 1, np.inf)
    far = -near
    np.minimum.at(near, pulse, distance)
    np.maximum.at(far, pulse, distance)
    return np.flatnonzero((far - near > SHORT * sigma)[pulse])


def blurred_patches(
    contacts: ContactedBeams, subrays: int, sigma: float
) -> tuple[np.ndarray, np.ndarray]:
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
    low, high = np.full((2, len(count)), [[np.inf], [-np.inf]])
    np.minimum.at(low, patch, away)
    np.maximum.at(high, patch, away)
    square = ((high - low) ** 2)[patch]
    many = (count[patch] > MANY) & (square > 0)
    share[many] = square[many] / (square + 4 * variance)[many]
    mean += some[patch]
    moved = np.where(count[patch] > 1, mean + np.sqrt(1 - share) * (at - mean), at)
    return moved, np.sqrt(share * variance)


def _patches(contacts: ContactedBeams, subrays: int, sigma: float) -> np.ndarray:
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


def _plane(contacts: ContactedBeams, i: np.ndarray, j: np.ndarray) -> np.ndarray:
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
