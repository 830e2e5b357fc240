"""Trajectories that HELIOS++ interpolates: tables of time, attitude and place in text files.

Between rows all goes linearly. Rows of the same time are a jump: what comes before it leads to the first of
them, what comes after it starts from the last.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from ...spec import SpecError
from ..foreign import guarded
from .document import find_file, number, yes

NAMES = ("t", "roll", "pitch", "yaw", "x", "y", "z")
KEYS = {f"{name}Index": place for place, name in enumerate(NAMES)}
SETTINGS = {
    *(
        "trajectory",
        "trajectory_separator",
        "trajectory_seperator",
        "slopeFilterThreshold",
        "toRadians",
        "syncGPSTime",
    ),
    *("tStart", "tEnd", "teleportToStart", "interpolationDomain", *KEYS),
}


@dataclass(frozen=True)
class SurveyTrack:
    """Way of a platform.

    time : (K,) seconds, ascending. place : (K, 3) metres. angles : (K, 3) roll, pitch and yaw in radians,
    which turn a vector about Z, then Y, then X; None: it looks along its way.
    """

    time: np.ndarray
    place: np.ndarray
    angles: np.ndarray | None = None

    def shifted(self, by: np.ndarray) -> SurveyTrack:
        """The track moved by (3,) metres."""
        return replace(self, place=self.place + by)

    def at(self, time: np.ndarray) -> tuple[np.ndarray, Rotation | None]:
        """(P, 3) places at times (P,), and attitudes; it stands before the first row and after the last."""
        time = np.clip(time, self.time[0], self.time[-1])
        row = np.clip(np.searchsorted(self.time, time, "right") - 1, 0, len(self.time) - 2)
        span = self.time[row + 1] - self.time[row]
        share = np.where(span > 0, (time - self.time[row]) / np.where(span > 0, span, 1.0), 1.0)

        def between(rows: np.ndarray) -> np.ndarray:
            return np.asarray(rows[row] + share[:, None] * (rows[row + 1] - rows[row]))

        if self.angles is None:
            return between(self.place), None
        return between(self.place), Rotation.from_euler("XYZ", between(self.angles))

    def part(self, start: float, stop: float) -> SurveyTrack:
        """The rows from a time to another, seconds; of a jump at an end only its inner side."""
        inner = np.flatnonzero((self.time > start) & (self.time < stop))
        first = np.searchsorted(self.time, start, "right") - 1
        last = np.searchsorted(self.time, stop, "left")
        rows = np.unique(np.clip([first, *inner, last], 0, len(self.time) - 1))
        angles = None if self.angles is None else self.angles[rows]
        return SurveyTrack(self.time[rows], self.place[rows], angles)


def read_tracks(
    legs: list[Element], survey: Element, path: Path, assets: Path | None
) -> list[tuple[SurveyTrack, float, float]]:
    """The track of each leg of platform settings, and from when to when it goes, seconds.

    Raises
    ------
    SpecError : a file is missing or is no table, or settings contradict each other.
    """
    files: dict[str, Element] = {}
    for leg in legs:
        name = leg.get("trajectory", "")
        if not name:
            raise SpecError(str(path), "a leg of an interpolated platform names no trajectory")
        if name not in files or set(leg.attrib) & set(KEYS):
            files[name] = leg
    tables = [_read(find_file(name, path, assets), leg, path) for name, leg in files.items()]
    rows = np.concatenate(tables)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    spec = survey.get("rotationSpec", "ARINC 705")
    if spec not in ("ARINC 705", "CANONICAL"):
        raise SpecError(str(path), f'rotationSpec = "{spec}" is neither ARINC 705 nor CANONICAL')
    if all(yes(leg.get("toRadians"), True) for leg in legs):
        rows[:, 1:4] = np.deg2rad(rows[:, 1:4])
    angles = rows[:, 1:4] if spec == "CANONICAL" else -rows[:, 1:4]
    only = {leg.get("interpolationDomain", "") for leg in legs} & {"position"}
    track = SurveyTrack(rows[:, 0], rows[:, 4:], None if only else angles)
    found = []
    for leg in legs:
        start = number(leg, "tStart", path, float(track.time[0]))
        stop = number(leg, "tEnd", path, float(track.time[-1]))
        if not start < stop:
            raise SpecError(str(path), f"a leg from tStart = {start:g} to {stop:g} s has no time")
        found.append((track.part(start, stop), start, stop))
    return found


@guarded("a table of a trajectory")
def _read(file: Path, leg: Element, path: Path) -> np.ndarray:
    """(K, 7) time, roll, pitch, yaw, x, y, z of a text file, by the indices of a leg or its header."""
    head: list[str] = []
    separator = leg.get("trajectory_separator", leg.get("trajectory_seperator", ","))  # theirs
    rows = []
    for text in file.read_text("utf-8", errors="replace").splitlines():
        if text.startswith("#HEADER"):
            head = [name.strip().strip('"') for name in text.partition(":")[2].split(",")]
        elif text.strip() and not text.startswith("#"):
            parts = text.split(separator if separator.strip() else None)
            try:
                rows.append([float(part) for part in parts])
            except ValueError:
                raise SpecError(str(file), "has a line that is not numbers") from None
    if len(rows) < 2:
        raise SpecError(str(file), f"has {len(rows)} rows; a trajectory needs two")
    table = np.array(rows)
    if set(leg.attrib) & set(KEYS):
        order = [int(number(leg, key, path, place)) for key, place in KEYS.items()]
    else:
        order = [head.index(name) if name in head else place for place, name in enumerate(NAMES)]
    needed = order if leg.get("interpolationDomain") != "position" else [order[0], *order[4:]]
    if min(needed) < 0 or max(needed) >= table.shape[1]:
        raise SpecError(str(file), f"has {table.shape[1]} columns, too few for {', '.join(NAMES)}")
    found = table[:, np.clip(order, 0, table.shape[1] - 1)]
    if not np.isfinite(found).all():
        raise SpecError(str(file), "has values that are no numbers")
    return found
