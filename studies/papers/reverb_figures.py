"""The figures of Kaneko & Gamper (2021), from our own responses.

Forests of cylinders on 1 km², as in the paper (a = 0.25 m, 24 kHz, ends at 1.5 m): 2 waveforms and spectra,
3 echo density by the number of trees and the distance, 4 energy decay by distance, 5 reverberation time by
octave and clarity by distance. The paper's four findings are tested on these responses, each by a rule that
is printed with its numbers: with the formulas as written, and with trees as faint as in the published code.
Values are means over several forests.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from forest_addon.api import Air, Forest, ImpulseResponse, Normal, Reverb, Stems

from ..inside import (
    FAINT,
    INK,
    Expansions,
    Say,
    Trunks,
    blank_figure,
    impulse_response,
    metrics,
    plant_stems,
    save_figure,
    write_whole,
)

SIDE = 1000.0  # m
RATE, DURATION = 24e3, 4.5  # s; all trunks of 1 km² are heard
FAINT_TREES = math.sqrt(2.0 * math.pi / 343.0)  # 1/√f over 1/√k
AIR = Air(sound_speed=343.0)
COLOURS = ("#c8442c", "#d99a2b", "#4c8c3a", "#2f7f8f", "#3b4ea0", "#7a3b86")
STEADY = (0.15, 1.5)  # s over which echo density is compared


@dataclass(frozen=True)
class Study:
    """Study: numbers of trees, distances in metres, seeds of forests."""

    numbers: tuple[int, ...] = (100_000, 200_000, 500_000)
    distances: tuple[float, ...] = (10.0, 25.0, 50.0, 100.0, 200.0)
    seeds: tuple[int, ...] = (1, 2, 3)


QUICK = Study((10_000, 20_000, 50_000), (10.0, 50.0, 200.0), (1, 2))
Responses = dict[tuple[int, float, int], ImpulseResponse]


def draw_figures(out: Path, quick: bool, say: Say = print) -> list[str]:
    """Compute, draw into a folder, and say which findings hold; returns these sentences."""
    study = QUICK if quick else Study()
    out.mkdir(parents=True, exist_ok=True)
    found = responses(study)
    draw_waveforms(study, found, out / "figure-2-waveforms-spectra.png")
    draw_echo_density(study, found, out / "figure-3-echo-density.png")
    draw_decay(study, found, out / "figure-4-energy-decay.png")
    draw_measures(study, found, out / "figure-5-t60-c50.png")
    sentences = ["The formulas as written:", *findings(study, found)]
    sentences += [
        "Trees 17.4 dB fainter, as in the published code (1/√f in place of 1/√k):",
        *findings(study, as_published(found)),
    ]
    if quick:
        sentences.insert(
            0, "Quick: a tenth of the trees of the paper, so its findings need not hold."
        )
    write_whole(out / "findings.txt", "\n".join(sentences) + "\n")
    for sentence in sentences:
        say(sentence)
    say(f"Wrote figures 2 to 5 and findings.txt into {out}.")
    return sentences


def responses(study: Study) -> Responses:
    """One response for every number of trees, distance and forest."""
    expansions = Expansions()
    field = Forest(size=(SIDE, SIDE), origin=(-SIDE / 2, -SIDE / 2))
    found: Responses = {}
    for number in study.numbers:
        for seed in study.seeds:
            group = Stems(count=number, radius=Normal(mean=0.25))
            position, radius = plant_stems(seed, field, (group,))
            forest = Trunks(position, radius, np.full(number, -1))
            for distance in study.distances:
                reverb = Reverb(
                    source=(-distance / 2, 0.0, 1.5),
                    receiver=(distance / 2, 0.0, 1.5),
                    sample_rate=RATE,
                    duration=DURATION,
                )
                ends = np.array([reverb.source[:2], reverb.receiver[:2]])
                found[number, distance, seed] = impulse_response(
                    forest.clear_of(ends), reverb, AIR, expansions=expansions
                )
    return found


def as_published(found: Responses) -> Responses:
    """The same responses with trees as faint as in the published code."""
    return {key: replace(each, trees=FAINT_TREES * each.trees) for key, each in found.items()}


def findings(study: Study, found: Responses) -> list[str]:
    """The paper's findings, each with numbers and whether it is reproduced."""
    few, many, near = study.numbers[0], study.numbers[-1], study.distances[0]
    steady = {number: _steady_density(study, found, number, near) for number in (few, many)}
    spread = {number: float(np.ptp(density)) for number, density in steady.items()}
    t60 = {number: _mean_t30(study, found, number, near) for number in study.numbers}
    octaves, whole = t60[many][1:], [values[0] for values in t60.values()]
    clarity = {
        number: [_mean_c50(study, found, number, distance) for distance in study.distances]
        for number in study.numbers
    }
    return [
        _verdict(
            f"Near-constant echo density for N = {many:,}",
            spread[many] < 0.1 and spread[many] < spread[few],
            f"{steady[many].min():.2f} to {steady[many].max():.2f} between {STEADY[0]:g} and "
            f"{STEADY[1]:g} s; {steady[few].min():.2f} to {steady[few].max():.2f} for N = {few:,}; "
            "holds where it changes by less than 0.1, and less than for few",
        ),
        _verdict(
            "T60 depends on frequency",
            np.nanmax(octaves) > 1.2 * np.nanmin(octaves),
            f"{np.nanmin(octaves):.2f} to {np.nanmax(octaves):.2f} s over octaves, N = {many:,}, "
            f"D = {near:g} m; holds where the largest is 1.2 times the smallest",
        ),
        _verdict(
            "C50 falls with distance",
            all(np.all(np.diff(values) < 0) for values in clarity.values()),
            "dB at "
            + ", ".join(f"{distance:g}" for distance in study.distances)
            + " m: "
            + "; ".join(
                f"N = {n:,}: " + ", ".join(f"{c:.1f}" for c in v) for n, v in clarity.items()
            )
            + "; holds where each is below the one before",
        ),
        _verdict(
            "More cylinders, longer T60",
            bool(np.all(np.diff(whole) > 0)),
            ", ".join(
                f"{value:.2f} s for {n:,}" for n, value in zip(study.numbers, whole, strict=True)
            )
            + f", whole band, D = {near:g} m; holds where each is longer than the one before",
        ),
    ]


def _verdict(finding: str, holds: bool, numbers: str) -> str:
    return f"{finding}: {'reproduced' if holds else 'NOT reproduced'} ({numbers})."


def _steady_density(study: Study, found: Responses, number: int, distance: float) -> np.ndarray:
    """Echo density within ``STEADY``, mean over forests, over 0.1 s."""
    rows = []
    for seed in study.seeds:
        time, density = metrics.echo_density(found[number, distance, seed].samples, RATE)
        rows.append(density[(time >= STEADY[0]) & (time <= STEADY[1])])
    return np.convolve(np.mean(rows, axis=0), np.full(10, 0.1), mode="valid")


def _mean_t30(study: Study, found: Responses, number: int, distance: float) -> np.ndarray:
    """(B,) reverberation times read from -5 to -35 dB, the whole band first."""
    rows = [
        metrics.room_metrics(heard.samples, RATE, heard.left_db).t30
        for heard in (found[number, distance, seed] for seed in study.seeds)
    ]
    return np.mean(rows, axis=0)


def _mean_c50(study: Study, found: Responses, number: int, distance: float) -> float:
    return float(
        np.mean([metrics.clarity_db(found[number, distance, s].samples, RATE) for s in study.seeds])
    )


def draw_waveforms(study: Study, found: Responses, path: Path) -> Path:
    """Figure 2: waveform and spectrum for each number of trees, at the shortest distance."""
    figure, axes = _grid(len(study.numbers), 2, (11, 2.4 * len(study.numbers)))
    for row, number in enumerate(study.numbers):
        samples = found[number, study.distances[0], study.seeds[0]].samples
        time = np.arange(len(samples)) / RATE
        wave, tone = axes[row]
        wave.plot(time, samples, color=INK, linewidth=0.3)
        wave.set_ylim(*(np.array([-1.1, 1.1]) * np.abs(samples).max()))
        wave.set_xlim(0, 0.5)
        wave.set_title(f"N = {number:,}: pressure re the source at 1 m")
        tone.semilogx(*_third_octaves(samples), color=COLOURS[row])
        tone.set_xlim(20, RATE / 2)
        tone.set_title("Spectrum, level in thirds of an octave (dB)")
    axes[-1][0].set_xlabel("seconds")
    axes[-1][1].set_xlabel("Hz")
    return save_figure(figure, path)


def _third_octaves(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean power density by thirds of an octave: frequencies and dB."""
    power = np.abs(np.fft.rfft(samples)) ** 2
    frequency = np.fft.rfftfreq(len(samples), 1 / RATE)
    middle = 1000.0 * 2.0 ** (np.arange(-17, 11) / 3)
    level = [
        power[(frequency >= f * 2 ** (-1 / 6)) & (frequency < f * 2 ** (1 / 6))].mean()
        for f in middle
    ]
    return middle, 10 * np.log10(level)


def draw_echo_density(study: Study, found: Responses, path: Path) -> Path:
    """Figure 3: echo density over time, by distance, one panel for each number of trees."""
    figure, axes = _grid(1, len(study.numbers), (11, 3.4))
    for panel, number in zip(axes[0], study.numbers, strict=True):
        for colour, distance in zip(COLOURS, study.distances, strict=False):
            response = found[number, distance, study.seeds[0]]
            panel.plot(
                *metrics.echo_density(response.samples, RATE),
                color=colour,
                linewidth=0.9,
                label=f"{distance:g} m",
            )
        panel.axhline(1, color=FAINT, linewidth=0.8)
        panel.set_ylim(0, 1.2)
        panel.set_xlim(0, 2.0)
        panel.set_xlabel("seconds")
        panel.set_title(f"Echo density, N = {number:,}")
    axes[0][-1].legend(title="distance")
    return save_figure(figure, path)


def draw_decay(study: Study, found: Responses, path: Path) -> Path:
    """Figure 4: energy decay by distance, one panel for each number of trees."""
    figure, axes = _grid(1, len(study.numbers), (11, 3.4))
    for panel, number in zip(axes[0], study.numbers, strict=True):
        for colour, distance in zip(COLOURS, study.distances, strict=False):
            response = found[number, distance, study.seeds[0]]
            decay = metrics.energy_decay_db(response.samples)
            time = np.arange(len(decay)) / RATE - response.direct_delay
            panel.plot(time, decay, color=colour, label=f"{distance:g} m")
        panel.set_ylim(-70, 2)
        panel.set_xlim(-0.05, 2.5)
        panel.set_xlabel("seconds after the direct sound")
        panel.set_title(f"Energy decay (dB), N = {number:,}")
    axes[0][-1].legend(title="distance")
    return save_figure(figure, path)


def draw_measures(study: Study, found: Responses, path: Path) -> Path:
    """Figure 5: reverberation time by octave, and clarity by distance."""
    figure, ((time, clarity),) = _grid(1, 2, (11, 3.8))
    near = study.distances[0]
    bands = metrics.octave_bands(RATE)
    for colour, number in zip(COLOURS, study.numbers, strict=False):
        seconds = _mean_t30(study, found, number, near)[1:]
        time.semilogx(bands, seconds, "o-", color=colour, label=f"N = {number:,}")
        values = [_mean_c50(study, found, number, distance) for distance in study.distances]
        clarity.plot(study.distances, values, "o-", color=colour, label=f"N = {number:,}")
    time.set_xticks(bands, labels=[f"{band:g}" for band in bands])
    time.minorticks_off()
    time.set_ylim(0, None)
    time.set_xlabel("Hz")
    time.set_title(f"T60 by octave (s), read from -5 to -35 dB, D = {near:g} m")
    clarity.set_xlabel("distance, m")
    clarity.set_title("C50 (dB)")
    clarity.legend()
    return save_figure(figure, path)


def _grid(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, Sequence]:
    figure = blank_figure(size)
    return figure, figure.subplots(rows, columns, squeeze=False)
