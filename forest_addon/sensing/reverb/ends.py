"""The ends of the paths: which sources there are, and which microphones.

The settings of a reverb go in, with the places of Blender objects by name; named places come out. A
receiver is a microphone, or a row of them around its place: an array, or a pair of ears (without a head,
so that they differ by delay and by distance alone). A channel is a source and a microphone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...spec import Reverb, SpecError

Places = Mapping[str, tuple[float, float, float]]


@dataclass(frozen=True)
class Ends:
    """sources : (S, 3) and receivers : (R, 3) metres, with a name for each."""

    sources: np.ndarray
    receivers: np.ndarray
    source_names: tuple[str, ...]
    receiver_names: tuple[str, ...]

    @property
    def channels(self) -> tuple[str, ...]:
        """S·R names, source by source."""
        return tuple(f"{s} to {r}" for s in self.source_names for r in self.receiver_names)

    @property
    def pairs(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """S·R pairs of source and receiver, in the order of the channels."""
        return [(source, receiver) for source in self.sources for receiver in self.receivers]

    @property
    def on_ground(self) -> np.ndarray:
        """(S + R, 2) where they stand."""
        return np.concatenate([self.sources, self.receivers])[:, :2]


def ends_of(reverb: Reverb, objects: Places | None = None) -> Ends:
    """All ends that a reverb names.

    objects : places of the Blender objects that can be named.

    Raises
    ------
    SpecError : an object is not there; an end is not above the ground.
    """
    sources = _places("source", reverb.source, reverb.sources, reverb.source_objects, objects or {})
    centres = _places(
        "receiver", reverb.receiver, reverb.receivers, reverb.receiver_objects, objects or {}
    )
    row = _row(reverb)
    receivers = {
        name if len(row) == 1 else f"{name}.{number + 1}": np.add(place, shift)
        for name, place in centres.items()
        for number, shift in enumerate(row)
    }
    low = next((name for name, place in receivers.items() if place[2] <= 0), None)
    if low:
        raise SpecError(
            "array_elevation_deg", f"{low} would be below the ground; raise it, or shorten the row"
        )
    return Ends(
        np.array(list(sources.values()), np.float64),
        np.array(list(receivers.values()), np.float64),
        tuple(sources),
        tuple(receivers),
    )


def _places(
    kind: str, first: tuple[float, ...], further: tuple, named: str, objects: Places
) -> dict[str, tuple[float, ...]]:
    """Return where each source, or each receiver, is, by its name."""
    found = {kind: first}
    found |= {f"{kind} {number}": place.position for number, place in enumerate(further, 2)}
    for name in filter(None, (part.strip() for part in named.split(","))):
        if name not in objects:
            known = ", ".join(sorted(objects)) or "none"
            raise SpecError(
                f"{kind}_objects",
                f'there is no Speaker, Empty or Camera "{name}" in the scene; it has {known}',
            )
        if objects[name][2] <= 0:
            raise SpecError(
                f"{kind}_objects", f'"{name}" must be above the ground, z = 0; raise it'
            )
        found[name] = objects[name]
    return found


def _row(reverb: Reverb) -> np.ndarray:
    """(K, 3) where the microphones of a row are, from its middle."""
    azimuth = math.radians(reverb.array_azimuth_deg)
    elevation = math.radians(reverb.array_elevation_deg)
    steps = (np.arange(reverb.array) - (reverb.array - 1) / 2) * reverb.array_spacing
    level = math.cos(elevation)
    way = (level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation))
    return np.outer(steps, way)
