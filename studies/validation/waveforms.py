"""Waveforms of an airborne digitiser over a deciduous forest, beside ours over stands like it.

Measured are 500 received pulses over Harvard Forest (NEON, by way of R's waveformlidar, Zhou et al. 2017).
Their places, which the file tells, are one transect of 60 x 3 m, so that each of ours is such a transect as
well. Of the stand nothing is known but that it is closed: ours are stands of oak and maple with 500 stems a
hectare of 27 cm (8 cm standard deviation), 31 m² of basal area. Both are measured by the
same functions: Gaussians fitted to each waveform, and moments of its light.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from forest_addon import api

from ..inside import LIGHT, Waveforms, decompose, settings_of, structure
from .run import Comparison, Interval

STANDS, BESIDE = 3, 8  # and transects of each
LENGTH, WIDE, MARGIN = 60.0, 3.0, 5.0  # m, of a transect, and of the stand around them
PULSES = 500  # of a transect
DENSITY, DBH = 0.05, (0.27, 0.08)  # stems a m²; m, mean and standard deviation
NAMES = ("pedunculate-oak", "norway-maple")
CREST, DARK = (
    0.15,
    0.02,
)  # of a waveform's peak: from where on a crest is one, and light is no noise
STEP, SIGMA = (
    1e-9 * LIGHT / 2,
    8.3e-9 * LIGHT / 2,
)  # m, of samples, and of the pulse that fits begin with
BASE = 8  # samples before the light, whose median is the baseline
MEASURES = {
    "Gaussians of a waveform, mean": "",
    "waveforms of one Gaussian": "%",
    "waveforms of three and more": "%",
    "width of the first Gaussian, median": "ns",
    "standard deviation of the light, median": "ns",
    "standard deviation of the light, 90 % are below": "ns",
    "skew of the light, median": "",
    "skew of the light, 90 % are below": "",
}


def measured(waves: Waveforms) -> list[float]:
    """Values of ``MEASURES`` of waveforms with a step of ``STEP``, baseline at 0."""
    first = np.flatnonzero(np.diff(waves.pulse, prepend=-1))
    many = np.diff(np.append(first, len(waves.pulse)))
    power = waves.value / np.repeat(np.maximum.reduceat(waves.value, first), many)
    pulse, _, _, width = decompose(replace(waves, value=power), SIGMA, CREST)
    begin = np.flatnonzero(np.diff(pulse, prepend=-1))
    found = np.diff(np.append(begin, len(pulse)))
    light = np.where(power > DARK, power, 0.0)
    light /= np.repeat(np.add.reduceat(light, first), many)
    away = waves.index - np.repeat(np.add.reduceat(light * waves.index, first), many)
    spread = np.sqrt(np.add.reduceat(light * away**2, first))
    skew = np.add.reduceat(light * away**3, first) / spread**3
    return [
        *(found.mean(), 100 * (found == 1).mean(), 100 * (found >= 3).mean()),
        np.median(width[begin]) / STEP,
        *np.quantile(spread, [0.5, 0.9]),
        *np.quantile(skew, [0.5, 0.9]),
    ]


def received(file: Path) -> Waveforms:
    """Measured waveforms, less their baselines."""
    counts = np.load(file)["received"].astype(float)
    kept = counts > 0
    base = np.array([np.median(row[row > 0][:BASE]) for row in counts])
    pulse, index = np.nonzero(kept)
    return Waveforms(pulse, index, (counts - base[:, None])[kept], STEP)


def simulated(seed: int) -> list[Waveforms]:
    """Waveforms of the transects of a stand of oaks and maples."""
    half = np.array([LENGTH, BESIDE * WIDE]) / 2 + MARGIN
    targets = api.Targets(dbh=api.Normal(mean=DBH[0], sd=DBH[1]))
    trees = tuple(
        api.Planting(species=name, variants=3, density=DENSITY / len(NAMES), targets=targets)
        for name in NAMES
    )
    field = api.Forest(origin=tuple((-half).tolist()), size=tuple((2 * half).tolist()))
    world = api.build(api.Scene(seed=seed, forest=field, plantings=trees))
    plain = structure(settings_of("optech-gemini", "airborne", Path()), api.Airborne)
    high = plain.position[2]
    side = float(np.degrees(np.arctan(BESIDE * WIDE / 2 / high)))
    found = world.scan(
        plain.changed(
            position=(-LENGTH / 2, 0.0, high),
            track=LENGTH,
            heading_deg=0.0,
            field_deg=(-side, side),
            pulse_rate=BESIDE * PULSES / (LENGTH / plain.speed),
            receiver=plain.receiver.changed(echoes="crests"),
        )
    ).found
    transect = np.full(int(found.waves.pulse.max(initial=0)) + 1, -1)
    transect[found.pulse] = np.floor(found.position[:, 1] / WIDE + BESIDE / 2)
    of = transect[found.waves.pulse]
    rows = [of == k for k in range(BESIDE)]
    pulse, index, value = found.waves.pulse, found.waves.index, found.waves.value - 1000.0
    return [Waveforms(pulse[own], index[own], value[own], STEP) for own in rows]


def compare_waveforms(data: Path, seed: int) -> list[Comparison]:
    """Rows of the measured waveforms and of ours over ``STANDS`` stands."""
    real = received(data / "neon_waveforms.npz")
    values = measured(real)
    ours = [measured(waves) for k in range(STANDS) for waves in simulated(seed + k)]
    intervals = [Interval.of(each) for each in np.array(ours).T]
    words = f"Agrees within the 90 % of {len(ours)} transects of {STANDS} stands."
    return [
        Comparison(
            f"digitiser over oaks and maples, {name}",
            *(unit, Interval(float(value)), interval, interval.meets(Interval(value))),
            words=words,
        )
        for (name, unit), value, interval in zip(MEASURES.items(), values, intervals, strict=True)
    ]
