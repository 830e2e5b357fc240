"""A user's tree as STL files becomes a species that grows.

Written into a folder: the library (``formats/template_library``) and a picture of what was recognised. A
scene then plants the species file; scene.toml is one.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from forest_addon.formats.template_library import Library, make_library
from forest_addon.spec import SpecError

from ..report.recognised import draw_recognised

Say = Callable[[str], None]


def make_template(
    wood: Path, leaves: Path | None, name: str, height: float, out: Path, say: Say = print
) -> Path:
    """Make a template library from STL files; returns the species file.

    height : metres of the tree; 0: the unit is inferred, and said.

    Raises
    ------
    SpecError : a file cannot be used, with the reason.
    """
    try:
        made = make_library(wood, leaves, name, height, out)
    except SpecError as problem:
        asked = problem.key in ("name", "height")
        raise SpecError(f"--{problem.key}" if asked else problem.key, problem.problem) from None
    _tell(made, height > 0, say)
    draw_recognised(made.found, made.unit.metres, name, out / "recognised.png")
    say(f"Wrote {made.species}, its STL files, recognised.png and scene.toml.")
    say(f"Next: python -m headless run {out / 'scene.toml'}")
    return made.species


def _tell(made: Library, given: bool, say: Say) -> None:
    """Say what was recognised, and how large it is taken to be."""
    found, tree, metres = made.found, made.tree, made.unit.metres
    firsts, others = len(tree.branches), tree.wood_components - 1 - len(tree.branches)
    say(f"Wood: {len(made.wood):,} triangles in {tree.wood_components:,} pieces:")
    say(
        f"  1 trunk ({tree.trunk_length:.2f} m long, foot radius {100 * tree.trunk_radius:.1f} cm), "
        f"{firsts:,} first-level branches, {others:,} that hang on those or were left out"
    )
    if tree.stubs:
        say(f"  {tree.stubs:,} too short or roots: left out")
    if made.leaves is not None:
        distinct = len(found.leaves.triangles)
        drawn = round(len(made.leaves) / max(distinct, 1) * tree.leaf_count)
        say(
            f"Leaves: {len(made.leaves):,} triangles, {drawn:,} leaf faces: {tree.leaf_count:,} leaves"
        )
        if drawn != tree.leaf_count:
            say(f"  (each drawn {drawn / tree.leaf_count:g} times, as from both sides)")
        if tree.unattached_leaves:
            say(f"  {tree.unattached_leaves:,} on the trunk or on what was left out: not used")
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
