"""The wheel: one package, ``forest_addon``, with the commands and the assets inside.

In the repository and in Blender's extension ``headless`` and ``assets`` stand beside it. The version is
that of blender_manifest.toml. The library of forest_addon/kernels goes in where a compiler is, and the
wheel is then one platform's, for every Python; without one it is any platform's, and numpy computes.
"""

import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.bdist_wheel import bdist_wheel
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
        libraries = list(folder.glob("_kernels.*"))
        newest = max(file.stat().st_mtime for file in [script, *folder.glob("*.[ch]")])
        if self.editable_mode and any(file.stat().st_mtime > newest for file in libraries):
            return  # packaging/setup_env.py has built it
        for earlier in () if self.editable_mode else libraries:
            earlier.unlink()
        wheel = self.get_finalized_command("bdist_wheel")
        other = [wheel.plat_name] if wheel.plat_name_supplied else []
        subprocess.run([sys.executable, script, *other, "--out", folder])


class WheelOfAPlatform(bdist_wheel):
    """A wheel for every Python: of one platform where the library is in it, else of any."""

    def get_tag(self) -> tuple[str, str, str]:
        python, abi, platform = super().get_tag()
        folder = Path(self.get_finalized_command("build_py").build_lib)
        if platform == "any" and list(folder.glob("forest_addon/kernels/_kernels.*")):
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
        return python, abi, platform


setup(
    cmdclass={"build_py": BuildWithKernels, "bdist_wheel": WheelOfAPlatform},
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
