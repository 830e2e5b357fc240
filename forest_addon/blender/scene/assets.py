"""Grown variants as assets: in the asset browser, with a picture, to be dragged into any scene.

What they measure and look like is told once they stand, and anew when they have changed (``untold``).
The picture is drawn here, from points strewn over the mesh, because a Blender without a window draws none.

A library has a .blend file for every species. Each tree is a collection that is marked as an asset, with
catalog, description, tags and picture, and holds one object. A collection can be dragged in as an instance,
which moves freely also where it is linked; its object can be appended or linked by itself. What sensors know
of the tree lies on its mesh (``meshes``). In the file the trees stand in a row; an instance has its tree at
its own origin.
"""

from __future__ import annotations

import os
import tomllib
import uuid
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy
import numpy as np

from ... import spec
from ...base.places import ASSETS, file_name
from ...base.progress import Progress
from ...base.rng import stream
from ...base.trimesh import DEAD, LEAF, WOOD, TriMesh, join
from ...formats.atomic import replacing
from ...growth.tree import Tree, grow
from ...growth.truth import tree_truth
from ...spec import Species
from . import materials
from .attributes import give_picture
from .layout import SHAPE_KEY, VARIANTS, all_or_nothing, by_role, find_part
from .meshes import to_mesh, write_truth
from .placing import TOLD_KEY, fingerprint, has_own_mesh

if TYPE_CHECKING:
    from ...stand.forest import GrownForest

Variant = tuple[int, int]  # number of the planting, and of the variant in it
Told = tuple[
    Mapping[str, float], str, np.ndarray
]  # its measures, a sentence, its picture (``draw``)
AUTHOR = "Forest Sensing"
PICTURE_KEY = "forest_picture"  # on the object of a variant: what its picture was drawn from
PIXELS = 128
DOTS = 60_000
FACES = 120_000  # of a mesh, at most, that dots are strewn over
LIGHT = np.array([-0.45, -0.70, 0.55])  # towards the sun; the eye looks along +Y
AMBIENT = 0.45
PAPER = 0.94  # grey of the paper, as in the pictures of presets


def untold(scene: bpy.types.Scene, forest: GrownForest) -> list[Variant]:
    """Return variants of a forest that stands in a scene whose measures or pictures are missing, or are of
    what stood before; without those that have a mesh of the user's own.
    """
    return [
        key
        for key, obj in _things(scene, forest).items()
        if obj.data.get(TOLD_KEY) != obj.data[SHAPE_KEY]
        or obj.get(PICTURE_KEY) != _drawn_from(obj, forest, key)
    ]


def tell_variants(
    scene: bpy.types.Scene, forest: GrownForest, told: Mapping[Variant, Told]
) -> None:
    """Have variants that stand in a scene say what they measure, and be assets with a picture.

    One that the user has made no asset any more stays none.
    """
    things = _things(scene, forest)
    for key in things.keys() & told.keys():
        obj, (truth, description, picture) = things[key], told[key]
        for name, value in truth.items():  # custom properties, for whoever looks
            obj.data[name] = value
        obj.data[TOLD_KEY] = obj.data[SHAPE_KEY]
        was, drawn_from = obj.get(PICTURE_KEY), _drawn_from(obj, forest, key)
        if was != drawn_from and (was is None or obj.asset_data is not None):
            tags = ("tree", "forest", forest.labels[key[0]])
            mark_asset(obj, description, tags, picture)
        obj[PICTURE_KEY] = drawn_from


def _things(scene: bpy.types.Scene, forest: GrownForest) -> dict[Variant, bpy.types.Object]:
    """The objects of variants that have the meshes that were made for them."""
    home = find_part(scene, VARIANTS)
    there = by_role(home.objects) if home is not None else {}
    roles = {key: f"{VARIANTS}/{forest.labels[key[0]]}.{key[1]:03d}" for key in forest.variants}
    found = {key: there[role] for key, role in roles.items() if role in there}
    return {key: t for key, t in found.items() if SHAPE_KEY in t.data and not has_own_mesh(t)}


def _drawn_from(obj: bpy.types.Object, forest: GrownForest, key: Variant) -> str:
    look = forest.species[key[0]].look
    return f"{obj.data[SHAPE_KEY]} {look.bark} {look.foliage()}"


def mark_asset(
    block: bpy.types.ID, description: str, tags: Iterable[str], picture: np.ndarray
) -> None:
    """Make an object or a collection an asset that says what tree it is; one that is an asset says so."""
    if block.asset_data is None:
        block.asset_mark()
        block.asset_data.author = AUTHOR
    block.asset_data.description = description
    for tag in tags:
        block.asset_data.tags.new(tag, skip_if_exists=True)
    give_picture(block, picture)


def on_paper(wood: np.ndarray, leaves: np.ndarray | None, look: spec.Look) -> np.ndarray:
    """(PIXELS, PIXELS, 3) sRGB, from the upper left: facets (T, 3, 3) of a tree before white paper."""
    parts = [(wood, WOOD)] + ([(leaves, LEAF)] if leaves is not None else [])
    mesh = join(
        [
            TriMesh.of_part(f.reshape(-1, 3), np.arange(3 * len(f)).reshape(-1, 3), part)
            for f, part in parts
        ]
    )
    drawn = draw(mesh, look)
    ink = drawn[::-1, :, 3:]
    return np.asarray(ink * drawn[::-1, :, :3] + PAPER * (1 - ink))


def draw(mesh: TriMesh, look: spec.Look, size: int = 1) -> np.ndarray:
    """(P, P, 4) sRGB, from the lower left: a tree from the front, the rest transparent; P is size PIXELS."""
    pixels, count = size * PIXELS, size**2 * DOTS
    picture = np.zeros((pixels, pixels, 4), dtype=np.float32)
    some = slice(None, None, 1 + len(mesh.triangles) // FACES)
    corner, of_part = mesh.vertices[mesh.triangles[some]], mesh.part[some]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = np.linalg.norm(normal, axis=1)
    if not area.sum() > 0:
        return picture
    rng = stream(0, "asset", "picture")
    face = rng.choice(len(area), count, p=area / area.sum())
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    a, b, c = corner[face].transpose(1, 0, 2)
    dots = a + u * (b - a) + v * (c - a)

    low, high = dots.min(axis=0), dots.max(axis=0)
    extent = max(high[0] - low[0], high[2] - low[2], 1e-9) * 1.04
    place = ((dots - (low + high) / 2) / extent + 0.5) * pixels
    column, row = np.clip(place[:, [0, 2]], 0, pixels - 1).astype(int).T
    order = np.argsort(-dots[:, 1])  # what is nearer is drawn over what is farther
    facing = np.abs(normal[face] @ LIGHT) / (area[face] * np.linalg.norm(LIGHT))
    tone = np.full((128, 3), 0.25)
    tone[[WOOD, DEAD]], tone[LEAF] = look.bark, look.foliage()
    shade = 2.5 * tone[of_part[face]] * (AMBIENT + (1 - AMBIENT) * facing)[:, None]
    picture[row[order], column[order], :3] = np.clip(shade[order], 0, 1) ** (1 / 2.2)
    picture[row, column, 3] = 1.0
    return picture


ROOT = "Forest Sensing"


# A grown tree, what it measures (by name and unit), and its picture (P, P, 4).
Exhibit = tuple[Tree, dict[str, float], np.ndarray]


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
        made.append((tree, tree_truth(tree), draw(tree.mesh, species.look, size=2)))
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
        for variant, (tree, truth, picture) in enumerate(exhibits):
            half = 0.55 * max(truth["crown_width_m"], 0.3 * truth["height_m"])
            x += half if variant else 0.0
            path = f"{ROOT}/{_named().get(species.name) or _guess(species, truth['height_m'])}"
            name = f"{species.name.replace('-', ' ').capitalize()} {variant + 1}"
            mesh = to_mesh(name, tree.mesh, coats)
            digest = fingerprint(tree.mesh)
            write_truth(mesh, f"{species.name}#{variant + 1} {digest}", species.name, tree)
            obj = bpy.data.objects.new(name, mesh)
            home = bpy.data.collections.new(name)
            home.objects.link(obj)
            obj.location.x = home.instance_offset[0] = x
            tags = ("tree", species.name, path.rpartition("/")[2].lower())
            mark_asset(home, describe(species.name, truth), tags, picture)
            home.asset_data.catalog_id = catalog_id(path)
            made.add(home)
            x += half
            paths.add(path)
        with replacing(file) as partial:
            bpy.data.libraries.write(os.fspath(partial), made, fake_user=True, compress=True)
    add_catalogs(folder, paths)
    return file


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
