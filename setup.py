"""The wheel: one package, ``forest_addon``, with the commands and the assets inside.

In the repository and in Blender's extension ``headless`` and ``assets`` stand beside it. The version is
that of blender_manifest.toml.
"""

import tomllib
from pathlib import Path

from setuptools import find_packages, setup

ROOT = Path(__file__).resolve().parent
MANIFEST = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
ASSETS = [
    path.relative_to(ROOT / "assets").as_posix()
    for path in sorted((ROOT / "assets").rglob("*"))
    if path.is_file() and path.suffix not in {".py", ".pyc"}
]

setup(
    version=MANIFEST["version"],
    packages=[
        *find_packages(include=["forest_addon", "forest_addon.*"]),
        "forest_addon.headless",
        *(f"forest_addon.headless.{name}" for name in find_packages("headless")),
        "forest_addon.assets",
    ],
    package_dir={
        "forest_addon": "forest_addon",
        "forest_addon.headless": "headless",
        "forest_addon.assets": "assets",
    },
    package_data={"forest_addon": ["**/*.npz"], "forest_addon.assets": ASSETS},
)
