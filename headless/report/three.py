"""The picture of three: the tree that was brought, the same rebuilt from its parts, and siblings of it."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.image import imread
from matplotlib.patches import Rectangle

from forest_addon.base.trimesh import LEAF, WOOD, TriMesh, join
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.growth.own_tree.recognise import Recognition
from forest_addon.growth.tree import Tree
from forest_addon.spec import Look, Species

from .pictures import FAINT, INK, PAPER, figure_on, save_figure

WIDTH = 2100  # pixels


def render_three(
    found: Recognition,
    metres: float,
    rebuilt: Tree,
    siblings: Sequence[Tree],
    look: Look,
    path: Path,
) -> Path:
    """Render the tree as its facets were, then rebuilt, then siblings, all at one scale.

    metres : in one unit of what was recognised.
    """
    from forest_addon.blender.library.sheet import FIELD, FOOT, render_sheet

    brought = _as_brought(found, metres, rebuilt)
    trees = [("brought", brought), ("rebuilt", rebuilt)]
    trees += [(f"sibling {number + 1}", tree) for number, tree in enumerate(siblings)]
    with tempfile.TemporaryDirectory() as folder:
        rendered = Path(folder) / "trees.png"
        cells = render_sheet(
            [(Species(name=name, look=look), tree) for name, tree in trees],
            len(trees),
            WIDTH,
            rendered,
            samples=32,
            one_scale=True,
        )
        image = imread(rendered)
    figure, axes = figure_on(image)
    high, wide = image.shape[:2]
    reach, below = 0.44 * wide / len(trees), FOOT / FIELD[0] * wide / len(trees)
    for cell, (name, tree) in zip(cells, trees, strict=True):
        ground = Rectangle((cell.x - reach, cell.y + 2), 2 * reach, below, color=PAPER, linewidth=0)
        if (tree.mesh.vertices[:, 2] < -0.02 * tree.height).sum() == 0:
            axes.add_patch(ground).set_zorder(1.5)
        axes.plot([cell.x - reach, cell.x + reach], [cell.y, cell.y], color=FAINT, linewidth=1.0)
        axes.text(cell.x, cell.y + 14, name, ha="center", va="top", color=INK, fontsize=13)
        detail = f"{tree.height:.1f} m"
        if len(tree.leaves):
            detail += f", {len(tree.leaves):,} leaves"
        axes.text(cell.x, cell.y + 36, detail, ha="center", va="top", color=INK, fontsize=10)
    axes.set_xlim(0, wide)
    axes.set_ylim(high, 0)
    return save_figure(figure, path)


def _as_brought(found: Recognition, metres: float, rebuilt: Tree) -> Tree:
    """The facets of the file as a tree, its foot moved to the origin; the skeleton is the rebuilt one's."""
    origin = found.origin
    parts = []
    for pieces, part, slot in ((found.wood, WOOD, 0), (found.leaves, LEAF, 1)):
        mesh = TriMesh.of_part((pieces.vertices - origin) * metres, pieces.triangles, part)
        mesh.material[:] = slot
        if part == LEAF:
            mesh.leaf[:] = pieces.piece
        parts.append(mesh)
    leaves = np.argsort(parts[1].leaf, kind="stable")
    mesh = join([parts[0], parts[1].select(leaves)])
    return Tree(mesh, measure_leaves(parts[1]), rebuilt.skeleton)
