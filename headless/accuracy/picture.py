"""Error against seconds, a panel a sensor: settings, the frontier, today, and the error of the model."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from forest_addon.drawing.figures import blank_figure, save_figure
from forest_addon.drawing.palette import FAINT, INK, LEAF_GREEN, RED

from .sweep import AccuracySweep, Point

FLOOR = 1e-16  # an error of 0 is drawn here
COLUMNS = 2
WIDE = 34  # letters of a line of the key
ROOM, LEAST = 0.08, 1.3  # share of the decades, and decades
FEW = 100.0  # times


def draw_sweeps(sweeps: list[AccuracySweep], chosen: list[Point], path: Path) -> Path:
    """Draw all sensors, two in a row, each with its key; returns the path."""
    columns = min(len(sweeps), COLUMNS)
    rows = math.ceil(len(sweeps) / columns)
    figure = blank_figure((6.6 * columns, 3.7 * rows))
    for number, (sweep, best) in enumerate(zip(sweeps, chosen, strict=True)):
        _draw(figure.add_subplot(rows, columns, number + 1), sweep, best)
    return save_figure(figure, path)


def _draw(axes: Axes, sweep: AccuracySweep, best: Point) -> None:
    """Numbered by seconds; the key beside it says what each is."""
    front = sweep.frontier()
    axes.plot([p.seconds for p in front], [_height(p) for p in front], color=FAINT, zorder=1)
    key = []
    for number, point in enumerate(sorted(sweep.all, key=lambda p: p.seconds), 1):
        colour = RED if point is sweep.today else INK
        low = min(point.spread, 0.9 * _height(point)) or None
        axes.errorbar(point.seconds, _height(point), yerr=low, fmt="none", ecolor=colour, zorder=2)
        ring = {"mec": LEAF_GREEN, "mew": 2.5} if point is best else {"mec": "white", "mew": 0.8}
        inner = "white"
        if point.elsewhere:  # hollow: no setting of the scene file
            ring, inner, colour = {"mec": INK, "mew": 1.2}, INK, "white"
        axes.plot(point.seconds, _height(point), "o", ms=12, color=colour, zorder=3, **ring)
        axes.annotate(
            str(number),
            (point.seconds, _height(point)),
            color=inner,
            fontsize=8,
            ha="center",
            va="center_baseline",
            zorder=4,
        )
        said = "today" if point is sweep.today else ""
        said += " and " if said and point is best else ""
        said += "recommended" if point is best else ""
        said = said or (point.elsewhere and f"hollow: {point.elsewhere}")
        if point.error == 0:
            said = f"{said}; off by 0" if said else "off by 0"
        words = f"{number}  {point.label}" + (f"\n    ({said})" if said else "")
        key.append(Line2D([], [], marker="o", ls="", ms=8, color=colour, label=words, **ring))
    heights, seconds = [_height(p) for p in sweep.all], [p.seconds for p in sweep.all]
    if sweep.model is not None and sweep.model[0] > 0:
        axes.axhline(sweep.model[0], color=RED, ls=":", lw=1)
        heights.append(sweep.model[0])
        words = textwrap.fill(f"the model itself: {sweep.model[1]}", WIDE, subsequent_indent="    ")
        key.append(Line2D([], [], color=RED, ls=":", label=words))
    axes.set(xscale="log", yscale="log", xlabel="CPU seconds")
    axes.set_xlim(*_around(seconds))
    axes.set_ylim(*_around(heights))
    axes.set_title(f"{sweep.sensor.name}: {sweep.what}")
    axes.set_ylabel("error" + (f", {sweep.unit}" if sweep.unit else ", share"))
    for axis, values in ((axes.xaxis, seconds), (axes.yaxis, heights)):
        low, high = _around(values)
        few = high / low < FEW  # decades: numbers between them too
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0) if few else tuple(range(2, 10))))
        axis.set_minor_formatter(FuncFormatter(lambda x, _: f"{x:.1g}") if few else NullFormatter())
        if few:
            axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:.1g}"))
    axes.legend(handles=key, loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


def _height(point: Point) -> float:
    return max(point.error, FLOOR) if math.isfinite(point.error) else FLOOR


def _around(values: list[float]) -> tuple[float, float]:
    """Limits around values with room for a mark, at least LEAST decades apart."""
    low, high = math.log10(min(values)), math.log10(max(values))
    more = max(ROOM * (high - low), (LEAST - (high - low)) / 2)
    return 10.0 ** (low - more), 10.0 ** (high + more)
