"""The picture of a site: trees on their estimated intensity, and L(r) - r within its envelopes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from forest_addon.stand.statistics.goodness import Goodness
from forest_addon.stand.statistics.k_function import At
from forest_addon.stand.statistics.window import Window

from .pictures import FAINT, INK, LEAF_GREEN, RED, blank_figure, save_figure
from .species_of_site import SpeciesOfSite

PIXELS = 400  # of the shown intensity along the longer side
MOST = 6  # species shown


def draw_site(grown: Sequence[SpeciesOfSite], window: Window, path: Path) -> Path:
    """One row a species, the six with the most trees."""
    shown = sorted(grown, key=lambda g: -len(g.points))[:MOST]
    figure = blank_figure((11, 4.4 * len(shown)))
    grid = figure.add_gridspec(len(shown), 2, width_ratios=(1.15, 1))
    for row, species in enumerate(shown):
        place, curve = (figure.add_subplot(grid[row, k]) for k in (0, 1))
        show_intensity(place, species.points, species.estimate.at, window)
        place.set_title(f"{species.name}: {len(species.points):,} trees, estimated intensity")
        if species.goodness is not None:
            show_goodness(curve, species.goodness)
        else:
            curve.set_axis_off()
            curve.text(0, 0.9, "too few trees to test", color=INK)
    return save_figure(figure, path)


def draw_goodness(found: Goodness, window: Window, path: Path) -> Path:
    """Return what the statistics say of a stand: L(r) - r, and how far quadrats are off."""
    figure = blank_figure((11, 4.2))
    grid = figure.add_gridspec(1, 2, width_ratios=(1.15, 1))
    curve, quadrats = (figure.add_subplot(grid[0, k]) for k in (0, 1))
    show_goodness(curve, found)
    expected = np.where(found.quadrats.expected >= 1, found.quadrats.expected, np.nan)
    stray = (found.quadrats.count - expected) / np.sqrt(expected)
    reach = max(3.0, float(np.nanmax(np.abs(stray), initial=0.0)))
    image = quadrats.imshow(
        stray,
        extent=(window.low[0], window.high[0], window.low[1], window.high[1]),
        origin="lower",
        cmap="BrBG",
        vmin=-reach,
        vmax=reach,
    )
    figure.colorbar(image, ax=quadrats, label="standard deviations", pad=0.01)
    quadrats.set_title("Trees in quadrats, against the intensity")
    quadrats.set_xlabel("x, m")
    quadrats.set_ylabel("y, m")
    return save_figure(figure, path)


def show_intensity(axes: Axes, points: np.ndarray, at: At, window: Window) -> None:
    """Trees as dots on λ, in trees per hectare."""
    columns, rows = np.maximum(np.ceil(PIXELS * window.extent / window.extent.max()), 2).astype(int)
    x = window.low[0] + (np.arange(columns) + 0.5) * window.extent[0] / columns
    y = window.low[1] + (np.arange(rows) + 0.5) * window.extent[1] / rows
    value = at(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(rows, columns)
    image = axes.imshow(
        np.where(window.coverage((rows, columns)) > 0, value * 1e4, np.nan),
        extent=(window.low[0], window.high[0], window.low[1], window.high[1]),
        origin="lower",
        cmap="YlGn",
        vmin=0,
        interpolation="bilinear",
    )
    size = float(np.clip(60 / np.sqrt(max(len(points), 1)), 0.3, 3))
    axes.plot(*points.T, "o", color=INK, markersize=size, linestyle="none", markeredgewidth=0)
    axes.figure.colorbar(image, ax=axes, label="trees/ha", pad=0.01)
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


def show_goodness(axes: Axes, found: Goodness) -> None:
    """L(r) - r: the observed, the pointwise and the global envelope."""
    radius, bands = found.radius, found.excess
    axes.fill_between(
        radius,
        bands.global_low,
        bands.global_high,
        color=FAINT,
        alpha=0.35,
        linewidth=0,
        label="global envelope, 5 %",
    )
    axes.fill_between(
        radius,
        bands.low,
        bands.high,
        color=LEAF_GREEN,
        alpha=0.3,
        linewidth=0,
        label=f"{bands.simulations} simulations",
    )
    axes.axhline(0, color=FAINT, linewidth=0.8)
    axes.plot(radius, bands.mean, color=LEAF_GREEN, linewidth=0.9, label="their mean")
    axes.plot(radius, bands.observed, color=INK if bands.inside else RED, label="these trees")
    reach = (
        1.15
        * np.abs([bands.global_low, bands.global_high, bands.observed])[
            :, len(radius) // 10 :
        ].max()
    )
    axes.set_ylim(-reach, reach)
    axes.set_xlim(0, radius[-1])
    axes.set_xlabel("r, m")
    axes.set_ylabel("L(r) - r, m")
    axes.set_title(
        f"Inhomogeneous L: p = {bands.p_value:.2g}; quadrats: p = {found.quadrat_p_value:.2g}"
    )
    axes.legend(fontsize=8, loc="lower right", ncols=2)
