"""Packages that Blender lacks and the extension brings along; what to do where one is missing."""

from __future__ import annotations

import functools
import importlib.util

from .words import keep, say

NEEDED = ("numpy", "scipy", "cattrs")
WHAT_TO_DO = (  # line by line, as wide as the sidebar
    keep("The extension brings it along:"),
    keep("install its zip again under"),
    keep("Preferences > Get Extensions"),
    keep("> Install from Disk."),
)


@functools.cache
def missing() -> tuple[str, ...]:
    """Packages that cannot be found; looked up once, none of them is imported."""
    return tuple(name for name in NEEDED if importlib.util.find_spec(name) is None)


def in_words(names: tuple[str, ...]) -> str:
    """One sentence for packages that are missing."""
    if len(names) == 1:
        return say("{package} is missing in this Blender", package=names[0])
    return say("{packages} are missing in this Blender", packages=say(" and ").join(names))


def what_to_do() -> str:
    """The same lines as a sentence."""
    return " ".join(say(line) for line in WHAT_TO_DO)
