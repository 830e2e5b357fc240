"""Measures of a recorded or simulated decay: T20 and C50 by octave, and the decay's shape.

A forest's sound falls as a power of time rather than as an exponential, because scattered sound spreads as it
travels. Both laws are fitted, by least squares in dB, to the energy of short frames of an octave; the
residual says which it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy import signal
from scipy.integrate import cumulative_trapezoid, trapezoid
from scipy.io import wavfile

from forest_addon.api import Air, ImpulseResponse, Reverb, SpecError

from ..inside import (
    DB_PER_NEPER,
    OMNI,
    Density,
    Directivity,
    Expansions,
    FoliageCanopy,
    Losses,
    Sent,
    Trunks,
    TrunkStand,
    absorption,
    clutter_around,
    cross_sections,
    impulse_response,
    octave,
    onset,
    reverberation_time,
    room_metrics,
    stream,
    tail_of,
)
from .run import Comparison, Interval

FRAME = 0.02  # s
BEGIN = 0.03  # s after the onset, from where laws are fitted
FALL = 40.0  # dB below the largest frame after BEGIN, down to where
LEAD = 0.002  # s kept before the onset


@dataclass(frozen=True)
class Decay:
    """Decay by octave (B,): Hz, t20 in s, c50 in dB, both laws' residuals in dB, the power law's exponent."""

    band: np.ndarray
    t20: np.ndarray
    c50: np.ndarray
    exponential: np.ndarray
    power: np.ndarray
    exponent: np.ndarray


def decay_of(
    samples: np.ndarray, rate: float, bands: np.ndarray, left_db: np.ndarray | None = None
) -> Decay:
    """Decay of an impulse response; a band of 0 is the whole."""
    measures = room_metrics(samples, rate, left_db)
    rows = [int(np.flatnonzero(measures.band == band)[0]) for band in bands]
    start = onset(samples)
    parts = [octave(samples, rate, float(band)) if band else samples for band in bands]
    laws = np.array([_laws(part, rate, start) for part in parts])
    return Decay(bands, measures.t20[rows], measures.c50[rows], *laws.T)


def read_recording(path: Path, rate: float) -> np.ndarray:
    """(N,) samples at ``rate`` from shortly before the onset on, the mean of all channels.

    Raises
    ------
    SpecError : the file is no recording that can be read.
    """
    try:
        own, recorded = wavfile.read(path)
    except (OSError, ValueError) as problem:
        raise SpecError(str(path), f"is no WAV that can be read ({problem})") from None
    samples = np.asarray(recorded, np.float64)
    samples = samples.mean(axis=1) if samples.ndim == 2 else samples
    if own != rate:
        divisor = math.gcd(int(own), int(rate))
        samples = signal.resample_poly(samples, int(rate) // divisor, int(own) // divisor)
    return np.asarray(samples[max(0, onset(samples) - int(LEAD * rate)) :])


def missing_loss(samples: np.ndarray, rate: float, band: float, t20: float, speed: float) -> float:
    """dB a metre of path that an octave must lose besides for its T20 to be ``t20``; NaN: it cannot."""
    heard = octave(samples, rate, band)
    metres = np.arange(len(heard)) * (speed / rate)

    def apart(loss: float) -> float:
        return (
            reverberation_time(heard * 10.0 ** (-loss * metres / 20.0), rate, (-5.0, -25.0)) - t20
        )

    low, high = -0.05, 1.0
    if not (apart(low) > 0 > apart(high)):
        return math.nan
    for _ in range(14):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if apart(middle) > 0 else (low, middle)
    return 0.5 * (low + high)


def _laws(samples: np.ndarray, rate: float, start: int) -> tuple[float, float, float]:
    """Residuals of an exponential and of a power law in dB, and the exponent of the energy's."""
    frame = round(FRAME * rate)
    first = start + round(BEGIN * rate)
    count = (len(samples) - first) // frame
    if count < 8:
        return math.nan, math.nan, math.nan
    energy = np.square(samples[first : first + count * frame]).reshape(count, frame).sum(axis=1)
    level = 10.0 * np.log10(np.maximum(energy, 1e-30))
    quiet = np.flatnonzero(level < level[:5].max() - FALL)
    level = level[: int(quiet[0])] if len(quiet) else level
    if len(level) < 8:
        return math.nan, math.nan, math.nan
    time = BEGIN + FRAME * (np.arange(len(level)) + 0.5)
    fits = []
    for axis in (time, 10.0 * np.log10(time)):
        slope, offset = np.polyfit(axis, level, 1)
        fits.append((float(np.std(level - slope * axis - offset)), float(slope)))
    return fits[0][0], fits[1][0], -fits[1][1]


# Loudspeakers of the recordings, as far as they are known.
#
# Koli was recorded with four Genelec 8130A that point to four sides ("in an attempt to better approximate
# an omni-directional source", OpenAIR), Jura with one portable JBL that points along the transect and
# whose directivity is not published. Both are taken as a Genelec 8030C, of the 8130A's drivers and size,
# as measured in the horizontal plane (Audio Science Review, in the collection *spinorama*): its power
# index from these levels is 3, 5.1, 7.0, 6.9, 7.4 dB at 500 Hz to 8 kHz, the measured one 3.0, 5.1, 5.5,
# 7.0, 7.6 dB.


HZ = np.array([500.0, 1000.0, 2000.0, 4000.0, 8000.0])
ANGLES = np.radians(np.arange(0.0, 181.0, 20.0))
LEVELS = np.array(  # dB re the axis, every 20 degrees; 500 Hz by the power index alone
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [-0.1, -0.5, -0.8, -0.2, -0.5],
        [-0.6, -1.9, -2.9, -2.0, -2.2],
        [-1.3, -4.0, -5.7, -5.5, -6.0],
        [-2.4, -5.6, -8.9, -9.5, -11.3],
        [-4.0, -6.6, -11.5, -13.4, -16.5],
        [-6.2, -8.1, -16.0, -16.2, -20.5],
        [-9.6, -13.0, -12.8, -17.8, -23.3],
        [-15.6, -15.2, -19.5, -18.8, -24.5],
        [-30.0, -12.6, -24.0, -19.8, -28.0],
    ]
)
MONITOR = Directivity(ANGLES, HZ, 10.0 ** (LEVELS / 20.0))
SIDES = np.radians([0.0, 90.0, 180.0, 270.0])


@lru_cache(maxsize=1)
def ring() -> Directivity:
    """Four monitors that point to four sides, mean over azimuths, re where one points; the axis is up."""
    azimuth = np.radians(np.arange(0.0, 360.0, 5.0))
    steep = np.radians(np.arange(0.0, 181.0, 10.0))  # from the vertical

    def energy(slope: float, turned: np.ndarray, hz: float) -> float:
        cosine = np.sin(slope) * np.cos(turned[:, None] - SIDES).ravel()
        gain = MONITOR.around(cosine, hz).reshape(len(turned), len(SIDES))
        return float((gain**2).sum(axis=1).mean())

    mean_square = [
        [energy(s, azimuth, hz) / energy(0.5 * np.pi, np.zeros(1), hz) for hz in HZ.tolist()]
        for s in steep.tolist()
    ]
    return Directivity(steep, HZ, np.sqrt(np.array(mean_square)))


# Stands that may be the recorded one, and their reverberation with each term of the model on or off.
#
# Nobody mapped the trees around the recordings: what is known of such forests is a range. Stands are drawn
# evenly from it (Latin hypercube: each of N equal parts of each range once), so that a band of simulations
# can be held to a recording without tuning one.


FIELD = 120.0  # m; trunks go on around it with the same density
REACH = 350.0  # m

# Range of each property of a stand; (low, high).
RANGES = {
    "density": (0.04, 0.15),  # trunks per m²
    "radius": (0.05, 0.15),  # m
    "flow_resistivity": (50.0, 88.0),  # kPa·s/m², Albert et al. 2015, summer
    "leaf_area_density": (0.0, 0.5),  # m²/m³ at the height of the path, below the crowns
    "leaf_absorption": (0.001, 0.002),  # Watanabe & Yamada 1996
    "leaf_radius": (0.002, 0.02),  # m; needles to birch
    "branch_area_density": (0.02, 0.2),  # m²/m³ of bark: dead branches below crowns, undergrowth
    "branch_radius": (0.003, 0.012),  # m
    "bark": (0.02, 0.10),  # Li et al. 2020
    "turbulence": (0.0, 3.0),  # 1e-6; Daigle 1979 has 2 to 10 over open ground
    "trunk_height": (10.0, 22.0),  # m
    "lean_deg": (1.0, 3.0),  # a scanned pine 1.3; of Douglas firs those over 2 count as leaning
    "floor_leaf_area": (0.3, 2.0),  # m²/m² of herbs and dwarf shrubs, bare to lush
    "height": (1.0, 1.6),  # m of loudspeaker and microphone, where nobody says it
}
NOT_SETTINGS = ("density", "radius", "height")

EVEN_BY_LOGARITHM = ("density", "radius", "leaf_radius", "branch_area_density", "branch_radius")
OFF = {
    "branches": False,
    "boundary_loss": False,
    "model": "forest",
    "extinction": "none",
    "tail": "none",
    "path_ground": False,
    "bark": 0.0,
    "foliage": False,
    "turbulence": 0.0,
    "trunk_height": 0.0,
    "lean_deg": 0.0,
    "floor_leaf_area": 0.0,
}
TERMS: dict[str, tuple[str, ...]] = {
    "extinction alone": ("extinction",),
    "extinction and transport": ("extinction", "tail"),
    "ground": ("path_ground",),
    "ground in moving air": ("path_ground", "turbulence"),
    "ground among trunks that lean": ("path_ground", "lean_deg"),
    "ground under herbs": ("path_ground", "branches", "foliage", "floor_leaf_area"),
    "leaves": ("foliage",),
    "branches and leaves": ("branches", "foliage"),
    "branches and leaves, bark and air at branches": (
        "branches",
        "foliage",
        "bark",
        "boundary_loss",
    ),
    "bark": ("bark",),
    "trunks' ends": ("trunk_height",),
}


class PlausibleStand(SimpleNamespace):
    """One draw: a value for each name of ``RANGES``, and its ``number``."""


@dataclass(frozen=True)
class SoundPath:
    """Between source and receiver: metres, height (0: the stand's), Hz, air, a source that points up."""

    distance: float
    height: float
    rate: float
    air: Air
    source: Directivity = OMNI


def plausible_stands(count: int, seed: int) -> list[PlausibleStand]:
    """Draw ``count`` stands, the parameters of EVEN_BY_LOGARITHM evenly by their logarithm."""
    rng = stream(seed, "validate", "stands")
    columns = {}
    for name, (low, high) in RANGES.items():
        share = (rng.permutation(count) + rng.random(count)) / count
        even = low + (high - low) * share
        columns[name] = low * (high / low) ** share if name in EVEN_BY_LOGARITHM else even
    return [
        PlausibleStand(**{name: float(values[n]) for name, values in columns.items()}, number=n)
        for n in range(count)
    ]


def settings(stand: PlausibleStand, path: SoundPath, **changes: object) -> Reverb:
    """All terms on, but for the changes."""
    half, height = path.distance / 2, path.height or stand.height
    given = {
        "source": (-half, 0.0, height),
        "receiver": (half, 0.0, height),
        "sample_rate": path.rate,
        "model": "forest",
        "surface": "forest floor",
        "continue_to": REACH,
        "facing_elevation_deg": 90.0,
        **{name: getattr(stand, name) for name in RANGES if name not in NOT_SETTINGS},
    }
    return Reverb(**(given | changes))


def variants(stand: PlausibleStand, path: SoundPath) -> dict[str, Reverb]:
    """The ablation: Kaneko & Gamper's model, none of the terms, each, all; all with needles for leaves."""
    every = settings(stand, path)
    settings_of = {
        "Kaneko & Gamper's model": settings(stand, path, model="paper"),
        "none": settings(stand, path, **OFF),
    }
    for name, terms in TERMS.items():
        kept = {key: value for key, value in OFF.items() if key not in terms}
        settings_of[name] = settings(stand, path, **kept)
    needles = {"leaf_area_density": 0.0, "needle_area_density": stand.leaf_area_density}
    return settings_of | {"all": every, "all, leaves as needles": settings(stand, path, **needles)}


def heard(
    stand: PlausibleStand, reverb: Reverb, path: SoundPath, expansions: Expansions | None = None
) -> ImpulseResponse:
    """The response of one stand: trunks evenly at random, all of one radius."""
    rng = stream(stand.number, "validate", "trunks")
    place = rng.uniform(-FIELD / 2, FIELD / 2, (rng.poisson(stand.density * FIELD**2), 2))
    ends = np.array([reverb.source[:2], reverb.receiver[:2]])
    trunks = Trunks(place, np.full(len(place), stand.radius), np.full(len(place), -1))
    return impulse_response(
        trunks.clear_of(ends),
        replace(reverb, tolerance=1e-3),
        path.air,
        directivity=path.source,
        rng=stream(stand.number, "validate", "continuation"),
        field=((-FIELD / 2, -FIELD / 2), (FIELD, FIELD)),
        expansions=expansions,
        key=(stand.number, "validate"),
    )


# Energy that a plausible stand is expected to send to a receiver, by octave and path length, and its
# decay.
#
# Direct sound and ground as waves, what trunks scatter once and again, and what branches and leaves turn:
# the mean over all places that trunks may have, which costs no sum over them.


STEPS = 400  # lengths at which energy is computed
LINES = np.geomspace(0.71, 1.41, 24)  # of an octave
EARLY = 0.05  # s, of C50


@dataclass(frozen=True)
class ExpectedEnergy:
    """Re the source's at 1 m. direct (B,); scattered (B, X) a metre at path lengths (X,) m."""

    direct: np.ndarray
    length: np.ndarray
    scattered: np.ndarray

    def decay(self, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """T20 in s and C50 in dB, (B,) each."""
        decays = []
        for direct, scattered in zip(self.direct, self.scattered, strict=True):
            heard = cumulative_trapezoid(scattered, self.length, initial=0.0)
            left = heard[-1] - heard
            time = (self.length - self.length[0]) / speed
            level = 10.0 * np.log10(np.maximum(left, 1e-30) / (direct + heard[-1]))
            even = np.linspace(0.0, time[-1], 6000)
            curve = np.interp(even, time, level)
            used = (curve <= -5.0) & (curve >= -25.0)
            slope = np.polyfit(even[used], curve[used], 1)[0] if used.sum() > 2 else np.nan
            late = float(np.interp(EARLY, time, left))
            decays.append((-60.0 / slope, 10.0 * np.log10((direct + heard[-1] - late) / late)))
        t20, c50 = np.array(decays).T
        return t20, c50


def expected_energy(
    stand: PlausibleStand,
    path: SoundPath,
    bands: np.ndarray,
    last: float,
    packets: int,
    sent: Callable[[float], Sent] | None = None,
) -> ExpectedEnergy:
    """Expected energy of octaves (B,) for ``last`` seconds. sent : by frequency, energy sent by ways."""
    reverb = settings(stand, path)
    canopy = replace(FoliageCanopy(), top=stand.trunk_height)
    around = TrunkStand(
        stand.density,
        (stand.radius,),
        stand.leaf_area_density,
        stand.trunk_height,
        clutter_around(reverb, canopy),
        stand.floor_leaf_area,
    )
    ends = np.array(reverb.source), np.array(reverb.receiver)
    losses = Losses.of(reverb, path.air, around, *ends)
    key = stand.number, "range"
    tail = tail_of(reverb, losses, Density.even(stand.density), *ends, last, key, packets, sent)
    speed, distance = path.air.speed(), path.distance
    length = np.geomspace(distance * 1.001, last * speed, STEPS)
    direct, scattered = [], []
    for band in bands:
        row = int(np.flatnonzero(tail.band == band)[0])
        once, again = (part[row] for part in tail.energies(length))
        lost = np.exp(-2.0 * np.outer(losses.along(band * LINES), length)).mean(axis=0)
        ground = np.mean([losses.unthinned.mean_square(f, length) for f in band * LINES], axis=0)
        of_air = float(losses.of_air(np.array([band]))[0])
        turned = tail.turned(length)[row] * np.exp(-2.0 * of_air * length)
        scattered.append((once + again) * ground * lost + turned)
        straight = losses.unthinned.mean_square(band * LINES, np.array(distance))
        taken = 2.0 * losses.along(band * LINES) + losses.removed(band * LINES)
        direct.append(float(np.mean(straight * np.exp(-taken * distance))) / distance**2)
    return ExpectedEnergy(np.array(direct), length, np.array(scattered))


# Losses of level sound in plausible stands, term by term and octave by octave, in dB a metre.


def losses_of(stand: PlausibleStand, path: SoundPath, bands: np.ndarray) -> dict[str, np.ndarray]:
    """{term: (B,) dB a metre}, taken for good or scattered away; bark of trunks as of trunks that are met."""
    reverb = settings(stand, path)
    canopy = replace(FoliageCanopy(), top=stand.trunk_height)
    ends = np.array(reverb.source), np.array(reverb.receiver)

    def along(**changes: object) -> Losses:
        given = replace(reverb, **changes)
        clutter = clutter_around(given, canopy)
        around = TrunkStand(
            stand.density,
            (stand.radius,),
            stand.leaf_area_density if given.foliage else 0.0,
            0.0,
            clutter,
        )
        return Losses.of(given, path.air, around, *ends)

    dry = along(boundary_loss=False, bark=0.0)
    barked, wet = along(boundary_loss=False), along(bark=0.0)
    scattered = dry.of_clutter(bands) - dry.of_leaves(bands)
    size = 2.0 * np.pi * bands / path.air.speed() * stand.radius
    trunks = stand.density * stand.radius
    terms = {
        "air": dry.of_air(bands),
        "leaves absorb": dry.of_leaves(bands),
        "bark of trunks": 0.5 * trunks * cross_sections(size, stand.bark).absorption,
        "bark of branches": barked.of_clutter(bands) - dry.of_clutter(bands),
        "air at branches": wet.of_clutter(bands) - dry.of_clutter(bands),
        "branches and leaves scatter": scattered,
        "trunks scatter": 0.5 * dry.removed(bands),
    }
    return {name: DB_PER_NEPER * values for name, values in terms.items()}


def judge_losses(
    stands: Sequence[PlausibleStand], path: SoundPath, bands: np.ndarray
) -> list[Comparison]:
    """A row an octave: the sum of what is taken for good, and each term's median."""
    every = [losses_of(stand, path, bands) for stand in stands]
    rows = []
    for n, band in enumerate(bands):
        terms = {name: np.array([each[name][n] for each in every]) for name in every[0]}
        for_good = sum(values for name, values in terms.items() if "scatter" not in name)
        words = ", ".join(
            f"{name} {np.median(v):.4f} (at most {v.max():.4f})" for name, v in terms.items()
        )
        rows.append(
            Comparison(
                f"Koli, what level sound loses for good at {band:g} Hz",
                "dB/m",
                None,
                Interval.of(np.asarray(for_good)),
                None,
                f"Medians of {len(stands)} stands: {words} dB/m.",
            )
        )
    return rows


# Number of plausible stands that agree with a recording, what they have in common, and what decides.


LAST, PACKETS = 1.8, 1500  # s of sound; packets an octave
NAMED = 4  # properties that matter most, which are named
NEARLY = 1  # measures that a stand may miss and still be named


def judge_agreement(
    stands: Sequence[PlausibleStand],
    path: SoundPath,
    measured: Decay,
    share: float,
    decibels: float,
) -> list[Comparison]:
    """A row an octave, and one of the stands that agree best. share : of T20. decibels : of C50."""
    every = [
        expected_energy(stand, path, measured.band, LAST, PACKETS, sent_by(path.source, 2)).decay(
            path.air.speed()
        )
        for stand in stands
    ]
    t20, c50 = (np.array(part) for part in zip(*every, strict=True))
    near = np.abs(t20 / measured.t20 - 1.0) <= share
    clear = np.abs(c50 - measured.c50) <= decibels
    effects = effects_of(stands, np.log(t20))
    rows = []
    for n, band in enumerate(measured.band):
        largest = sorted(effects, key=lambda name: -abs(effects[name][n]))[:NAMED]
        words = ", ".join(f"{name} {100 * np.expm1(effects[name][n]):+.0f} %" for name in largest)
        true = float(measured.t20[n])
        rows.append(
            Comparison(
                f"Koli, T20 at {band:g} Hz as expected of {len(stands)} stands",
                "s",
                Interval(true, true * (1 - share), true * (1 + share)),
                Interval.of(t20[:, n][np.isfinite(t20[:, n])]),
                None,
                f"{near[:, n].sum()} within {100 * share:.0f} %, C50 of {clear[:, n].sum()} within "
                f"{decibels:g} dB. From the low to the high end of its range each moves T20 by: {words}.",
            )
        )
    return [*rows, _best(stands, near.sum(axis=1) + clear.sum(axis=1), 2 * len(measured.band))]


def sent_by(source: Directivity, axis: int) -> Callable[[float], Sent]:
    """Energy that a source sends by ways, by frequency, re that along its axis, of x, y and z."""
    return lambda frequency: lambda way: source.around(way[:, axis], frequency) ** 2


def effects_of(stands: Sequence[PlausibleStand], values: np.ndarray) -> dict[str, np.ndarray]:
    """Change of values (N, B) over the whole range of each property, by least squares."""
    columns = [np.ones(len(stands))]
    for name, ends in RANGES.items():
        value = np.array([getattr(stand, name) for stand in stands])
        if name in EVEN_BY_LOGARITHM:
            value, ends = np.log(value), (np.log(ends[0]), np.log(ends[1]))
        columns.append((value - ends[0]) / (ends[1] - ends[0]) - 0.5)
    slopes = np.linalg.lstsq(np.column_stack(columns), values, rcond=None)[0]
    return dict(zip(RANGES, slopes[1:], strict=True))


def _best(stands: Sequence[PlausibleStand], met: np.ndarray, all_of: int) -> Comparison:
    best = [stand for stand, count in zip(stands, met, strict=True) if count >= all_of - NEARLY]
    words = "; ".join(
        f"{name} {np.median([getattr(stand, name) for stand in best]):.3g} "
        f"(all: {np.median([getattr(stand, name) for stand in stands]):.3g})"
        for name in RANGES
        if best
    )
    return Comparison(
        f"Koli, measures of {all_of} that the best of {len(stands)} stands meets",
        "",
        Interval(float(all_of)),
        Interval(float(met.max())),
        None,
        f"{len(best)} stands meet {all_of - NEARLY} or more. Their medians: {words}.",
    )


# Level of steady noise by distance in a forest: what impulse responses hold, summed over time.
#
# Expected energies of a stand (direct sound and ground as waves, trunks once and again, branches and
# leaves) by distance, in octaves; beside them levels of steady white noise that two recorders measured at
# 1 to 100 m in an alpine conifer forest (Haupert, Sebe & Sueur 2022), less their background, over what
# spreading and air take.


ALPINE = Air(temperature_c=15.0, humidity=60.0, pressure_kpa=88.0)
NEAREST = 10.0  # m, where levels are 0 dB
BANDS = np.array([1000.0, 2000.0, 4000.0, 8000.0])
HEARD = 3.0  # dB over the background, below which a level is not read
LEVEL_LAST, LEVEL_PACKETS = 6.0, 3000  # s of sound; packets an octave


@dataclass(frozen=True)
class Range:
    """distance (D,) m; excess (B, D) dB over spreading and air, 0 at NEAREST; NaN: not heard."""

    distance: np.ndarray
    excess: np.ndarray


def read_range(path: Path) -> Range:
    """Read what a recorder measured."""
    with np.load(path) as file:
        frequency = 1000.0 * file["frequency"]
        signal, background = file["signal_psd_mean"], file["background_psd_mean"]
        distance = file["distance_m"]
    excess = np.full((len(BANDS), len(distance)), np.nan)
    for row, band in enumerate(BANDS):
        rows = (frequency >= band / np.sqrt(2.0)) & (frequency < band * np.sqrt(2.0))
        whole, noise = signal[rows].sum(axis=0), background[rows].sum(axis=0)
        heard = whole > noise * 10.0 ** (HEARD / 10.0)
        level = 10.0 * np.log10(np.where(heard, whole - noise, np.nan))
        lost = 20.0 * np.log10(distance) + 8.686 * _air(band) * distance
        excess[row] = -(level + lost)
    return Range(distance, excess - excess[:, distance == NEAREST])


def range_of(stand: PlausibleStand, distance: np.ndarray, height: float = 1.5) -> Range:
    """Compute the same of a stand."""
    levels = np.array([_levels(stand, float(r), height) for r in distance]).T
    lost = 20.0 * np.log10(distance) + 8.686 * _air(BANDS)[:, None] * distance
    excess = -(levels + lost)
    return Range(distance, excess - excess[:, distance == NEAREST])


def _air(band: np.ndarray | float) -> np.ndarray:
    return absorption(np.asarray(band), ALPINE.temperature_c, ALPINE.humidity, ALPINE.pressure_kpa)


def _levels(stand: PlausibleStand, distance: float, height: float) -> np.ndarray:
    """(B,) dB of all energy, re the source's at 1 m."""
    path = SoundPath(distance, height, 32e3, ALPINE)
    energy = expected_energy(stand, path, BANDS, LEVEL_LAST, LEVEL_PACKETS, sent_by(MONITOR, 0))
    whole = energy.direct + trapezoid(energy.scattered, energy.length, axis=1)
    return np.asarray(10.0 * np.log10(whole))
