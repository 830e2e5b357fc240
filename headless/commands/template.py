"""``python -m headless template``: a user's tree in files becomes a species that grows.

Written into a folder: the library (``growth.library``), a picture of what was
recognised, and one of the tree that was brought, the same put together again from its parts, and five
siblings. A table says how close siblings come, a verdict whether they may be planted. A scene then plants
the species file; scene.toml is one.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from forest_addon.base.progress import Say
from forest_addon.base.rng import stream
from forest_addon.formats.helios.parts import lost_materials
from forest_addon.formats.ownership import claim
from forest_addon.growth.library import (
    Brought,
    Library,
    NotUnderstoodError,
    load_species,
    make_library,
)
from forest_addon.growth.own_tree.anatomy import OFF, Anatomy
from forest_addon.growth.own_tree.pieces import Group
from forest_addon.growth.own_tree.relay import farthest_off, hold_rings
from forest_addon.growth.own_tree.sibling import Grown, grow_sibling
from forest_addon.growth.tree import Tree, grow
from forest_addon.spec import Siblings, SpecError

from ..command import PROGRAM, UnlikeError
from ..progress import Stages, hushed
from ..report import can_draw, without

SHOWN = 5  # siblings in the picture
SENSED = 8  # siblings that are scanned and listened to


def run(chosen: argparse.Namespace, say: Say = print) -> None:
    """Make a template library from files of a tree.

    Raises
    ------
    SpecError : a file cannot be used, with the reason.
    UnlikeError : siblings are too unlike the tree; all but the scene was written.
    """
    name, out, siblings, accept = chosen.name, chosen.out, chosen.siblings, chosen.accept
    if siblings and not 3 <= siblings <= 1000:
        raise SpecError("--siblings", f"{siblings} is out of range; use 3 to 1000, or 0 for none")
    claim(*(out / file for file in ("recognised.png", "siblings.png")[: 1 + bool(siblings)]))
    try:
        groups = _groups(chosen.wood, chosen.leaves)
        brought = Brought(
            chosen.wood, chosen.leaves, chosen.height, chosen.unit, chosen.up, groups=groups
        )
        for file in filter(None, (brought.wood, brought.leaves)):
            for lost in lost_materials(file):
                say(f"Warning: {lost}")
        with Stages(False).stage("recognise the tree") as progress:
            made = make_library(brought, name, out, progress, chosen.grammar, siblings, accept)
    except NotUnderstoodError as problem:
        raise SpecError("template", _drawn(problem, name, out)) from None
    except SpecError as problem:
        asked = problem.key in ("name", "height", "unit", "up")
        raise SpecError(f"--{problem.key}" if asked else problem.key, problem.problem) from None
    _tell(made, brought, say)
    _tell_how(made, bool(brought.up), say)
    written = f"{made.species}, its STL files"
    if can_draw():
        from ..report.trees import draw_recognised

        draw_recognised(made.found, made.unit.metres, name, out / "recognised.png")
        written += ", recognised.png"
    else:
        say(without("Pictures are left out"))
    if made.verdict is not None:
        _show_siblings(made, min(SENSED, siblings), out / "siblings.png", say)
        written += ", siblings.png" if can_draw() else ""
        if made.verdict.variety < 1:
            say(f"Variety: {made.verdict.variety:g}, with which siblings come nearest to the tree")
        if made.verdict.missed:
            say(f"In doubt: {made.verdict.sentence}.")
        if not made.verdict.stands and not accept:
            say(f"Wrote {written}, and no scene.")
            raise UnlikeError(
                f"{made.verdict.sentence}; look at siblings.png and recognised.png, mend the mesh, or plant "
                "them all the same with --accept"
            )
    say(f"Wrote {written} and scene.toml.")
    say(f"Next: {PROGRAM} run {out / 'scene.toml'}")


def _drawn(problem: NotUnderstoodError, name: str, out: Path) -> str:
    """Draw what was not understood, and say where the picture is."""
    if not can_draw():
        return problem.problem
    from ..report.trees import draw_problem

    out.mkdir(parents=True, exist_ok=True)
    picture = draw_problem(problem.facets, problem.places, name, out / "recognised.png")
    return f"{problem.problem.removesuffix('.')} (see {picture})."


def _groups(wood: Path, leaves: Path | None) -> list[Group]:
    """Meshes of files that are no STL; nothing where both are."""
    if all(path.suffix.lower() == ".stl" for path in (wood, leaves) if path):
        return []
    from forest_addon.blender.files.export import read_parts

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
    for told in _bridged(made.habit.anatomy):
        say(f"Bridged: {told}")
    for doubt in made.found.doubts:
        marked = " recognised.png marks where." if can_draw() else ""
        say(f"In doubt: {doubt.sentence}{marked}")


def _bridged(anatomy: Anatomy) -> list[str]:
    """Limbs and stems whose mesh began off what bears them, in words."""
    told = []
    for limbs, one, many, off in (
        (anatomy.parent >= 0, "limb", "limbs", "off the wood that bears"),
        (anatomy.parent < 0, "stem", "stems", "above the ground that bears"),
    ):
        gap = anatomy.bridged[limbs & (anatomy.bridged > 0)]
        if len(gap):
            what, whom = (one, "it") if len(gap) == 1 else (many, "them")
            far = f"{gap[0]:.3g} m" if len(gap) == 1 else f"up to {gap.max():.3g} m"
            told.append(f"{len(gap):,} {what} began {far} {off} {whom}; a tube leads there")
    return told


def _rings(anatomy: Anatomy, grown: Grown, what: str) -> str:
    """Say how far lowest rings of limbs were off the mesh of what bears them, and are."""

    far, left = hold_rings(anatomy, grown)
    limbs, moved = int((grown.parent >= 0).sum()), int((far > OFF).sum())
    text = f"Lowest rings on the mesh, {what}: {moved:,} of {limbs:,} limbs"
    if moved:
        text += f" had corners up to {1000 * far.max():.0f} mm off the wood that bears them, moved"
        return f"{text} in; now {1000 * left.max():.1f} mm at most"
    return f"{text} were off the wood that bears them by more than {1000 * OFF:.0f} mm"


def _show_siblings(made: Library, sensed: int, path: Path, say: Say) -> None:
    """Say how siblings compare with the tree, and render some beside it.

    sensed : siblings that are scanned and listened to.
    """

    from ..report.trees import add_sensors, tell_likeness

    verdict = made.verdict
    species, template = load_species(made.species)
    itself = grow(
        replace(species, siblings=replace(species.siblings or Siblings(), variety=0.0)),
        template,
        stream(0, "template"),
    )
    anatomy = made.habit.anatomy
    rebuilt = grow_sibling(made.habit, Siblings(variety=0.0), 0)
    off = farthest_off(anatomy, rebuilt)
    say(
        f"Rebuilt from its parts: {len(itself.leaves):,} of {made.leaf_count:,} leaves, every vertex "
        f"within {1000 * off:.2g} mm of where it was."
    )
    say(_rings(anatomy, rebuilt, "the tree itself"))
    kin = grow_sibling(made.habit, Siblings(variety=verdict.variety), 1)
    say(_rings(anatomy, kin, "a sibling"))

    def sibling(number: int) -> Tree:
        return grow(species, template, stream(0, "template", "sibling", number))

    with hushed():
        likeness = add_sensors(verdict.likeness, itself, (sibling(k) for k in range(sensed)))
        if can_draw():
            from ..report.trees import render_three

            shown = [sibling(number) for number in range(SHOWN)]
            render_three(made.found, made.unit.metres, itself, shown, species.look, path)
    tell_likeness(likeness, verdict.siblings, sensed, say)


def _tell(made: Library, brought: Brought, say: Say) -> None:
    """Say what was recognised, and how large it is taken to be."""
    recognition, anatomy, metres = made.found, made.habit.anatomy, made.unit.metres
    trunk = int(anatomy.trunks[0])
    others = anatomy.count - 1 - made.branches
    say(f"Wood: {len(made.wood):,} triangles in {anatomy.count:,} pieces:")
    say(
        f"  1 trunk ({anatomy.lines.reach()[trunk]:.2f} m long, foot radius "
        f"{100 * anatomy.foot_radius()[trunk]:.1f} cm), {made.branches:,} first-level branches, "
        f"{others:,} that hang on those"
    )
    if made.leaves is not None:
        distinct = len(recognition.leaves.triangles)
        drawn = round(len(made.leaves) / max(distinct, 1) * made.leaf_count)
        say(
            f"Leaves: {len(made.leaves):,} triangles, {drawn:,} leaf faces: {made.leaf_count:,} leaves"
        )
        if drawn != made.leaf_count:
            say(f"  (each drawn {drawn / made.leaf_count:g} times, as from both sides)")
    sizes = f"{made.height:.2f} m high"
    if made.leaf:
        sizes += f", leaves {100 * made.leaf * metres:.1f} cm long"
    if brought.height:
        say(f"Scale: given by --height; 1 unit = {metres:.5g} m: {sizes}")
    elif brought.unit:
        say(f"Scale: given by --unit {made.unit.name} (1 unit = {metres:g} m): {sizes}")
    else:
        say(
            f"Scale: inferred, as the file does not say; taken as {made.unit.name} "
            f"(1 unit = {metres:g} m): {sizes}. If that is wrong, give --height or --unit."
        )
        if made.unit.name != "metres":
            tall = made.height / metres
            say(
                f"NOTE: in metres it would be {tall:,.6g} m high, so it is taken to be in {made.unit.name}."
            )
