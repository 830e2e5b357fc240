"""Maps of stands: trees over the intensity they were drawn from, tests of where they stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ..spec import Scene
from ..stand.compose import Inputs, corners_of
from ..stand.plan import Stand
from ..stand.statistics.intensity import Window
from ..stand.statistics.law import At, Goodness
from .figures import blank_figure
from .palette import FAINT, INK, LEAF_GREEN, RED, species_colour
from .strips import CLEARING, MEADOW, stand_map

MEADOW_MAP = LinearSegmentedColormap.from_list("meadow", [CLEARING, MEADOW])
GRID = 360  # pixels along the longer side of what is drawn of fields
LEGEND = 12  # species named
MOST = 6  # species shown of a site


def draw_stand(stand: Stand, labels: Sequence[str], settings: Scene, inputs: Inputs) -> Figure:
    """Draw the map of a stand with its outline, contours of the ground and numbers of trees."""
    low, high = corners_of(settings.forest)
    wide, tall = high - low
    figure = blank_figure((11, float(np.clip(8.6 * tall / wide, 3.2, 9.5))))
    axes = figure.add_subplot()
    strip = stand_map(stand, settings, inputs).strips[0]
    axes.imshow(strip.pixels, extent=_extent(low, high), origin="lower", zorder=0)
    if strip.values is not None:
        scale = ScalarMappable(Normalize(strip.values.low, strip.values.high), MEADOW_MAP)
        figure.colorbar(
            *(scale, None, axes), label="intensity, trees/ha", shrink=0.5, aspect=24, anchor=(0, 0)
        ).outline.set_edgecolor(FAINT)
    field = settings.forest
    for ring in (field.polygon, *field.holes):
        if ring:
            axes.plot(*np.array([*ring, ring[0]]).T, color=INK, linewidth=0.9, zorder=3)
    if inputs.terrain is not None:
        _show_contours(axes, settings, inputs, low, high)
    room = 0.02 * max(wide, tall)
    axes.set_xlim(low[0] - room, high[0] + room)
    axes.set_ylim(low[1] - room, high[1] + room)
    _name_axes(axes)
    axes.set_title(strip.title)
    counts, density = stand.counts(), stand.density() * 1e4
    shown = sorted(range(len(labels)), key=lambda k: -counts[k])[:LEGEND]
    handles = [
        Line2D([], [], marker="o", linestyle="none", markersize=7, color=species_colour(k))
        for k in shown
    ]
    each = [f"{d:,.0f}" if d >= 10 else f"{d:.2g}" for d in density]
    names = [
        f"{labels[k]}\n{counts[k]:,} {'tree' if counts[k] == 1 else 'trees'}, {each[k]}/ha"
        for k in shown
    ]
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
    return figure


def _extent(low: np.ndarray, high: np.ndarray) -> tuple[float, float, float, float]:
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def _shape(size: np.ndarray) -> tuple[int, int]:
    """Rows and columns of a field that is drawn."""
    columns, rows = np.maximum(np.ceil(GRID * size / size.max()), 2).astype(int)
    return int(rows), int(columns)


def _grid(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, tuple[int, int]]:
    """Centres (N, 2) of the drawn pixels, south first, and their rows and columns."""
    rows, columns = _shape(high - low)
    x = low[0] + (np.arange(columns) + 0.5) * (high - low)[0] / columns
    y = low[1] + (np.arange(rows) + 0.5) * (high - low)[1] / rows
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2), (rows, columns)


def _name_axes(axes: Axes) -> None:
    axes.set_aspect("equal")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")


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


def draw_site(
    species: Sequence[tuple[str, np.ndarray, At, Goodness | None]], window: Window
) -> Figure:
    """Draw a mapped site, a row for each of the six species with the most trees.

    species : name, places (N, 2), estimated intensity and its test, of each.
    """
    shown = sorted(species, key=lambda one: -len(one[1]))[:MOST]
    figure = blank_figure((11, 4.4 * len(shown)))
    axes = figure.subplots(len(shown), 2, squeeze=False, width_ratios=(1.15, 1))
    for (place, curve), (name, points, intensity, goodness) in zip(axes, shown, strict=True):
        show_intensity(place, points, intensity, window)
        place.set_title(
            f"{name}: {len(points):,} {'tree' if len(points) == 1 else 'trees'}, estimated intensity"
        )
        if goodness is not None:
            show_goodness(curve, goodness)
        else:
            curve.set_axis_off()
            curve.text(0, 0.9, "too few trees to test", color=INK)
    return figure


def draw_goodness(found: Goodness, window: Window) -> Figure:
    """Draw the tests of a stand: L(r) - r, and how far the counts of quadrats are off."""
    figure = blank_figure((11, 4.2))
    curve, quadrats = figure.subplots(1, 2, width_ratios=(1.15, 1))
    show_goodness(curve, found)
    expected = np.where(found.quadrats.expected >= 1, found.quadrats.expected, np.nan)
    stray = (found.quadrats.count - expected) / np.sqrt(expected)
    reach = max(3.0, float(np.nanmax(np.abs(stray), initial=0.0)))
    image = quadrats.imshow(
        stray,
        extent=_extent(window.low, window.high),
        origin="lower",
        cmap="BrBG",
        vmin=-reach,
        vmax=reach,
    )
    figure.colorbar(image, ax=quadrats, label="standard deviations", pad=0.01)
    quadrats.set_title("Trees in quadrats, against the intensity")
    _name_axes(quadrats)
    return figure


def show_intensity(axes: Axes, points: np.ndarray, at: At, window: Window) -> None:
    """Trees as dots on λ, in trees per hectare."""
    grid, shape = _grid(window.low, window.low + window.extent)
    value = at(grid).reshape(shape)
    image = axes.imshow(
        np.where(window.coverage(shape) > 0, value * 1e4, np.nan),
        extent=_extent(window.low, window.high),
        origin="lower",
        cmap="YlGn",
        vmin=0,
        interpolation="bilinear",
        alpha=0.5,  # where it is highest, and everywhere where it is uniform, dots would be dark on dark
    )
    size = float(np.clip(60 / np.sqrt(max(len(points), 1)), 0.3, 3))
    axes.plot(*points.T, "o", color=INK, markersize=size, linestyle="none", markeredgewidth=0)
    axes.figure.colorbar(image, ax=axes, label="trees/ha", pad=0.01)
    _name_axes(axes)


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
