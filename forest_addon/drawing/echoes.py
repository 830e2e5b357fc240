"""Pictures of echoes: the scene from above, waveforms, what an ear hears over time and frequency.

Figures 6 and 7 of Tanveer et al. (2020) are drawn from results: the scene from above with the -3 dB contour
of every pose, the leaves that are heard in red, and the waveforms below each other. Beside them stand the
spectrogram and the cochleagram: the output of a bank of gammatone filters (order 4, constant quality), as
levels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import mlab
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..sensing.sonar.beam import Horseshoe, beam_offsets
from ..sensing.sonar.echo import Echo, PingSeries
from ..sensing.sonar.station import SonarPose
from ..spec import Sensor, Sonar, Terrestrial
from .figures import blank_figure, draw_cloud, draw_reverb, draw_scan
from .palette import BARK, FAINT, INK, LEAF_GREEN, RED

HEARD_DB = 40.0  # red are those at most so much weaker than the loudest
FLOOR_DB = 60.0
CHANNELS = 80  # of a cochleagram
QUALITY = 20.0  # centre frequency over -3 dB bandwidth of a channel
RINGS = 25.0  # nepers by which a channel has fallen when it is silent
LINES = 12  # waveforms below each other


def figure_of(
    sensor: Sensor, found: Any, around: tuple[np.ndarray, np.ndarray] | None = None
) -> Figure | None:
    """Draw what a sensor found; None of kinds whose picture is made of strips alone (``draw_strips``).

    around : (M, 2) leaves and (N, 2) stems in metres, that a sonar's map shows; None: the first ping alone.
    """
    if sensor.kind == "tractor":
        return draw_scan(found)
    if sensor.kind == "reverb":
        return draw_reverb(found)
    if sensor.kind in ("terrestrial", "mobile", "airborne"):
        return draw_cloud(found, sensor if isinstance(sensor, Terrestrial) else None)
    if sensor.kind != "sonar":
        return None
    if around is not None and hasattr(found, "echoes"):
        return draw_flight(found, sensor, *around)
    return draw_echo(getattr(found, "echoes", (found,))[0], sensor, *(around or ()))


def draw_echo(
    echo: Echo, sonar: Sonar, leaves: np.ndarray | None = None, stems: np.ndarray | None = None
) -> Figure:
    """Draw a ping: the echo, its spectrum, spectrogram, cochleagram.

    leaves, stems : (M, 2) and (N, 2) metres; where they are given, the beam from above stands beside.
    """
    if leaves is None or stems is None:
        figure = blank_figure((8.1, 8.6))
        grid = figure.add_gridspec(4, 1)
    else:
        figure = blank_figure((13.5, 8.6))
        grid = figure.add_gridspec(4, 2, width_ratios=(1, 1.5))
        _map(figure.add_subplot(grid[:, 0]), [echo], sonar, leaves, stems)
    for row, draw in enumerate((_envelope, _spectrum, _spectrogram, _cochleagram)):
        draw(figure.add_subplot(grid[row, -1]), echo)
    return figure


def draw_flight(flight: PingSeries, sonar: Sonar, leaves: np.ndarray, stems: np.ndarray) -> Figure:
    """Draw poses and their beams from above, and the waveforms (Tanveer et al. 2020, Figures 6 and 7)."""
    figure = blank_figure((13.5, 8.2))
    grid = figure.add_gridspec(1, 2, width_ratios=(1.1, 1))
    _map(figure.add_subplot(grid[0, 0]), flight.echoes, sonar, leaves, stems)
    axes = figure.add_subplot(grid[0, 1])  # each echo to its own height, with its peak level
    shown = flight.echoes[:LINES]
    for number, echo in enumerate(shown):
        wave = echo.heard_waveforms[0]
        peak = float(np.abs(wave).max(initial=0.0))
        axes.plot(echo.time * 1e3, -number + 0.45 * wave / (peak or 1.0), color=INK, linewidth=0.35)
        level = f"{20 * math.log10(peak):.0f} dB" if peak else "silence"
        axes.annotate(
            level, (1.0, -number), xycoords=("axes fraction", "data"), xytext=(3, 0),
            textcoords="offset points", fontsize=7,
        )  # fmt: skip
    axes.set_yticks([-n for n in range(len(shown))], [f"{n + 1}" for n in range(len(shown))])
    axes.set_ylabel("pose")
    axes.set_xlabel("ms after the call")
    axes.set_title("Echoes, each to its own height; peak re call at 1 m")
    axes.margins(x=0)
    return figure


# ------------------------------------------------------------------------------------------ from above


def _map(
    axes: Axes,
    echoes: Sequence[Echo],
    sonar: Sonar,
    leaves: np.ndarray,
    stems: np.ndarray,
) -> None:
    """The scene from above: leaves, those in the beam in red, poses with their -3 dB contours."""
    axes.scatter(*leaves.T, s=0.4, c="#a9c59f", linewidths=0, rasterized=True)
    axes.plot(*stems.T, "o", color=BARK, markersize=2.5, linestyle="none")
    shown = [np.array([echo.pose.position[:2] for echo in echoes])]
    for number, echo in enumerate(echoes, start=1):
        width = _width(echo.pose, sonar)
        heard = echo.heard
        loud = heard.amplitude >= heard.amplitude.max(initial=0.0) * 10 ** (-HEARD_DB / 20)
        places = heard.position[loud & (heard.kind == "leaf")]
        away = places - echo.pose.position
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        red = places[np.hypot(*beam_offsets(away, echo.pose.frame)) <= width / 2]
        axes.scatter(*red[:, :2].T, s=1.4, c=RED, linewidths=0, rasterized=True)
        reach = np.linalg.norm(red - echo.pose.position, axis=1).max(initial=2.0)
        if width < math.pi:
            turn = np.linspace(-width / 2, width / 2, 40)
            forward, left, _ = echo.pose.frame
            edge = echo.pose.position + float(reach) * (
                np.outer(np.cos(turn), forward) + np.outer(np.sin(turn), left)
            )
            outline = np.concatenate([echo.pose.position[None], edge, echo.pose.position[None]])[
                :, :2
            ]
            axes.plot(*outline.T, color=INK, linewidth=0.8)
            shown.append(outline)
        shown.append(red[:, :2])
        place = echo.pose.position[:2]
        axes.plot(*place, "o", color=INK, markersize=4)
        if len(echoes) > 1:
            axes.annotate(f"{number}", place, xytext=(4, 3), textcoords="offset points")
    if len(echoes) > 1:
        axes.plot(*shown[0].T, color=FAINT, linewidth=1.0, zorder=0)
    corners = np.concatenate(shown)
    low, high = corners.min(axis=0) - 1.5, corners.max(axis=0) + 1.5
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal", adjustable="box")
    axes.set_title("From above: -3 dB contours, leaves heard within them in red")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def _width(pose: SonarPose, sonar: Sonar) -> float:
    """Full -3 dB width in radians; 2π of a beam that has none."""
    if sonar.beam == "gaussian":
        return pose.width or math.radians(sonar.beam_width_deg[0])
    if sonar.beam == "horseshoe":
        return float(Horseshoe().width(np.array(sum(sonar.band) / 2)))
    return 2 * math.pi


# ---------------------------------------------------------------------------------------------- signals


def _envelope(axes: Axes, echo: Echo) -> None:
    for number, envelope in enumerate(echo.envelopes):
        level = _level(envelope)
        colour = (LEAF_GREEN, BARK)[number % 2]
        axes.plot(echo.time * 1e3, level, color=colour, linewidth=0.7, label=f"ear {number + 1}")
    top = 20 * math.log10(max(float(echo.envelopes.max(initial=0.0)), 1e-9))
    axes.set_ylim(top - 80, top + 5)
    axes.set_ylabel("dB re call at 1 m")
    axes.set_title("Envelope of the impulse response")
    axes.set_xlabel("ms after the call")
    axes.margins(x=0)
    if 1 < len(echo.envelopes) <= 4:
        axes.legend(loc="upper right")
    metres = axes.secondary_xaxis(
        "top",
        functions=(
            lambda t: t * echo.sound_speed / 2e3,
            lambda r: r * 2e3 / echo.sound_speed,
        ),
    )
    metres.set_xlabel("distance, m")


def _spectrum(axes: Axes, echo: Echo) -> None:
    marker = "o" if len(echo.frequency) == 1 else None
    level = _level(np.abs(echo.spectrum), 1e-12)
    axes.plot(echo.frequency / 1e3, level, color=INK, linewidth=0.6, marker=marker)
    axes.set_title("Transfer function")
    axes.set_xlabel("kHz")
    axes.set_ylabel("dB re call at 1 m")
    axes.margins(x=0)


def _spectrogram(axes: Axes, echo: Echo) -> None:
    signal, rate = echo.heard_waveforms[0], echo.sample_rate
    axes.set_title("Spectrogram of the echo")
    window = min(256, len(signal) // 2)
    if window < 8:
        return
    hop = max(1, window // 8)
    power, frequency, time = mlab.specgram(signal, window, rate, noverlap=window - hop)
    level = 10 * np.log10(np.maximum(power, 1e-30))
    _image(axes, level, (*(1e3 * time[[0, -1]]), *(frequency[[0, -1]] / 1e3)))
    low, high = np.array(_around(echo)) / 1e3
    axes.set_xlim(0.0, len(signal) / rate * 1e3)
    axes.set_ylim(low, high)


def _cochleagram(axes: Axes, echo: Echo) -> None:
    centre, level = cochleagram(echo)
    _image(axes, level, (0.0, echo.time[-1] * 1e3, centre[0] / 1e3, centre[-1] / 1e3))
    axes.set_xlabel("ms after the call")
    axes.set_title(f"Cochleagram: {CHANNELS} gammatone channels, Q = {QUALITY:g}")


def cochleagram(echo: Echo) -> tuple[np.ndarray, np.ndarray]:
    """Centre frequencies (C,) Hz and levels (C, N) dB of gammatone channels, at the first ear.

    A channel's response is 1/(1 + i(f - f_c)/b)^4, that of a gammatone filter of order 4, with b so that
    it has fallen by 3 dB at f_c ± f_c/2Q.
    """
    low, high = _around(echo)
    centre = np.geomspace(low, high, CHANNELS)
    width = centre / (2 * QUALITY) / math.sqrt(2 ** (1 / 4) - 1)
    signal = echo.heard_waveforms[0]
    rings = math.ceil(RINGS / (2 * math.pi * width.min()) * echo.sample_rate)
    length = len(signal) + rings  # so that no end is heard again at the beginning
    frequency = np.fft.fftfreq(length, 1 / echo.sample_rate)
    spectrum = 2 * np.fft.fft(signal, length) * (frequency > 0)
    every = max(1, len(signal) // 2000)
    levels = []
    for middle, half in zip(centre, width, strict=True):
        response = (1 + 1j * (frequency - middle) / half) ** -4
        heard = np.abs(np.fft.ifft(spectrum * response))[: len(signal) : every]
        levels.append(_level(heard, 1e-15))
    return centre, np.array(levels)


def _around(echo: Echo) -> tuple[float, float]:
    """A band of frequencies with some room around that of the echo."""
    low, high = float(echo.frequency[0]), float(echo.frequency[-1])
    room = max(0.15 * (high - low), 0.01 * high)
    return max(low - room, 1.0), min(high + room, echo.sample_rate / 2)


def _image(axes: Axes, level: np.ndarray, extent: tuple[float, ...]) -> None:
    top = float(level.max())
    axes.imshow(
        level,
        extent=extent,
        origin="lower",
        aspect="auto",
        cmap="inferno",
        vmin=top - FLOOR_DB,
        vmax=top,
        rasterized=True,
    )
    axes.set_ylabel("kHz")


def _level(size: np.ndarray, floor: float = 1e-9) -> np.ndarray:
    return 20 * np.log10(np.maximum(size, floor))
