"""Figures of results, drawn by matplotlib from the arrays that are also written as data.

Notebooks and scripts (``Result.plot``), the report and the studies draw by the same functions.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import (
    BoundaryNorm,
    LinearSegmentedColormap,
    ListedColormap,
    LogNorm,
    Normalize,
    to_rgba_array,
)
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from ..base.trimesh import DEAD, GROUND, LEAF, WOOD
from ..formats.atomic import replacing
from ..sensing.lidar.cloud import ESCAPED, Cloud
from ..sensing.lidar.glance import range_image
from ..sensing.lidar.tractor import TractorScan
from ..sensing.reverb import metrics
from ..sensing.reverb.channels import ImpulseResponse
from ..spec import Terrestrial
from .palette import FAINT, INK, LEAF_GREEN, ORGANS, PAPER, RED, SKY
from .strips import Plot

MOST_POINTS = 150_000  # drawn; more are thinned evenly
STYLE = {
    "font.size": 9,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "legend.frameon": False,
}


def draw_scan(scan: TractorScan) -> Figure:
    """The tractor's matrix: distance above, what was hit below."""
    figure, (far, what) = _figure(2, 1, (11, 6.6))
    extent = (*_edges(scan.track), *_edges(np.rad2deg(scan.angle)))
    distance = np.ma.masked_invalid(scan.distance.T)
    image = far.imshow(
        distance,
        extent=extent,
        origin="lower",
        aspect="auto",
        cmap="viridis_r",
        norm="log",
        interpolation="nearest",
        rasterized=True,
    )
    far.set_facecolor(SKY)
    far.set_title("Distance of the first hit")
    _distance_bar(figure, image, far)
    codes = sorted(ORGANS)
    what.imshow(
        scan.organ.T,
        extent=extent,
        origin="lower",
        aspect="auto",
        cmap=ListedColormap([ORGANS[code][1] for code in codes]),
        norm=BoundaryNorm([codes[0] - 0.5, *(code + 0.5 for code in codes)], len(codes)),
        interpolation="nearest",
        rasterized=True,
    )
    _organ_legend(what, (LEAF, WOOD, GROUND, ESCAPED))
    what.set_title("What was hit")
    for axes in (far, what):
        axes.set_ylabel("angle from the horizontal, °")
    what.set_xlabel("metres along the track")
    return figure


def _edges(centre: np.ndarray) -> tuple[float, float]:
    """Outer edges of cells whose centres are even steps apart; a cell alone is 1 wide."""
    first, last = float(centre[0]), float(centre[-1])
    half = (last - first) / (len(centre) - 1) / 2 if last != first else 0.5
    return first - half, last + half


def draw_cloud(cloud: Cloud, tripod: Terrestrial | None = None) -> Figure:
    """A scan of points: from a tripod the panorama by distance, else the side; and from above."""
    figure, (left, above) = _figure(1, 2, (12.5, 5.2), widths=(1.75, 1))
    every = max(1, -(-len(cloud) // MOST_POINTS))
    order = np.argsort(cloud.position[::every, 2], kind="stable")
    points, organ = cloud.position[::every][order], cloud.returns.organ[::every][order]
    colours = to_rgba_array([ORGANS[o][1] for o in range(DEAD + 1)])[organ]
    if tripod is not None:
        (low_az, high_az), (low_el, high_el) = tripod.azimuth_deg, tripod.elevation_deg
        shown = left.imshow(
            np.ma.masked_invalid(range_image(cloud, tripod)),
            extent=(low_az, high_az, low_el, high_el),
            origin="lower",
            aspect="auto",
            cmap="viridis_r",
            norm="log",
            rasterized=True,
        )
        left.set_facecolor(SKY)
        left.set_title("Panorama: distance of the first hit")
        left.set_xlabel("azimuth, °")
        left.set_ylabel("elevation, °")
        _distance_bar(figure, shown, left)
        near = np.abs(points[:, :2] - np.array(tripod.position)[:2]).max(axis=1) < 22.0
        points, colours = points[near], colours[near]
    else:
        left.scatter(*points[:, [0, 2]].T, s=0.5, c=colours, linewidths=0, rasterized=True)
        left.set_aspect("equal", adjustable="datalim")
        left.set_title("Points from the side")
        left.set_xlabel("x, m")
        left.set_ylabel("z, m")
    above.scatter(*points[:, :2].T, s=0.5, c=colours, linewidths=0, rasterized=True)
    if tripod is not None:
        above.plot(*tripod.position[:2], "o", color=RED, markersize=5)
        above.annotate(
            "scanner",
            tripod.position[:2],
            xytext=(7, 6),
            textcoords="offset points",
            color=RED,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5},
        )
    above.set_aspect("equal")
    above.set_title("Points from above", pad=22)  # over the legend
    above.set_xlabel("x, m")
    above.set_ylabel("y, m")
    dead = (DEAD,) if (organ == DEAD).any() else ()
    _organ_legend(above, (WOOD, LEAF, GROUND, *dead))
    return figure


def draw_reverb(response: ImpulseResponse) -> Figure:
    """An impulse response: waveform, energy decay, spectrogram."""
    figure, (wave, decay, tone) = _figure(3, 1, (11, 8.2))
    time = np.arange(len(response.samples)) / response.sample_rate
    peak = float(np.abs(response.samples).max()) or 1.0
    level = 20 * np.log10(np.maximum(np.abs(response.samples) / peak, 1e-6))
    wave.plot(time * 1e3, level, color=INK, linewidth=0.35)
    wave.axvline(response.direct_delay * 1e3, color=RED, linewidth=0.8)
    wave.annotate(
        "direct sound",
        (response.direct_delay * 1e3, -4),
        xytext=(5, 0),
        textcoords="offset points",
        color=RED,
    )
    wave.set_ylim(-100, 3)
    wave.set_ylabel("dB re peak")
    wave.set_title("Impulse response")

    energy = metrics.energy_decay_db(response.samples)
    decay.plot(time * 1e3, energy, color=LEAF_GREEN, linewidth=1.2)
    decay.axhline(-5, color=FAINT, linewidth=0.8)
    decay.axhline(-35, color=FAINT, linewidth=0.8)
    decay.set_ylim(-70, 2)
    decay.set_ylabel("dB")
    decay.set_title("Energy decay (Schroeder); reverberation time is read between the grey lines")

    window = min(512, max(len(response.samples) // 2, 1))
    tone.specgram(
        response.samples + 1e-9 * peak,
        NFFT=window,
        Fs=int(response.sample_rate),
        noverlap=window * 7 // 8,
        cmap="inferno",
        vmin=20 * np.log10(peak) - 150,
        vmax=20 * np.log10(peak) - 50,
    )
    tone.set_xlim(0, time[-1])
    tone.set_facecolor("black")
    tone.set_ylabel("Hz")
    tone.set_xlabel("seconds")
    tone.set_title("Spectrogram")
    wave.set_xlim(0, time[-1] * 1e3)
    decay.set_xlim(0, time[-1] * 1e3)
    wave.set_xlabel("ms")
    decay.set_xlabel("ms")
    return figure


def _distance_bar(figure: Figure, image: ScalarMappable, axes: Axes) -> None:
    if np.ma.count(image.get_array()) == 0:  # a logarithm has no scale for nothing
        image.set_norm("linear")
        return
    bar = figure.colorbar(image, ax=axes, label="m", pad=0.01)
    low, high = image.get_clim()
    ticks = [t for t in (0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500) if low <= t <= high]
    bar.set_ticks(ticks, labels=[f"{t:g}" for t in ticks])
    bar.minorticks_off()


def _organ_legend(axes: Axes, organs: tuple[int, ...]) -> None:
    axes.legend(
        handles=[
            Patch(facecolor=ORGANS[o][1], edgecolor=FAINT, label=ORGANS[o][0]) for o in organs
        ],
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=len(organs),
        borderaxespad=0.2,
        handlelength=1.2,
        columnspacing=1.0,
    )


def draw_strips(plot: Plot) -> Figure:
    """Draw the picture of any result: its strips above one another, over their common axis."""
    figure, axes = _figure(len(plot.strips), 1, (10, 2.5 * len(plot.strips)))
    for each, strip in zip(axes[::-1], plot.strips, strict=True):
        extent = (plot.across.low, plot.across.high, strip.up.low, strip.up.high)
        each.imshow(strip.pixels, origin="lower", aspect="auto", extent=extent)
        each.set(title=strip.title, ylabel=strip.up.label, xlabel=plot.across.label)
        if strip.values is not None:
            values = strip.values
            scale = LinearSegmentedColormap.from_list("strip", list(strip.colours))
            norm = (LogNorm if values.log else Normalize)(values.low, values.high)
            figure.colorbar(ScalarMappable(norm, scale), ax=each, label=values.label, pad=0.01)
    return figure


def _figure(
    rows: int, columns: int, size: tuple[float, float], widths: tuple[float, ...] | None = None
) -> tuple[Figure, np.ndarray]:
    figure = blank_figure(size)
    grid = figure.add_gridspec(rows, columns, width_ratios=widths)
    axes = [figure.add_subplot(grid[r, c]) for r in range(rows) for c in range(columns)]
    return figure, np.array(axes, dtype=object)


def blank_figure(size: tuple[float, float]) -> Figure:
    """An empty figure in the project's style, inches."""
    import matplotlib

    matplotlib.rcParams.update(STYLE)
    return Figure(figsize=size, layout="constrained", dpi=110)


def figure_on(rendered: np.ndarray) -> tuple[Figure, Axes]:
    """A figure that is a render (H, W, 3), to write on in its pixels."""
    import matplotlib

    matplotlib.rcParams.update(STYLE)
    high, wide = rendered.shape[:2]
    figure = Figure(figsize=(wide / 100, high / 100), dpi=100, facecolor=PAPER)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(rendered)
    axes.set_axis_off()
    return figure, axes


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG; returns the path."""
    with replacing(path) as partial:
        figure.savefig(partial, metadata={"Software": "Forest Sensing"})
    return path
