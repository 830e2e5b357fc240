"""Add > Mesh > L-system Tree: one tree at the 3D cursor, changed in the redo panel."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import Any, ClassVar

import bpy
from bpy_extras.object_utils import AddObjectHelper, object_data_add

from ...spec import Species
from ..assets import ASSETS
from ..running import PROBLEMS, WhenReady, in_words
from ..words import label, language


def species_items(_operator: Any = None, _context: Any = None) -> list[tuple[str, str, str]]:
    """The presets, as a menu."""
    return _species_items(language())


@functools.cache  # Blender wants the strings kept
def _species_items(_language: str) -> list[tuple[str, str, str]]:
    names = sorted(path.stem for path in (ASSETS / "species").glob("*.toml"))
    return [
        (name, name.replace("-", " ").title(), label("Grow a {species}", species=name))
        for name in names
    ]


class FOREST_OT_add_tree(WhenReady, bpy.types.Operator, AddObjectHelper):
    """Grow one tree of a species at the 3D cursor"""

    bl_idname = "forest.add_tree"
    bl_label = "L-system Tree"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO", "PRESET"}

    species: bpy.props.EnumProperty(name="Species", description="What grows", items=species_items)
    seed: bpy.props.IntProperty(
        name="Seed", description="Another number is another tree", default=1, min=0
    )
    generations: bpy.props.IntProperty(
        name="Generations",
        description="How often the L-system is rewritten; 0: as the species says",
        default=0,
        min=0,
        soft_max=9,
        max=12,
    )
    leaves: bpy.props.BoolProperty(
        name="Leaves", description="Switching them off moves no branch", default=True
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            data = self._grow()
        except PROBLEMS as problem:
            self.report({"ERROR"}, in_words(problem))
            return {"CANCELLED"}
        object_data_add(context, data, operator=self)
        return {"FINISHED"}

    def draw(self, _context: bpy.types.Context) -> None:
        column = self.layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        for name in ("species", "seed", "generations", "leaves", "align", "location", "rotation"):
            column.prop(self, name)

    def _grow(self) -> bpy.types.Mesh:
        from ...blender import materials
        from ...blender.meshes import to_mesh
        from ...formats.species_file import find_species, load_species
        from ...growth.mesh.trimesh import LEAF
        from ...growth.tree import grow
        from ...rng import stream

        species, template = load_species(find_species(self.species, ASSETS))
        if self.generations:
            species = with_generations(species, self.generations)
        tree = grow(species, template, stream(self.seed, "tree", self.species))
        mesh = tree.mesh if self.leaves else tree.mesh.select(tree.mesh.part != LEAF)
        data = to_mesh(species.name, mesh)
        data.materials.append(materials.bark(f"{species.name} bark", species.look.bark))
        data.materials.append(materials.leaf(f"{species.name} leaf", species.look.foliage()))
        return data


def with_generations(species: Species, generations: int) -> Species:
    """A species that is rewritten so many times; one that branches by levels is left as it is."""
    changed: dict[str, Any] = {}
    if species.rules is not None:
        changed["rules"] = replace(species.rules, generations=generations)
    elif species.honda is None:
        changed["grammar"] = replace(species.grammar, generations=generations)
    return replace(species, **changed)


def draw_in_menu(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """The entry in Add > Mesh."""
    menu.layout.operator(FOREST_OT_add_tree.bl_idname, icon="OUTLINER_OB_CURVES")


CLASSES = (FOREST_OT_add_tree,)


def register() -> None:
    """Add the entry to Blender's menu."""
    bpy.types.VIEW3D_MT_mesh_add.append(draw_in_menu)


def unregister() -> None:
    """Take it back."""
    bpy.types.VIEW3D_MT_mesh_add.remove(draw_in_menu)
