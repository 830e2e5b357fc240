"""Packages that Blender lacks and the extension brings along; what to do where one is missing."""

from __future__ import annotations

import functools
import importlib.util

NEEDED = ("numpy", "scipy", "cattrs")
WHAT_TO_DO = (  # line by line, as wide as the sidebar
    "The extension brings it along:",
    "install its zip again under",
    "Preferences > Get Extensions",
    "> Install from Disk.",
)


@functools.cache
def missing() -> tuple[str, ...]:
    """Packages that cannot be found; looked up once, none of them is imported."""
    return tuple(name for name in NEEDED if importlib.util.find_spec(name) is None)


def in_words(names: tuple[str, ...]) -> str:
    """One sentence for packages that are missing."""
    verb = "is" if len(names) == 1 else "are"
    return f"{' and '.join(names)} {verb} missing in this Blender"
