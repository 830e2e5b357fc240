"""Versions of the programs that made a dataset."""

from __future__ import annotations

import importlib.metadata
import platform

PACKAGES = ("forest-sensing", "bpy", "numpy", "scipy", "laspy", "lazrs")


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide the bytes, by name."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "unknown"
    return found
