"""A biosonar held to recordings: echoes of a planter and of a pole at 40 kHz, 0.5 and 1 m away.

What is known of the recorder comes from the pole: its pulse and its level (the pole's own echo over that of
a simulated pole), the width of its beam and how high it stands (the pole's second echo, by way of the
floor). Nothing comes from the planter. Plants are drawn, a box of leaves each, and asked for the same
measures, as many aspects of each as were recorded.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import signal

from forest_addon.api import Air, Echo, Rays, Sonar, SpecError, TriMesh

from ..inside import (
    BARK,
    LEAF_GREEN,
    OTHER,
    WOOD,
    EchoTargets,
    Equipment,
    Station,
    blank_figure,
    join_meshes,
    make_caster,
    nearest_leaves,
    ping,
    rescattering,
    save_figure,
    stream,
    tube,
)
from ..scenes import scene_of, turned
from .run import Comparison, Interval, Picture

TITLE = "Sonar: echoes of a planter"
SUMMARY = """\
Measured: echoes of a planter with foliage and of a pole, 0.5 and 1 m away, about 40 kHz, 300 kHz sampling (D.
Vanderelst and Thinh's data repository, ThinhData; no licence stated: compared, not shipped). Neither size nor
species nor beam are stated. The 25 rows of the planter are five aspects of five pings each, alike to 1.00,
so each measure is one of five aspects, here as in the recording. Pulse and level are the pole's at 0.5 m;
nothing is fitted to the planter. Plants are drawn: a box of foliage with sides of 0.2 to 0.6 m, leaves of 2
to 12 cm that are 0.35 to 0.9 times as wide, 2 to 15 m² of them a cubic metre, inclined between a sphere and
mostly level, eight stems and a pot below. The pole's radius is drawn too, 5 to 60 mm: it sets the level, by
10 dB. *Simulated* is the median, and the interval that holds 90 % of the plants; *agrees*: the recording is
in it. Times are after 2(d - 0.25 m)/c.
"""
TERMS = """\
What agrees, agrees within wide intervals: five aspects of a plant that nobody has seen, beside a pole of
unknown radius, leave 19 dB for the energy and a factor of five for its spread. The table can still tell: the
fit of Tanveer et al. is 20 dB too loud.

What does not agree is the tail. From 3 ms on the recording falls ten times in 2 ms and more, the simulation
in less than one: single scattering ends with the plant. Echoes between leaves, solved for plants of few
leaves, come 0.2 ms later in the mean and give back the 3 dB that extinction takes; the floor and the room add
theirs in the recording (the pole's own second echo comes by the floor, and all four recordings have faint
echoes from 11 ms on). The pole at 1 m is 1 dB louder than by its echo at 0.5 m, whatever its radius, as if it
stood at 0.92 m, though it is heard at the right time.

Why the planter falls faster than the pole: a leaf's echo falls as r⁻⁴, a pole's as r⁻³, and the nearest
leaves, 0.3 m away in the one recording and 0.8 m in the other, have most of it: half of the plants fall by
3 dB, one in five by more than the recorded 4.7. Against all of the pole's echo, with that by the floor, the
planter has 4.6 dB at 1 m.

What was tried: the near field is in all ways. Leaves that shade each other (extinction) make echoes 2 dB
fainter and end them sooner. Bent leaves (flat facets, up to 1 rad from end to end; few plants, which makes
intervals narrow) change little. Stems and pot add 0.3 dB.
"""
DISTANCES = (0.5, 1.0)  # m
ASPECTS, REPEATS = 5, 5  # of the planter: rows of a recording
BAND = (30e3, 55e3)  # Hz
RATE = 300e3  # Hz
RECORD = 7000  # samples
AHEAD, BEYOND = 0.25, 0.75  # m before and behind the distance: what is measured
SPEED = Air().speed()
POLE = (0.005, 0.06)  # m, radius
PULSE = (0.3e-3, 1.4e-3)  # s before and after the peak of the pole's echo
SECOND = (1.2e-3, 2.8e-3)  # s after it: the echo by way of the floor
PLANTS = 60
TILES = 6  # triangles of a leaf; rings of a curved one
LEAF_PART = 2
LATE = 3e-3  # s, from where on it is the tail
SOLVED = 150  # leaves of a plant whose echoes between leaves are solved
NARROW = (38.5e3, 41.5e3)  # Hz
MEASURES = {  # quantity and unit of what ``measures`` gives, in order
    "energy": ("energy over the pole's", "dB"),
    "spread": ("spread of energy between aspects (coefficient of variation)", ""),
    "first": ("first tenth of the energy", "ms"),
    "last": ("last tenth of the energy", "ms"),
    "alike": ("largest correlation between aspects, median", ""),
    "scintillation": ("scintillation around the peak", ""),
    "peak": ("peak over root mean square", ""),
    "late": ("energy later than 3 ms, of all", "dB"),
}


Where = tuple[float, float]  # turn about the upright axis, rad, and metres along x


@dataclass(frozen=True)
class Recorder:
    """Recorder as the pole tells it: (K,) Hz, the pulse's spectrum (K,) over 1 at 1 m; full width of its
    beam, rad; height over the floor, m."""

    frequency: np.ndarray
    pulse: np.ndarray
    width: float
    height: float


@dataclass(frozen=True)
class PottedPlant:
    """A plant about the middle of its foliage: leaves (L,) by centre, normal and along (L, 3), half length,
    half width and bend (rad, from rim to rim) of each; stems and pot as a mesh of wood and one of facets."""

    centre: np.ndarray
    normal: np.ndarray
    along: np.ndarray
    length: np.ndarray
    width: np.ndarray
    bend: np.ndarray
    wood: TriMesh
    pot: TriMesh


def read_echoes(path: Path) -> np.ndarray:
    """(R, N) samples in the band.

    Raises
    ------
    SpecError : there is no such recording.
    """
    try:
        with np.load(path) as kept:
            echo, rate = kept["echo"].astype(np.float64), float(kept["sample_rate"])
    except (OSError, KeyError, ValueError) as problem:
        raise SpecError(str(path), f"is no recording of echoes ({problem})") from None
    if rate != RATE:
        raise SpecError(str(path), f"is sampled at {rate:g} Hz; {RATE:g} is expected")
    return in_band(echo - echo.mean(axis=1, keepdims=True))


def in_band(samples: np.ndarray) -> np.ndarray:
    """Samples (..., N) without what is outside ``BAND``."""
    filters = signal.butter(4, BAND, "band", fs=RATE, output="sos")
    return np.asarray(signal.sosfiltfilt(filters, samples, axis=-1))


def measures(aspects: np.ndarray, distance: float) -> dict[str, float]:
    """Measures of the echoes (A, N) of some aspects; energy in dB of the recorder's square.

    Times are after 2(d - ``AHEAD``)/c. Scintillation is the variance of the intensity between aspects over
    its squared mean, in the mean over all times where the mean is above half its largest.
    """
    first, last = (round(2 * (distance + off) / SPEED * RATE) for off in (-AHEAD, BEYOND))
    part = aspects[:, first:last]
    intensity = np.abs(signal.hilbert(aspects, axis=1))[:, first:last] ** 2
    energy = intensity.sum(axis=1)
    share = np.cumsum(intensity.mean(axis=0)) / energy.mean()
    norms = np.sqrt((part**2).sum(axis=1))
    pairs = [
        signal.correlate(part[i], part[j], method="fft").max() / (norms[i] * norms[j])
        for i in range(len(part))
        for j in range(i)
    ]
    loud = intensity.mean(axis=0) > 0.5 * intensity.mean(axis=0).max()
    varied = intensity.var(axis=0, ddof=1) / intensity.mean(axis=0) ** 2
    return {
        "energy": 10 * math.log10(energy.mean()),
        "spread": float(energy.std(ddof=1) / energy.mean()),
        "first": float(1e3 / RATE * np.argmax(share > 0.1)),
        "last": float(1e3 / RATE * np.argmax(share > 0.9)),
        "alike": float(np.median(pairs)),
        "scintillation": float(varied[loud].mean()),
        "late": float(10 * np.log10(max(1 - share[round(LATE * RATE)], 1e-9))),
        "peak": float(np.median(np.sqrt(intensity.max(axis=1) / (0.5 * intensity.mean(axis=1))))),
    }


def pole_mesh(radius: float, distance: float, height: float) -> TriMesh:
    """An upright pole from the floor to as far above the sonar."""
    axis = np.array([[distance, 0.0, -height], [distance, 0.0, height]])
    return TriMesh.of_part(*tube(axis, np.full(2, radius), 64), WOOD)


def heard(
    meshes: Sequence[TriMesh], width: float, where: Where = (0.0, 0.0), **settings: Any
) -> tuple[np.ndarray, ...]:
    """(K,) Hz and the transfer function (K,) of a ping from the origin along x; settings : of the sonar."""
    echo = pinged(meshes, sonar_of(width, **settings), where)
    return echo.frequency, echo.spectrum


def sonar_of(width: float, **settings: Any) -> Sonar:
    """The recorder as a sonar at the origin that looks along x, its beam so wide, rad."""
    given = {"band": BAND, "record": RECORD / RATE, "tolerance": 1e-4, "cull": 1e-3} | settings
    beam = (math.degrees(width),) * 2
    return Sonar(position=(0, 0, 0), sample_rate=RATE, beam_width_deg=beam, **given)


def pinged(meshes: Sequence[TriMesh], sonar: Sonar, where: Where = (0.0, 0.0)) -> Echo:
    """The echo of meshes, which shade as the sonar's settings say; where : turn, rad, and metres along x."""
    some = [mesh for mesh in meshes if len(mesh.triangles)]
    place = np.tile([where[1], 0.0], (len(some), 1))
    scene = scene_of(some, turned(place, np.full(len(some), where[0])))
    wood = make_caster(scene.solid(), Rays()) if "trunks" in sonar.shading else None
    everything = make_caster(scene, Rays()) if "extinction" in sonar.shading else None
    return ping(EchoTargets(scene), sonar, Air(), wood, everything=everything)


def sounded(recorder: Recorder, transfer: np.ndarray) -> np.ndarray:
    """(N,) samples as the recorder would have them."""
    length = round(RATE / float(recorder.frequency[1] - recorder.frequency[0]))
    whole = np.zeros(length // 2 + 1, complex)
    first = round(float(recorder.frequency[0]) / RATE * length)
    whole[first : first + len(transfer)] = transfer * recorder.pulse
    return in_band(np.fft.irfft(whole, length)[:RECORD])


def second_echo(pole: np.ndarray) -> tuple[float, float, float]:
    """Peak of the pole's first echo, s, and of its second: s after it and its share of the pressure."""
    envelope = np.abs(signal.hilbert(pole))
    begin = round(2e-3 * RATE)
    peak = begin + int(np.argmax(envelope[begin:]))
    some = slice(*(peak + round(t * RATE) for t in SECOND))
    later = some.start + int(np.argmax(envelope[some]))
    return peak / RATE, (later - peak) / RATE, float(envelope[later] / envelope[peak])


def beam_by_floor(pole: np.ndarray, radius: float, distance: float) -> tuple[float, float]:
    """Full -3 dB width of a Gaussian beam, rad, and height over the floor, m, by the pole's second echo.

    Sound that goes by floor and pole, and the other way round, seems to come from a mirror image 2h below:
    over √((2r)² + (2h)²) from h/r below the axis, twice, where the first goes over 2r once. The pole
    spreads both alike.
    """
    _, late, share = second_echo(pole)
    straight = 2 * (distance - radius)
    path = straight + late * SPEED
    height = 0.5 * math.sqrt(path**2 - straight**2)
    fallen = 2 * straight / path
    off = math.atan2(2 * height, straight)
    sent = share / fallen  # both ways
    power = -20 * math.log10(sent) / 2  # dB one way, 3.01·(off/half)² of a Gaussian
    return 2 * off / math.sqrt(power / (10 * math.log10(2))), height


def calibrated(poles: dict[float, np.ndarray], radius: float) -> Recorder:
    """The recorder by the pole's mean echo (N,) at each distance: its pulse at the first, beam and height by
    the second."""
    near, far = DISTANCES
    width, height = beam_by_floor(poles[far], radius, far)
    frequency, transfer = heard([pole_mesh(radius, near, height)], width, shading="none")
    time = np.arange(RECORD) / RATE
    peak = second_echo(poles[near])[0]
    kept = time > peak - PULSE[0]
    kept &= time < peak + PULSE[1]
    window = np.zeros(RECORD)
    window[kept] = signal.windows.tukey(int(kept.sum()), 0.2)
    sent = np.exp(-2j * math.pi * np.outer(frequency, time[kept])) @ (poles[near] * window)[kept]
    return Recorder(frequency, sent / transfer, width, height)


def draw_plant(seed: int, number: int) -> PottedPlant:
    """A plant as one may be that nobody has seen: a box of 0.2 to 0.6 m, leaves of 2 to 12 cm, 2 to 15 m² of
    them a cubic metre, any inclination between a sphere's and mostly level; stems and a pot below."""
    rng = stream(seed, "validate sonar", number)
    box = rng.uniform(0.2, 0.6, 3)
    length = math.exp(rng.uniform(math.log(0.02), math.log(0.12)))
    shape, density = rng.uniform(0.35, 0.9), math.exp(rng.uniform(math.log(2), math.log(15)))
    level, bend = rng.uniform(1.0, 2.5), rng.uniform(0.0, 1.0)
    leaf = math.pi / 4 * length**2 * shape
    count = int(np.clip(density * box.prod() / leaf, 8, 4000))
    half = 0.5 * length * np.clip(rng.normal(1, 0.2, count), 0.5, 1.5)
    centre = rng.uniform(-0.5, 0.5, (count, 3)) * box
    normal = rng.normal(size=(count, 3)) * (1, 1, level)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    along = np.cross(normal, rng.normal(size=(count, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    foot = np.array([0.0, 0.0, -0.5 * box[2] - 0.05])
    stems = [
        TriMesh.of_part(
            *tube(
                np.stack([foot + rng.uniform(-0.03, 0.03, 3) * (1, 1, 0), tip * (0.7, 0.7, 0.9)]),
                np.full(2, size),
                8,
            ),
            WOOD,
        )
        for tip, size in zip(centre[:8], rng.uniform(0.001, 0.004, 8), strict=False)
    ]
    wide, deep = rng.uniform(0.06, 0.15), rng.uniform(0.1, 0.3)
    sides = np.stack([foot - (0, 0, deep), foot])
    pot = TriMesh.of_part(*tube(sides, wide * np.array([0.8, 1.0]), 32), OTHER)
    return PottedPlant(
        centre, normal, along, half, half * shape, np.full(count, bend), join_meshes(stems), pot
    )


def leaves_of(plant: PottedPlant, curved: bool) -> TriMesh:
    """The leaves: flat hexagons of an ellipse's area, or, curved, surfaces of flat facets that bend along."""
    rings = TILES // 2 if curved else 1
    turn = 2 * math.pi * np.arange(TILES * rings) / (TILES * rings)
    radius = np.repeat(np.arange(1, rings + 1) / rings, len(turn))
    angle = np.tile(turn, rings)
    area = (
        len(turn) / (2 * math.pi) * math.sin(2 * math.pi / len(turn))
    )  # of a polygon, over its circle's
    x = np.append(0.0, radius * np.cos(angle)) / math.sqrt(area)
    y = np.append(0.0, radius * np.sin(angle)) / math.sqrt(area)
    across = np.cross(plant.normal, plant.along)
    s = plant.length[:, None] * x
    depth = np.zeros_like(s)
    if curved:  # about an axis across the blade
        bent = np.maximum(0.5 * plant.bend / plant.length, 1e-9)[:, None]  # 1/radius
        s, depth = np.sin(bent * s) / bent, (1 - np.cos(bent * s)) / bent
        depth = depth - depth.mean(axis=1, keepdims=True)
    places = (
        plant.centre[:, None]
        + s[:, :, None] * plant.along[:, None]
        + (plant.width[:, None] * y)[:, :, None] * across[:, None]
        - depth[:, :, None] * plant.normal[:, None]
    )
    corner, following = np.arange(len(turn)), (np.arange(len(turn)) + 1) % len(turn)
    tiles = [np.stack([corner * 0, 1 + corner, 1 + following], axis=1)]
    for ring in range(1, rings):
        inner, outer = 1 + (ring - 1) * len(turn), 1 + ring * len(turn)
        tiles += [
            np.stack([inner + corner, outer + corner, outer + following], axis=1),
            np.stack([inner + corner, outer + following, inner + following], axis=1),
        ]
    tile = np.concatenate(tiles)
    count = len(plant.centre)
    triangles = (tile + np.arange(count)[:, None, None] * len(x)).reshape(-1, 3)
    mesh = TriMesh.of_part(places.reshape(-1, 3), triangles, OTHER if curved else LEAF_PART)
    if curved:
        return mesh
    return replace(mesh, leaf=np.repeat(np.arange(count), len(tile)).astype(np.int32))


# What is in a simulation: whether leaves are alone, whether they are bent, settings of the sonar, plants.
WAYS: dict[str, tuple[bool, bool, dict[str, Any], int]] = {
    "as the sonar comes": (False, False, {}, PLANTS),
    "leaves that shade each other (extinction)": (
        False,
        False,
        {"shading": "trunks+extinction"},
        20,
    ),
    "without stems and pot": (True, False, {}, 20),
    "leaves of physical optics": (False, False, {"leaf_model": "piston"}, 20),
    "leaves by the fit of Tanveer et al. 2020a": (False, False, {"leaf_model": "paper"}, 20),
    "bent leaves": (False, True, {}, 6),
}


def echoes_of(plant: PottedPlant, recorder: Recorder, distance: float, way: str) -> np.ndarray:
    """(A, N) echoes of a plant's aspects, evenly around."""
    bare, curved, settings, _ = WAYS[way]
    parts = [leaves_of(plant, curved)]
    if not bare:
        parts += [plant.wood, plant.pot]
    echoes = []
    for angle in 2 * math.pi / ASPECTS * np.arange(ASPECTS):
        _, transfer = heard(parts, recorder.width, (angle, distance), **settings)
        echoes.append(sounded(recorder, transfer))
    return np.array(echoes)


def pole_energy(pole: np.ndarray) -> float:
    """dB of the recorder's square, mean of the pole's first echo (R, N)."""
    peak = round(second_echo(pole.mean(axis=0))[0] * RATE)
    part = slice(*(peak + round(t * RATE) for t in (-PULSE[0], PULSE[1])))
    intensity = np.abs(signal.hilbert(pole, axis=1))[:, part] ** 2
    return 10 * math.log10(intensity.sum(axis=1).mean())


def validate(data: Path, out: Path, arguments: argparse.Namespace) -> list[Comparison]:
    """The planter's measures at both distances, then each way to simulate, then the pole alone."""
    folder = data / "echoes"
    poles = {d: read_echoes(folder / f"pole_{d:g}m.npz") for d in DISTANCES}
    planters = {d: read_echoes(folder / f"planter_{d:g}m.npz") for d in DISTANCES}
    planters = {d: rows.reshape(ASPECTS, REPEATS, -1).mean(axis=1) for d, rows in planters.items()}
    means = {d: rows.mean(axis=0) for d, rows in poles.items()}
    levels = {d: pole_energy(rows) for d, rows in poles.items()}
    rng = stream(arguments.seed, "validate sonar", "pole")
    radii = np.exp(rng.uniform(*np.log(POLE), PLANTS))
    recorders = [calibrated(means, radius) for radius in radii.tolist()]
    plants = [draw_plant(arguments.seed, number) for number in range(PLANTS)]

    def over_pole(aspects: np.ndarray, distance: float) -> dict[str, float]:
        found = measures(aspects, distance)
        return found | {"energy": found["energy"] - levels[distance]}

    measured = {d: over_pole(rows, d) for d, rows in planters.items()}
    simulated: dict[str, dict[float, dict[str, np.ndarray]]] = {}
    envelopes: dict[float, list[np.ndarray]] = {d: [] for d in DISTANCES}
    for way, (*_, count) in WAYS.items():
        simulated[way] = {}
        for distance in DISTANCES:
            rows = []
            for plant, recorder in zip(plants[:count], recorders, strict=False):
                aspects = echoes_of(plant, recorder, distance, way)
                rows.append(over_pole(aspects, distance))
                if count == PLANTS:
                    envelopes[distance].append(envelope_of(aspects))
            simulated[way][distance] = {
                name: np.array([row[name] for row in rows]) for name in MEASURES
            }
    judged = simulated[next(iter(WAYS))]
    rows = [
        _judged(f"{quantity}, {d:g} m", unit, measured[d][name], judged[d][name])
        for name, (quantity, unit) in MEASURES.items()
        for d in DISTANCES
    ]
    near, far = DISTANCES
    rows.append(
        _judged(
            "energy over the pole's at 1 m, over that at 0.5 m",
            "dB",
            measured[far]["energy"] - measured[near]["energy"],
            judged[far]["energy"] - judged[near]["energy"],
        )
    )
    picture = Picture(
        _draw({d: envelope_of(rows) for d, rows in planters.items()}, envelopes, out / "sonar.png"),
        "Envelope of the planter's echo, root mean square over five aspects: recorded (brown), and what "
        "holds 90 % of the plants (green) with their median. The recorder is deaf before 1.5 ms.",
    )
    rows[0] = replace(rows[0], pictures=(picture,))
    rows += [_of_way(way, measured, simulated[way]) for way in WAYS]
    return [*rows, *_of_echoes(plants, recorders), *_of_pole(poles, recorders, radii)]


def _judged(
    quantity: str, unit: str, measured: float, simulated: np.ndarray, words: str = ""
) -> Comparison:
    """A measure beside that of every plant: it agrees where it lies within what holds 90 % of them."""
    value, found = Interval(measured), Interval.of(simulated)
    share = f"{(simulated < measured).mean():.0%} of the plants have less." * (len(simulated) > 20)
    words = " ".join(filter(None, (share, words)))
    return Comparison(quantity, unit, value, found, found.meets(value), words)


def _of_way(
    way: str, measured: dict[float, dict[str, float]], found: dict[float, dict[str, np.ndarray]]
) -> Comparison:
    """A way by how many of the measures it has within its intervals, and its medians."""
    pairs = [(name, d) for name in MEASURES for d in DISTANCES]
    within = sum(
        Interval.of(found[d][name]).meets(Interval(measured[d][name])) for name, d in pairs
    )
    medians = "; ".join(
        f"{MEASURES[name][0].split(',')[0]} "
        + ", ".join(f"{np.median(found[d][name]):.2f}" for d in DISTANCES)
        for name in MEASURES
    )
    words = f"{WAYS[way][-1]} plants. Medians at 0.5 and 1 m: {medians}."
    whole = Interval(float(len(pairs)))
    return Comparison(f"{way}: measures within", "", whole, Interval(float(within)), None, words)


def _of_echoes(plants: Sequence[PottedPlant], recorders: Sequence[Recorder]) -> list[Comparison]:
    """Changes by echoes between leaves, of the plants that have few."""
    errors = []
    for plant, recorder in zip(plants, recorders, strict=True):
        if len(plant.centre) > SOLVED:
            continue
        sonar = sonar_of(recorder.width, band=NARROW, shading="extinction")
        echo = pinged([leaves_of(plant, False)], sonar, (0.0, DISTANCES[0]))
        station = Station(sonar, Air(), echo.pose, Equipment.of(sonar))
        leaves = nearest_leaves(echo.groups, SOLVED)
        if leaves is not None:
            errors.append(rescattering(leaves, station))
    alone = [20 * np.log10(np.linalg.norm(f.every) / np.linalg.norm(f.once)) for f in errors]
    words = (
        f"{len(errors)} plants of at most {SOLVED} leaves, 38.5 to 41.5 kHz: all echoes between leaves "
        "(Foldy-Lax with physical optics) against each leaf alone. The spectra with and without, shaded by "
        f"extinction, differ by {np.median([f.relative for f in errors]):.0%} (median, L2)."
    )
    rows = (
        ("energy over that of leaves that shade nothing", "dB", alone, words),
        ("energy over that with extinction", "dB", [f.level_db for f in errors], ""),
        ("mean delay beyond that with extinction", "ms", [1e3 * f.later for f in errors], ""),
    )
    return [
        Comparison(f"multiple scattering, {name}", unit, None, Interval.of(np.array(v)), None, said)
        for name, unit, v, said in rows
    ]


def _of_pole(
    poles: dict[float, np.ndarray], recorders: Sequence[Recorder], radii: np.ndarray
) -> list[Comparison]:
    """The pole at 1 m, as the recorder that it made at 0.5 m has it."""
    near, far = DISTANCES
    levels, delays, widths = [], [], []
    for recorder, radius in zip(recorders[::6], radii[::6].tolist(), strict=True):
        _, transfer = heard(
            [pole_mesh(radius, far, recorder.height)], recorder.width, shading="none"
        )
        echo = sounded(recorder, transfer)
        levels.append(pole_energy(echo[None]) - pole_energy(poles[near]))
        delays.append(1e3 * second_echo(echo)[0])
        widths.append(
            [math.degrees(beam_by_floor(poles[d].mean(axis=0), radius, d)[0]) for d in DISTANCES]
        )
    wide = np.median(widths, axis=0)
    level = pole_energy(poles[far]) - pole_energy(poles[near])
    delay = 1e3 * second_echo(poles[far].mean(axis=0))[0]
    words = (
        f"By its second echo, by way of the floor, the beam is {wide[1]:.0f}° wide (-3 dB, one way; from "
        f"0.5 m {wide[0]:.0f}°) and {np.median([r.height for r in recorders]):.2f} m above the floor."
    )
    return [
        _judged("pole, energy at 1 m over that at 0.5 m", "dB", level, np.array(levels), words),
        Comparison(
            "pole, peak of its echo at 1 m",
            "ms",
            Interval(delay),
            Interval.of(np.array(delays)),
            None,
        ),
    ]


def envelope_of(aspects: np.ndarray) -> np.ndarray:
    """(N,) root mean square of the envelopes (A, N)."""
    squared = np.abs(signal.hilbert(aspects, axis=1)) ** 2
    return np.asarray(np.sqrt(squared.mean(axis=0)))


def _draw(
    measured: dict[float, np.ndarray], simulated: dict[float, list[np.ndarray]], path: Path
) -> Path:
    figure = blank_figure((9, 3.2))
    time = 1e3 / RATE * np.arange(RECORD)
    for number, distance in enumerate(DISTANCES):
        axes = figure.add_subplot(1, 2, number + 1)
        low, middle, high = np.quantile(simulated[distance], [0.05, 0.5, 0.95], axis=0)
        axes.fill_between(time, low, high, color=LEAF_GREEN, alpha=0.25, lw=0)
        axes.plot(time, middle, color=LEAF_GREEN, lw=1)
        axes.plot(time, measured[distance], color=BARK, lw=1)
        first = 2e3 * (distance - AHEAD) / SPEED
        axes.set(yscale="log", ylim=(0.5, 2000), xlim=(first - 0.3, first + 5), xlabel="time, ms")
        axes.set(title=f"{distance:g} m")
        if number == 0:
            axes.set_ylabel("envelope, recorder's units")
    return save_figure(figure, path)
