"""Scatter by branches and leaves: what they take out of a sound and where they send it, by height.

A ``Clutter`` goes in; coefficients a metre and a phase function in space go out. A branch is a cylinder much
longer than the wave: sound that meets it at γ from its axis goes on along the cone of the same γ, turned
about the axis as at a trunk of size ka·sin γ (van de Hulst 1957, ch. 15); it is held against level sound at
the slopes that branches have, and looks all ways for sound that was scattered before. A leaf is a hard disc
that looks all ways: Rayleigh's cross-section (2k²a³/3π)²·4π/3·cos² below, half its area above, in between
the smaller; it scatters all ways alike. Lobes straight on, as large as the shadow, are no scattering.
Branches take what their bark takes, as trunks', and what the air at it takes (``boundary_loss``). A leaf
takes what was measured of leaves, in which the air at them is held.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ....acoustics.boundary_loss import twig_loss
from ....acoustics.cylinder import transfer
from ....acoustics.extinction import cross_sections
from ....acoustics.foliage import foliage_loss
from ....acoustics.shoot import shoot_width
from .clutter import Clutter
from .transport import without_shadow

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

ANGLES = 90  # of the phase function, 0 to π
SLOPES, TURNS = 16, 360  # γ and turns about the axis, over which a branch is averaged
ALL_WAYS = 0.785  # mean |sin| to branches and needles that look all ways
THIN = 0.05  # ka, below which bark takes the same share of a branch's width
EDGE = 4.0  # of the smaller of two areas of a leaf
SPECTRUM = np.geomspace(1.0, 200e3, 140)  # Hz at which a level coefficient is computed


@dataclass(frozen=True)
class Takes:
    """Absorption by leaves and branches: what they take for good.

    leaf_absorption : G of ``acoustics/foliage``. bark : share of a wave head on that branches' bark takes.
    boundary : the air at branches takes some too.
    """

    leaf_absorption: float = 0.0
    bark: float = 0.0
    boundary: bool = False


@dataclass(frozen=True)
class Scatter:
    """At one frequency.

    scattered, absorbed : (Z,) share of the energy a metre, in each layer of the clutter.
    density : (ANGLES,) scattered share per steradian by angle from straight on, mean over heights; its
    integral over the sphere is 1.
    """

    scattered: np.ndarray
    absorbed: np.ndarray
    density: np.ndarray


def scatter_of(clutter: Clutter, frequency: float, speed: float, takes: Takes) -> Scatter:
    """Of branches and leaves."""
    radii = np.array(clutter.radii)
    wood = np.zeros(len(clutter.length))
    lost = np.zeros(len(clutter.length))
    density = np.zeros(ANGLES)
    if len(radii):
        each = _widths(clutter, frequency, speed)
        wood = np.array(clutter.length) @ each
        lost = np.array(clutter.length) @ _taken(clutter, frequency, speed, takes)
        share = np.array(clutter.length).sum(axis=0) * each
        for radius, part in zip(radii, share, strict=True):
            if part > 1e-3 * share.sum():
                density += part * _turned(float(radius), frequency, speed)
    area = _to(np.array(clutter.leaf_area), clutter.layers)
    leaves = area * _leaf_width(clutter.leaf_radius, frequency, speed)
    density += leaves.sum() / (4.0 * math.pi)
    absorbed = area * 2.0 * foliage_loss(np.array([frequency]), 1.0, takes.leaf_absorption)[0]
    wood, lost = _to(wood, clutter.layers), _to(lost, clutter.layers)
    if np.any(clutter.needle_area):
        area = _to(np.array(clutter.needle_area), clutter.layers)
        alone, joint, taken, turned = _needles(clutter, frequency, speed, takes)
        wood, lost = wood + area * (alone + joint), lost + area * taken
        density += area.sum() * (alone * _turned(clutter.needle_radius, frequency, speed))
        density += area.sum() * joint * turned
    whole = wood.sum() + leaves.sum()
    return Scatter(
        wood + leaves,
        lost + absorbed,
        density / whole if whole > 0 else np.full(ANGLES, 0.25 / math.pi),
    )


def _to(layers: np.ndarray, count: int) -> np.ndarray:
    """(count,) of layers, those above are empty."""
    return np.pad(layers, (0, count - len(layers)))


def _needles(
    clutter: Clutter, frequency: float, speed: float, takes: Takes
) -> tuple[float, float, float, np.ndarray]:
    """Shares of half the needles' surface: each scatters, shoots do in phase, air at them takes.

    And (ANGLES,) per steradian of what is in phase.
    """
    radius = clutter.needle_radius
    metres = 1.0 / (math.pi * radius)  # of needle a m²
    size = max(2.0 * math.pi * frequency / speed * radius * ALL_WAYS, 1e-4)
    alone = metres * float(cross_sections(np.array([size])).energy[0]) * radius * ALL_WAYS
    given = clutter.shoot_area, radius, clutter.shoot_spread, frequency, speed
    joint, turned = shoot_width(*given, ANGLES)
    taken = 0.0
    if takes.boundary:
        taken = metres * float(twig_loss(np.array([radius]), frequency, speed)[0])
    return alone, joint, taken, turned


def level_loss(clutter: Clutter, height: float, speed: float, takes: Takes) -> CubicSpline | None:
    """Nepers of amplitude a metre at a height: branches and needles take or scatter it, leaves scatter it.

    By log frequency; the values are logarithms. None where there is nothing.
    """
    layer = int(height)
    wood = np.array(clutter.length[layer]) if layer < len(clutter.length) else np.zeros(0)
    leaves = clutter.leaf_area[layer] if layer < len(clutter.leaf_area) else 0.0
    needles = clutter.needle_area[layer] if layer < len(clutter.needle_area) else 0.0
    if not wood.any() and leaves <= 0 and needles <= 0:
        return None
    found = leaves * _leaf_widths(clutter.leaf_radius, speed)
    if len(wood):
        every = SPECTRUM[:, None]
        found = (
            found + (_widths(clutter, every, speed) + _taken(clutter, every, speed, takes)) @ wood
        )
    if needles > 0:
        of_needles = [sum(_needles(clutter, f, speed, takes)[:3]) for f in SPECTRUM.tolist()]
        found = found + needles * np.array(of_needles)
    from scipy.interpolate import CubicSpline  # here: other sensors need not wait for its import

    return CubicSpline(np.log(SPECTRUM), np.log(0.5 * np.maximum(found, 1e-30)))


def leaf_loss(
    area: float, radius: float, frequency: np.ndarray, speed: float, absorption: float
) -> np.ndarray:
    """(F,) nepers of amplitude a metre that m²/m³ of leaves take and scatter away. absorption : G."""
    row = np.log(np.clip(frequency, SPECTRUM[0], SPECTRUM[-1]))
    width = np.interp(row, np.log(SPECTRUM), _leaf_widths(radius, speed))
    return np.asarray(0.5 * area * width + foliage_loss(frequency, area, absorption))


@lru_cache(maxsize=16)
def _leaf_widths(radius: float, speed: float) -> np.ndarray:
    return np.array([_leaf_width(radius, f, speed) for f in SPECTRUM.tolist()])


def _widths(clutter: Clutter, frequency: float | np.ndarray, speed: float) -> np.ndarray:
    """(..., K) m of width that a metre of branch scatters of level sound, at a frequency or (F, 1)."""
    radii, across = np.array(clutter.radii), np.array(clutter.across)
    size = np.maximum(2.0 * math.pi * frequency / speed * radii * across, 1e-4)
    return np.asarray(cross_sections(size.ravel()).energy.reshape(size.shape) * radii * across)


def _taken(
    clutter: Clutter, frequency: float | np.ndarray, speed: float, takes: Takes
) -> np.ndarray:
    """(..., K) m of width whose sound a metre of branch takes for good."""
    radii = np.array(clutter.radii)
    found = np.zeros(np.broadcast_shapes(np.shape(frequency), radii.shape))
    if takes.bark > 0:
        across = np.array(clutter.across)
        size = np.maximum(2.0 * math.pi * frequency / speed * radii * across, THIN)
        whole = (
            1.0 + size**2
        ) / size**2  # trunks' bark fades out below ka = 1, where none is measured
        absorbed = cross_sections(size.ravel(), takes.bark).absorption.reshape(size.shape)
        found += absorbed * whole * radii * across
    if takes.boundary:
        found += twig_loss(radii, frequency, speed)
    return found


def _leaf_width(radius: float, frequency: float, speed: float) -> float:
    """Share of a leaf's area by which it scatters, mean over all ways that it may look."""
    ka = 2.0 * math.pi * frequency / speed * radius
    small = 16.0 / 81.0 / math.pi**2 * ka**4  # (2k²a³/3π)²·4π/3·<cos²>/(πa²)
    return float((small**-EDGE + 0.5**-EDGE) ** (-1.0 / EDGE)) if ka > 1e-3 else 0.0


@lru_cache(maxsize=256)
def _turned(radius: float, frequency: float, speed: float) -> np.ndarray:
    """(ANGLES,) per steradian of a branch that looks all ways."""
    slope = (math.pi * (np.arange(SLOPES) + 0.5) / SLOPES)[: SLOPES // 2]
    turn = math.pi * (np.arange(TURNS) + 0.5) / TURNS
    size = radius * np.sin(slope)
    each = np.abs(transfer(frequency, turn[:, None], size, speed)) ** 2  # (TURNS, slopes)
    widths = cross_sections(2.0 * math.pi * frequency / speed * size)
    shadow = (widths.extinction - widths.energy) * size
    found = np.zeros(ANGLES)
    for gamma, column, lobe in zip(slope.tolist(), each.T, shadow.tolist(), strict=True):
        weight = math.sin(gamma) ** 2 * without_shadow(column, lobe)
        cosine = math.cos(gamma) ** 2 + math.sin(gamma) ** 2 * np.cos(turn)
        row = np.minimum((np.arccos(np.clip(cosine, -1, 1)) * (ANGLES / math.pi)).astype(int), 89)
        found += np.bincount(row, weight, ANGLES)
    edges = np.cos(np.linspace(0.0, math.pi, ANGLES + 1))
    found /= 2.0 * math.pi * -np.diff(edges)
    return found / (found @ (2.0 * math.pi * -np.diff(edges)))
