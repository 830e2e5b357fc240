"""Properties that Blender keeps in a file: settings of a scene, its sensors and edited species, results.

Each group of settings is made from its class of ``spec`` (``groups``); what follows when a setting changes is
handed in here by those who do it.
"""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from .. import spec
from .forest import build, wind
from .settings import exchange, hills, references
from .settings.groups import fields_of, group_class, make_group, property_of, words_of
from .shell.views import choose_number, number_of_sensor
from .species import edit

# What follows when a setting changes, or an item of a list is chosen.
WHEN_SET = {
    **{name: references.resolver(name) for name in references.REFERENCES},
    "centre": lambda hill, _: hills.place(hill),
    "width": lambda hill, _: hills.place(hill),
    "active_gaussians": hills.choose,
    "scanner": exchange.take_scanner,
}


BESIDES: dict[type, dict[str, Any]] = {
    spec.Gaussian: {"handle": PointerProperty(type=bpy.types.Object)},
    spec.Planting: {"standing": IntProperty(default=-1, options={"HIDDEN"})},
}


def _make_group(settings: type[spec.Settings]) -> None:
    """Make the group of a settings class, after those that it holds."""
    for field in fields_of(settings):
        part = {"group": field.kind, "groups": field.item}.get(field.how)
        if part is not None and part not in GROUPS:
            _make_group(part)
    held = dict(BESIDES.get(settings, {}))
    for field in fields_of(settings):
        if field.name in references.REFERENCES and field.kind is str:
            held |= references.pointers(field.name, words_of(field))
    GROUPS[settings] = make_group(settings, GROUPS, WHEN_SET, held)


GROUPS: dict[type, type] = {}
for _settings in (
    *(spec.Forest, spec.Planting, spec.Stems, spec.Air, spec.Wind, spec.Rays, spec.Accuracy),
    *(spec.Flight, spec.Species, *spec.SENSORS.values()),
):
    _make_group(_settings)


# The settings of a sensor, on its object: a group for each kind, of which that of its own is used.
FOREST_PG_sensor = group_class(
    "sensor", {kind: PointerProperty(type=GROUPS[cls]) for kind, cls in spec.SENSORS.items()}
)
FOREST_PG_edited = group_class(  # a species that is edited in this file
    "edited",
    {
        "name": StringProperty(),  # what plantings call it
        "origin": StringProperty(description="What it was made from, as a planting calls that"),
        "folder": StringProperty(
            description="Folder that its STL files start from", subtype="DIR_PATH"
        ),
        "settings": PointerProperty(type=GROUPS[spec.Species]),
    },
)
FOREST_PG_figure = group_class(  # a line of a result: what, how much
    "figure",
    {
        "name": StringProperty(),
        "value": StringProperty(),  # in English
        "made_of": StringProperty(),  # what says it in another language
    },
)
FOREST_PG_legend = (
    group_class(  # the meaning of a colour of a cloud, where its menu is set to ``choice``
        "legend",
        {
            "name": StringProperty(),
            "choice": StringProperty(),
            "colour": FloatVectorProperty(size=3),
        },
    )
)
FOREST_PG_frame = group_class(  # the result of one frame
    "frame",
    {
        "frame": IntProperty(),
        "said": StringProperty(description="Figures and legend"),
        "points": PointerProperty(type=bpy.types.Mesh),
        "picture": PointerProperty(type=bpy.types.Image),
        "sound": PointerProperty(type=bpy.types.Sound),
        "found": StringProperty(subtype="BYTE_STRING"),
    },
)
FOREST_PG_result = group_class(  # the result of a run
    "result",
    {
        "name": StringProperty(),  # of the sensor
        "kind": StringProperty(),
        "title": StringProperty(name="Title", description="What this result is called here"),
        "stale": BoolProperty(description="Found before the forest was grown anew"),
        "opened": BoolProperty(
            name="Open", description="Show figures and picture; the newest result is", default=True
        ),
        "figures": CollectionProperty(type=FOREST_PG_figure),
        "summary": PointerProperty(type=FOREST_PG_figure),
        "shown": StringProperty(description="Object with what was found"),
        "file": StringProperty(subtype="FILE_PATH", description="File with what was found"),
        "picture": PointerProperty(type=bpy.types.Image),
        "caption": StringProperty(),
        "found": StringProperty(
            subtype="BYTE_STRING",
            description="What was found, where the points of an object are not all of it",
        ),
        "legend": CollectionProperty(type=FOREST_PG_legend),
        "frames": CollectionProperty(type=FOREST_PG_frame),
    },
)


PLAIN = {field.name: field for field in fields_of(spec.Scene)}
FOREST_PG_scene = group_class(  # everything that a Blender scene holds of ours
    "scene",
    {
        **{name: property_of(PLAIN[name]) for name in ("name", "seed", "offset", "crs")},
        "forest": PointerProperty(type=GROUPS[spec.Forest]),
        "plantings": CollectionProperty(type=GROUPS[spec.Planting]),
        "active_plantings": IntProperty(
            name="Planting",
            description="The planting that the panels below are about",
            options={"HIDDEN"},
        ),
        "stems": CollectionProperty(type=GROUPS[spec.Stems]),
        "active_stems": IntProperty(
            name="Stems",
            description="The stems that the settings below are about",
            options={"HIDDEN"},
        ),
        "air": PointerProperty(type=GROUPS[spec.Air]),
        "wind": PointerProperty(type=GROUPS[spec.Wind]),
        "rays": PointerProperty(type=GROUPS[spec.Rays]),
        "accuracy": PointerProperty(type=GROUPS[spec.Accuracy]),
        "flight": PointerProperty(type=GROUPS[spec.Flight]),
        "active_sensor": IntProperty(
            name="Sensor",
            description="The sensor that the buttons below are about",
            options={"HIDDEN", "SKIP_SAVE"},
            get=number_of_sensor,
            set=choose_number,
        ),
        "last_sensor": PointerProperty(type=bpy.types.Object),
        "display": EnumProperty(
            name="Display",
            description="What views show of trees that are points; renders and sensors see full trees",
            items=wind.ITEMS,
            options={"SKIP_SAVE"},
            get=wind.get_display,
            set=wind.set_display,
        ),
        "look_shows": EnumProperty(
            name="Image Shows",
            description="What the image shows while you look through a scanner",
            items=[
                ("DISTANCE", "Distance", "How far away it is; near is bright"),
                (
                    "BRIGHTNESS",
                    "Brightness",
                    "Light that comes back, as if all were equally far away",
                ),
                ("ORGAN", "Organ", "Leaf, wood, ground or something else"),
            ],
        ),
        "show_sensors": BoolProperty(
            name="Sensors",
            description="Draw where sensors look: beams to -3 dB, fans, paths of sound",
            default=True,
        ),
        "show_intensity": BoolProperty(
            name="Tree Density", description="Draw where trees are likely to stand"
        ),
        "show_points": BoolProperty(
            name="Points",
            description="Draw points of results large enough to be seen, in their colours",
            default=True,
        ),
        "advanced": BoolProperty(
            name="Advanced",
            description="Show every setting, the papers' symbols too; what is hidden keeps its value",
        ),
        "point_size": FloatProperty(
            name="Point Size",
            description="Of points that are drawn over the view; renders have their Radius",
            subtype="PIXEL",
            default=2.5,
            min=1.0,
            max=30.0,
            soft_max=10.0,
            step=50,
            precision=1,
        ),
        "drag_hills": BoolProperty(
            name="Drag in View",
            description="A circle in the view for every hill: move and scale it, copy it, delete it",
            update=lambda props, _: hills.renew(props.id_data),
        ),
        "plant_radius": FloatProperty(
            name="Brush Radius",
            description="Of the disc that Plant by Hand plants or clears",
            subtype="DISTANCE",
            default=3.0,
            min=0.05,
            max=1000.0,
            soft_max=30.0,
        ),
        "plant_density": FloatProperty(
            name="Density (/m²)",
            description="Trees on a square metre that a dragged brush fills up to",
            default=0.1,
            min=1e-4,
            max=100.0,
            soft_max=2.0,
            precision=3,
        ),
        "plant_grows": BoolProperty(
            name="Grow at Once",
            description="Grow the forest after each stroke, and plant trees that are dropped from the "
            "Asset Browser; else Grow Forest and Plant Copies do that",
            default=True,
        ),
        "live": BoolProperty(
            name="Live",
            description="Grow the forest anew whenever a setting, a hill, a painting or the terrain "
            "has changed",
            update=lambda props, _: build.begin_live(props.id_data),
        ),
        "built": StringProperty(
            description="Fingerprint of what the forest was built from", options={"HIDDEN"}
        ),
        "folder": StringProperty(
            name="Species Folder",
            description="Folder that names of species files start from",
            subtype="DIR_PATH",
        ),
        "output": StringProperty(
            name="Save To",
            description="Folder that results are written to; empty: they stay in this file alone",
            subtype="DIR_PATH",
            options={"ANIMATABLE", "PATH_SUPPORTS_BLEND_RELATIVE"},
        ),
        "edited": CollectionProperty(type=FOREST_PG_edited),
        "species_picture": EnumProperty(
            name="Species",
            description="What the chosen planting plants",
            items=lambda props, _: edit.choices(props),
            get=edit.number_of,
            set=edit.choose,
            options={"SKIP_SAVE"},
        ),
        "results": CollectionProperty(type=FOREST_PG_result),
        "dry": EnumProperty(
            name="Sound",
            description="What is heard in the forest when a reverb is played",
            items=[
                ("CLAP", "Clap", "Two hands, hollow palms"),
                ("CALL", "Bat Call", "A falling sweep, slowed down twenty times"),
                ("FILE", "File", "A WAV file of your own, recorded without echoes"),
                ("NONE", "Click", "The impulse response itself"),
            ],
        ),
        "dry_file": StringProperty(
            name="WAV File",
            description="Sound that was recorded without echoes",
            subtype="FILE_PATH",
            options={"ANIMATABLE", "PATH_SUPPORTS_BLEND_RELATIVE"},
        ),
        "layout": IntProperty(options={"HIDDEN"}),  # of these settings in the file (saved)
        "notice": StringProperty(options={"HIDDEN"}),
    },
)
PROPERTIES = (
    (bpy.types.Scene, "forest_sensing", PointerProperty(type=FOREST_PG_scene)),
    (bpy.types.Object, "forest_sensor", PointerProperty(type=FOREST_PG_sensor)),
)
CLASSES = (
    references.FOREST_PG_heard,
    *GROUPS.values(),
    FOREST_PG_sensor,
    FOREST_PG_edited,
    FOREST_PG_figure,
    FOREST_PG_legend,
    FOREST_PG_frame,
    FOREST_PG_result,
    FOREST_PG_scene,
)
