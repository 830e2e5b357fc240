"""Folders that come with the add-on, and its version: as a repository, an extension or a wheel."""

import os
import re
import tomllib
from importlib.metadata import version as installed_version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# A wheel has its data within the one package that it installs.
ASSETS = next(
    (folder for folder in (ROOT / "assets", ROOT / "forest_addon" / "assets") if folder.is_dir()),
    ROOT / "assets",
)

NO_BLENDER = (
    "is not installed; pip install bpy (5.2 for Python 3.13, 4.5 for 3.11), or run in Blender"
)

FORMER = {
    "t20-circle.csv": "tanveer-circle.csv",
    "t20-eight.csv": "tanveer-eight.csv",
    "t20-five-trees": "tanveer-five-trees",
    "t20-one-tree": "tanveer-one-tree",
    "t20-table-1-five": "tanveer-table-1-five",
    "t20-table-1-one": "tanveer-table-1-one",
}
"""Names that files of assets/scenes had in earlier releases, and those that they have now."""


def shipped(word: str | os.PathLike[str], folder: str, ending: str) -> Path:
    """Return the file that a word means: one that is there, or one that comes with the add-on, by its name
    alone (hedge-bat) or by its path in the repository (assets/scenes/hedge-bat.toml). A folder of that name
    is no such file."""
    given = Path(word)
    if given.parts[:1] == ("assets",):
        shipped_file = ASSETS.joinpath(*given.parts[1:])
    elif not given.suffix and len(given.parts) == 1:
        shipped_file = ASSETS / folder / f"{FORMER.get(str(given), given)}{ending}"
    else:
        return given
    return (
        shipped_file if shipped_file.is_file() and (given.is_dir() or not given.exists()) else given
    )


def environment_of_child(**more: str) -> dict[str, str]:
    """Return the environment of a Python process of ours: it finds what this one finds, and takes no module
    from the folder that it starts in.

    more : variables beside those of this process.
    """
    known = [entry for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    path = [str(ROOT), *(entry for entry in known if os.path.isabs(entry))]
    return os.environ | {"PYTHONPATH": os.pathsep.join(path), "PYTHONSAFEPATH": "1"} | more


def version() -> str:
    """Return the version of Forest Sensing: the manifest's; of an installed wheel, its metadata's."""
    manifest = ROOT / "blender_manifest.toml"
    if manifest.is_file():
        return str(tomllib.loads(manifest.read_text(encoding="utf-8"))["version"])
    return installed_version("forest-sensing")


def file_name(name: str) -> str:
    """A name as that of a file: what a folder or another system reads as more than a name is "_"."""
    return re.sub(r"[^\w .-]", "_", name)
