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
