"""The picture of what was recognised in a user's tree: trunk, first-level branches, leaves in colours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from forest_addon.growth.own_tree.recognise import Recognition

from .pictures import INK, LEAF_GREEN, STYLE, save_figure

TRUNK = "#4a3526"
DOUBT = "#d22f27"
RING: dict[str, Any] = {
    "marker": "o",
    "markersize": 14,
    "markerfacecolor": "none",
    "markeredgecolor": DOUBT,
    "markeredgewidth": 1.6,
    "linestyle": "none",
}
MOST_RINGS = 60
MOST_DRAWN = 400_000  # facets


def draw_recognised(found: Recognition, metres: float, name: str, path: Path) -> Path:
    """Front and side of the tree, each first-level branch with all it bears in a colour of its own.

    metres : in one unit of what was recognised.
    """
    matplotlib.rcParams.update(STYLE)
    figure = Figure(figsize=(12, 7.5), layout="constrained", dpi=110)
    front, side, bare = figure.subplots(1, 3, sharey=True)
    colours, firsts = _branch_colours(found)
    wood = found.wood.vertices[found.wood.triangles] * metres
    leaves = found.leaves.vertices[found.leaves.triangles] * metres
    green = np.empty((0, 3))
    if len(leaves):
        bearer = colours[found.bearer[found.leaves.piece]]
        green = 0.78 * np.array(matplotlib.colors.to_rgb(LEAF_GREEN)) + 0.22 * bearer
    paint = colours[found.wood.piece]
    _draw(front, np.concatenate([wood, leaves]), np.concatenate([paint, green]), 0)
    _draw(side, np.concatenate([wood, leaves]), np.concatenate([paint, green]), 1)
    _draw(bare, wood, paint, 0)
    for axes, title, across in (
        (front, "from the front (-y)", "x, m"),
        (side, "from the right (+x)", "y, m"),
        (bare, "wood alone, from the front", "x, m"),
    ):
        axes.set_title(title)
        axes.set_xlabel(across)
    front.set_ylabel("z, m")
    for doubt in found.doubts:
        _ring(front, doubt.places * metres, 0)
        _ring(side, doubt.places * metres, 1)
    figure.suptitle(
        f"{name}: {found.wood.count:,} pieces of wood, {len(firsts):,} first-level branches, "
        f"{found.leaves.count:,} leaves",
        color=INK,
        x=0.01,
        ha="left",
    )
    shown = firsts[:: max(1, len(firsts) // 5)][:5]
    keys = [Patch(facecolor=TRUNK, label="trunk")]
    keys += [Patch(facecolor=colours[first], label="") for first in shown[:-1]]
    keys += [
        Patch(facecolor=colours[shown[-1]], label="first-level branches and what hangs on them")
    ]
    if found.doubts:
        keys.append(Line2D([], [], **RING, label="in doubt"))
    if len(leaves):
        keys.append(Patch(facecolor=LEAF_GREEN, label="leaves, tinted by their branch"))
    figure.legend(
        handles=keys,
        loc="outside lower center",
        ncols=len(keys),
        handlelength=1.2,
        columnspacing=0.6,
    )
    return save_figure(figure, path)


def draw_problem(facets: np.ndarray, places: np.ndarray, name: str, path: Path) -> Path:
    """Front and side of facets (T, 3, 3) that are no tree, in their own units; places (N, 3) ringed."""
    matplotlib.rcParams.update(STYLE)
    figure = Figure(figsize=(9, 7.5), layout="constrained", dpi=110)
    facets = facets[:: max(1, len(facets) // MOST_DRAWN)]
    colour = np.tile(np.array(matplotlib.colors.to_rgb("#8b8b86")), (len(facets), 1))
    both = figure.subplots(1, 2, sharey=True)
    for axes, across, title, label in (
        (both[0], 0, "from the front (-y)", "x"),
        (both[1], 1, "from the right (+x)", "y"),
    ):
        _draw(axes, facets, colour, across)
        _ring(axes, places, across)
        axes.set_title(title)
        axes.set_xlabel(f"{label}, units of the file")
    both[0].set_ylabel("z")
    figure.suptitle(f"{name}: not understood; rings mark where", color=INK, x=0.01, ha="left")
    return save_figure(figure, path)


def _ring(axes: Axes, places: np.ndarray, across: int) -> None:
    shown = places[:: max(1, len(places) // MOST_RINGS)]
    axes.plot(*(shown[:, [across, 2]].T), **RING, zorder=5)


def _branch_colours(found: Recognition) -> tuple[np.ndarray, np.ndarray]:
    """(C, 3) colour of each piece of wood, and the first-level branches from the lowest up."""
    firsts = found.firsts
    firsts = firsts[np.argsort(found.foot[firsts, 2])]
    hue = (0.02 + 0.618034 * np.arange(len(firsts))) % 1.0  # neighbours differ
    bright = matplotlib.colors.hsv_to_rgb(
        np.stack([hue, np.full(len(hue), 0.75), np.full(len(hue), 0.85)], axis=1)
    ).reshape(-1, 3)
    colours = np.tile(np.array(matplotlib.colors.to_rgb(TRUNK)), (found.wood.count, 1))
    place = np.full(found.wood.count, -1)
    place[firsts] = np.arange(len(firsts))
    branch = np.where(found.branch >= 0, place[np.maximum(found.branch, 0)], -1)
    colours[branch >= 0] = bright[branch[branch >= 0]]
    return colours, firsts


def _draw(axes: Axes, facets: np.ndarray, colour: np.ndarray, across: int) -> None:
    """Facets (T, 3, 3) seen along an axis, the nearest last, shaded by their slope."""
    normal = np.cross(facets[:, 1] - facets[:, 0], facets[:, 2] - facets[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    depth = 1 - across
    light = np.array([0.45, 0.35, 0.82])
    shade = 0.55 + 0.45 * np.abs(normal @ light)
    middle = facets[:, :, depth].mean(axis=1)
    order = np.argsort(-middle if across == 0 else middle, kind="stable")
    axes.add_collection(
        PolyCollection(
            facets[order][:, :, [across, 2]],
            facecolors=np.clip(colour * shade[:, None], 0, 1)[order],
            linewidths=0,
            rasterized=True,
        )
    )
    axes.autoscale_view()
    axes.set_aspect("equal")
