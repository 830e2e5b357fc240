"""The report of a run and its pictures.

Matplotlib does not come with Blender: without it data and tables are written all the same, pictures are the
plain ones of ``drawing.strips``, and a sentence says what is left out and how to get it.
"""

import importlib.util

DRAWERS = ("matplotlib", "PIL")


def can_draw() -> bool:
    """Return whether matplotlib is there; it is not imported."""
    return all(importlib.util.find_spec(name) is not None for name in DRAWERS)


def without(what: str) -> str:
    """A sentence for where it is not there. what : that happens then, as in "the map is left out"."""
    from forest_addon.blender.packages import to_install  # here: planning a stand needs no Blender

    return (
        f"{what}: matplotlib is not there, and Blender does not bring it. "
        f"To have it, type once: {to_install('matplotlib')}"
    )
