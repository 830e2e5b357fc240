"""Pictures where there is no matplotlib: numpy draws them and Blender writes on them, as in the panel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy  # noqa: F401  where Blender is a module, it brings blf and imbuf
import numpy as np

from forest_addon.formats.atomic import replacing
from forest_addon.formats.raster_file import write_png
from forest_addon.results.kind import Finding
from forest_addon.results.kinds import results_of
from forest_addon.results.plot import PAPER, Axis, Plot, Strip
from forest_addon.spec import Scene, Sensor
from forest_addon.stand.compose import corners_of, process_of
from forest_addon.stand.inputs import Inputs
from forest_addon.stand.plan import Stand
from forest_addon.ui.results.images import drawn

# Told apart by those who see no red or green, too (Okabe and Ito 2008), on dark paper.
COLOURS = {
    "green": (0.0, 0.62, 0.45),
    "orange": (0.9, 0.62, 0.0),
    "light blue": (0.34, 0.71, 0.91),
    "pink": (0.8, 0.47, 0.65),
    "yellow": (0.94, 0.89, 0.26),
    "red": (0.84, 0.37, 0.0),
    "blue": (0.1, 0.5, 0.8),
    "grey": (0.7, 0.7, 0.7),
}
MEADOW = np.array([0.16, 0.22, 0.11])  # where the intensity is highest
WIDE, HIGH = 1100, 900  # pixels, at most
MANY = 20_000  # trees from which on each is a pixel


def draw_result(sensor: Sensor, found: Finding, path: Path) -> Path | None:
    """Draw what a sensor found into a PNG; returns its path, None where there is nothing to draw."""
    plot = results_of(sensor).plot(sensor, found)
    return _save(plot, path) if plot else None


def draw_stand(
    stand: Stand, labels: Sequence[str], settings: Scene, inputs: Inputs, path: Path
) -> Path:
    """Draw the trees of a stand from above, on their intensity, into a PNG; returns its path."""
    low, high = corners_of(settings.forest)
    extent = high - low
    scale = float(min(WIDE / extent[0], HIGH / extent[1]))  # pixels a metre
    columns, rows = np.maximum((extent * scale).astype(int), 8)
    pixels = np.tile(PAPER, (rows, columns, 1))
    planted = [p for p in settings.plantings if p.layout == "poisson"]
    if planted:
        x, y = (low[k] + (np.arange(n) + 0.5) / scale for k, n in enumerate((columns, rows)))
        points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        value = sum(process_of(p, settings.forest, inputs).at(points) for p in planted)
        share = np.reshape(value, (rows, columns, 1)) / (np.max(value) or 1.0)
        pixels += share * (MEADOW - PAPER)
    _set_trees(pixels, stand, settings, low, scale)
    strip = Strip(
        f"{settings.name}: {len(stand):,} trees on {stand.area / 1e4:,.3g} ha",
        pixels,
        Axis(float(low[1]), float(high[1]), "y (m)"),
    )
    return _save(Plot((strip,), Axis(float(low[0]), float(high[0]), "x (m)"), ""), path)


def colours_in_words(labels: Sequence[str]) -> str:
    """Return which colour a species has in the map."""
    names = list(COLOURS)
    said = (f"{label} {names[k % len(names)]}" for k, label in enumerate(labels))
    return f"In the map: {', '.join(said)}."


def _set_trees(
    pixels: np.ndarray, stand: Stand, settings: Scene, low: np.ndarray, scale: float
) -> None:
    """Each tree a disc as wide as its crown, where that is known, in the colour of its species."""
    if not len(stand):
        return
    rows, columns, _ = pixels.shape
    colours = np.array(list(COLOURS.values()))[stand.species % len(COLOURS)]
    column, row = ((stand.position[:, :2] - low) * scale).T
    crown = np.array([p.crown for p in settings.plantings])[stand.species] * stand.scale
    usual = 0.15 * np.sqrt(stand.area / len(stand)) * stand.scale
    radius = np.clip(scale * np.where(crown > 0, crown, usual), 1.0, 0.05 * columns)
    if len(stand) > MANY:
        place = np.clip(row.astype(int), 0, rows - 1), np.clip(column.astype(int), 0, columns - 1)
        pixels[place] = colours
        return
    for x, y, reach, colour in zip(column, row, radius, colours, strict=True):
        left, foot = max(int(x - reach), 0), max(int(y - reach), 0)
        part = pixels[foot : max(int(y + reach) + 2, 0), left : max(int(x + reach) + 2, 0)]
        up, across = np.ogrid[foot : foot + part.shape[0], left : left + part.shape[1]]
        away = np.sqrt((up + 0.5 - y) ** 2 + (across + 0.5 - x) ** 2)
        cover = 0.85 * np.clip(reach + 0.5 - away, 0.0, 1.0)[..., None]
        part += cover * (colour - part)


def _save(plot: Plot, path: Path) -> Path:
    with replacing(path) as partial:
        partial.write_bytes(write_png(drawn(plot)[::-1]))
    return path
