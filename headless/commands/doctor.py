"""``python -m headless doctor``: what is installed, what computes, what is missing and how to get it."""

from __future__ import annotations

import argparse
import importlib.metadata
import os
import platform
import re
import sys

from forest_addon import kernels
from forest_addon.base.places import NO_BLENDER, ROOT, version

from ..command import IncompleteError, installed

INSIDE = {"dev", "docs", "bpy"}  # extras that are no user's, or told apart
KERNELS = "a C compiler (gcc, clang or pip install ziglang) builds them: install again, or run make"


def run(_chosen: argparse.Namespace) -> None:
    """Print what is installed."""
    engine = kernels.engine()
    print(f"Forest Sensing  {version()} in {ROOT}")
    print(f"Python          {platform.python_version()} ({sys.executable})")
    print(f"machine         {platform.platform()}, {os.cpu_count()} cores")
    print(f"kernels         {engine}" + ("" if engine == "C" else f"; {KERNELS}"))
    lacking = [*_blender(), *_packages()]
    if lacking:
        raise IncompleteError(f"{', '.join(lacking)} missing; forests need all of these")


def _blender() -> list[str]:
    """Print what Blender and its rays are; return the name where it is missing."""
    try:
        import bpy
    except ImportError as problem:
        print(f"Blender         {NO_BLENDER} ({problem})")
        return ["Blender"]
    from forest_addon.blender.rays.casters import embree_problem

    why = embree_problem()
    print(f"Blender         {bpy.app.version_string}")
    print(f"rays            {f'BVHTree ({why})' if why else 'Embree'}")
    return []


def _packages() -> list[str]:
    """Print the packages that are used, by extra; return which of those are missing that all need."""
    wanted: dict[str, list[str]] = {}
    try:
        lines = importlib.metadata.requires("forest-sensing") or ()
    except importlib.metadata.PackageNotFoundError:
        print("packages        not by pip: what Blender and its extension have")
        return []
    for line in lines:
        name = re.match(r"[\w.-]+", line)
        extra = re.search(r"extra == [\"'](\w+)", line)
        if name and name[0] != "forest-sensing":
            wanted.setdefault(extra[1] if extra else "", []).append(name[0])
    for extra in sorted(wanted.keys() - INSIDE):
        has = {name: installed(name) for name in wanted[extra]}
        missing = [name for name, number in has.items() if not number]
        said = ", ".join(f"{name} {number}" for name, number in has.items() if number)
        if missing:
            how = (
                f'pip install "forest-sensing[{extra}]"' if extra else "pip install forest-sensing"
            )
            apart = (
                ", in an environment of its own" if extra == "trees" else ""
            )  # with an older scipy
            said += f"{'; ' if said else ''}missing {', '.join(missing)}: {how}{apart}"
        print(f"{f'[{extra}]' if extra else 'packages':<15} {said}")
    return [name for name in wanted.get("", ()) if not installed(name)]
