"""A forest as a Blender scene: variants as meshes, trees that share them, a ground.

Everything stands in named collections below *Forest*: *Trees*, *Variants* (hidden; assets to drag in),
their *Outlines* (hidden), *Ground*, *Sensors* and *Results*. Trees are objects, one collection a
species, or points of one object that geometry nodes put variants on. All data of a new forest is
complete before an old one is touched, and what was made of one that fails is taken back; then the
objects that stand there get it, with materials as they were (``placing``). Arrays are made beside the
window (``make_ready``, ``tell_of``): before, fingerprints and stand-ins for views; after, measures and
pictures of variants that are new.
"""

from __future__ import annotations

import weakref
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import bpy
import numpy as np

from ... import spec
from ...base.progress import Progress
from ...base.trimesh import TriMesh
from ...growth.mesh.stand_in import Level, level_for, stand_in
from ...growth.truth import tree_truth
from ...stand.forest import GrownForest
from ...stand.intensity.surface import Flat, GroundSurface
from . import materials
from .assets import Told, Variant, draw, tell_variants, untold
from .instances import (
    SPECIES_KEY,
    STOOD_KEY,
    TREE_KEY,
    points_mesh,
    ranks,
    told_of_tree,
)
from .layout import (
    GROUND_NAME,
    GROUND_ROLE,
    MADE_KEY,
    OUTLINES,
    POINTS_ROLE,
    SHAPE_KEY,
    TREES,
    VARIANTS,
    adopt,
    all_or_nothing,
    find_part,
    grove,
    is_ours,
    part,
)
from .meshes import ground_mesh, to_mesh
from .nodes import LEVEL_KEY, give_instancer, instancer_group, show_near
from .placing import Coat, KeptStanding, WantedObject, fingerprint, hide_wind, put

DRAWABLE = 5_000_000  # triangles of all stand-ins of a forest together, which a graphics card draws at once


@dataclass(frozen=True)
class ReadyForest:
    """Shapes and stand-ins of variants, as far as they were made ahead.

    drawable : triangles that all stand-ins of a forest may have together.
    """

    shapes: dict[Variant, str] = field(default_factory=dict)
    stand_ins: dict[Variant, TriMesh] = field(default_factory=dict)
    drawable: int = DRAWABLE

    def level(self, forest: GrownForest) -> Level:
        """Level at which stand-ins show the trees of a forest."""
        return level_for(len(forest.stand), self.drawable)


def make_ready(
    forest: GrownForest,
    known: Collection[str],
    as_points: bool,
    tell: Progress,
    drawable: int = DRAWABLE,
) -> ReadyForest:
    """Make ahead what the variants of a forest need to stand; touches no Blender.

    known : shapes that stand in the scene already, of which nothing is made anew.
    """
    ready = ReadyForest(drawable=drawable)
    level = ready.level(forest)
    for number, (key, tree) in enumerate(forest.variants.items()):
        tell(number, len(forest.variants))
        ready.shapes[key] = fingerprint(tree.mesh)
        if as_points and f"{ready.shapes[key]} {level.most}" not in known:
            ready.stand_ins[key] = stand_in(tree.mesh, tree.skeleton, level)
    return ready


def tell_of(
    forest: GrownForest, wanted: Sequence[Variant], tell: Progress | None = None
) -> dict[Variant, Told]:
    """Measure variants of a forest and draw their pictures; touches no Blender."""
    told = {}
    for number, key in enumerate(wanted):
        if tell:
            tell(number, len(wanted))
        tree, label = forest.variants[key], forest.labels[key[0]]
        height = float(tree.mesh.vertices[:, 2].max(initial=0.0))
        described = f"{label}, {height:.1f} m tall, {tree.mesh.leaf.max(initial=-1) + 1:,} leaves"
        picture = draw(tree.mesh, forest.species[key[0]].look)
        told[key] = tree_truth(tree), described, picture
    return told


MANY = 1000  # trees; where there are more, they are points unless the settings say otherwise
SHOWN_IN_FULL = (
    30_000_000  # triangles; where there are more, views show stand-ins until told otherwise
)
_stands: dict[int, weakref.ref[GrownForest]] = {}  # built last, by scene


def build(
    scene: bpy.types.Scene,
    settings: spec.Scene,
    forest: GrownForest,
    terrain: GroundSurface | None = None,
    *,
    as_assets: bool = True,
    looks: bool = True,
    ready: ReadyForest | None = None,
) -> None:
    """Put a forest into a Blender scene, or bring the one that is there up to date; its sensors stay.

    terrain : the ground that the forest was planned on; None: flat.
    as_assets : whether variants become assets, each with a picture, and say what they measure; nobody
        looks at those of a scene that is not kept, and a window does it once the forest stands.
    looks : whether materials have nodes, and meshes are known again; neither matters in a scene that is
        sensed once, seen by nobody and not kept.
    ready : what was made ahead (``make_ready``).

    Raises
    ------
    SpecError : a tree that cannot stand (see ``points_mesh``), or an object of the forest that is in Edit
        Mode, where Blender gives it no other mesh; nothing is changed.
    """
    terrain = Flat(settings.forest.terrain.base) if terrain is None else terrain
    adopt(scene)
    standing = KeptStanding.of(scene)
    edited = next((obj.name for obj in standing.things.values() if obj.mode == "EDIT"), "")
    if edited:
        why = f'"{edited}" is being edited; leave Edit Mode, then grow the forest again'
        raise spec.SpecError("build", why)
    ready, points = ready or ReadyForest(), are_points(settings.forest, forest)
    labels = () if points else forest.labels
    with all_or_nothing():
        library, outlines = _library(standing, forest, points, ready, looks)
        wanted, light = [*outlines, *library], False
        number_of = {key: number for number, key in enumerate(forest.variants)}
        pairs = zip(forest.stand.species.tolist(), forest.stand.variant.tolist(), strict=True)
        variant = np.array([number_of[pair] for pair in pairs], dtype=np.int64)
        if not points:
            wanted += _trees(forest, [want.data for want in library], variant)
        elif len(forest.stand):
            trees, light = _points(scene, standing, forest, library, variant)
            wanted.append(trees)
        if not settings.forest.terrain.object:
            shape = ground_mesh(settings.forest, terrain)
            coats, make = [Coat("Ground", materials.ground)], partial(to_mesh, "Ground", shape)
            data = standing.renew(GROUND_ROLE, "Ground", fingerprint(shape), make, coats)
            wanted.append(WantedObject(GROUND_NAME, GROUND_ROLE, "Ground", data))

    chosen = bpy.data.objects.get(settings.forest.terrain.object)
    if chosen is not None and is_ours(chosen):  # else it stays anyway, or went while trees grew
        del chosen[MADE_KEY]
    if looks:
        standing.dress([coat for pair in _coats(forest) for coat in pair])
    things = put(scene, standing, wanted, labels)
    if POINTS_ROLE in things:
        libraries = part(scene, VARIANTS), part(scene, OUTLINES)
        give_instancer(things[POINTS_ROLE], *libraries, light=light)
        things[POINTS_ROLE][LEVEL_KEY] = ready.level(forest).most
    for planting, label in enumerate(labels):  # where its trees were planted
        places = forest.stand.position[forest.stand.species == planting, :2]
        grove(scene, label)[STOOD_KEY] = places.ravel().tolist()
    if GROUND_ROLE in things:
        show_near(things[GROUND_ROLE], settings.forest, terrain)
    _stands[scene.session_uid] = weakref.ref(forest)
    if as_assets:
        tell_variants(scene, forest, tell_of(forest, untold(scene, forest)))
    hide_wind(scene)  # which moved the trees of before


def triangles_of(forest: GrownForest) -> int:
    """Number of triangles that a view draws which shows every tree in full."""
    stand = forest.stand
    pairs = np.column_stack([stand.species, stand.variant])
    kinds, count = np.unique(pairs, axis=0, return_counts=True) if len(stand) else (pairs, pairs)
    return sum(
        int(many) * len(forest.variants[planting, variant].mesh.triangles)
        for (planting, variant), many in zip(kinds.tolist(), count.tolist(), strict=True)
    )


def are_points(settings: spec.Forest, forest: GrownForest) -> bool:
    """Return whether the trees of a forest are points of one object, not objects."""
    if settings.instancing == "auto":
        return len(forest.stand) > MANY
    return settings.instancing == "points"


def shapes_in(scene: bpy.types.Scene) -> set[str]:
    """Return the shapes of all meshes of ours that stand in a scene (``make_ready``)."""
    return {str(mesh.get(SHAPE_KEY, "")) for mesh in KeptStanding.of(scene).meshes.values()}


def standing_forest(scene: bpy.types.Scene) -> GrownForest | None:
    """Return the forest that was last built in a Blender scene, if it is still in memory."""
    last = _stands.get(scene.session_uid)
    return None if last is None else last()


def _coats(forest: GrownForest) -> list[tuple[Coat, Coat]]:
    """Bark and leaves of every planting."""
    kinds = zip(forest.labels, forest.species, strict=True)
    return [
        (
            Coat(
                f"{label} bark",
                partial(materials.bark, coat=kind.bark),
                kind.look.bark,
                repr(kind.bark),
            ),
            Coat(
                f"{label} leaf",
                partial(materials.leaf, veins=materials.veins_of(kind)),
                kind.look.foliage(),
            ),
        )
        for label, kind in kinds
    ]


def _library(
    standing: KeptStanding,
    forest: GrownForest,
    with_outlines: bool,
    ready: ReadyForest,
    looks: bool,
) -> tuple[list[WantedObject], list[WantedObject]]:
    """Plan an object for every variant and its outline, named so that their order is their number."""
    coats, library, outlines = _coats(forest), [], []
    if not looks:
        coats = [(replace(bark, make=_bare), replace(leaf, make=_bare)) for bark, leaf in coats]
    digits, level = max(3, len(str(len(forest.variants)))), ready.level(forest)
    for number, ((planting, variant), tree) in enumerate(forest.variants.items()):
        label, numbered = forest.labels[planting], f"{number:0{digits}d} "
        name, key = f"{label}.{variant:03d}", (planting, variant)
        shape = (ready.shapes.get(key) or fingerprint(tree.mesh)) if looks else ""
        role, make = f"{VARIANTS}/{name}", partial(to_mesh, name, tree.mesh)
        sister = standing.first(f"{VARIANTS}/{label}")
        mesh = standing.renew(role, name, shape, make, coats[planting], sister)
        says = {SPECIES_KEY: planting}
        library.append(WantedObject(VARIANTS, role, numbered + name, mesh, says=says))
        if with_outlines:
            role, rough = f"{OUTLINES}/{name}", f"{name} outline"
            made = ready.stand_ins.get(key)
            make = lambda rough=rough, tree=tree, made=made: to_mesh(  # noqa: E731
                rough, made or stand_in(tree.mesh, tree.skeleton, level)
            )
            data = standing.renew(role, rough, f"{shape} {level.most}", make, coats[planting], mesh)
            outlines.append(WantedObject(OUTLINES, role, numbered + rough, data))
    return library, outlines


def _bare(name: str, *_look: object) -> bpy.types.Material:
    """A material that looks like nothing."""
    return bpy.data.materials.new(name)


def _trees(
    forest: GrownForest, meshes: Sequence[bpy.types.Mesh], variant: np.ndarray
) -> Iterable[WantedObject]:
    """An object for every tree, in the collection of its planting."""
    stand = forest.stand
    for tree, place in enumerate(forest.transforms()):
        planting, number = int(stand.species[tree]), int(stand.id[tree])
        label = forest.labels[planting]
        name, stood = f"{label} {number:04d}", told_of_tree(forest, tree)
        says = {TREE_KEY: number, SPECIES_KEY: planting, STOOD_KEY: stood}
        mesh = meshes[variant[tree]]
        yield WantedObject(TREES, f"{TREES}/{name}", name, mesh, label, place, says)


def _points(
    scene: bpy.types.Scene,
    standing: KeptStanding,
    forest: GrownForest,
    library: Sequence[WantedObject],
    variant: np.ndarray,
) -> tuple[WantedObject, bool]:
    """One object for all trees, and whether views show their outlines at first."""
    instancer_group()
    stand, home = forest.stand, find_part(scene, VARIANTS)
    others = [b.name for b in (*home.objects, *home.children) if not is_ours(b)] if home else []
    rank = ranks([want.name for want in library], others)
    make = partial(
        points_mesh,
        TREES,
        count=len(library) + len(others),
        position=forest.transforms()[:, :, 3],
        rotation=stand.rotation,
        scale=stand.scale,
        variant=rank[variant],
        tree=stand.id,
        species=stand.species,
    )
    faces = np.array([len(want.data.polygons) for want in library], dtype=np.int64)
    aligned = bool((rank == np.arange(len(rank))).all())  # or outlines would be those of others
    light = aligned and bool(faces[variant].sum() > SHOWN_IN_FULL)
    data = standing.renew(POINTS_ROLE, TREES, "", make)
    return WantedObject(TREES, POINTS_ROLE, TREES, data), light
