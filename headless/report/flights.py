"""Pictures of flights and of the experiments with them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from forest_addon.drawing.figures import STYLE, save_figure
from forest_addon.drawing.palette import BLUE, FAINT, LINES, RED, VIOLET
from forest_addon.flight.flying import interval
from forest_addon.flight.top_view import TopView

ENDS = {"arrived": BLUE, "crashed": RED, "late": VIOLET}


def new_figure(columns: int, size: tuple[float, float], **options: Any) -> tuple[Figure, Any]:
    """A figure of the project's look with a row of axes."""
    with rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots(1, columns, squeeze=False, **options)[0]
    return figure, axes


def draw_flights(path: Path, cells: Sequence[Any], cell: Any, world: Any, title: str) -> Path:
    """The flights of one cell in its first forest from above; beside it success against speed."""
    with rc_context(STYLE):
        figure, (above, curve) = new_figure(2, (12, 5), width_ratios=(2, 1))
        view = TopView(world)
        low, high = world.field
        extent = (low[0] - 5, high[0] + 5, low[1] - 5, high[1] + 5)
        above.imshow(view.picture, extent=extent, aspect="equal", interpolation="nearest")
        forest = cell.tracks[0].forest
        tracks = [track for track in cell.tracks if track.forest == forest]
        for end, colour in ENDS.items():
            lines = [track.position[:, :2] for track in tracks if track.end == end]
            above.add_collection(LineCollection(lines, colors=colour, linewidths=0.9, label=end))
        stops = np.array([t.position[-1, :2] for t in tracks if t.end == "crashed"]).reshape(-1, 2)
        above.plot(*stops.T, "x", color=RED, ms=4)
        above.set(xlabel="x, m", ylabel="y, m", title=f"{title}, {cell.speed:g} m/s")
        above.legend(loc="lower right", facecolor="white", frameon=True, framealpha=0.8)
        for colour, density in zip(LINES, sorted({cell.density for cell in cells}), strict=False):
            of_density = sorted((c for c in cells if c.density == density), key=lambda c: c.speed)
            share = np.array([c.arrived / len(c.tracks) for c in of_density])
            ends = np.array([interval(c.arrived, len(c.tracks)) for c in of_density])
            speed = [c.speed for c in of_density]
            error = np.maximum(np.stack([share - ends[:, 0], ends[:, 1] - share]), 0)
            curve.errorbar(
                speed,
                share,
                error,
                color=colour,
                marker="o",
                ms=4,
                lw=1.3,
                capsize=2,
                label=f"{of_density[0].trees:.3g} trees/m²",
            )
        curve.set(
            xlabel="speed, m/s", ylabel="share that arrives", ylim=(-0.03, 1.05), title="Success"
        )
        curve.grid(color=FAINT, lw=0.4)
        curve.legend()
    return save_figure(figure, path)
