"""Lists of what a forest is made of: plantings with their hills and images, distances, stems."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy

from ..settings.lists import Listed, Row, buttons, rows
from ..shell.chosen import chosen_planting
from ..shell.names import EDITED, title_of
from ..shell.words import keep, label

Context = bpy.types.Context


def _props(context: Context) -> Any:
    return context.scene.forest_sensing


def _planting(context: Context) -> Any:
    return chosen_planting(_props(context))


def _middle(field: Any) -> list[float]:
    return [o + s / 2 for o, s in zip(field.origin, field.size, strict=True)]


NO_PLANTING = keep("There is no planting yet. Add one to the list")
PLANTINGS = Listed("plantings", _props)
HILLS = Listed("gaussians", _planting, NO_PLANTING)
IMAGES = Listed("rasters", _planting, NO_PLANTING)
DISTANCES = Listed("distances", lambda context: _props(context).forest)
STEMS = Listed("stems", _props)


def _planting_row(item: Any) -> Row:
    edited = item.species.startswith(EDITED)
    known = item.standing >= 0
    count = item.standing if known else item.expected
    number = label("1 tree") if count == 1 else label("{expected:g} trees", expected=count)
    return Row(
        title_of(item.species) or label("(no species)"),
        "GREASEPENCIL" if edited else "OUTLINER_OB_CURVES",
        number if known or item.use_expected else "",
    )


def _hill_row(item: Any) -> Row:
    x, y = item.centre
    return Row(f"{x:g}, {y:g} m", "MESH_CIRCLE", label("peak {height:.3g}", height=item.peak))


def _stems_row(item: Any) -> Row:
    return Row(label("{count:,} stems", count=item.count), "MESH_CYLINDER")


def _image_row(item: Any) -> Row:
    return Row(Path(item.file).name or label("(no file)"), "IMAGE_DATA", item.use)


def _distance_row(item: Any) -> Row:
    pair = f"{item.species or '?'}, {item.other or '?'}"
    return Row(pair, "DRIVER_DISTANCE", f"{item.distance:g} m")


def _start_planting(planting: Any, _context: Context) -> None:
    planting.species = "maple"
    planting.use_expected = True


def _start_hill(hill: Any, context: Context) -> None:
    field = _props(context).forest
    hill.centre = _middle(field)
    hill.width = [s / 4 for s in field.size]


def _start_image(raster: Any, context: Context) -> None:
    field = _props(context).forest
    raster.size, raster.origin = field.size, field.origin  # when switched on


def _start_distance(pair: Any, context: Context) -> None:
    planting = _planting(context)
    if planting is not None:
        pair.species = pair.other = planting.species
    pair.distance = _props(context).forest.spacing


def _start_stems(stems: Any, _context: Context) -> None:
    stems.count = 1000


OF_PLANTING = "Plant one more species"
OF_HILL = "Add a hill of the intensity function, in the middle of the field"
OF_IMAGE = "Add an image to the intensity function"
OF_DISTANCE = (
    "Add a distance between trees of two species, at first of the chosen planting with itself"
)
OF_STEMS = "Add trees that are upright cylinders only: reverb hears them, nothing is grown"

CLASSES = (
    rows("plantings", "Species of the forest", _planting_row),
    rows("gaussians", "Hills of a species' intensity", _hill_row),
    rows("rasters", "Images of a species' intensity", _image_row),
    rows("distances", "Distances between pairs of species", _distance_row),
    rows("stems", "Stems that only reverb hears", _stems_row),
    *buttons("planting", "Planting", PLANTINGS, OF_PLANTING, _start_planting),
    *buttons("gaussian", "Hill", HILLS, OF_HILL, _start_hill),
    *buttons("raster", "Image", IMAGES, OF_IMAGE, _start_image),
    *buttons("distance", "Distance", DISTANCES, OF_DISTANCE, _start_distance),
    *buttons("stems", "Stems", STEMS, OF_STEMS, _start_stems),
)
