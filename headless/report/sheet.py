"""Pictures of species: all of them on a contact sheet, and a small one of each."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path

from matplotlib.image import imread
from matplotlib.patches import Rectangle

from forest_addon.base.places import file_name
from forest_addon.formats.atomic import replacing
from forest_addon.growth.tree import Tree
from forest_addon.spec import Species

from .pictures import FAINT, INK, PAPER, figure_on, save_figure

TREE = 800  # pixels that a tree of a sheet has
ICON = 192  # pixels along a side of a small picture


def draw_sheet(grown: Sequence[tuple[Species, Tree]], path: Path, pixels: int = TREE) -> Path:
    """The contact sheet: a render of all trees with a name and a scale below each.

    pixels : width of a tree's cell.
    """
    from forest_addon.blender.library.sheet import FIELD, FOOT, render_sheet

    columns = max(1, min(6, round(math.sqrt(1.6 * len(grown)))))
    scale = max(pixels / 330, 0.75)  # of what is written
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        rendered = Path(folder) / "trees.png"
        cells = render_sheet(grown, columns, columns * pixels, rendered)
        image = imread(rendered)
    figure, axes = figure_on(image)
    high, wide = image.shape[:2]
    reach, below = 0.42 * wide / columns, FOOT / FIELD[0] * wide / columns
    for cell in cells:  # the sunk foot of a trunk is no part of the picture
        ground = Rectangle((cell.x - reach, cell.y), 2 * reach, below, color=PAPER, linewidth=0)
        axes.add_patch(ground).set_zorder(1.5)
    for (species, tree), cell in zip(grown, cells, strict=True):
        axes.plot([cell.x - reach, cell.x + reach], [cell.y, cell.y], color=FAINT, linewidth=1.0)
        axes.text(
            *(cell.x, cell.y + 10 * scale, species.name),
            ha="center",
            va="top",
            color=INK,
            fontsize=11 * scale,
        )
        detail = f"{tree.height:.1f} m"
        if len(tree.leaves):
            detail += f", {len(tree.leaves):,} leaves"
        axes.text(
            *(cell.x, cell.y + 28 * scale, detail),
            ha="center",
            va="top",
            color=INK,
            fontsize=8.5 * scale,
        )
    axes.set_xlim(0, wide)
    axes.set_ylim(high, 0)
    return save_figure(figure, path)


def draw_pictures(grown: Sequence[tuple[Species, Tree]], folder: Path) -> None:
    """A square JPEG of each tree, cut from one render at twice its size."""
    from PIL import Image

    from forest_addon.blender.library.sheet import FIELD, FOOT, render_sheet

    columns = math.ceil(math.sqrt(len(grown)))
    wide = 2 * ICON
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as held:
        rendered = Path(held) / "trees.png"
        cells = render_sheet(grown, columns, columns * wide, rendered)
        with Image.open(rendered) as image:
            whole = image.convert("RGBA")
    above, below = round((FIELD[1] - FOOT) * wide), round(0.03 * wide)
    side = above + below
    for (species, _), cell in zip(grown, cells, strict=True):
        left, foot = round(cell.x) - wide // 2, round(cell.y)
        tree_alone = whole.crop((left, foot - above, left + wide, foot))  # without its sunk foot
        paper = Image.new("RGBA", (side, side), PAPER)
        paper.alpha_composite(tree_alone, ((side - wide) // 2, 0))
        small = paper.convert("RGB").resize((ICON, ICON), Image.Resampling.LANCZOS)
        with replacing(folder / f"{file_name(species.name)}.jpg") as partial:
            small.save(partial, quality=85, optimize=True)
