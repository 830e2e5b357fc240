"""Base of the settings of all sensors, with the table of their kinds."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from .base import Settings


class Sensor(Settings):
    """Base of the settings of a sensor: ``kind`` is its word in a scene file, ``name`` that of its files.

    KINDS : every kind that a scene file may name, in the order in which a user is told of them. The program's
    own are in ``scene``; ``sensing.kinds.add`` adds others.
    """

    KINDS: ClassVar[dict[str, type[Sensor]]] = {}

    if TYPE_CHECKING:  # each class declares both, with defaults of its own
        kind: str
        name: str
