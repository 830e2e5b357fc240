"""Dotted paths into tables: ``air.humidity``, ``sensors[tls].angle_step_deg``, ``plantings[*].scale[0]``.

An index is a number, the name of an entry (its ``name``, ``sensor`` or ``species``), or ``*`` for all.
"""

from __future__ import annotations

import re
from typing import Any

from forest_addon.spec import SpecError

STEP = re.compile(r"([A-Za-z_]\w*)((?:\[[^\[\]]+\])*)")
NAMES = ("name", "sensor", "species", "kind")


def put(table: dict[str, Any], path: str, value: Any) -> None:
    """Set what a path means, in place; tables on the way are made, entries of lists must be there.

    Raises
    ------
    SpecError : it is no path, or leads to an entry that there is not; says which there are.
    """
    steps = _steps(path)
    places: list[Any] = [table]
    for number, step in enumerate(steps):
        last = number == len(steps) - 1
        places = [after for place in places for after in _go(place, step, path, value, last)]


def _steps(path: str) -> list[str]:
    steps: list[str] = []
    for word in path.split("."):
        found = STEP.fullmatch(word)
        if found is None:
            raise SpecError(
                path, 'is no path; write one as air.humidity or "sensors[tls].angle_step_deg"'
            )
        steps += [found[1], *re.findall(r"\[[^\[\]]+\]", found[2])]
    return steps


def _go(place: Any, step: str, path: str, value: Any, last: bool) -> list[Any]:
    """Return what one step leads to; the last one sets."""
    if not step.startswith("["):
        if not isinstance(place, dict):
            raise SpecError(
                path, f"{step} is asked of what is no table; an entry of a list is [0] or [name]"
            )
        if last:
            place[step] = value
        return [] if last else [place.setdefault(step, {})]
    if not isinstance(place, list):
        raise SpecError(path, f"{step} is asked of what is no list in the base scene")
    found = _entries(place, step[1:-1], path)
    if last:
        for number in found:
            place[number] = value
        return []
    return [place[number] for number in found]


def _entries(place: list[Any], word: str, path: str) -> list[int]:
    if word == "*":
        return list(range(len(place)))
    if word.isdigit():
        found = [int(word)] if int(word) < len(place) else []
    else:
        found = [
            number
            for number, entry in enumerate(place)
            if isinstance(entry, dict) and word in [entry.get(key) for key in NAMES]
        ]
    if not found:
        there = [
            next((str(entry[key]) for key in NAMES if key in entry), str(number))
            for number, entry in enumerate(place)
            if isinstance(entry, dict)
        ]
        raise SpecError(
            path, f"[{word}] is not there; use one of {', '.join(there) or 'none'}, or *"
        )
    return found
