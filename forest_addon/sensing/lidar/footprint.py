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
import scipy

from ... import kernels
from ...base.rng import keyed_uniform
from ...base.rows import RowTable, distinct
from ...spec import Beam
from .cloud import cosines
from .pattern import Pulses
from .waveform import by_pulse

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


def radii(subrays: int) -> np.ndarray:
    """(N,) distances from the axis, in units of w, from the axis outwards; one ray is on the axis.

    The share of energy outside r is q = exp(-2 r²); the mean of r² = -ln(q)/2 over a ring is closed.
    """
    if subrays == 1:
        return np.zeros(1)
    edge = 1 - np.arange(subrays + 1) / subrays
    inside = (edge - scipy.special.xlogy(edge, edge)) / 2  # the integral of -ln(q)/2
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
    return rays_at(frames(pulses, beam, keys), places(beam.subrays))


def rays_at(beams: BeamFrames, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P·N, 3) origins and unit directions of rays of P beams at places (N, 2) across them, beam by beam."""
    given = [np.ascontiguousarray(vectors) for vectors in vars(beams).values()]
    library = kernels.library()
    if library is not None:
        origin, way = np.empty((2, len(beams.axis) * len(place), 3))
        library.spread_rays(len(beams.axis), *given, len(place), place, origin, way)
        return origin, way
    start, axis, exit_x, exit_y, turn_x, turn_y = (vectors[:, None] for vectors in given)
    x, y = place.T[:, :, None]
    origin = (exit_x * x + exit_y * y + start).reshape(-1, 3)
    way = (turn_x * x + turn_y * y + axis).reshape(-1, 3)
    return origin, way / np.sqrt(way[:, :1] ** 2 + way[:, 1:2] ** 2 + way[:, 2:] ** 2)


def reach(beam: Beam) -> tuple[float, float]:
    """Metres that a sub-ray starts at most beside the axis, and radians that it turns from it at most."""
    widest = float(np.hypot(*places(beam.subrays).T).max())
    return widest * beam.exit_diameter / 2, widest * max(beam.divergence_mrad) * 0.5e-3


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


def blurred_patches(
    ray: np.ndarray,
    subrays: int,
    surface: np.ndarray,
    distance: np.ndarray,
    energy: np.ndarray,
    rays: tuple[np.ndarray, np.ndarray],
    normal: np.ndarray,
    sigma: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Ranges (C,) of the light of contacts, and its spread (C,) in range, metres.

    ray, subrays, distance, energy, sigma : see ``waveform.find_echoes``.
    surface : (C,) int8, contacts of one number may lie on one surface; -1: none that goes on. Of a ray the
        first contact of each counts.
    rays : origins and unit directions (C, 3) of the rays on which contacts are seen.
    normal : (C, 3) unit vectors.
    """
    library = kernels.library()
    if library is not None:
        moved, blur = np.empty((2, len(ray)))
        library.blur_patches(
            len(ray),
            np.argsort(ray, kind="stable"),
            *(ray, subrays, surface),
            *(np.ascontiguousarray(one) for one in (distance, energy, *rays, normal)),
            sigma,
            *(np.empty(3 * subrays, dtype=np.int64), np.empty(6 * subrays), moved, blur),
        )
        return moved, blur
    moved, blur = np.array(distance), np.zeros(len(ray))
    for rows in by_pulse(ray, subrays, np.flatnonzero((surface >= 0) & (energy > 0))):
        if np.ptp(distance[rows]) <= SHORT * sigma:
            continue
        for number in distinct(surface[rows]):
            contacts = rows[surface[rows] == number]
            contacts = contacts[np.unique(ray[contacts], return_index=True)[1]]
            beams = distance[contacts], *(vectors[contacts] for vectors in rays), normal[contacts]
            patch = _patches(ray[contacts] % subrays, subrays, beams, sigma)
            for group in np.split(
                contacts[np.argsort(patch, kind="stable")], np.cumsum(np.bincount(patch))
            ):
                if len(group) > 1:
                    given = _blurred(distance[group], energy[group])
                    moved[group], blur[group] = given
    return moved, blur


def _blurred(distance: np.ndarray, energy: np.ndarray) -> tuple[np.ndarray, float]:
    """Ranges (C,) of the light of a patch, and its spread in range."""
    away = distance - distance[0]  # differences from one of the patch's own ranges lose no digits
    mean = np.average(away, weights=energy)
    variance = np.average((away - mean) ** 2, weights=energy)
    share, square = min(SPREAD / np.sqrt(len(away)), MOST), np.ptp(away) ** 2
    if len(away) > MANY and square > 0:
        share = square / (square + 4 * variance)
    mean += distance[0]
    return mean + np.sqrt(1 - share) * (distance - mean), np.sqrt(share * variance)


def _patches(
    subray: np.ndarray, subrays: int, beams: tuple[np.ndarray, ...], sigma: float
) -> np.ndarray:
    """(C,) number of the patch that each contact of a pulse is on."""
    at = np.full(subrays, -1)
    at[subray] = np.arange(len(subray))
    i, j = (at[rays] for rays in _pairs(subrays))
    both = np.flatnonzero((i >= 0) & (j >= 0))
    one, other = (tuple(values[rows[both]] for values in beams) for rows in (i, j))
    near, far = 1 / one[0], 1 / other[0]
    change = far - near
    expected = (_plane(one, other) - near + far - _plane(other, one)) / 2
    linked = (
        np.abs(change - expected) <= BESIDE_SHARE * np.abs(change) + BESIDE * sigma * near * far
    )
    linked &= cosines(one[3], other[3]) > ALIKE
    links = (np.ones(np.count_nonzero(linked), dtype=bool), (i[both[linked]], j[both[linked]]))
    graph = scipy.sparse.coo_array(links, shape=(len(subray), len(subray)))
    return scipy.sparse.csgraph.connected_components(graph, directed=False)[1]


def _plane(one: tuple[np.ndarray, ...], other: tuple[np.ndarray, ...]) -> np.ndarray:
    """(K,) 1/range at which rays of others meet the planes of contacts; below 0: behind."""
    distance, origin, way, normal = one
    foot = origin - other[1] + distance[:, None] * way
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse: np.ndarray = (normal * other[2]).sum(axis=1) / (normal * foot).sum(axis=1)
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
