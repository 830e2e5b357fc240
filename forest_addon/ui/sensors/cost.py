"""Cost of a run in words: before it begins, and when it is so large that one is asked."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import bpy

from ...blender.sensors import objects as sensors
from ..settings.exchange import to_spec
from ..shell.progress import duration
from ..shell.words import label

if TYPE_CHECKING:
    from ...sensing.kind import Cost

LONG = 60.0  # s; what takes longer is asked about
LARGE = 2e9  # bytes; the same
KEPT = 1 / 3  # of a run's memory: 100 bytes a point, which is what Blender keeps of it
PICTURE = 1e6  # bytes of a picture that is kept, as measured


def costs(context: bpy.types.Context, things: Iterable[bpy.types.Object]) -> list[Cost]:
    """The cost of running each of these sensors once.

    Raises
    ------
    SpecError, ValueError : settings that cannot be used.
    """
    from ...blender.sensors.observe import Observer
    from ...sensing.kinds import cost_of

    home = Path(bpy.path.abspath(context.scene.forest_sensing.folder))
    found = []
    trees = sum(planting.standing for planting in context.scene.forest_sensing.plantings)
    for thing in things:
        settings = to_spec(context.scene, [thing])
        (sensor,) = settings.sensors
        engine = "bvhtree" if settings.rays.engine == "bvhtree" else "embree"
        found.append(cost_of(sensor, Observer.way(sensor, home), engine, settings, trees))
    return found


def chosen_things(scene: bpy.types.Scene, name: str, again: bool = False) -> list[bpy.types.Object]:
    """The sensor of this name, all where it is empty. again : only those whose result is of the forest that
    stood before."""
    results = scene.forest_sensing.results
    stale = {result.name for result in results if result.stale}
    found = [thing for thing in sensors.sensors_of(scene) if name in ("", thing.name)]
    return [thing for thing in found if thing.name in stale] if again else found


def is_large(found: list[Cost], frames: int = 1, keep: bool = False) -> bool:
    """Return whether one should be asked before this runs. keep : what all frames find stays in the file."""
    seconds = frames * sum(cost.seconds for cost in found)
    return seconds > LONG or memory_of(found, frames if keep else 1) > LARGE


def memory_of(found: list[Cost], kept: int = 1) -> float:
    """Bytes of a run whose points and pictures stay for so many frames."""
    return sum(cost.memory + (kept - 1) * (KEPT * cost.memory + PICTURE) for cost in found)


def in_words(found: list[Cost], frames: int = 1, keep: bool = False) -> str:
    """22.5 M pulses, about 5 min, 1.8 GB."""

    def count(what: str) -> str:
        return short(frames * sum(cost.count for cost in found if cost.what == what))

    there = {cost.what for cost in found}
    parts = []
    if "pulses" in there:
        parts.append(label("{count} pulses", count=count("pulses")))
    if "pings" in there:
        one = count("pings") == "1"
        parts.append(label("1 ping") if one else label("{count} pings", count=count("pings")))
    if "channels" in there:
        one = count("channels") == "1"
        many = label("{count} channels", count=count("channels"))
        parts.append(label("1 channel") if one else many)
    if "runs" in there:
        one = count("runs") == "1"
        parts.append(label("1 run") if one else label("{count} runs", count=count("runs")))
    parts.append(label("about {time}", time=duration(frames * sum(c.seconds for c in found))))
    memory = memory_of(found, frames if keep else 1)
    if memory >= 5e7:
        parts.append(label("{size:.1f} GB", size=memory / 1e9))
    return ", ".join(parts)


def short(count: int) -> str:
    """A number with three digits that count: 22.5 M."""
    for unit, word in ((1e9, " G"), (1e6, " M"), (1e4, "k")):
        if count >= unit:
            return f"{count / (1e3 if word == 'k' else unit):.3g}{word}"
    return f"{count:,}"
