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
from scipy.special import xlogy

from ...base.rng import keyed_uniform
from ...base.rows import RowTable
from ...spec import Beam
from .scanner import Pulses

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
    x, y = places(subrays).T  # before the turn of each pulse
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
