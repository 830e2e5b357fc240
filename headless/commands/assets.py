"""``python -m headless assets``: an asset library for Blender's Asset Browser."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np

from forest_addon.blender.scene.assets import FILE, grow_exhibits, write_species
from forest_addon.drawing.figures import save_figure
from forest_addon.drawing.palette import INK, PAPER
from forest_addon.formats.ownership import claim
from forest_addon.growth.library import find_species, load_species, presets

from ..command import refuse_beyond

MOST = 200  # trees of a species
COLUMNS = (("height_m", ".1f"), ("dbh_m", ".2f"), ("leaves", ",.0f"))
CELL, LABEL = 256, 34  # pixels of a picture, and of the words below it


def run(chosen: argparse.Namespace) -> None:
    """Write a library of species, presets or files; none: every preset.

    Raises
    ------
    SpecError : a species is not known or cannot be used; the number of trees cannot be.
    OSError : a file could not be written; those written before stay.
    """
    out, variants, sheet = chosen.out, chosen.variants, chosen.sheet
    refuse_beyond("--variants", variants, 1, MOST)
    claim(out / FILE, *([sheet] if sheet else []))
    loaded = [
        load_species(find_species(name, Path())) for name in chosen.names or presets("species")
    ]
    print(f"{'species':<20}{'trees':>6}{'height':>14}{'DBH':>16}{'leaves':>20}{'file':>10}")
    files = []
    for species, template in loaded:
        exhibits = grow_exhibits(species, template, variants, chosen.seed)
        file = write_species(out, species, exhibits)
        files.append(file)
        truths = [truth for _, truth, _ in exhibits]
        spans = [_span([t[k] for t in truths], f) for k, f in COLUMNS]
        print(
            f"{species.name:<20}{variants:>6}{spans[0]:>12} m{spans[1]:>14} m"
            f"{spans[2]:>20}{file.stat().st_size / 1e6:>7.1f} MB"
        )
    if sheet:
        draw_sheet(files, sheet)
        print(f"Wrote {sheet}")
    print(
        f"Done: {len(files)} files and {FILE} in {out}. Add the folder to Blender's asset libraries:"
    )
    print("  Preferences > File Paths > Asset Libraries, or the add-on's preferences")


def _span(values: list[float], digits: str) -> str:
    return f"{min(values):{digits}}-{max(values):{digits}}"


def pictures_of(file: Path) -> dict[str, np.ndarray]:
    """The picture (H, W, 4) of every asset of a file, rows from above."""

    with bpy.data.libraries.load(str(file), assets_only=True, link=True) as (there, here):
        here.collections = list(there.collections)
    pictures = {}
    for home in here.collections:
        preview = home.preview
        wide, high = preview.image_size
        pixels = np.array(preview.image_pixels_float, dtype=np.float32)
        pictures[home.name] = pixels.reshape(high, wide, 4)[::-1]
    bpy.data.batch_remove([home.library for home in here.collections[:1] if home.library])
    return pictures


def draw_sheet(files: Sequence[Path], path: Path) -> Path:
    """All pictures of a library with their names, as the Asset Browser shows them."""
    from matplotlib.figure import Figure

    shown = [pair for file in files for pair in sorted(pictures_of(file).items())]
    columns = max(1, min(8, math.ceil(math.sqrt(1.6 * len(shown)))))
    wide, high = columns * CELL, math.ceil(len(shown) / columns) * (CELL + LABEL)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(wide / 200, high / 200), dpi=200, facecolor=PAPER)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    for number, (name, pixels) in enumerate(shown):
        row, column = divmod(number, columns)
        x, y = column * CELL, row * (CELL + LABEL)
        axes.imshow(pixels, extent=(x + 8, x + CELL - 8, y + CELL - 8, y + 8))
        axes.text(x + CELL / 2, y + CELL + 4, name, ha="center", va="center", color=INK, fontsize=6)
    axes.set_xlim(0, wide)
    axes.set_ylim(high, 0)
    axes.set_aspect("auto")
    return save_figure(figure, path)
