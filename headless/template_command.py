"""``python -m headless template``: a user's tree as STL files becomes a species that grows.

Written into a folder: the tree in metres (wood.stl, leaves.stl), a species file with a grammar fitted to
its habit, and a picture of what was recognised. A scene then plants the species file; scene.toml is one.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from forest_addon.formats.atomic import replacing
from forest_addon.formats.stl import StlError, read_stl, write_stl
from forest_addon.growth.habit import fit_grammar
from forest_addon.growth.leaves import measure_leaves
from forest_addon.growth.recognise import Recognition, TemplateError, recognise
from forest_addon.growth.template import TreeTemplate, split_tree
from forest_addon.growth.trimesh import LEAF, TriMesh
from forest_addon.growth.unit import Unit, infer_unit
from forest_addon.spec import Grammar, SpecError

Say = Callable[[str], None]


@dataclass(frozen=True)
class _Source:
    """What was read and recognised, in file units."""

    wood: np.ndarray  # (T, 3, 3)
    leaves: np.ndarray | None
    found: Recognition

    @property
    def height(self) -> float:
        return float(np.ptp(self.wood[:, :, 2]))


def make_template(
    wood: Path, leaves: Path | None, name: str, height: float, out: Path, say: Say = print
) -> Path:
    """Make a template library from STL files; returns the species file.

    height : metres of the tree; 0: the unit is inferred, and said.

    Raises
    ------
    SpecError : a file cannot be used, with the reason.
    """
    if not re.fullmatch(r"[\w-]+", name):
        raise SpecError("--name", f'"{name}" must be letters, digits, - and _ only')
    if not 0 <= height <= 200:
        raise SpecError("--height", f"{height:g} m is out of range; use 0 to 200")
    source = _read(wood, leaves)
    unit = _unit(source, height)
    tree = split_tree(
        source.wood * unit.metres, None if source.leaves is None else source.leaves * unit.metres
    )
    _tell(source, unit, tree, height > 0, say)

    out.mkdir(parents=True, exist_ok=True)
    write_stl(out / "wood.stl", source.wood * unit.metres, f"{name}: wood, metres")
    if source.leaves is not None:
        write_stl(out / "leaves.stl", source.leaves * unit.metres, f"{name}: leaves, metres")
    species = out / f"{name}.toml"
    origin = " and ".join(path.name for path in (wood, leaves) if path)
    _write(species, _species_text(name, origin, source.leaves is not None, fit_grammar(tree)))
    _write(out / "scene.toml", _scene_text(name, source.height * unit.metres))
    from .recognised import draw_recognised

    draw_recognised(source.found, unit.metres, name, out / "recognised.png")
    say(f"Wrote {species}, its STL files, recognised.png and scene.toml.")
    say(f"Next: python -m headless run {out / 'scene.toml'}")
    return species


def _read(wood: Path, leaves: Path | None) -> _Source:
    try:
        timber = read_stl(wood)
        foliage = read_stl(leaves) if leaves else None
        return _Source(timber, foliage, recognise(timber, foliage))
    except FileNotFoundError as problem:
        raise SpecError(
            "template", f"there is no file {problem.filename}; check the path"
        ) from None
    except (StlError, TemplateError) as problem:
        raise SpecError("template", str(problem)) from None


def _unit(source: _Source, height: float) -> Unit:
    if height > 0:
        return Unit(height / source.height, "units of the height given")
    return infer_unit(source.height, _leaf_length(source.found))


def _leaf_length(found: Recognition) -> float | None:
    """Median length of the leaves in file units, None without leaves."""
    pieces = found.leaves
    if not pieces.count:
        return None
    mesh = TriMesh.of_part(pieces.vertices, pieces.triangles, LEAF)
    mesh.leaf[:] = pieces.piece
    return float(np.median(measure_leaves(mesh).length))


def _tell(source: _Source, unit: Unit, tree: TreeTemplate, given: bool, say: Say) -> None:
    """Say what was recognised, and how large it is taken to be."""
    found, metres = source.found, unit.metres
    firsts, others = len(tree.branches), tree.wood_components - 1 - len(tree.branches)
    say(f"Wood: {len(source.wood):,} triangles in {tree.wood_components:,} pieces:")
    say(
        f"  1 trunk ({tree.trunk_length:.2f} m long, foot radius {100 * tree.trunk_radius:.1f} cm), "
        f"{firsts:,} first-level branches, {others:,} that hang on those or were left out"
    )
    if tree.stubs:
        say(f"  {tree.stubs:,} too short or roots: left out")
    if source.leaves is not None:
        distinct = len(found.leaves.triangles)
        drawn = round(len(source.leaves) / max(distinct, 1) * tree.leaf_count)
        say(
            f"Leaves: {len(source.leaves):,} triangles, {drawn:,} leaf faces: {tree.leaf_count:,} leaves"
        )
        if drawn != tree.leaf_count:
            say(f"  (each drawn {drawn / tree.leaf_count:g} times, as from both sides)")
        if tree.unattached_leaves:
            say(f"  {tree.unattached_leaves:,} on the trunk or on what was left out: not used")
    leaf = _leaf_length(found)
    sizes = f"{source.height * metres:.2f} m high"
    if leaf:
        sizes += f", leaves {100 * leaf * metres:.1f} cm long"
    if given:
        say(f"Scale: given by --height; 1 unit = {metres:.5g} m: {sizes}")
    else:
        say(
            f"Scale: inferred, as an STL does not say; taken as {unit.name} "
            f"(1 unit = {metres:g} m): {sizes}. If that is wrong, give --height."
        )


def _species_text(name: str, origin: str, leafy: bool, grammar: Grammar) -> str:
    return f"""\
name = "{name}"
source = "Template from {origin.replace('"', "'").replace(chr(92), "/")}; grammar of T20 fitted to its habit."

[template]
wood = "wood.stl"
leaves = "{"leaves.stl" if leafy else ""}"

[grammar]
generations = {grammar.generations}
copies = {grammar.copies}
length = {grammar.length}
side_ratio = {grammar.side_ratio}
centre_ratio = {grammar.centre_ratio}
angle_deg = {grammar.angle_deg}
twist_deg = {grammar.twist_deg}
radius = {grammar.radius}
radius_ratio = {grammar.radius_ratio}
"""


def _scene_text(name: str, height: float) -> str:
    side = round(max(4.0, 2.5 * height), 1)
    return f"""\
name = "{name} forest"
seed = 1

[forest]
size = [{side}, {side}]
spacing = {round(0.3 * height, 2)}

[[plantings]]
species = "{name}.toml"
variants = 3
expected = 12
"""


def _write(path: Path, text: str) -> None:
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8")
