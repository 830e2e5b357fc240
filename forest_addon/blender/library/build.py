"""An asset library: for every species a .blend file with grown trees to drag into any scene.

Each tree is a collection that is marked as an asset, with catalog, description, tags and picture, and holds
one object. A collection can be dragged in as an instance, which moves freely also where it is linked; its
object can be appended or linked by itself. What sensors know of the tree lies on its mesh
(``scene.meshes``). In the file the trees stand in a row; an instance has its tree at its own origin.
"""

from __future__ import annotations

import os
import tomllib
import uuid
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...base.places import ASSETS, file_name
from ...base.progress import Progress
from ...base.rng import stream
from ...formats.atomic import replacing
from ...growth.tree import Tree, grow
from ...growth.truth import tree_truth
from ...spec import Species
from ..scene import materials
from ..scene.assets import draw, mark_asset
from ..scene.layout import all_or_nothing
from ..scene.meshes import to_mesh, write_truth
from ..scene.placing import fingerprint

ROOT = "Forest Sensing"


@dataclass(frozen=True)
class Exhibit:
    """A grown tree, what it measures (by name and unit), and its picture (P, P, 4)."""

    tree: Tree
    truth: dict[str, float]
    picture: np.ndarray


def grow_exhibits(
    species: Species, template: Any, variants: int, seed: int, progress: Progress | None = None
) -> list[Exhibit]:
    """Grow trees of a species and draw them; touches no Blender data.

    Raises
    ------
    SpecError : the species cannot be grown.
    """
    made = []
    for variant in range(variants):
        tree = grow(species, template, stream(seed, "library", species.name, variant))
        made.append(Exhibit(tree, tree_truth(tree), draw(tree.mesh, species.look, size=2)))
        if progress:
            progress(variant + 1, variants)
    return made


def write_species(folder: Path, species: Species, exhibits: Sequence[Exhibit]) -> Path:
    """Write trees of a species as assets; returns the file. The file that is open stays as it is.

    Raises
    ------
    OSError : the folder or the file cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / f"{file_name(species.name)}.blend"
    x, made, paths = 0.0, set(), set()
    with all_or_nothing(always=True):
        coats = materials.coats_of(species)
        for variant, exhibit in enumerate(exhibits):
            truth = exhibit.truth
            half = 0.55 * max(truth["crown_width_m"], 0.3 * truth["height_m"])
            x += half if variant else 0.0
            path = f"{ROOT}/{_named().get(species.name) or _guess(species, truth['height_m'])}"
            made.add(_asset(species.name, exhibit, variant, x, path, coats))
            x += half
            paths.add(path)
        with replacing(file) as partial:
            bpy.data.libraries.write(os.fspath(partial), made, fake_user=True, compress=True)
    add_catalogs(folder, paths)
    return file


def _asset(
    species: str,
    exhibit: Exhibit,
    variant: int,
    x: float,
    path: str,
    coats: Sequence[bpy.types.Material],
) -> bpy.types.Collection:
    """A collection with one tree, marked as an asset."""
    name = f"{species.replace('-', ' ').capitalize()} {variant + 1}"
    mesh = to_mesh(name, exhibit.tree.mesh)
    for coat in coats:
        mesh.materials.append(coat)
    digest = fingerprint(exhibit.tree.mesh)
    write_truth(mesh, f"{species}#{variant + 1} {digest}", species, exhibit.tree)
    thing = bpy.data.objects.new(name, mesh)
    home = bpy.data.collections.new(name)
    home.objects.link(thing)
    thing.location.x = home.instance_offset[0] = x
    tags = ("tree", species, path.rpartition("/")[2].lower())
    mark_asset(home, describe(species, exhibit.truth), tags, exhibit.picture)
    home.asset_data.catalog_id = catalog_id(path)
    return home


def describe(species: str, truth: dict[str, float]) -> str:
    """A tree in one line, for the asset browser."""
    said = [f"{species}: height {truth['height_m']:.1f} m"]
    if truth["dbh_m"] > 0:
        said.append(f"DBH {truth['dbh_m']:.2f} m")
    said.append(f"crown {truth['crown_width_m']:.1f} m wide from {truth['crown_base_m']:.1f} m up")
    if truth["leaves"] > 0:
        said.append(f"{truth['leaf_area_m2']:.3g} m² of leaves ({truth['leaves']:,.0f})")
    return ", ".join(said)


FILE = "blender_assets.cats.txt"
LOW = 1.5  # metres, below which a plant that no catalog names is undergrowth
_NAMESPACE = uuid.UUID("8b6c5a52-0a53-5d43-9d3e-6f6c2f7d6a11")
_HEAD = """\
# This is an Asset Catalog Definition file for Blender.
#
# Empty lines and lines starting with `#` will be ignored.
# The first non-ignored line should be the version indicator.
# Other lines are of the format "UUID:catalog/path/for/assets:simple catalog name"

VERSION 1
"""


def _guess(species: Species, height: float) -> str:
    if height < LOW:
        return "Undergrowth"
    return "Conifers" if species.needles or species.leaf.shape == "needle" else "Broadleaves"


@cache
def _named() -> dict[str, str]:
    """The catalog of each preset."""
    listed = tomllib.loads((ASSETS / "catalogs.toml").read_text(encoding="utf-8"))
    return {name: group for group, names in listed.items() for name in names}


def catalog_id(path: str) -> str:
    """The UUID of a catalog."""
    return str(uuid.uuid5(_NAMESPACE, path))


def add_catalogs(folder: Path, paths: Iterable[str]) -> Path:
    """Have a library's file name these catalogs and those above them; returns the file.

    Raises
    ------
    OSError : the file cannot be read or written.
    """
    file = folder / FILE
    text = file.read_text(encoding="utf-8") if file.is_file() else _HEAD
    known = {line.split(":", 1)[0] for line in text.splitlines() if ":" in line}
    whole = {
        "/".join(path.split("/")[: k + 1]) for path in paths for k in range(path.count("/") + 1)
    }
    lines = [
        f"{catalog_id(path)}:{path}:{path.replace('/', '-')}"
        for path in sorted(whole)
        if catalog_id(path) not in known
    ]
    if lines or not file.is_file():
        with replacing(file) as partial:
            partial.write_text(text.rstrip("\n") + "\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return file
