"""Error against seconds, a panel a sensor: settings, the frontier, today, and the error of the model."""

from __future__ import annotations

import math
from pathlib import Path

from matplotlib.axes import Axes

from ..report.pictures import FAINT, INK, LEAF_GREEN, RED, blank_figure, save_figure
from .sweep import Point, Sweep

FLOOR = 1e-13  # an error of 0 is drawn here


def draw_sweeps(sweeps: list[Sweep], chosen: list[Point], path: Path) -> Path:
    """Draw all sensors side by side; returns the path."""
    columns = min(len(sweeps), 3)
    rows = math.ceil(len(sweeps) / columns)
    figure = blank_figure((4.6 * columns, 3.9 * rows))
    for number, (sweep, best) in enumerate(zip(sweeps, chosen, strict=True)):
        _draw(figure.add_subplot(rows, columns, number + 1), sweep, best)
    return save_figure(figure, path)


def _draw(axes: Axes, sweep: Sweep, best: Point) -> None:
    for point in sweep.all:
        now = point is sweep.today
        axes.errorbar(
            point.seconds,
            max(point.error, FLOOR),
            yerr=min(point.spread, 0.9 * max(point.error, FLOOR)) or None,
            fmt="o",
            ms=9 if now else 5,
            color=RED if now else INK,
            label="today" if now else None,
            zorder=3,
        )
        axes.annotate(
            point.label,
            (point.seconds, max(point.error, FLOOR)),
            xytext=(6, 4),
            textcoords="offset points",
            fontsize=7,
        )
    front = sweep.frontier()
    axes.plot(
        [p.seconds for p in front], [max(p.error, FLOOR) for p in front], color=FAINT, zorder=1
    )
    axes.plot(
        best.seconds,
        max(best.error, FLOOR),
        "o",
        ms=14,
        mfc="none",
        mec=LEAF_GREEN,
        mew=2,
        label="recommended",
    )
    if sweep.model is not None and sweep.model[0] > 0:
        axes.axhline(sweep.model[0], color=RED, ls=":", lw=1)
        axes.annotate(
            "the model itself",
            (0.02, sweep.model[0]),
            xycoords=("axes fraction", "data"),
            va="bottom",
            fontsize=7,
            color=RED,
        )
    axes.set(xscale="log", yscale="log", xlabel="CPU seconds", title=sweep.sensor.name)
    axes.set_ylabel("error" + (f", {sweep.unit}" if sweep.unit else ", share"))
    axes.margins(x=0.25, y=0.15)
    axes.legend(loc="best", fontsize=7)
