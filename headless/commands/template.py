"""``python -m headless template``: a user's tree in files becomes a species that grows.

Written into a folder: the library (``formats/template_library``) and a picture of what was recognised. A
scene then plants the species file; scene.toml is one.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from forest_addon.formats.template_library import Library, NotUnderstoodError, make_library
from forest_addon.growth.template.parts import Group
from forest_addon.spec import SpecError

Say = Callable[[str], None]


def make_template(
    wood: Path,
    leaves: Path | None,
    name: str,
    height: float,
    out: Path,
    say: Say = print,
    *,
    unit: str = "",
    up: str = "",
) -> Path:
    """Make a template library from files of a tree; returns the species file.

    height : metres of the tree; 0: as the unit says.
    unit, up : of the files, and their upright axis; empty: inferred, and said.

    Raises
    ------
    SpecError : a file cannot be used, with the reason.
    """
    try:
        groups = _groups(wood, leaves)
        made = make_library(wood, leaves, name, height, out, groups=groups, unit=unit, up=up)
    except NotUnderstoodError as problem:
        from ..report.recognised import draw_problem

        out.mkdir(parents=True, exist_ok=True)
        picture = draw_problem(problem.facets, problem.places, name, out / "recognised.png")
        said = f"{problem.problem.removesuffix('.')} (see {picture})."
        raise SpecError("template", said) from None
    except SpecError as problem:
        asked = problem.key in ("name", "height", "unit", "up")
        raise SpecError(f"--{problem.key}" if asked else problem.key, problem.problem) from None
    _tell(made, height > 0, bool(unit), say)
    _tell_how(made, bool(up), say)
    from ..report.recognised import draw_recognised

    draw_recognised(made.found, made.unit.metres, name, out / "recognised.png")
    say(f"Wrote {made.species}, its STL files, recognised.png and scene.toml.")
    say(f"Next: python -m headless run {out / 'scene.toml'}")
    return made.species


def _groups(wood: Path, leaves: Path | None) -> list[Group]:
    """What files hold that are no STL; nothing where both are."""
    if all(path.suffix.lower() == ".stl" for path in (wood, leaves) if path):
        return []
    known = (".stl", ".ply", ".obj", ".gltf", ".glb")
    for path in (wood, leaves):
        if path and path.suffix.lower() not in known:
            raise SpecError("template", f"{path.name} is of no known kind; use {', '.join(known)}")
    from forest_addon.blender.tree_files import read_parts

    return read_parts(wood, leaves)


def _tell_how(made: Library, up_given: bool, say: Say) -> None:
    """Say what had to be guessed of the file, and what of the tree is in doubt."""
    if made.told:
        say(f"Wood and leaves: told apart {made.told}")
    if made.up != "z" or up_given:
        say(f"Up: {made.up}, {'given' if up_given else 'inferred; if that is wrong, give --up'}")
    if made.found.fronds:
        say("Palm: each frond is a branch, with a midrib drawn through it")
    if len(made.found.stems) > 1:
        say(f"Stems: {len(made.found.stems)}, the largest of which is taken for the trunk")
    closed = len(made.found.wood.triangles) - made.found.wood.drawn
    if closed and not made.found.fronds:
        say(f"Joined: cut at its forks; {closed:,} triangles close the cuts, inside the wood")
    for doubt in made.found.doubts:
        say(f"In doubt: {doubt.sentence} recognised.png marks where.")


def _tell(made: Library, given: bool, unit_given: bool, say: Say) -> None:
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
    elif unit_given:
        say(f"Scale: given by --unit {made.unit.name} (1 unit = {metres:g} m): {sizes}")
    else:
        say(
            f"Scale: inferred, as the file does not say; taken as {made.unit.name} "
            f"(1 unit = {metres:g} m): {sizes}. If that is wrong, give --height or --unit."
        )
