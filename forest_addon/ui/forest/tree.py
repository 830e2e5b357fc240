"""Add > Mesh > L-system Tree: one tree at the 3D cursor, whose mesh keeps the settings it was grown from.

They are changed in the redo panel, and ever after in the Properties editor, below the mesh: *Grow Again*
gives the mesh another shape, whatever objects, modifiers and materials use it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
from bpy_extras.object_utils import AddObjectHelper, object_data_add

from ...base.rng import stream
from ...base.trimesh import LEAF
from ...blender.scene import materials
from ..settings.drawing import OfData, split
from ..settings.groups import group_class
from ..shell.running import WhenReady, button, panel
from ..shell.words import keep
from ..species import edit

LEAFY = "maple"  # what grows first
SHAPE_OF = "forest_shape_of"  # on a mesh: the species that it has the shape of by now
SETTINGS = ("species", "seed", "generations", "leaves")


def species_items(_owner: Any = None, context: Any = None) -> list[tuple[str, str, str, int, int]]:
    """Presets, the user's own species and those edited in this file, as a menu; a leafy one first."""
    return edit.menu((context or bpy.context).scene.forest_sensing, LEAFY)


def _settings() -> dict[str, Any]:
    """The settings of a tree as properties; an operator and a mesh have the same."""
    return {
        "species": bpy.props.EnumProperty(
            name="Species", description="What grows", items=species_items
        ),
        "seed": bpy.props.IntProperty(
            name="Seed", description="Another number is another tree", default=1, min=0
        ),
        "generations": bpy.props.IntProperty(
            name="Generations",
            description="How often the L-system is rewritten; 0: as the species says",
            default=0,
            min=0,
            soft_max=9,
            max=12,
        ),
        "leaves": bpy.props.BoolProperty(
            name="Leaves", description="Switching them off moves no branch", default=True
        ),
    }


FOREST_PG_grown = group_class(  # settings that a single tree was grown from
    "grown",
    _settings()
    | {
        "grown": bpy.props.StringProperty(
            options={"HIDDEN"}
        ),  # the species; tells its mesh from any other
        "species": bpy.props.EnumProperty(
            name="Species",
            description="What grows",
            items=species_items,
            get=lambda group: next((i[4] for i in species_items() if i[0] == group.grown), 0),
            set=lambda group, number: setattr(
                group, "grown", next((i[0] for i in species_items() if i[4] == number), LEAFY)
            ),
        ),
    },
)


def _draw_settings(pressed: bpy.types.Operator, _context: bpy.types.Context) -> None:
    column = split(pressed.layout)
    for name in (*SETTINGS, "align", "location", "rotation"):
        column.prop(pressed, name)


@button(
    "L-system Tree",
    WhenReady,
    AddObjectHelper,
    bl_options={"REGISTER", "UNDO", "PRESET"},
    draw=_draw_settings,
    **_settings(),
)
def add_tree(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Grow one tree of a species at the 3D cursor"""
    data = _grow(context, pressed.species, pressed.seed, pressed.generations, pressed.leaves)
    object_data_add(context, data, operator=pressed)
    return ""


@button(
    "Grow Again",
    WhenReady,
    needs=(
        (
            lambda context: _is_grown(context),
            keep("This is no tree of Add > Mesh > L-system Tree"),
        ),
        (
            lambda context: context.object.data.is_editable,
            keep("This tree is of another file: grow it there"),
        ),
    ),
    new_seed=bpy.props.BoolProperty(
        name="New Seed", description="Another tree of the same species", options={"SKIP_SAVE"}
    ),
)
def _grow_again(pressed: bpy.types.Operator, context: bpy.types.Context) -> str:
    """Grow this tree from its settings; objects, modifiers and materials stay"""
    old = context.object.data
    settings = old.forest_grown
    seed = settings.seed + 1 if pressed.new_seed else settings.seed
    data = _grow(context, settings.grown, seed, settings.generations, settings.leaves)
    if old.get(SHAPE_OF) == settings.grown:  # another species has a bark of its own
        made = list(data.materials)
        data.materials.clear()
        for material in old.materials:
            data.materials.append(material)
        bpy.data.batch_remove([material for material in made if not material.users])
    name = old.name
    for key, value in old.items():  # what the user has noted on it
        if key not in data:
            data[key] = value
    old.user_remap(data)
    bpy.data.meshes.remove(old)
    data.name = name
    return ""


def _is_grown(context: bpy.types.Context) -> bool:
    """Return whether the active object is such a tree."""
    obj = context.object
    return obj is not None and obj.type == "MESH" and bool(obj.data.forest_grown.grown)


@panel("L-system Tree", OfData, needs=_is_grown)
def grown(tab: bpy.types.Panel, context: bpy.types.Context) -> None:
    """The settings of a single tree, where Blender's own meshes have theirs."""
    settings = context.object.data.forest_grown
    column = split(tab.layout)
    for name in SETTINGS:
        column.prop(settings, name)
    row = tab.layout.row(align=True)
    row.operator("forest.grow_again", icon="FILE_REFRESH").new_seed = False
    row.operator("forest.grow_again", text="New Seed", icon="ADD").new_seed = True


def _grow(
    context: bpy.types.Context, name: str, seed: int, generations: int, leaves: bool
) -> bpy.types.Mesh:
    """A mesh with a tree of a species, with the settings that it was grown from.

    Raises
    ------
    SpecError, ValueError, OSError : there is no such species, or it cannot be grown.
    """
    from ...blender.scene.meshes import to_mesh
    from ...growth.tree import grow

    folder = Path(bpy.path.abspath(context.scene.forest_sensing.folder))
    species, template = edit.load(name, folder, edit.edited_species(context.scene))
    if generations and species.rules is not None:
        rules = replace(species.rules, generations=generations)
        species = replace(species, rules=rules)
    elif generations and species.honda is None:  # one that branches by levels stays as it is
        species = replace(species, grammar=replace(species.grammar, generations=generations))
    tree = grow(species, template, stream(seed, "tree", name))
    mesh = tree.mesh if leaves else tree.mesh.select(tree.mesh.part != LEAF)
    data = to_mesh(species.name, mesh, materials.coats_of(species))
    data[SHAPE_OF] = name
    noted = data.forest_grown
    noted.grown, noted.seed, noted.generations, noted.leaves = name, seed, generations, leaves
    return data


def draw_in_menu(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """The entry in Add > Mesh."""
    menu.layout.operator("forest.add_tree", icon="OUTLINER_OB_CURVES")


MENUS = (("VIEW3D_MT_mesh_add", draw_in_menu),)
SETTINGS_OF_MESH = bpy.props.PointerProperty(type=FOREST_PG_grown)
PROPERTIES = ((bpy.types.Mesh, "forest_grown", SETTINGS_OF_MESH),)
