"""The wheel: one package, ``forest_addon``, with the commands and the assets inside.

In the repository and in Blender's extension ``headless`` and ``assets`` stand beside it. The version is
that of blender_manifest.toml. The library of forest_addon/kernels goes in where a compiler is, and the
wheel is then one platform's, for every Python; without one it is any platform's, and numpy computes.
"""

import subprocess
import sys
import tomllib
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parent
MANIFEST = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
ASSETS = [
    path.relative_to(ROOT / "assets").as_posix()
    for path in sorted((ROOT / "assets").rglob("*"))
    if path.is_file() and path.suffix not in {".py", ".pyc"}
]


class BuildWithKernels(build_py):
    """Files of Python, and the library beside them; of an editable installation in the repository."""

    def run(self) -> None:
        super().run()
        top = ROOT if self.editable_mode else ROOT / self.build_lib
        script, folder = ROOT / "packaging/build_kernels.py", top / "forest_addon/kernels"
        subprocess.run([sys.executable, script, "--out", folder])


setup(
    cmdclass={"build_py": BuildWithKernels},
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
    package_data={"forest_addon": ["**/*.npz", "kernels/*.[ch]"], "forest_addon.assets": ASSETS},
)
