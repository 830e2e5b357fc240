"""Between the panel and ``spec``: properties to settings, settings to properties.

Whatever is found wrong with a property is a ``SpecError`` of ``spec`` itself, with the key that a scene
file would have. Blender keeps numbers in single precision; ``read`` gives back the shortest decimal that
is this number, so 0.002 that was typed, or read from a scene file, is 0.002 again.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from .. import spec
from ..spec import Settings, SpecError
from .properties import LARGEST_INT, fields_of, is_sensor_kind, items_of, part_of, without_none

T = TypeVar("T", bound=Settings)


def to_spec(props: Any, kinds: Iterable[str] = tuple(spec.SENSORS)) -> spec.Scene:
    """The scene that the panel says, with these kinds of sensors.

    Raises
    ------
    SpecError : a value that cannot be used; ``key`` names it as a scene file would.
    """
    return spec.Scene(
        name=props.name,
        seed=props.seed,
        forest=read(props.forest, spec.Forest, "forest"),
        plantings=tuple(
            read(group, spec.Planting, f"plantings[{number}]")
            for number, group in enumerate(props.plantings)
        ),
        air=read(props.air, spec.Air, "air"),
        rays=read(props.rays, spec.Rays, "rays"),
        sensors=tuple(read(getattr(props, kind), spec.SENSORS[kind], kind) for kind in kinds),
    )


def from_spec(props: Any, scene: spec.Scene) -> list[str]:
    """Put a scene into the properties; returns the names of sensors that find no place.

    The panel has one sensor of each kind: the first. Kinds that the scene lacks get their defaults.

    Raises
    ------
    SpecError : a number that Blender cannot hold; nothing is changed.
    """
    if scene.seed > LARGEST_INT:
        raise SpecError("seed", f"{scene.seed} is too large for the panel; use up to {LARGEST_INT}")
    props.name, props.seed = scene.name, scene.seed
    write(props.forest, scene.forest)
    write(props.air, scene.air)
    write(props.rays, scene.rays)
    _fill(props, "plantings", scene.plantings)
    first: dict[str, Settings] = {}
    for sensor in scene.sensors:
        first.setdefault(sensor.kind, sensor)
    taken = {sensor.name for sensor in first.values()}
    for kind, settings in spec.SENSORS.items():
        write(getattr(props, kind), first.get(kind) or _new_sensor(settings, taken))
    return [sensor.name for sensor in scene.sensors if sensor is not first[sensor.kind]]


def untouched(props: Any) -> bool:
    """Whether nobody has set anything yet: no scene file, no panel, no script."""
    for known in props.bl_rna.properties:
        name = known.identifier
        if known.type == "POINTER" and known.fixed_type.identifier.startswith("FOREST_PG_"):
            if not untouched(getattr(props, name)):
                return False
        elif known.type == "COLLECTION":
            if len(getattr(props, name)):
                return False
        elif name != "rna_type" and props.is_property_set(name):
            return False
    return True


def read(group: Any, settings: type[T], place: str = "") -> T:
    """The settings that a property group holds; ``place`` is what an error calls the group.

    Raises
    ------
    SpecError : a value that cannot be used.
    """
    values: dict[str, Any] = {}
    for name, kind, known, _ in fields_of(settings):
        items, part = items_of(kind), part_of(kind)
        if part:
            values[name] = read(getattr(group, name), part, f"{place}.{name}".lstrip("."))
        elif items:
            values[name] = tuple(
                read(item, items, f"{place}.{name}[{number}]".lstrip("."))
                for number, item in enumerate(getattr(group, name))
            )
        elif is_sensor_kind(name, known):
            continue
        elif without_none(kind) and not getattr(group, f"use_{name}"):
            values[name] = None
        else:
            values[name] = _plain(getattr(group, name))
    try:
        return settings(**values)
    except SpecError as problem:
        raise SpecError(f"{place}.{problem.key}".strip("."), problem.problem) from None


def write(group: Any, settings: Settings, only: Mapping[str, Any] | None = None) -> None:
    """Put settings into their property group; ``only`` those that such a table names."""
    for name, kind, known, _ in fields_of(type(settings)):
        if only is not None and name not in only:
            continue
        value = getattr(settings, name)
        if part_of(kind):
            write(getattr(group, name), value, None if only is None else only[name])
        elif items_of(kind):
            _fill(group, name, value)
        elif is_sensor_kind(name, known):
            continue
        else:
            if without_none(kind):
                setattr(group, f"use_{name}", value is not None)
            if value is not None:
                setattr(group, name, value)


def _new_sensor(settings: type[Settings], taken: set[str]) -> Settings:
    """A sensor with its defaults, under a name that no other has."""
    new = settings()
    return settings(name=f"{new.name}-{new.kind}") if new.name in taken else new


def _fill(group: Any, name: str, items: Iterable[Settings]) -> None:
    collection = getattr(group, name)
    collection.clear()
    for item in items:
        write(collection.add(), item)
    setattr(group, f"active_{name}", 0)


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return _shortest(value)
    if isinstance(value, (bool, int, str)):
        return value
    return tuple(_plain(item) for item in value)


def _shortest(value: float) -> float:
    """The shortest decimal with the same single-precision number as ``value``."""
    stored = struct.pack("f", value)
    return next(
        (
            decimal
            for digits in range(1, 10)
            if struct.pack("f", decimal := float(f"{value:.{digits}g}")) == stored
        ),
        value,
    )
