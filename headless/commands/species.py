"""``python -m headless species``: every preset in a table, and in pictures.

``--pictures`` renders a small picture of each, as Blender's panel shows them (assets/species/pictures);
``--close-ups`` a fork, the bark of a stem at a metre and a twig against the light.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from forest_addon.base.places import file_name
from forest_addon.base.progress import Say
from forest_addon.base.rng import stream
from forest_addon.formats.ownership import claim
from forest_addon.growth.library import find_species, load_species, presets
from forest_addon.growth.measured.allometry import Kind, typical_tree
from forest_addon.growth.tree import Tree, grow
from forest_addon.growth.truth import tree_truth
from forest_addon.spec import Normal, SpecError, Species
from forest_addon.stand.competition import ALONE

from ..command import refuse_beyond
from ..progress import hushed
from ..report import can_draw, without

SHOTS = (("european-beech", "fork"), ("scots-pine", "bark"), ("norway-maple", "twig"))
CLOSE = 0.0006  # metres of tolerance
OLDER = 1.5  # diameter of a tree that is looked at closely, over the mean of its species


def run(chosen: argparse.Namespace) -> None:
    """Grow one tree of each species, print its truth, and render them; or show close-ups.

    Raises
    ------
    SpecError : a species is not known or cannot be used; pictures cannot be drawn.
    """
    refuse_beyond("--pixels", chosen.pixels, 50, 4000)
    sheet, pictures = chosen.sheet, chosen.pictures
    if chosen.close_ups:
        show_closeups(chosen.names, chosen.close_ups, chosen.seed)
        if not (sheet or pictures):
            return
    grown = [_grow(name, chosen.seed) for name in chosen.names or presets("species")]
    head = f"{'species':<20}{'height':>8}{'triangles':>12}{'leaves':>9}{'leaf area':>11}{'wood':>9}"
    print(head)
    for species, tree in grown:
        truth = tree_truth(tree)
        print(
            f"{species.name:<20}{truth['height_m']:>6.1f} m{len(tree.mesh.triangles):>12,}"
            f"{len(tree.leaves):>9,}{truth['leaf_area_m2']:>8.1f} m²"
            f"{1000 * truth['wood_volume_m3']:>7.0f} l"
        )
    if not (sheet or pictures):
        return
    if not can_draw():
        asked = "--sheet" if sheet else "--pictures"
        raise SpecError(asked, without("cannot be drawn here"))
    from ..report.trees import draw_pictures, draw_sheet

    files = [pictures / f"{file_name(species.name)}.jpg" for species, _ in grown if pictures]
    claim(*files, *([sheet] if sheet else []))
    if sheet:
        draw_sheet(grown, sheet, chosen.pixels)
        print(f"Wrote {sheet}")
    if pictures:
        draw_pictures(grown, pictures)
        print(f"Wrote {len(grown)} pictures into {pictures}")


def show_closeups(
    names: Sequence[str],
    folder: Path,
    seed: int,
    say: Say = print,
    *,
    size: tuple[int, int] = (800, 1000),
    samples: int = 48,
) -> None:
    """Render close-ups into a folder: of each species a fork, bark and a twig; without any, ``SHOTS``.

    Raises
    ------
    SpecError : a species is not known, or has nothing of the kind.
    """

    from forest_addon.blender.show.preview import SHOTS as KINDS, render_closeup

    asked = [(name, kind) for name in names for kind in KINDS] or list(SHOTS)
    folder.mkdir(parents=True, exist_ok=True)
    for name, kind in asked:
        species, template = load_species(find_species(name, Path()))
        detail = species.detail.changed(tolerance=CLOSE, relief=kind == "bark")
        species = species.changed(detail=detail)
        targets = species.targets
        if kind != "twig" and targets is not None and targets.dbh is not None:
            old = Normal(mean=OLDER * targets.dbh.mean, sd=0.0)
            species = species.changed(targets=targets.changed(dbh=old))
        tree = grow(species, template, stream(seed, "close-up", name))
        path = folder / f"{kind}-{species.name}.png"
        with hushed():
            render_closeup(species, tree, kind, path, size=size, samples=samples)
        say(f"Wrote {path}")


def _grow(name: str, seed: int) -> tuple[Species, Tree]:
    """A tree of a preset or species file; of a measured one its middle tree, standing alone."""

    species, template = load_species(find_species(name, Path()))
    fine = species.changed(detail=species.detail.changed(tolerance=0.003))
    wanted = None
    if species.targets is not None and isinstance(template, Kind):
        wanted = typical_tree(species.targets, template.allometry, species.name, ALONE)
    return species, grow(fine, template, stream(seed, "sheet", name), wanted)
