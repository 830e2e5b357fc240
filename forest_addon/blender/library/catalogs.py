"""The catalogs of an asset library: ``blender_assets.cats.txt``, and where in it a species stands.

A line of the file is UUID:path:simple name. The UUID of a catalog follows from its path (RFC 9562, version
5), so that libraries that are made anew, elsewhere or in parts keep their catalogs; lines of others stay.
"""

from __future__ import annotations

import tomllib
import uuid
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from ...base.places import ASSETS
from ...formats.atomic import replacing
from ...spec import Species

FILE = "blender_assets.cats.txt"
ROOT = "Forest Sensing"
LOW = 1.5  # metres, below which a plant that no catalog names is undergrowth
_NAMESPACE = uuid.UUID("8b6c5a52-0a53-5d43-9d3e-6f6c2f7d6a11")
_HEAD = """\
# This is an Asset Catalog Definition file for Blender.
#
# Empty lines and lines starting with `#` will be ignored.
# The first non-ignored line should be the version indicator.
# Other lines are of the format "UUID:catalog/path/for/assets:simple catalog name"

VERSION 1
"""


def catalog_of(species: Species, height: float) -> str:
    """The path of the catalog of a species whose trees are so tall, metres."""
    return f"{ROOT}/{_named().get(species.name) or _guess(species, height)}"


def _guess(species: Species, height: float) -> str:
    if height < LOW:
        return "Undergrowth"
    return "Conifers" if species.needles or species.leaf.shape == "needle" else "Broadleaves"


@cache
def _named() -> dict[str, str]:
    """The catalog of each preset."""
    listed = tomllib.loads((ASSETS / "catalogs.toml").read_text(encoding="utf-8"))
    return {name: group for group, names in listed.items() for name in names}


def catalog_id(path: str) -> str:
    """The UUID of a catalog."""
    return str(uuid.uuid5(_NAMESPACE, path))


def add_catalogs(folder: Path, paths: Iterable[str]) -> Path:
    """Have a library's file name these catalogs and those above them; returns the file.

    Raises
    ------
    OSError : the file cannot be read or written.
    """
    file = folder / FILE
    text = file.read_text(encoding="utf-8") if file.is_file() else _HEAD
    known = {line.split(":", 1)[0] for line in text.splitlines() if ":" in line}
    whole = {
        "/".join(path.split("/")[: k + 1]) for path in paths for k in range(path.count("/") + 1)
    }
    lines = [
        f"{catalog_id(path)}:{path}:{path.replace('/', '-')}"
        for path in sorted(whole)
        if catalog_id(path) not in known
    ]
    if lines or not file.is_file():
        with replacing(file) as partial:
            partial.write_text(text.rstrip("\n") + "\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return file
