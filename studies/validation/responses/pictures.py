"""Pictures of the reverb's validation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from forest_addon.sensing.reverb.metrics import octave, onset
from headless.report.pictures import FAINT, INK, LEAF_GREEN, RED, blank_figure, save_figure

from .decay import FRAME, Decay
from .ensemble import JudgedSum


def draw_bands(
    path: Path, measured: Decay, every: Sequence[Decay], before: Sequence[Decay]
) -> Path:
    """T20 and C50 by octave: the recording, and what 90 % of the stands have."""
    figure = blank_figure((10.0, 3.8))
    for axes, name, title in zip(
        figure.subplots(1, 2), ("t20", "c50"), ("T20, s", "C50, dB"), strict=True
    ):
        place = np.arange(len(measured.band))
        for some, colour, label in (
            (before, RED, "Kaneko & Gamper's model"),
            (every, LEAF_GREEN, "all terms"),
        ):
            low, middle, high = np.nanquantile(
                [getattr(each, name) for each in some], [0.05, 0.5, 0.95], axis=0
            )
            axes.fill_between(place, low, high, color=colour, alpha=0.22, lw=0)
            axes.plot(place, middle, color=colour, label=f"{label}, median and 90 % of stands")
        axes.plot(place, getattr(measured, name), "o-", color=INK, label="recording")
        axes.set_xticks(place, [f"{band:g}" for band in measured.band])
        axes.set_xlabel("octave, Hz")
        axes.set_title(title)
        axes.set_ylim(bottom=0)
    figure.axes[0].legend(fontsize=8)
    return save_figure(figure, path)


def draw_ablation(
    path: Path, measured: Decay, rows: dict[str, tuple[np.ndarray, np.ndarray]]
) -> Path:
    """One line a variant; the recording in black."""
    import matplotlib

    colours = matplotlib.colormaps["tab10"].colors
    figure = blank_figure((11.0, 4.4))
    place = np.arange(len(measured.band))
    for axes, part, title in zip(figure.subplots(1, 2), (0, 1), ("T20, s", "C50, dB"), strict=True):
        for number, (name, values) in enumerate(rows.items()):
            strong = {
                "all": (LEAF_GREEN, 2.6),
                "none": (FAINT, 2.6),
                "Kaneko & Gamper's model": (RED, 2.6),
            }
            colour, width = strong.get(name, (colours[number % 10], 1.2))
            axes.plot(place, values[part], color=colour, lw=width, label=name)
        axes.plot(place, (measured.t20, measured.c50)[part], "o-", color=INK, label="recording")
        axes.set_xticks(place, [f"{band:g}" for band in measured.band])
        axes.set_xlabel("octave, Hz")
        axes.set_title(title)
        axes.set_ylim(bottom=0)
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(), loc="outside right upper", fontsize=8
    )
    return save_figure(figure, path)


def draw_decays(
    path: Path, recorded: np.ndarray, simulated: Sequence[np.ndarray], rate: float
) -> Path:
    """Energy of frames of two octaves, over the logarithm of time: a power law is straight."""
    figure = blank_figure((10.0, 3.8))
    for axes, band in zip(figure.subplots(1, 2, sharey=True), (1000.0, 4000.0), strict=True):
        for samples in simulated:
            axes.plot(*_frames(samples, rate, band), color=LEAF_GREEN, alpha=0.4, lw=0.8)
        axes.plot(*_frames(recorded, rate, band), color=INK, lw=1.4)
        axes.set_xscale("log")
        axes.set_ylim(-80, 2)
        axes.set_xlim(0.01, 2.0)
        axes.set_xlabel("s after the onset")
        axes.set_title(f"{band:g} Hz, dB re the first frame: recording black, stands green")
    return save_figure(figure, path)


def _frames(samples: np.ndarray, rate: float, band: float) -> tuple[np.ndarray, np.ndarray]:
    frame = round(FRAME * rate)
    part = octave(samples, rate, band)[onset(samples) :]
    count = len(part) // frame
    energy = np.square(part[: count * frame]).reshape(count, frame).sum(axis=1)
    level = 10.0 * np.log10(np.maximum(energy, 1e-30) / energy[0])
    return FRAME * (np.arange(count) + 0.5), level


def draw_ensembles(path: Path, cases: Sequence[tuple[str, JudgedSum]]) -> Path:
    """Level of each way above exact multiple scattering, by path length."""
    figure = blank_figure((5.2 * len(cases), 3.8))
    colours = (FAINT, RED, "#d99a2b", LEAF_GREEN, "#2f7f8f")
    every = figure.subplots(1, len(cases), sharey=True, squeeze=False)[0]
    for axes, (title, judged) in zip(every, cases, strict=True):
        middle = np.sqrt(judged.edges[1:] * judged.edges[:-1])
        axes.fill_between(middle, -judged.spread, judged.spread, color=FAINT, alpha=0.5, lw=0)
        for (name, level), colour in zip(judged.level.items(), colours, strict=True):
            axes.plot(middle, level, color=colour, lw=1.8, label=name)
        axes.set_xscale("log")
        axes.set_ylim(-20, 4)
        axes.set_xticks((6, 10, 20, 30), ("6", "10", "20", "30"))
        axes.minorticks_off()
        axes.set_xlabel("path, m")
        axes.set_title(title)
    every[0].set_ylabel("dB re exact multiple scattering")
    every[0].legend(fontsize=8, loc="lower left")
    return save_figure(figure, path)
