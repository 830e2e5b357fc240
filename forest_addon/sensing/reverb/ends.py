"""The ends of the paths: which sources there are, and which microphones, and where they go.

The settings of a reverb go in, with the places of Blender objects by name; named places come out. A
receiver is a microphone, or a row of them around its place, or an array of a file: all differ by delay and
by distance alone (``hearing`` gives one directions, or a head). A channel is a source and a microphone, at a
moment where one of them moves.

Places as CSV, with a header: microphones of an array, and where a source or a receiver goes.

    x, y, z             time, x, y, z
    0.05, 0, 0          0, 0, 10, 1.5
    -0.05, 0, 0         8, 20, 10, 1.5

Metres and seconds; other columns are not read. Between the times of a path it is straight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...formats.foreign import guarded
from ...formats.table import read_columns
from ...spec import Reverb, SpecError

Places = Mapping[str, tuple[float, float, float]]


@dataclass(frozen=True)
class Ends:
    """sources : (S, 3) and receivers : (R, 3) metres, with a name for each.

    times : (T,) s, moments of what moves. source_shift, receiver_shift : (T, 3) m from the places above, of
    the first source and of the first ``moving`` receivers. Nothing moves: one moment, without a shift.
    """

    sources: np.ndarray
    receivers: np.ndarray
    source_names: tuple[str, ...]
    receiver_names: tuple[str, ...]
    times: tuple[float, ...] = ()
    source_shift: np.ndarray | None = None
    receiver_shift: np.ndarray | None = None
    moving: int = 0

    @property
    def channels(self) -> tuple[str, ...]:
        """T·S·R names, moment by moment, in it source by source."""
        names = [f"{s} to {r}" for s in self.source_names for r in self.receiver_names]
        if not self.times:
            return tuple(names)
        return tuple(f"{name} at {time:g} s" for time in self.times for name in names)

    @property
    def pairs(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """T·S·R pairs of source and receiver, in the order of the channels."""
        return [
            (source, receiver)
            for moment in range(max(1, len(self.times)))
            for source in self._moved(self.sources, self.source_shift, 1, moment)
            for receiver in self._moved(self.receivers, self.receiver_shift, self.moving, moment)
        ]

    @property
    def on_ground(self) -> np.ndarray:
        """(T·(S + R), 2) where they stand."""
        if not self.times:
            return np.concatenate([self.sources, self.receivers])[:, :2]
        return np.unique(np.array(self.pairs).reshape(-1, 3)[:, :2], axis=0)

    @staticmethod
    def _moved(places: np.ndarray, shift: np.ndarray | None, count: int, moment: int) -> np.ndarray:
        if shift is None:
            return places
        moved = places.copy()
        moved[:count] += shift[moment]
        return moved


def ends_of(reverb: Reverb, objects: Places | None = None, folder: Path = Path()) -> Ends:
    """All ends that a reverb names.

    objects : places of the Blender objects that can be named. folder : that its files are relative to.

    Raises
    ------
    SpecError : an object or a file is not there; an end is not above the ground.
    """
    sources = _places("source", reverb.source, reverb.sources, reverb.source_objects, objects or {})
    centres = _places(
        "receiver", reverb.receiver, reverb.receivers, reverb.receiver_objects, objects or {}
    )
    row = read_microphones(folder / reverb.array_file) if reverb.array_file else _row(reverb)
    receivers = {
        name if len(row) == 1 else f"{name}.{number + 1}": np.add(place, shift)
        for name, place in centres.items()
        for number, shift in enumerate(row)
    }
    ends = Ends(
        np.array(list(sources.values()), np.float64),
        np.array(list(receivers.values()), np.float64),
        tuple(sources),
        tuple(receivers),
    )
    if reverb.source_path or reverb.receiver_path:
        ends = _moving(ends, reverb, folder, len(row))
    number = next((n for n, (_, end) in enumerate(ends.pairs) if end[2] <= 0), None)
    if number is not None:
        key = "array_file" if reverb.array_file else "array_elevation_deg"
        name = ends.channels[number].split(" to ", 1)[1]
        raise SpecError(key, f"{name} would be below the ground; raise it, or shorten the row")
    return ends


def _moving(ends: Ends, reverb: Reverb, folder: Path, microphones: int) -> Ends:
    """Ends at the moments of their paths, every ``path_step``; before and after its path, an end waits."""
    named = {"source_path": reverb.source_path, "receiver_path": reverb.receiver_path}
    paths = {key: read_path(folder / name, key) for key, name in named.items() if name}
    first = min(time[0] for time, _ in paths.values())
    last = max(time[-1] for time, _ in paths.values())
    steps = max(1, math.ceil((last - first) / reverb.path_step - 1e-9))
    if steps >= MOST_MOMENTS:
        raise SpecError(
            "path_step",
            f"gives {steps + 1:,} impulse responses; lengthen it, at most 2,000 are made",
        )
    times = np.linspace(first, last, steps + 1)

    def shift(key: str, centre: np.ndarray) -> np.ndarray | None:
        if key not in paths:
            return None
        time, place = paths[key]
        return np.column_stack([np.interp(times, time, axis) for axis in place.T]) - centre

    return Ends(
        ends.sources,
        ends.receivers,
        ends.source_names,
        ends.receiver_names,
        tuple(times.tolist()),
        shift("source_path", np.asarray(reverb.source)),
        shift("receiver_path", np.asarray(reverb.receiver)),
        microphones,
    )


def _places(
    kind: str, first: tuple[float, ...], further: tuple, named: str, objects: Places
) -> dict[str, tuple[float, ...]]:
    """Place of each source, or each receiver, by its name."""
    place_of = {kind: first}
    place_of |= {f"{kind} {number}": place.position for number, place in enumerate(further, 2)}
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
        place_of[name] = objects[name]
    return place_of


def _row(reverb: Reverb) -> np.ndarray:
    """(K, 3) where the microphones of a row are, from its middle."""
    azimuth = math.radians(reverb.array_azimuth_deg)
    elevation = math.radians(reverb.array_elevation_deg)
    steps = (np.arange(reverb.array) - (reverb.array - 1) / 2) * reverb.array_spacing
    level = math.cos(elevation)
    way = (level * math.cos(azimuth), level * math.sin(azimuth), math.sin(elevation))
    return np.outer(steps, way)


MOST_MICROPHONES = 256
MOST_MOMENTS = 2000  # of a path


@guarded("a CSV of microphones", key="array_file")
def read_microphones(path: Path) -> np.ndarray:
    """(K, 3) metres of a CSV with the columns x, y and z.

    Raises
    ------
    SpecError : it is missing, lacks a column, has a cell that is no number, or too many rows.
    """
    microphones = _columns("array_file", path, "x", "y", "z")
    if len(microphones) > MOST_MICROPHONES:
        raise SpecError(
            "array_file", f"{path.name} has {len(microphones)} microphones; give at most 256"
        )
    return microphones


@guarded("a CSV of a path")
def read_path(path: Path, key: str) -> tuple[np.ndarray, np.ndarray]:
    """(T,) s that rise and (T, 3) metres of a CSV with the columns time, x, y and z.

    Raises
    ------
    SpecError : as above; times do not rise; fewer than two rows; a place that is not above the ground.
    """
    rows = _columns(key, path, "time", "x", "y", "z")
    if len(rows) < 2 or (np.diff(rows[:, 0]) <= 0).any():
        raise SpecError(key, f"{path.name} needs two rows or more, whose times rise")
    if (rows[:, 3] <= 0).any():
        raise SpecError(key, f"{path.name}: z must be above the ground, z = 0; raise it")
    return rows[:, 0], rows[:, 1:]


def _columns(key: str, path: Path, *names: str) -> np.ndarray:
    """(N, columns) numbers."""
    try:
        return read_columns(path, *names).matrix(*names)
    except SpecError as problem:
        raise SpecError(key, f"{path.name}: {problem.problem}") from None
