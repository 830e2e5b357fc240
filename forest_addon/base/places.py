"""Folders that come with the add-on, and its version: as a repository, an extension or a wheel."""

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


def version() -> str:
    """Return the version of Forest Sensing: the manifest's; of an installed wheel, its metadata's."""
    manifest = ROOT / "blender_manifest.toml"
    if manifest.is_file():
        return str(tomllib.loads(manifest.read_text(encoding="utf-8"))["version"])
    return installed_version("forest-sensing")


def file_name(name: str) -> str:
    """A name as that of a file: what a folder or another system reads as more than a name is "_"."""
    return re.sub(r"[^\w .-]", "_", name)
