"""Every preset in a table, and in a contact sheet with ``--sheet``.

``--pictures`` renders a small picture of each, as Blender's panel shows them (assets/species/pictures).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from forest_addon.base.progress import Say
from forest_addon.base.rng import stream
from forest_addon.growth.library.species_file import find_species, load_species, species_names
from forest_addon.growth.tree import Tree, grow
from forest_addon.growth.truth import tree_truth
from forest_addon.spec import Detail, SpecError, Species

from ...report.drawing import can_draw, without


def show_species(
    names: Sequence[str],
    sheet: Path | None,
    seed: int,
    say: Say = print,
    pictures: Path | None = None,
) -> None:
    """Grow one tree of each species, print its truth, and render them.

    names : presets or species files; none: every preset.
    sheet : picture of all of them. pictures : folder for a small picture of each.

    Raises
    ------
    SpecError : a species is not known or cannot be used; pictures cannot be drawn.
    """
    grown = [_grow(name, seed) for name in names or species_names()]
    head = f"{'species':<20}{'height':>8}{'triangles':>12}{'leaves':>9}{'leaf area':>11}{'wood':>9}"
    say(head)
    for species, tree in grown:
        truth = tree_truth(tree)
        say(
            f"{species.name:<20}{truth['height_m']:>6.1f} m{len(tree.mesh.triangles):>12,}"
            f"{len(tree.leaves):>9,}{truth['leaf_area_m2']:>8.1f} m²"
            f"{1000 * truth['wood_volume_m3']:>7.0f} l"
        )
    if not (sheet or pictures):
        return
    if not can_draw():
        asked = "--sheet" if sheet else "--pictures"
        raise SpecError(asked, without("cannot be drawn here"))
    from ...report.sheet import draw_pictures, draw_sheet

    if sheet:
        draw_sheet(grown, sheet)
        say(f"Wrote {sheet}")
    if pictures:
        draw_pictures(grown, pictures)
        say(f"Wrote {len(grown)} pictures into {pictures}")


def _grow(name: str, seed: int) -> tuple[Species, Tree]:
    species, template = load_species(find_species(name, Path()))
    fine = replace(species, detail=Detail(tolerance=0.003))
    return species, grow(fine, template, stream(seed, "sheet", name))
