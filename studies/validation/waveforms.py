"""Waveforms of an airborne digitiser over a deciduous forest, beside ours over stands like it.

Measured are 500 received pulses over Harvard Forest (NEON, by way of R's waveformlidar, Zhou et al.
2017): its stand is not described. Ours are stands of oak and maple with stems of 32 cm (7 cm standard
deviation), assumed, seen by the same digitiser with the pulse that it sent (``optech-gemini``), not
fitted. Both are measured by the same functions: Gaussians fitted to each waveform, and moments of its
light.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from forest_addon import api

from ..inside import LIGHT, Waveforms, decompose, pulse_length, settings_of, structure
from .run import Comparison, Interval

STANDS, SIDE, MIDDLE = (
    6,
    40.0,
    12.0,
)  # and metres, of which that many to each side of the middle are seen
PULSES, CREST = 500, 0.15  # of a waveform's peak, from which on a crest is one
STEP, TOTAL = 1e-9 * LIGHT / 2, 250.0  # m; stems a hectare
FLOOR = 8  # samples before the light, whose median is the baseline
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
    """Values of ``MEASURES`` of records of 1 ns, baseline at 0."""
    sigma, rows, moments = pulse_length(15.4), [], []
    for power in np.split(waves.value, waves.starts[1:]):
        one = Waveforms(np.zeros(len(power), int), np.arange(len(power)), power, STEP)
        pulse, _, _, width = decompose(one, sigma, CREST * power.max())
        if not len(pulse):
            continue
        light, time = np.where(power > 0.02 * power.max(), power, 0.0), np.arange(len(power))
        mean = (light * time).sum() / light.sum()
        spread = np.sqrt((light * (time - mean) ** 2).sum() / light.sum())
        moments.append([spread, (light * (time - mean) ** 3).sum() / light.sum() / spread**3])
        rows.append([len(pulse), width[0] / STEP])
    (many, first), (spread, skew) = np.array(rows).T, np.array(moments).T
    shares = 100 * (many == 1).mean(), 100 * (many >= 3).mean()
    wide = np.median(first), np.median(spread), np.quantile(spread, 0.9)
    return [float(many.mean()), *shares, *wide, np.median(skew), np.quantile(skew, 0.9)]


def received(file: Path) -> Waveforms:
    """Measured waveforms, less their baselines."""
    counts = np.load(file)["received"].astype(float)
    kept = counts > 0
    base = np.array([np.median(row[row > 0][:FLOOR]) for row in counts])
    pulse, index = np.nonzero(kept)
    return Waveforms(pulse, index, (counts - base[:, None])[kept], STEP)


def simulated(seed: int) -> Waveforms:
    """Waveforms of a stand of oaks and maples."""
    field = api.Forest(origin=(-SIDE / 2, -SIDE / 2), size=(SIDE, SIDE))
    targets = api.Targets(dbh=api.Normal(mean=0.32, sd=0.07))
    trees = tuple(
        api.Planting(species=name, variants=3, density=TOTAL / 2, targets=targets)
        for name in ("pedunculate-oak", "norway-maple")
    )
    world = api.build(api.Scene(seed=seed, forest=field, plantings=trees))
    plain = structure(settings_of("optech-gemini", "airborne", Path()), api.Airborne)
    wide = float(np.degrees(np.arctan(MIDDLE / plain.position[2])))
    scanner = plain.changed(
        position=(-MIDDLE, 0.0, plain.position[2]),
        track=2 * MIDDLE,
        heading_deg=0.0,
        field_deg=(-wide, wide),
        pulse_rate=PULSES / (2 * MIDDLE / plain.speed),
        receiver=plain.receiver.changed(echoes="crests"),
    )
    waves = world.scan(scanner).found.waves
    return Waveforms(waves.pulse, waves.index, waves.value.astype(float) - 1000.0, STEP)


def compare_waveforms(data: Path, seed: int) -> list[Comparison]:
    """Rows of the measured waveforms and of ours over ``STANDS`` stands."""
    real = received(data / "neon_waveforms.npz")
    values = measured(real)
    ours = np.array([measured(simulated(seed + k)) for k in range(STANDS)]).T
    return [
        Comparison(
            f"digitiser over oaks and maples, {name}",
            unit,
            Interval(value),
            Interval.of(each),
            Interval.of(each).meets(Interval(value)),
            words=f"Of {len(real.starts)} waveforms; agrees within the 90 % of {STANDS} stands.",
        )
        for (name, unit), value, each in zip(MEASURES.items(), values, ours, strict=True)
    ]
