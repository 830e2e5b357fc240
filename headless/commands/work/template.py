"""A user's tree in files becomes a species that grows.

Written into a folder: the library (``formats/template_library``), a picture of what was recognised, and
one of the tree that was brought, the same put together again from its parts, and five siblings. A table
says how close siblings come. A scene then plants the species file; scene.toml is one.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from forest_addon.base.progress import Say
from forest_addon.base.rng import stream
from forest_addon.growth.library.species_file import load_species
from forest_addon.growth.library.template_library import Library, NotUnderstoodError, make_library
from forest_addon.growth.likeness import compare
from forest_addon.growth.recognise.parts import Group
from forest_addon.growth.regrow.relay import farthest_off
from forest_addon.growth.regrow.sibling import grow_sibling
from forest_addon.growth.tree import Tree, grow
from forest_addon.spec import Siblings, SpecError, Species

from ...command import PROGRAM
from ...progress import Stages, hushed
from ...report.drawing import can_draw, without
from ...report.likeness import compare_with_sensors, tell_likeness

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
    *,
    unit: str = "",
    up: str = "",
) -> Path:
    """Make a template library from files of a tree; returns the species file.

    height : metres of the tree; 0: as the unit says.
    unit, up : of the files, and their upright axis; empty: inferred, and said.
    grammar : "fitted" or "t20". siblings : how many to compare with the tree; 0: none.

    Raises
    ------
    SpecError : a file cannot be used, with the reason.
    """
    if siblings and not 3 <= siblings <= 1000:
        raise SpecError("--siblings", f"{siblings} is out of range; use 3 to 1000, or 0 for none")
    try:
        groups = _groups(wood, leaves)
        with Stages(False).stage("recognise the tree") as progress:
            made = make_library(
                *(wood, leaves, name, height, out, progress),
                grammar=grammar,
                groups=groups,
                unit=unit,
                up=up,
            )
    except NotUnderstoodError as problem:
        said = problem.problem
        if can_draw():
            from ...report.recognised import draw_problem

            out.mkdir(parents=True, exist_ok=True)
            picture = draw_problem(problem.facets, problem.places, name, out / "recognised.png")
            said = f"{said.removesuffix('.')} (see {picture})."
        raise SpecError("template", said) from None
    except SpecError as problem:
        asked = problem.key in ("name", "height", "unit", "up")
        raise SpecError(f"--{problem.key}" if asked else problem.key, problem.problem) from None
    _tell(made, height > 0, bool(unit), say)
    _tell_how(made, bool(up), say)
    written = f"{made.species}, its STL files"
    if can_draw():
        from ...report.recognised import draw_recognised

        draw_recognised(made.found, made.unit.metres, name, out / "recognised.png")
        written += ", recognised.png"
    else:
        say(without("Pictures are left out"))
    if siblings and grammar == "fitted":
        _show_siblings(made, siblings, out / "siblings.png", say)
        written += ", siblings.png" if can_draw() else ""
    say(f"Wrote {written} and scene.toml.")
    say(f"Next: {PROGRAM} run {out / 'scene.toml'}")
    return made.species


def _groups(wood: Path, leaves: Path | None) -> list[Group]:
    """Return what files hold that are no STL; nothing where both are."""
    if all(path.suffix.lower() == ".stl" for path in (wood, leaves) if path):
        return []
    known = (".stl", ".ply", ".obj", ".gltf", ".glb")
    for path in (wood, leaves):
        if path and path.suffix.lower() not in known:
            raise SpecError("template", f"{path.name} is of no known kind; use {', '.join(known)}")
    from forest_addon.blender.files.tree_files import read_parts

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
        marked = " recognised.png marks where." if can_draw() else ""
        say(f"In doubt: {doubt.sentence}{marked}")


def _show_siblings(made: Library, count: int, path: Path, say: Say) -> None:
    """Grow siblings, compare them with the tree, and render some beside it."""
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
        if can_draw():
            from ...report.three import render_three

            shown = [sibling(number) for number in range(min(SHOWN, count))]
            render_three(made.found, made.unit.metres, itself, shown, species.look, path)
    tell_likeness(compare(one, all_of_them), count, say)


def _varied(species: Species, variety: float) -> Species:
    return replace(species, siblings=replace(species.siblings or Siblings(), variety=variety))


def _tell(made: Library, given: bool, unit_given: bool, say: Say) -> None:
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
    elif unit_given:
        say(f"Scale: given by --unit {made.unit.name} (1 unit = {metres:g} m): {sizes}")
    else:
        say(
            f"Scale: inferred, as the file does not say; taken as {made.unit.name} "
            f"(1 unit = {metres:g} m): {sizes}. If that is wrong, give --height or --unit."
        )
