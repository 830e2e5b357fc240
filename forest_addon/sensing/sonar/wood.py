"""Trunks and branches as finite cylinders: where they run in a mesh, and how they sound back.

Wood is any mesh of tubes. Its pieces and their centrelines are found as for templates
(``growth/own_tree/centreline``), so that bent, scaled and imported wood is heard as it is evaluated; a line
is straightened where it stays within a tolerance of a chord. A segment of length ℓ and radius a that the
sound meets at the angle ψ to its axis scatters back with

    f = (ℓ/π)·S(ka·sinψ, π)·sinc(kℓ·cosψ),   sinc x = sin x/x,

S of ``acoustics/cylinder`` (a line source of the strength that gives the endless cylinder's far field).
That holds in the far field of the segment, so segments are cut to half a Fresnel width, ℓ² <= λr/4; their
coherent sum is right nearer too. S is tabulated once, with the delay of the near side taken off.

A thick segment sounds twice: its near side mirrors, as the optics of a cylinder say, and what is left has
crept around its back. Each alone is smooth in frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from ... import kernels
from ...acoustics.chebyshev import Cubics
from ...acoustics.cylinder import scattering_sum
from ...base.rows import lengths
from ...base.trimesh import TriMesh, is_wood
from ...growth.own_tree.centreline import find_centrelines
from ...growth.own_tree.pieces import part
from .scatterers import (
    WOOD,
    Population,
    Scatterers,
    Sight,
    Strength,
    StrengthParts,
    Views,
    cluster,
    paired,
)

STRAIGHT = 0.002  # m between a centreline and the chords that stand for it
ALIKE = 0.1  # relative change of the radius along a chord
CREEPING = 2.0 + math.pi  # radii, the way around the back from the near side
# Radii that what sounds reaches to both sides of its delay: all, what is mirrored, and what is left, which
# creeps around the back.
WAVES = {"whole": CREEPING / 2, "mirror": 0.0, "creeping": 1.0}
CREPT = 2  # number of the last
THICK = 4.0  # ka from where these two are taken apart
FADING = 2.2  # about e^{-FADING·(ka)^⅓} of S creeps around
AUDIBLE = 300.0  # over it, from where on that is faint
LARGEST = 600.0  # ka; beyond, S grows as its root
FINE = 12_000  # steps up to there of what S at most is
TABULATED, EXTENDED = 1e-7, 4e-6  # largest error of S relative to it, up to there and beyond


@dataclass(frozen=True)
class CylinderStrength(Strength):
    """level : (M,) metres, ℓ/π times the root of the distance to the near side over that to the axis: waves
    spread around a cylinder from its axis, while the delay is that of the near side. size, turn : (M,) a·sinψ
    and ℓ·cosψ, metres. wave : (M,) int8, which of ``WAVES``. end : (M,) int8, 1 of one end alone, whose turn
    is 0 and whose level is in parts of i/k.
    """

    level: np.ndarray
    size: np.ndarray
    turn: np.ndarray
    wave: np.ndarray
    end: np.ndarray

    def amplitude(self, wavenumber: np.ndarray) -> np.ndarray:
        k, given = wavenumber[:, None], (self.size, self.turn, self.level, self.wave, self.end)
        library = kernels.library()
        if library is not None:
            amplitude = np.empty((len(wavenumber), len(self)), np.complex128)
            ends = LARGEST, np.array([_bend()]), *_tables(), amplitude
            library.cylinders(len(wavenumber), wavenumber, len(self), *given, *ends)
            return amplitude
        waves = np.choose(self.wave, [_backscatter(k * self.size, wave) for wave in WAVES])
        amplitude = np.sinc(k * (self.turn / math.pi)) * np.conj(waves) * self.level
        return np.where(self.end, amplitude * (1j / k), amplitude)

    def bound(self, lowest: float, highest: float) -> np.ndarray:
        with np.errstate(divide="ignore"):
            lobes = 1.0 / (lowest * np.abs(self.turn))
        return self.level * _largest_backscatter(highest * self.size) * np.minimum(lobes, 1.0)

    def reach(self, wavenumber: float) -> np.ndarray:
        reach = np.array(list(WAVES.values())).take(self.wave)
        creeping = np.flatnonzero(self.wave == CREPT)
        reach[creeping] *= np.minimum(1.0, AUDIBLE * _crept(wavenumber * self.size[creeping]))
        return np.abs(self.turn) + reach * self.size

    def error(self, highest: float) -> np.ndarray:
        size = highest * self.size
        share = np.where(size > LARGEST, EXTENDED, TABULATED)
        return share * self.level * _largest_backscatter(size)

    def parts(self, lowest: float, highest: float) -> StrengthParts:
        """Mirror and creeping wave of thick segments, and both ends of those off the normal."""
        period = 2.0 * math.pi / (highest - lowest)
        thick = self.size > max(THICK / lowest, period / CREEPING)
        rows, wave = paired(thick)
        some, creeping = self.select(rows), np.flatnonzero(wave == CREPT)
        share, around = np.ones(len(rows)), np.zeros(len(rows))
        around[creeping] = CREEPING * some.size[creeping]
        share[creeping] = _crept(lowest * some.size[creeping])
        ends = np.abs(some.turn) > period / 2.0
        turn, late = np.where(ends, [[0.0], [1.0]], [[1.0], [0.0]]) * some.turn
        level = 0.5 * some.level / np.where(ends, some.turn, 1.0)  # a half twice where it is no end
        strength = CylinderStrength(level, some.size, turn, wave, ends.astype(np.int8))
        offset, second = around + np.stack([late, -late]), np.where(ends, -1.0, 1.0)
        return StrengthParts(rows, offset, share, strength, second)


@dataclass(frozen=True)
class WoodCylinders(Scatterers):
    """Segments: unit axis (M, 3), length and radius (M,).

    ``centre`` is on the axis, moved towards the sonar to where it meets the near side.
    """

    axis: np.ndarray
    length: np.ndarray
    radius: np.ndarray
    kind: ClassVar[str] = WOOD

    @property
    def clear(self) -> np.ndarray:
        return np.maximum(self.radius, 1e-3)

    def seen(self, point: np.ndarray) -> CylinderStrength:
        away = self.centre - point
        distance = lengths(away)
        cosine = np.einsum("mi,mi->m", away, self.axis) / distance
        sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
        size = self.radius * sine
        level = self.length / math.pi * np.sqrt(distance / (distance + size))
        whole = np.zeros((2, len(self)), np.int8)
        return CylinderStrength(level, size, self.length * cosine, *whole)


class WoodPopulation(Population):
    """The wood of one mesh."""

    kind: ClassVar[str] = WOOD

    def __init__(self, mesh: TriMesh) -> None:
        start, end, radius = wood_segments(mesh)
        middle = (start + end) / 2
        half = np.linalg.norm(end - start, axis=1) / 2
        self.blocks = cluster(middle, half + radius)
        order = self.blocks.order
        self._start, self._end, self._radius = start[order], end[order], radius[order]
        self._length = 2 * half[order]
        self._lengths = self.blocks.each(np.add, self._length)
        self._thickest = self.blocks.each(np.maximum, self._radius)

    @property
    def held(self) -> tuple[np.ndarray, np.ndarray]:
        return (self._start + self._end) / 2, np.full(len(self._start), -1)

    def ceiling(self, views: Views, lowest: float, highest: float) -> np.ndarray:
        widest = views.stretch[:, 0]
        size = _largest_backscatter(highest * widest * self._thickest[views.block])
        return widest * self._lengths[views.block] / math.pi * size

    def scatterers(self, transform: np.ndarray, rows: np.ndarray, sight: Sight) -> list[Scatterers]:
        linear, shift = transform[:, :3], transform[:, 3]
        start, end = (ends.take(rows, 0) @ linear.T + shift for ends in (self._start, self._end))
        span = end - start
        length = lengths(span)
        # The cross section changes by what the volume changes beyond the length.
        volume = abs(float(np.linalg.det(linear)))
        shrunk = self._length[rows] / np.maximum(length, 1e-30)
        radius = self._radius[rows] * np.sqrt(volume * shrunk)
        return [_cut(start, span, length, radius, self.blocks.order[rows], sight)]


def wood_segments(mesh: TriMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start and end (N, 3) and radius (N,) of the wood of a mesh, local metres."""
    triangles = mesh.triangles[is_wood(mesh.part)]
    triangles = triangles[np.isfinite(mesh.vertices).all(axis=1)[triangles].all(axis=1)]
    nothing = np.empty((0, 3)), np.empty((0, 3)), np.empty(0)
    if not len(triangles):
        return nothing
    pieces = part(mesh.vertices[triangles])
    if not pieces.count:
        return nothing
    lines = find_centrelines(pieces)
    first, last = _chords(lines.knot, lines.radius, lines.first)
    total = np.concatenate([[0.0], np.cumsum((lines.radius[1:] + lines.radius[:-1]) / 2)])
    radius = (total[last] - total[first]) / (last - first)
    return lines.knot[first], lines.knot[last], radius


def _chords(
    knot: np.ndarray, radius: np.ndarray, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """First and last knot of each of the chords that stand for the lines; pairs are joined in rounds."""
    starts = np.ones(len(knot), dtype=bool)  # knots where a chord starts or a line ends
    fixed = np.zeros(len(knot), dtype=bool)
    fixed[first[:-1]] = fixed[first[1:] - 1] = True
    allowed = STRAIGHT
    for _ in range(6):
        allowed /= 2
        kept = np.flatnonzero(starts)
        place = np.arange(1, len(kept) - 1, 2)
        at, before, after = kept[place], kept[place - 1], kept[place + 1]
        chord = knot[after] - knot[before]
        square = np.maximum(np.einsum("ni,ni->n", chord, chord), 1e-30)
        offset = knot[at] - knot[before]
        share = np.einsum("ni,ni->n", offset, chord) / square
        miss = np.linalg.norm(offset - share[:, None] * chord, axis=1)
        alike = np.abs(radius[after] - radius[before]) <= ALIKE * (radius[after] + radius[before])
        starts[at[~fixed[at] & (miss <= allowed) & (share > 0) & (share < 1) & alike]] = False
    kept = np.flatnonzero(starts)
    line = np.searchsorted(first, kept, side="right")
    together = line[1:] == line[:-1]
    return kept[:-1][together], kept[1:][together]


def _cut(
    start: np.ndarray,
    span: np.ndarray,
    length: np.ndarray,
    radius: np.ndarray,
    number: np.ndarray,
    sight: Sight,
) -> WoodCylinders:
    """Segments cut to half a Fresnel width, and moved to their near side."""
    away = start + span / 2 - sight.point
    nearest = np.maximum(lengths(away) - length / 2, 1e-3)
    longest = np.sqrt(math.pi * nearest / (2.0 * sight.wavenumber))
    parts = np.clip(np.ceil(length / longest), 1, 4096).astype(np.int64)
    row = np.repeat(np.arange(len(start)), parts)
    place = np.arange(len(row)) - np.repeat(np.cumsum(parts) - parts, parts)
    middle = start.take(row, 0) + ((place + 0.5) / parts[row])[:, None] * span.take(row, 0)
    axis = (span / np.maximum(length, 1e-30)[:, None]).take(row, 0)
    towards = sight.point - middle
    square = towards - np.einsum("mi,mi->m", towards, axis)[:, None] * axis
    distance = np.maximum(lengths(square), 1e-30)
    moved = np.minimum(radius[row] / distance, 0.9)
    middle += moved[:, None] * square
    return WoodCylinders(middle, number[row], axis, (length / parts)[row], radius[row])


# ---------------------------------------------------------------------------------------------- S


def _backscatter(size: np.ndarray, wave: str = "whole") -> np.ndarray:
    """S(ka, π) times e^{2ika}, what is left when the near side's delay is taken off, or a part (e^{-iωt})."""
    inside = np.minimum(size, LARGEST)
    value: np.ndarray = _table(wave).at(_coordinate(inside)) * inside**2 / (1.0 + inside**1.5)
    beyond = np.maximum(size / LARGEST, 1.0)
    return value * np.sqrt(beyond) * (1.0 + _bend() * (1.0 - 1.0 / beyond))


def _crept(size: np.ndarray) -> np.ndarray:
    """Share of S that has crept around the back, about."""
    return np.asarray(np.exp(-FADING * np.cbrt(size)))


def _mirrored(size: np.ndarray) -> np.ndarray:
    """S(ka, π) times e^{2ika} without what creeps, but for terms of (ka)^-5."""
    series = 1.0 - 11j / (16.0 * size) - 353.0 / (512.0 * size**2)
    series += 11569j / (8192.0 * size**3) + 2397995.0 / (524288.0 * size**4)
    return np.asarray(np.sqrt(math.pi * size) / 2.0 * np.exp(-0.25j * math.pi) * series)


def _largest_backscatter(size: np.ndarray) -> np.ndarray:
    """Upper bound of |S(x, π)| over x <= ka."""
    largest = _envelope()
    place = np.ceil(_coordinate(np.fmin(size, LARGEST)) * (FINE / _coordinate(LARGEST)))
    return largest.take(place.astype(np.int64)) * np.sqrt(np.maximum(size / LARGEST, 1.0))


@lru_cache(maxsize=1)
def _bend() -> complex:
    """Change of S/√ka, relative to it, from ``LARGEST`` to infinity: ∝ 1/ka."""
    half, last = (
        _table("whole").at(_coordinate(np.array(x))) * x**1.5 / (1.0 + x**1.5)
        for x in (LARGEST / 2, LARGEST)
    )
    return complex((last - half) / last)


@lru_cache(maxsize=len(WAVES))
def _table(wave: str) -> Cubics:
    """S·e^{2ika}·(1 + ka^1.5)/ka², which is flat at both ends, or a part of it, over ``_coordinate``."""

    def flattened(place: np.ndarray) -> np.ndarray:
        size = _size(place)
        value = scattering_sum(size, math.pi) * np.exp(2j * size)
        if wave != "whole":
            mirrored = _mirrored(size)
            later = np.exp(-1j * CREEPING * size)
            value = mirrored if wave == "mirror" else (value - mirrored) * later
        return np.asarray(value * (1.0 + size**1.5) / size**2)

    first, last = (float(_coordinate(np.array(end))) for end in (1e-6, LARGEST))
    return Cubics.of(flattened, first, last, 6000)


@lru_cache(maxsize=1)
def _tables() -> tuple[float, float, int, np.ndarray]:
    """Arguments of the kernels: all of ``WAVES``, one after the other."""
    return *_table("whole").given[:3], np.concatenate([_table(wave).table for wave in WAVES])


@lru_cache(maxsize=1)
def _envelope() -> np.ndarray:
    """No |S(x, π)| is larger up to even steps of ``_coordinate``; a hair beyond the last, for rounding."""
    size = _size(np.linspace(0.0, _coordinate(LARGEST), FINE + 1))
    largest = np.maximum.accumulate(np.abs(_backscatter(size))) * 1.001
    return np.append(largest, largest[-1])


def _coordinate(size: np.ndarray | float) -> np.ndarray:
    """Even steps of it are small where S wiggles (ka near 1) and wide where it is smooth."""
    return np.log1p(2.0 * size)


def _size(coordinate: np.ndarray) -> np.ndarray:
    return np.expm1(coordinate) / 2.0
