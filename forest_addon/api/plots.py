"""Results as matplotlib figures, for notebooks and scripts; matplotlib is asked for when one is drawn."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING, Any

import numpy as np

from ..results.plot import Plot
from ..sensing.lidar.cloud import Cloud
from ..sensing.lidar.tractor import TractorScan
from ..spec import SpecError

if TYPE_CHECKING:
    from ..sensing.reverb.response import ImpulseResponse
    from ..sensing.sonar.ping import Echo

ORGANS = ("other", "wood", "leaf", "ground", "dead wood")
COLOURS = ("#7a7a7a", "#7a4a1f", "#3f8f3a", "#b8a06a", "#8c8378")
MOST_POINTS = 40_000  # drawn; more are thinned evenly
SOME_STAND = 0.02  # share of points that are not ground, from which on a picture is of these


def draw_cloud(cloud: Cloud) -> Any:
    """Points from above and from the side, coloured by organ; where there are trees, they fill the frame."""
    figure, (above, side) = _figure(1, 2, (10, 4.5))
    rows = slice(None, None, max(1, -(-len(cloud) // MOST_POINTS)))
    place = cloud.position[rows]
    organ = np.clip(cloud.returns.organ[rows], 0, len(ORGANS) - 1)
    for number, (name, colour) in enumerate(zip(ORGANS, COLOURS, strict=True)):
        x, y, z = place[organ == number].T
        if len(x):
            dots = {"ls": "", "marker": "o", "ms": 1.0, "mew": 0.0, "color": colour}
            above.plot(x, y, **dots)
            side.plot(x, z, **dots, label=name)
    above.set(xlabel="x, m", ylabel="y, m", title="from above", aspect="equal")
    side.set(xlabel="x, m", ylabel="z, m", title="from the side", aspect="equal")
    if len(cloud):
        low, high = _frame(place, organ)
        above.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        side.set(xlim=(low[0], high[0]), ylim=(low[2], high[2]))
        side.legend(
            markerscale=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.35), ncols=4
        )
    return figure


def _frame(place: np.ndarray, organ: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest (3,) of what is drawn: what stands, with a little ground around; else all."""
    standing = place[organ != ORGANS.index("ground")]
    if len(standing) < SOME_STAND * len(place):
        standing = place
    low, high = np.quantile(standing, [0.001, 0.999], axis=0)
    edge = np.maximum(0.08 * (high - low), 0.5)
    return np.minimum(low, [np.inf, np.inf, place[:, 2].min()]) - edge, high + edge


def draw_matrix(scan: TractorScan) -> Any:
    """The matrix of distances as an image: along the drive and up the fan."""
    figure, axes = _figure(1, 1, (10, 3.5))
    distance = np.where(np.isfinite(scan.distance), scan.distance, np.nan)
    low, high = np.rad2deg(scan.angle[[0, -1]])
    extent = (scan.track[0], scan.track[-1], low, high)
    image = axes.imshow(distance.T, origin="lower", aspect="auto", extent=extent, cmap="viridis_r")
    axes.set(xlabel="along the drive, m", ylabel="elevation, deg")
    figure.colorbar(image, label="distance, m")
    return figure


def draw_echo(echo: Echo) -> Any:
    """The waveform of the first ear over the range that it comes from, and its spectrum."""
    figure, (above, below) = _figure(2, 1, (9, 5))
    distance = echo.time * echo.sound_speed / 2
    above.plot(distance, echo.waveforms[0], lw=0.6, color="#2b5f8a")
    above.set(xlabel="distance, m", ylabel="pressure re call at 1 m")
    level = 20 * np.log10(np.maximum(np.abs(echo.spectrum), 1e-30))
    below.plot(echo.frequency / 1e3, level, lw=0.8, color="#2b5f8a")
    below.set(xlabel="frequency, kHz", ylabel="level, dB re call at 1 m")
    return figure


def draw_response(found: ImpulseResponse) -> Any:
    """The first channel's samples and the decay of its energy."""
    from ..sensing.reverb.metrics import energy_decay_db

    figure, (above, below) = _figure(2, 1, (9, 5))
    time = np.arange(len(found.samples)) / found.sample_rate
    above.plot(time, found.samples, lw=0.5, color="#8a4a2b")
    above.set(xlabel="time, s", ylabel="pressure re source at 1 m")
    below.plot(time, energy_decay_db(found.samples), lw=0.9, color="#8a4a2b")
    below.set(xlabel="time, s", ylabel="energy left, dB", ylim=(-80, 2))
    return figure


def draw_strips(plot: Plot) -> Any:
    """Draw the picture of any result: its strips above one another, over their common axis."""
    figure, axes = _figure(len(plot.strips), 1, (10, 2.5 * len(plot.strips)))
    for each, strip in zip(np.atleast_1d(axes)[::-1], plot.strips, strict=True):
        extent = (plot.across.low, plot.across.high, strip.up.low, strip.up.high)
        each.imshow(strip.pixels, origin="lower", aspect="auto", extent=extent)
        each.set(title=strip.title, ylabel=strip.up.label, xlabel=plot.across.label)
    return figure


def as_html(result: Any) -> str:
    """A result's figure as an image in HTML; nothing where there is no matplotlib."""
    try:
        figure = result.plot()
    except SpecError:
        return ""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=80)
    return f'<img src="data:image/png;base64,{base64.b64encode(picture.getvalue()).decode()}">'


def _figure(rows: int, columns: int, size: tuple[float, float]) -> Any:
    """A figure and its axes that no window shows."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        from ..blender.packages import to_install

        raise SpecError(
            "plot", f"needs matplotlib; type once: {to_install('matplotlib')}"
        ) from None
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns)
