"""Between the panel and ``spec``: properties to settings, settings to properties.

Whatever is found wrong with a property is a ``SpecError`` of ``spec`` itself, with the key that a scene
file would have. Where a sensor stands is what its object says (``blender/sensors``), the rest is a group of
properties on that object.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import bpy

from ... import spec
from ...blender.scene.layout import shortest
from ...blender.sensors import objects as sensors
from ...blender.sensors.objects import file_name
from ...formats.toml_file import settings_of, structure
from ...spec import Settings, SpecError
from ..shell.views import redraw_panels
from ..shell.words import say
from . import hills, references
from .groups import LARGEST_INT, WHEN_USED, fields_of, text_of

T = TypeVar("T", bound=Settings)
# What is set where one senses, whether a forest is to stand there or not.
OF_SENSORS = frozenset(
    {
        "air",
        "wind",
        "rays",
        "accuracy",
        "active_sensor",
        "last_sensor",
        "output",
        "results",
        "layout",
    }
    | {"show_sensors", "show_points", "point_size", "advanced", "folder"}
    | {"dry", "dry_file"}
)


def to_spec(scene: Any, things: Iterable[Any] | None = None) -> spec.Scene:
    """The settings that a Blender scene holds, with these of its sensors; by default with all.

    Raises
    ------
    SpecError : a value that cannot be used; ``key`` names it as a scene file would.
    """
    props = scene.forest_sensing
    things = sensors.sensors_of(scene) if things is None else things
    return spec.Scene(
        name=props.name,
        seed=props.seed,
        offset=parsed("offset", props.offset) or (0.0, 0.0, 0.0),
        crs=props.crs,
        forest=read(props.forest, spec.Forest, "forest"),
        plantings=tuple(
            read(group, spec.Planting, f"plantings[{number}]")
            for number, group in enumerate(props.plantings)
        ),
        stems=tuple(
            read(group, spec.Stems, f"stems[{number}]") for number, group in enumerate(props.stems)
        ),
        air=read(props.air, spec.Air, "air"),
        wind=read(props.wind, spec.Wind, "wind"),
        rays=read(props.rays, spec.Rays, "rays"),
        flight=read(props.flight, spec.Flight, "flight"),
        accuracy=read(props.accuracy, spec.Accuracy, "accuracy"),
        sensors=tuple(sensor_of(obj) for obj in things),
    )


def sensor_of(obj: Any) -> Settings:
    """The settings of a sensor: those on its object, and where and how that stands.

    Raises
    ------
    SpecError : a value that cannot be used; a reverb without a receiver.
    """
    kind = sensors.kind_of(obj)
    cls = spec.SENSORS[kind]
    group = getattr(obj.forest_sensor, kind)
    given = {"name": file_name(obj.name)} | sensors.pose(obj)
    if "azimuth_deg" not in given and hasattr(group, "azimuth_deg"):  # a window, not a direction
        given["azimuth_deg"] = _turned(_plain(group.azimuth_deg), sensors.heading(obj))
    return read(group, cls, file_name(obj.name), given)


def _turned(window: tuple[float, float], heading: float) -> tuple[float, float]:
    """A window of azimuth that turns with its tripod, within the limits that ``spec`` has; degrees."""
    if not heading:
        return window
    first, last = (round(edge + heading, 6) for edge in window)
    whole = -360.0 * (last > 720.0) + 360.0 * (first < -360.0)
    return first + whole, last + whole


def from_spec(scene: Any, settings: spec.Scene, keep_sensors: bool = False) -> None:
    """Put settings into a Blender scene, in place of those and of the sensors that it has.

    keep_sensors : those stay; of the new ones those are added that are not there yet.

    Raises
    ------
    SpecError : a number that Blender cannot hold; nothing is changed.
    """
    if settings.seed > LARGEST_INT:
        raise SpecError(
            "seed",
            say(
                "{seed} is too large for the panel; use up to {most}",
                seed=settings.seed,
                most=LARGEST_INT,
            ),
        )
    props = scene.forest_sensing
    props.name, props.seed = settings.name, settings.seed
    props.offset, props.crs = text_of(settings.offset), settings.crs
    for name in ("forest", "air", "wind", "rays", "flight", "accuracy"):
        write(getattr(props, name), getattr(settings, name))
    fill(props, "plantings", settings.plantings)
    fill(props, "stems", settings.stems)
    known = [
        replace(sensor_of(one), name=sensors.kind_of(one)) for one in usable(scene) if keep_sensors
    ]
    for obj in () if keep_sensors else sensors.sensors_of(scene):
        sensors.remove_sensor(obj)
    for sensor in settings.sensors:
        if replace(sensor, name=sensor.kind) not in known:
            add_sensor(scene, sensor)
    hills.renew(scene)
    scene.update_tag()  # Blender reports no change of a list by itself
    for layer in scene.view_layers:  # until then objects do not say where they are
        layer.update()


def usable(scene: Any) -> list[Any]:
    """The sensors of a scene whose settings can be used: those that cannot must not stop all else."""
    found = []
    for obj in sensors.sensors_of(scene):
        with suppress(SpecError):
            sensor_of(obj)
            found.append(obj)
    return found


def add_sensor(scene: Any, settings: Settings) -> Any:
    """A new object with the settings of a sensor."""
    obj = sensors.new_sensor(scene, settings)
    write(getattr(obj.forest_sensor, settings.kind), settings)
    return obj


def forestless(props: Any) -> bool:
    """Return whether no forest was asked for yet: all that is set is about sensors."""
    return untouched(props, OF_SENSORS)


def untouched(props: Any, but: frozenset[str] = frozenset()) -> bool:
    """Return whether nobody has set anything yet, except what ``but`` names: no scene file, no panel, no
    script."""
    for known in props.bl_rna.properties:
        name = known.identifier
        if name in but or name == "rna_type":
            continue
        if known.type == "POINTER" and known.fixed_type.identifier.startswith("FOREST_PG_"):
            is_set = not untouched(getattr(props, name))
        elif known.type == "COLLECTION":
            is_set = len(getattr(props, name)) > 0
        elif known.type == "POINTER":  # to a thing; none is what it starts with
            is_set = getattr(props, name) is not None
        else:
            is_set = not known.is_skip_save and props.is_property_set(name)
        if is_set:
            return False
    return True


def read(group: Any, settings: type[T], place: str = "", given: dict[str, Any] | None = None) -> T:
    """The settings that a property group holds; ``place`` is what an error calls the group.

    given : values that are known from elsewhere.

    Raises
    ------
    SpecError : a value that cannot be used.
    """
    values: dict[str, Any] = {}
    for field in fields_of(settings):
        name, key = field.name, f"{place}.{field.name}".lstrip(".")
        if given and name in given:
            values[name] = given[name]
        elif field.how == "kind":
            continue
        elif field.optional and not getattr(group, f"use_{name}"):
            values[name] = None
        elif field.how == "groups":
            values[name] = tuple(
                read(item, field.item, f"{key}[{number}]")
                for number, item in enumerate(getattr(group, name))
            )
        elif field.how == "group":
            values[name] = read(getattr(group, name), field.kind, key)
        elif field.how == "list":
            values[name] = _list_of(key, getattr(group, name), field.item)
        elif field.how == "text":
            values[name] = parsed(key, getattr(group, name))
        elif name in references.REFERENCES and field.kind is str:
            values[name] = references.name_of(group, name, key)
        else:
            values[name] = _plain(getattr(group, name))
    try:
        return settings(**values)
    except SpecError as problem:
        raise SpecError(f"{place}.{problem.key}".strip("."), problem.problem) from None


def write(group: Any, settings: Settings, only: Mapping[str, Any] | None = None) -> None:
    """Put settings into their property group; ``only`` those that such a table names."""
    for field in fields_of(type(settings)):
        name, value = field.name, getattr(settings, field.name)
        if only is not None and name not in only:
            continue
        if field.optional:
            setattr(group, f"use_{name}", value is not None)
        if field.how == "group":
            value = WHEN_USED[name] if value is None else value
            write(getattr(group, name), value, None if only is None else only[name])
        elif field.how == "groups":
            fill(group, name, value)
        elif field.how in ("list", "text"):
            text = text_of(value)
            setattr(group, name, text.strip("[]") if field.item in (int, float) else text)
        elif value is not None and field.how != "kind":
            setattr(group, name, value)


def take_scanner(props: Any, context: Any) -> None:
    """Put the figures of the scanner that was chosen into the settings; they can be changed after."""
    kind = type(props).__name__.removeprefix("FOREST_PG_")
    folder = Path(bpy.path.abspath(context.scene.forest_sensing.folder))
    try:
        figures = settings_of(props.scanner, kind, folder)
        chosen = structure(figures, spec.SENSORS[kind])
    except (spec.SpecError, ImportError):
        return  # not a whole name yet, or none: what is set stays
    write(props, chosen, figures)


def fill(group: Any, name: str, items: Iterable[Settings]) -> None:
    """Put settings into a list of property groups, in place of those in it."""
    collection = getattr(group, name)
    collection.clear()
    for item in items:
        write(collection.add(), item)
    setattr(group, f"active_{name}", 0)
    redraw_panels()


def parsed(place: str, text: str) -> Any:
    """Tuples of numbers from a text such as [[0, 0], [10, 0], [10, 5.5]]."""
    try:
        return _tuples(json.loads(text or "[]"))
    except ValueError:
        problem = say('"{text}" is not a list of numbers; write [[0, 0], [1, 0], …]', text=text)
        raise SpecError(place, problem) from None


def _list_of(place: str, text: str, item: type | None) -> tuple[Any, ...]:
    """Texts parted by semicolons, or numbers by commas; brackets around these are let pass."""
    if item is str:
        return tuple(part.strip() for part in text.split(";") if part.strip())
    try:
        numbers = parsed(place, f"[{text.strip().strip('[]')}]")
    except SpecError:
        problem = say('"{text}" is not a list of numbers; write 2, 3', text=text)
        raise SpecError(place, problem) from None
    if item is int:
        if not all(number.is_integer() for number in numbers):
            raise SpecError(place, say('"{text}" must be whole numbers; write 2, 3', text=text))
        return tuple(int(number) for number in numbers)
    return numbers


def _tuples(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_tuples(item) for item in value)
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError
    return float(value)


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return shortest(value)
    if isinstance(value, (bool, int, str)):
        return value
    return tuple(_plain(item) for item in value)
