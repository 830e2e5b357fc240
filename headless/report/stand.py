"""The map of a stand: trees in the colours of their species, over the intensity they were drawn from.

A few thousand trees are drawn as crowns, a million as the share of species in every pixel, so the picture
takes about as long for any number.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import LinearSegmentedColormap, to_rgb
from matplotlib.lines import Line2D

from forest_addon.spec import Scene
from forest_addon.stand.compose import corners_of, process_of
from forest_addon.stand.inputs import Inputs
from forest_addon.stand.plan import Stand

from .pictures import FAINT, INK, blank_figure, save_figure

# Told apart by those who see no red or green, too (Okabe and Ito 2008), in an order that fits trees.
COLOURS = ("#00724f", "#d55e00", "#0072b2", "#c4638f", "#b8860b", "#3b9fd6", "#6b4c9a", "#4a4a4a")
MEADOW = LinearSegmentedColormap.from_list("meadow", ["#fbfcfa", "#dde9cf", "#aecb93"])
FIELD_PIXELS = 360  # of the intensity along the longer side
TREE_PIXELS = 1100  # of many trees along the longer side
MANY = 20_000  # trees from which on pixels are drawn
LEGEND = 12  # species named


def draw_stand(
    stand: Stand, labels: Sequence[str], settings: Scene, inputs: Inputs, path: Path
) -> Path:
    """Draw the map into a PNG; returns its path."""
    low, high = corners_of(settings.forest)
    wide, tall = high - low
    height = float(np.clip(8.6 * tall / wide, 3.2, 9.5))
    figure = blank_figure((11, height))
    axes = figure.add_subplot()
    _show_intensity(axes, settings, inputs, low, high)
    _show_outline(axes, settings)
    if inputs.terrain is not None:
        _show_contours(axes, settings, inputs, low, high)
    colours = np.array([to_rgb(COLOURS[k % len(COLOURS)]) for k in range(max(1, len(labels)))])
    if len(stand) > MANY:
        _show_pixels(axes, stand, colours, low, high)
    else:
        _show_crowns(axes, stand, colours, settings, low, high)
    room = 0.02 * max(wide, tall)
    axes.set_xlim(low[0] - room, high[0] + room)
    axes.set_ylim(low[1] - room, high[1] + room)
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    axes.set_title(f"{settings.name}: {len(stand):,} trees on {stand.area / 1e4:,.3g} ha")
    _name_species(axes, stand, labels, colours)
    return save_figure(figure, path)


def _grid(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, tuple[int, int]]:
    """Centres (N, 2) of the shown pixels, south first, and their rows and columns."""
    size = high - low
    columns, rows = np.maximum(np.ceil(FIELD_PIXELS * size / size.max()), 2).astype(int)
    x = low[0] + (np.arange(columns) + 0.5) * size[0] / columns
    y = low[1] + (np.arange(rows) + 0.5) * size[1] / rows
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), (rows, columns)


def _show_intensity(
    axes: Axes, settings: Scene, inputs: Inputs, low: np.ndarray, high: np.ndarray
) -> None:
    """The sum of all intensities, trees per hectare."""
    drawn = [p for p in settings.plantings if p.layout == "poisson"]
    if not drawn:
        return
    points, shape = _grid(low, high)
    value = sum(process_of(p, settings.forest, inputs).at(points) for p in drawn)
    image = axes.imshow(
        np.reshape(value, shape) * 1e4,
        extent=(low[0], high[0], low[1], high[1]),
        origin="lower",
        cmap=MEADOW,
        vmin=0,
        interpolation="bilinear",
        zorder=0,
    )
    figure = axes.figure
    figure.colorbar(
        image, ax=axes, label="intensity, trees/ha", pad=0.015, shrink=0.5, aspect=24, anchor=(0, 0)
    ).outline.set_edgecolor(FAINT)


def _show_outline(axes: Axes, settings: Scene) -> None:
    field = settings.forest
    for ring in (field.polygon, *field.holes):
        if ring:
            axes.plot(*np.array([*ring, ring[0]]).T, color=INK, linewidth=0.9, zorder=3)


def _show_contours(
    axes: Axes, settings: Scene, inputs: Inputs, low: np.ndarray, high: np.ndarray
) -> None:
    """Lines of equal height."""
    points, (rows, columns) = _grid(low, high)
    height = inputs.ground(settings.forest.terrain.base).height(points).reshape(rows, columns)
    if not np.nanmax(height, initial=-np.inf) > np.nanmin(height, initial=np.inf):
        return
    x, y = points[:columns, 0], points[::columns, 1]
    lines = axes.contour(x, y, height, levels=10, colors="#8a7f6b", linewidths=0.6, zorder=1)
    axes.clabel(lines, fmt="%g m", fontsize=7)


def _show_crowns(
    axes: Axes,
    stand: Stand,
    colours: np.ndarray,
    settings: Scene,
    low: np.ndarray,
    high: np.ndarray,
) -> None:
    """A disc a tree: its crown where that is known, else a size that fits the number of trees."""
    if not len(stand):
        return
    crown = np.array([p.crown for p in settings.plantings])[stand.species] * stand.scale
    usual = np.clip(
        0.3 * np.sqrt(stand.area / len(stand)), 0.004 * max(high - low), 0.02 * max(high - low)
    )
    across = 2 * np.where(crown > 0, crown, 0.5 * usual * stand.scale)
    shade = np.column_stack([colours[stand.species], np.full(len(stand), 0.78)])
    axes.add_collection(
        EllipseCollection(
            across,
            across,
            np.zeros(len(stand)),
            units="xy",
            offsets=stand.position[:, :2],
            offset_transform=axes.transData,
            facecolors=shade,
            edgecolors="white",
            linewidths=0.3 if len(stand) < 4000 else 0.0,
            zorder=2,
        )
    )


def _show_pixels(
    axes: Axes, stand: Stand, colours: np.ndarray, low: np.ndarray, high: np.ndarray
) -> None:
    """Every pixel in the mean colour of its trees, the denser the more it covers."""
    size = high - low
    columns, rows = np.maximum(np.ceil(TREE_PIXELS * size / size.max()), 2).astype(int)
    place = (stand.position[:, :2] - low) / size * [columns, rows]
    column, row = np.clip(place.astype(int), 0, [columns - 1, rows - 1]).T
    pixel = row * columns + column
    count = np.bincount(pixel, minlength=rows * columns)
    shade = np.zeros((rows * columns, 4))
    for channel in range(3):
        total = np.bincount(pixel, colours[stand.species, channel], rows * columns)
        shade[:, channel] = total / np.maximum(count, 1)
    usual = max(1.0, float(np.quantile(count[count > 0], 0.9)))
    shade[:, 3] = 1 - np.exp(-1.6 * count / usual)
    axes.imshow(
        shade.reshape(rows, columns, 4),
        extent=(low[0], high[0], low[1], high[1]),
        origin="lower",
        interpolation="antialiased",
        zorder=2,
    )


def _name_species(axes: Axes, stand: Stand, labels: Sequence[str], colours: np.ndarray) -> None:
    counts, density = stand.counts(), stand.density() * 1e4
    shown = sorted(range(len(labels)), key=lambda k: -counts[k])[:LEGEND]
    handles = [
        Line2D([], [], marker="o", linestyle="none", markersize=7, color=colours[k]) for k in shown
    ]
    each = [f"{d:,.0f}" if d >= 10 else f"{d:.2g}" for d in density]
    names = [f"{labels[k]}\n{counts[k]:,} trees, {each[k]}/ha" for k in shown]
    if len(labels) > len(shown):
        handles.append(Line2D([], [], linestyle="none"))
        names.append(f"and {len(labels) - len(shown)} more")
    if handles:
        axes.legend(
            handles,
            names,
            loc="upper left",
            bbox_to_anchor=(1.01, 1.0),
            borderaxespad=0.0,
            labelspacing=1.0,
            handletextpad=0.3,
        )
