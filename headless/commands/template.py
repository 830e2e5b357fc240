"""``python -m headless template``: a user's tree as STL files becomes a species that grows.

Written into a folder: the library (``formats/template_library``), a picture of what was recognised, and
one of the tree that was brought, the same put together again from its parts, and five siblings. A table
says how close siblings come. A scene then plants the species file; scene.toml is one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from forest_addon.formats.species_file import load_species
from forest_addon.formats.template_library import Library, make_library
from forest_addon.growth.likeness import compare
from forest_addon.growth.template.relay import farthest_off
from forest_addon.growth.template.sibling import grow_sibling
from forest_addon.growth.tree import Tree, grow
from forest_addon.rng import stream
from forest_addon.spec import Siblings, SpecError, Species

Say = Callable[[str], None]
SHOWN = 5  # siblings in the picture


def make_template(
    wood: Path,
    leaves: Path | None,
    name: str,
    height: float,
    out: Path,
    grammar: str = "fitted",
    siblings: int = 50,
    say: Say = print,
) -> Path:
    """Make a template library from STL files; returns the species file.

    height : metres of the tree; 0: the unit is inferred, and said.
    grammar : "fitted" or "t20". siblings : how many to compare with the tree; 0: none.

    Raises
    ------
    SpecError : a file cannot be used, with the reason.
    """
    if siblings and not 3 <= siblings <= 1000:
        raise SpecError("--siblings", f"{siblings} is out of range; use 3 to 1000, or 0 for none")
    try:
        made = make_library(wood, leaves, name, height, out, grammar=grammar)
    except SpecError as problem:
        asked = problem.key in ("name", "height")
        raise SpecError(f"--{problem.key}" if asked else problem.key, problem.problem) from None
    _tell(made, height > 0, say)
    from ..report.recognised import draw_recognised

    draw_recognised(made.found, made.unit.metres, name, out / "recognised.png")
    written = f"{made.species}, its STL files, recognised.png"
    if siblings and grammar == "fitted":
        _show_siblings(made, siblings, out / "siblings.png", say)
        written += ", siblings.png"
    say(f"Wrote {written} and scene.toml.")
    say(f"Next: python -m headless run {out / 'scene.toml'}")
    return made.species


def _show_siblings(made: Library, count: int, path: Path, say: Say) -> None:
    """Grow siblings, compare them with the tree, and render some beside it."""
    from ..progress import hushed
    from ..report.likeness import compare_with_sensors, tell_likeness
    from ..report.three import render_three

    species, template = load_species(made.species)
    itself = grow(_varied(species, 0.0), template, stream(0, "template"))
    off = farthest_off(made.habit.anatomy, grow_sibling(made.habit, Siblings(variety=0.0), 0))
    say(
        f"Rebuilt from its parts: {len(itself.leaves):,} of {made.leaf_count:,} leaves, every vertex "
        f"within {1000 * off:.2g} mm of where it was."
    )

    def sibling(number: int) -> Tree:
        return grow(species, template, stream(0, "template", "sibling", number))

    with hushed():
        one, all_of_them = compare_with_sensors(itself, (sibling(k) for k in range(count)))
        shown = [sibling(number) for number in range(min(SHOWN, count))]
        render_three(made.found, made.unit.metres, itself, shown, species.look, path)
    tell_likeness(compare(one, all_of_them), count, say)


def _varied(species: Species, variety: float) -> Species:
    return replace(species, siblings=replace(species.siblings or Siblings(), variety=variety))


def _tell(made: Library, given: bool, say: Say) -> None:
    """Say what was recognised, and how large it is taken to be."""
    found, anatomy, metres = made.found, made.habit.anatomy, made.unit.metres
    trunk = int(np.flatnonzero(anatomy.order == 0)[0])
    others = anatomy.count - 1 - made.branches
    say(f"Wood: {len(made.wood):,} triangles in {anatomy.count:,} pieces:")
    say(
        f"  1 trunk ({anatomy.lines.reach()[trunk]:.2f} m long, foot radius "
        f"{100 * anatomy.foot_radius()[trunk]:.1f} cm), {made.branches:,} first-level branches, "
        f"{others:,} that hang on those"
    )
    if made.leaves is not None:
        distinct = len(found.leaves.triangles)
        drawn = round(len(made.leaves) / max(distinct, 1) * made.leaf_count)
        say(
            f"Leaves: {len(made.leaves):,} triangles, {drawn:,} leaf faces: {made.leaf_count:,} leaves"
        )
        if drawn != made.leaf_count:
            say(f"  (each drawn {drawn / made.leaf_count:g} times, as from both sides)")
    sizes = f"{made.height:.2f} m high"
    if made.leaf:
        sizes += f", leaves {100 * made.leaf * metres:.1f} cm long"
    if given:
        say(f"Scale: given by --height; 1 unit = {metres:.5g} m: {sizes}")
    else:
        say(
            f"Scale: inferred, as an STL does not say; taken as {made.unit.name} "
            f"(1 unit = {metres:g} m): {sizes}. If that is wrong, give --height."
        )
