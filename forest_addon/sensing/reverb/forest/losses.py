"""Losses of a sound on a path by way of a trunk, besides what the trunk does, by length and frequency.

Settings, heights and what the stand is like come in; two functions go out. A trunk is upright, so that it
keeps a sound's vertical wavenumber: over any ground that is the same everywhere, sound by way of trunks is
reflected as the direct sound is, once, along a path as long as all its legs together (the field separates in
the plane and in height; four images, of source, receiver and both, are those of a point that scatters).
With x = r_s + r_r, H of ``acoustics/cylinder`` and P the pressure of Kaneko & Gamper's units,

    P = √(x/(r_s·r_r))/x · H(f, φ) · g(f, x) · e^{-(b(f) + κ(f))x - ikx}

b : what air and leaves take, κ : what other trunks take (``extinction``), nepers per metre. g : the ground,

    g = (x/R₁)·e^{-ik(R₁ - x)} + e^{i·acos Γ}·Q·(x/R₂)·e^{-ik(R₂ - x)},  R = √(x² + (z_s ∓ z_r)²),

Q the spherical wave's reflection. Γ is the coherence that turbulence leaves between both ways: one state of
the air turns their phase by as much, so that the mean of it and its opposite has the energy
|p₁|² + |p₂|² + 2Γ·Re p₁p₂*. And the trunks' end: the Fresnel integral up to their height
and down to its image, for a trunk in the middle of the path, averaged over heights that differ.

Coherence that leaning trunks leave between a path by way of them and the same path by way of the ground.

Heights of both ends, how far trunks lean and a path's length and wavenumber go in; Γ from 1 (upright) to 0
goes out. In the mirrored space over a level ground a trunk that leans by the slope t has a kink at z = 0: its
axis is displaced by t·|z|, and a way that meets it at z, turned by φ, is longer by τ·|z|, τ = t·(ŝ - ŝ')
of its level directions. Along the axis the way grows by (z - z₀)²/2ρ, ρ = r_s·r_r/x, so that trunk and way
give Fresnel integrals over both halves,

    U(z₀) = h(z₀) + h(-z₀),  h(z₀) = e^{ik(τz₀ - ρτ²/2)}·½·erfc(-e^{-iπ/4}·√(k/2ρ)·(z₀ - ρτ)),

z₀ the height at which the straight way, or the one to the mirrored receiver, meets an upright trunk. Γ is the
correlation of both U over trunks anywhere on the way, lean in any direction, and φ as a hard, thick
cylinder turns sound (sin(φ/2)/4); sound that meets N trunks keeps Γ^N. Upright, U = 1. Energies |U|² are
1 within 1 dB and taken as 1. The slow turn of a packet's slope, from trunk to trunk, is not in it: over 200 m
it takes 1 dB where trunks lean by 2 degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from ....acoustics.air import absorption
from ....acoustics.extinction import cross_sections
from ....acoustics.foliage import foliage_loss
from ....acoustics.ground import (
    SURFACES,
    coherence,
    spherical_reflection,
    surface_impedance,
    under_leaves,
)
from ....spec import Air, Reverb
from ..trunks import Trunks
from .clutter import BARE, Clutter, Takes, leaf_loss, level_loss

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline, RectBivariateSpline

LOWEST, HIGHEST = 1.0, 200e3  # Hz; below and above, ground and branches are as they are there
NEAR = 256.0  # m of path, up to which both ways to the ground are told apart
SIZES, SMALLEST = 1024, 1e-3  # ka at which the extinction is computed, and the first of them
MOST_RADII = 24  # radii that stand for all
FLOOR = 0.3  # m of height of the plants on the floor
UNEVEN = 0.2  # standard deviation of trunks' heights over their mean


@dataclass(frozen=True)
class TrunkStand:
    """Stand that paths meet besides single trunks.

    density : trunks per m². radii : m, a few that stand for all.
    leaf_area_density : m²/m³ at the path. trunk_height : m, 0 endless. floor_leaf_area : m²/m² of
    herbs and dwarf shrubs. clutter : branches and leaves that scatter, by height.
    """

    density: float = 0.0
    radii: tuple[float, ...] = ()
    leaf_area_density: float = 0.0
    trunk_height: float = 0.0
    clutter: Clutter = BARE
    floor_leaf_area: float = 0.0


@dataclass(frozen=True)
class Losses:
    """Losses of all paths between a source and a receiver.

    low, high : the heights of the ends, metres. resistivity : of the ground, kPa·s/m², 0: ``constant``.
    back : turbulence turns phases the other way. scattered : what branches and leaves scatter is lost too.
    extinction : as in the settings. bark, foliage, turbulence, ground : switched off where 0 or False.
    boundary : air at branches takes sound. lean : standard deviation of trunks' slopes in each direction.
    """

    air: Air
    stand: TrunkStand
    source_height: float
    receiver_height: float
    extinction: str
    bark: float
    leaf_absorption: float
    ground: bool
    constant: float
    resistivity: float
    impedance_model: str
    turbulence: float
    back: bool = False
    scattered: bool = True
    boundary: bool = False
    lean: float = 0.0

    @classmethod
    def of(
        cls, reverb: Reverb, air: Air, stand: TrunkStand, source: np.ndarray, receiver: np.ndarray
    ) -> Losses:
        """Losses of a model ``forest``."""
        constant = reverb.ground_kind == "constant"
        resistivity = 0.0 if constant else reverb.flow_resistivity or SURFACES[reverb.ground_kind]
        return cls(
            air=air,
            stand=stand,
            source_height=float(source[2]),
            receiver_height=float(receiver[2]),
            extinction=reverb.extinction,
            bark=reverb.bark,
            leaf_absorption=reverb.leaf_absorption if reverb.foliage else 0.0,
            ground=reverb.path_ground,
            constant=reverb.ground,
            resistivity=resistivity,
            impedance_model=reverb.impedance_model,
            turbulence=1e-6 * reverb.turbulence,
            boundary=reverb.boundary_loss,
            lean=math.tan(math.radians(reverb.lean_deg)),
        )

    def along(self, frequency: np.ndarray) -> np.ndarray:
        """(F,) nepers of amplitude per metre that air, leaves and branches take."""
        return self.of_air(frequency) + self.of_clutter(frequency)

    def of_air(self, frequency: np.ndarray) -> np.ndarray:
        """(F,) nepers of amplitude per metre that the air takes."""
        return loss_per_metre(frequency, self.air)

    def of_clutter(self, frequency: np.ndarray) -> np.ndarray:
        """(F,) nepers of amplitude per metre that leaves and branches take, and scatter away."""
        loss = self.of_leaves(frequency)
        level = None
        if self.scattered and not self.stand.clutter.empty:
            height = 0.5 * (self.source_height + self.receiver_height)
            level = level_loss(self.stand.clutter, height, self.air.speed(), self.takes)
        if level is None:
            return loss
        return loss + np.exp(level(np.log(np.clip(frequency, LOWEST, HIGHEST))))

    def of_leaves(self, frequency: np.ndarray) -> np.ndarray:
        """(F,) nepers of amplitude per metre that leaves take."""
        return foliage_loss(frequency, self.stand.leaf_area_density, self.leaf_absorption)

    @property
    def takes(self) -> Takes:
        """Loss to leaves and branches that take sound for good."""
        return Takes(self.leaf_absorption, self.bark, self.boundary)

    @property
    def among_leaves(self) -> bool:
        """Return whether leaves or branches take something."""
        leaves = self.stand.leaf_area_density > 0 and self.leaf_absorption > 0
        return leaves or (self.scattered and not self.stand.clutter.empty)

    def removed(self, frequency: np.ndarray) -> np.ndarray:
        """Share of a sound's energy that trunks take out of it per metre, by ``extinction``."""
        if self.extinction == "none" or not self.stand.radii or self.stand.density == 0:
            return np.zeros(np.shape(frequency))
        frequency = np.asarray(frequency)
        top = 2.0 ** math.ceil(math.log2(max(float(frequency.max(initial=0.0)), 1000.0)))
        given = self.stand.radii, self.bark, self.extinction, self.air.speed()
        width = np.exp(_removed(*given, top)(np.log(np.maximum(frequency, LOWEST))))
        return np.where(frequency > 0, width * self.stand.density, 0.0)

    @property
    def unthinned(self) -> Losses:
        """The same where trunks take nothing: transport has that already."""
        return replace(self, extinction="none")

    @property
    def passes(self) -> bool:
        """Return whether ``gain`` is 1 everywhere."""
        level = self.source_height == self.receiver_height
        none = self.extinction == "none" or self.stand.density == 0
        return level and none and not self.ground and self.stand.trunk_height == 0

    def gain(self, frequency: np.ndarray, length: np.ndarray) -> np.ndarray:
        """g·e^{-κx} with the trunks' ends, and what is lost over R - x; the arguments broadcast."""
        return self.of_ground(frequency, length) * self.of_trunks(frequency, length)

    def of_ground(self, frequency: np.ndarray, length: np.ndarray) -> np.ndarray:
        """g of the ground alone, which the direct sound has too."""
        gain = 0.0
        for rise in self.rises:
            share = self.share(frequency, length, rise)
            gain = gain + share * self.carried(frequency, length, rise)
        return np.asarray(gain)

    def carried(self, frequency: np.ndarray, length: np.ndarray, rise: float) -> np.ndarray:
        """e^{-(b + ik)(R - x)}."""
        wavenumber = 2.0 * math.pi * frequency / self.air.speed()
        loss = self.along(np.asarray(frequency))
        return np.asarray(np.exp(-(loss + 1j * wavenumber) * self.detour(length, rise)))

    def mean_square(self, frequency: np.ndarray, length: np.ndarray) -> np.ndarray:
        """Mean of |g|² over states of the air."""
        if (self.turbulence == 0 and self.lean == 0) or not self.ground:
            return np.asarray(np.abs(self.gain(frequency, length)) ** 2)
        still = replace(self, turbulence=0.0, lean=0.0)
        straight, bounced = (
            still.share(frequency, length, rise) * still.carried(frequency, length, rise)
            for rise in self.rises
        )
        both = np.abs(straight) ** 2 + np.abs(bounced) ** 2
        both = both + 2.0 * self.coherence(frequency, length) * (straight * bounced.conj()).real
        return np.asarray(both * np.abs(self.of_trunks(frequency, length)) ** 2)

    def bounce(self, frequency: np.ndarray, length: float) -> np.ndarray:
        """(F,) what the ground sends back of the direct sound, over so many metres, in this air."""
        rise = self.source_height + self.receiver_height
        path = np.asarray(math.hypot(length, rise))
        still = replace(self, lean=0.0)  # no trunk is on the way
        reflection: np.ndarray = self._reflection(frequency, path, rise)
        return reflection * still._turned(frequency, np.asarray(length))

    @property
    def rises(self) -> tuple[float, ...]:
        """Rise of the straight path and of the ground's, from source to receiver."""
        fall = abs(self.source_height - self.receiver_height)
        return (fall, self.source_height + self.receiver_height)[: 2 if self.ground else 1]

    @staticmethod
    def detour(length: np.ndarray, rise: float) -> np.ndarray:
        """R - x, metres."""
        return np.asarray(rise**2 / (np.hypot(length, rise) + length))

    def share(self, frequency: np.ndarray, length: np.ndarray, rise: float) -> np.ndarray:
        """x/R of the straight path; Q·e^{i·acos Γ}·x/R of the ground's."""
        path = np.hypot(length, rise)
        if rise == self.rises[0]:
            return np.asarray(length / path + 0.0 * frequency)
        return np.asarray(
            length
            / path
            * self._reflection(frequency, path, rise)
            * self._turned(frequency, length)
        )

    def of_trunks(self, frequency: np.ndarray, length: np.ndarray) -> np.ndarray:
        """Gain after what other trunks take, and what trunks' ends leave."""
        gain = np.exp(-0.5 * self.removed(frequency) * length)
        if self.stand.trunk_height > 0:
            gain = gain * self.of_ends(frequency, length)
        return np.asarray(gain)

    def _turned(self, frequency: np.ndarray, length: np.ndarray) -> np.ndarray:
        """e^{i·acos Γ}: what one state of the air, and of trunks that lean, does to the ground's path."""
        if self.turbulence == 0 and self.lean == 0:
            return np.ones(())
        left = self.coherence(frequency, length)
        aside = np.sqrt(np.maximum(1.0 - left**2, 0.0))
        return np.asarray(left + (-1j if self.back else 1j) * aside)

    def coherence(self, frequency: np.ndarray, length: np.ndarray) -> np.ndarray:
        """Γ, that turbulence and trunks that lean leave between both ways over the ground."""
        wavenumber = 2.0 * math.pi * np.maximum(frequency, LOWEST) / self.air.speed()
        low, high = self.source_height, self.receiver_height
        between = np.asarray(2.0 * low * high / (low + high))  # above the bounce
        left = coherence(wavenumber, length, between, self.turbulence)
        if self.lean > 0:
            met = replace(self, extinction="energy").removed(np.asarray(frequency)) * length
            left = left * lean_coherence(wavenumber, length, (low, high), self.lean, met)
        return np.asarray(left)

    def _reflection(self, frequency: np.ndarray, path: np.ndarray, rise: float) -> np.ndarray:
        if self.resistivity == 0:
            return np.asarray(self.constant)
        audible = np.maximum(frequency, LOWEST)
        impedance = surface_impedance(audible, self.resistivity, self.impedance_model)
        area = self.stand.floor_leaf_area
        if area > 0 and self.leaf_absorption > 0:
            radius, absorption = self.stand.clutter.leaf_radius, self.leaf_absorption
            loss = leaf_loss(area / FLOOR, radius, audible, self.air.speed(), absorption)
            given = rise / path, impedance, FLOOR, loss
            impedance = under_leaves(audible, *given, self.air.speed())
        return spherical_reflection(audible, path, rise, impedance, self.air.speed())

    def of_ends(self, frequency: np.ndarray, length: np.ndarray) -> np.ndarray:
        """The part of an endless trunk's sound that comes from between its end and that end's image.

        Heights are normal about their mean, which keeps the Fresnel integral in closed form:
        ∫e^{-iαz²} up to h ± s is 1/2·√(π/iα)·(1 + erf(q·h)), q² = iα/(1 + 2iαs²).
        """
        wavenumber = 2.0 * math.pi * np.maximum(frequency, LOWEST) / self.air.speed()
        bend = 2.0 * wavenumber / length  # α, of a trunk in the middle of the path
        top = self.stand.trunk_height
        place = 0.5 * (self.source_height + self.receiver_height)
        slope = np.sqrt(1j * bend / (1.0 + 2j * bend * (UNEVEN * top) ** 2))
        between: np.ndarray = special.erf(slope * (top - place)) + special.erf(
            slope * (top + place)
        )
        return 0.5 * between


def loss_per_metre(frequency: np.ndarray, air: Air, losses: Losses | None = None) -> np.ndarray:
    """(F,) nepers of amplitude that the air takes, and leaves."""
    if losses is not None:
        return losses.along(frequency)
    return absorption(frequency, air.temperature_c, air.humidity, air.pressure_kpa)


@lru_cache(maxsize=32)
def _removed(
    radii: tuple[float, ...], bark: float, extinction: str, speed: float, highest: float
) -> CubicSpline:
    """Width, metres, that a trunk takes out on average, by frequency up to ``highest`` Hz, by logarithms."""
    different, times = np.unique(radii, return_counts=True)
    wavenumber = 2.0 * math.pi / speed * np.geomspace(LOWEST, 1.001 * highest, SIZES)
    most = max(float(wavenumber[-1] * different[-1]), 1.0)
    width = _widths(2.0 ** math.ceil(math.log2(most)), bark, extinction)
    size = np.maximum(np.outer(different, wavenumber), SMALLEST)
    removed = (times * different) @ np.exp(width(np.log(size))) / len(radii)
    from scipy.interpolate import CubicSpline  # here: other sensors need not wait for its import

    return CubicSpline(np.log(wavenumber * speed / (2.0 * math.pi)), np.log(removed))


@lru_cache(maxsize=16)
def _widths(highest: float, bark: float, extinction: str) -> CubicSpline:
    """Width that trunks take out over the radius, both by logarithms, of sizes ka: smooth, or it would
    ring."""
    size = np.geomspace(SMALLEST, 1.001 * highest, SIZES)
    sections = cross_sections(size, bark)
    taken = sections.energy if extinction == "energy" else sections.extinction
    from scipy.interpolate import CubicSpline  # here: other sensors need not wait for its import

    return CubicSpline(np.log(size), np.log(taken))


def stand_of(
    trunks: Trunks,
    area: float,
    leaf_area_density: float,
    trunk_height: float,
    clutter: Clutter = BARE,
    floor_leaf_area: float = 0.0,
) -> TrunkStand:
    """The stand of trunks on so many m²; not yet any where they are fewer than three."""
    rest = leaf_area_density, trunk_height, clutter, floor_leaf_area
    if len(trunks) < 3 or area <= 0:
        return TrunkStand(0.0, (), *rest)
    radii = trunks.radius[trunks.radius > 0]
    if len(np.unique(radii)) > MOST_RADII:
        radii = np.quantile(radii, (np.arange(MOST_RADII) + 0.5) / MOST_RADII)
    elif len(radii) > MOST_RADII:
        shares = (np.arange(MOST_RADII) + 0.5) / MOST_RADII
        radii = np.quantile(radii, shares, method="nearest")
    return TrunkStand(len(trunks) / area, tuple(radii.tolist()), *rest)


LEANS = 81  # of τ, over REACH of its unit
REACH = 6.5
PLACES = 4  # of trunks along the way
LEAN_SIZES = np.geomspace(
    0.01, 8.0, 19
)  # kδh; below, -log Γ goes on as a power, beyond, Γ falls as 1/k
REACHES = np.geomspace(0.05, 60.0, 6)  # xδ/h
LEAST, MOST = 1e-3, 1.0 - 1e-12  # of Γ, as tabulated


def lean_coherence(
    wavenumber: np.ndarray,
    path: np.ndarray,
    heights: tuple[float, float],
    lean: float,
    met: np.ndarray,
) -> np.ndarray:
    """Γ; the arguments broadcast.

    path : metres. heights : of both ends. lean : standard deviation of a trunk's slope in each of two
    directions. met : trunks that sound meets on the way, on average; at least one of them it met.
    """
    mean = math.sqrt(heights[0] * heights[1])
    size = np.maximum(wavenumber * (lean * mean), 1e-9)
    reach = np.clip(path * (lean / mean), REACHES[0], REACHES[-1])
    table = _table(round(math.log2(heights[0] / heights[1]), 3))
    inside = np.log(np.clip(size, LEAN_SIZES[0], LEAN_SIZES[-1]))
    double = np.exp(table.ev(*np.broadcast_arrays(inside, np.log(reach))))
    first, last = (table.ev(math.log(end), np.log(reach), dx=1) for end in LEAN_SIZES[[0, -1]])
    below, above = np.minimum(size / LEAN_SIZES[0], 1.0), np.maximum(size / LEAN_SIZES[-1], 1.0)
    once = np.exp(-double * below**first) * above ** (-double * last)  # no kinks in frequency
    several = np.maximum(met, 1e-6)
    return np.asarray(
        np.exp(-several * (1.0 - once)) * -np.expm1(-several * once) / -np.expm1(-several)
    )


@lru_cache(maxsize=16)
def _table(ratio: float) -> RectBivariateSpline:
    """log(-log Γ) by the logarithms of kδh and xδ/h, of ends whose heights are as 2^ratio."""
    from scipy.interpolate import RectBivariateSpline  # here: other sensors need not wait for it

    low, high = 2.0 ** (0.5 * ratio), 2.0 ** (-0.5 * ratio)
    gamma = np.array(
        [
            [_once(size, reach, low, high) for reach in REACHES.tolist()]
            for size in LEAN_SIZES.tolist()
        ]
    )
    values = np.log(-np.log(np.clip(gamma, LEAST, MOST)))
    return RectBivariateSpline(np.log(LEAN_SIZES), np.log(REACHES), values, kx=3, ky=3)


def _once(wavenumber: float, path: float, low: float, high: float) -> float:
    """Γ of one trunk of unit lean, in units of the ends' mean height."""
    slope, weight = _slopes()
    share = (np.arange(PLACES) + 0.5) / PLACES
    bend = path * share * (1.0 - share)  # ρ
    straight = _kinked(low + (high - low) * share, slope, wavenumber, bend)
    bounced = _kinked(low - (low + high) * share, slope, wavenumber, bend)
    both = (weight * straight * bounced.conj()).sum()
    sizes = [(weight * np.abs(one) ** 2).sum() for one in (straight, bounced)]
    return float(np.clip(both.real / math.sqrt(sizes[0] * sizes[1]), 0.0, 1.0))


@lru_cache(maxsize=1)
def _slopes() -> tuple[np.ndarray, np.ndarray]:
    """(LEANS, 1) τ of trunks of unit lean, and their weights: normal times 2·sin(φ/2)."""
    slope = np.linspace(-REACH, REACH, LEANS)
    turn = np.sqrt(1.0 - ((np.arange(64) + 0.5) / 64) ** 2)  # sin(φ/2)
    wide = 2.0 * turn[:, None]
    density = (np.exp(-0.5 * (slope / wide) ** 2) / wide).mean(axis=0)
    return slope[:, None], (density / density.sum() / PLACES)[:, None]


def _kinked(
    place: np.ndarray, slope: np.ndarray, wavenumber: float, bend: np.ndarray
) -> np.ndarray:
    """(LEANS, PLACES) U."""
    field: np.ndarray = np.zeros(1, np.complex128)
    for half in (place, -place):
        turned = np.exp(1j * wavenumber * slope * (half - 0.5 * bend * slope))
        met = np.sqrt(0.5 * wavenumber / bend) * (half - bend * slope)
        field = field + turned * 0.5 * special.erfc(-np.exp(-0.25j * math.pi) * met)
    return field
