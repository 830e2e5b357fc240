"""The largest memory that this process had.

Linux hands ``ru_maxrss`` of a process on to those that it starts; the high-water mark of /proc is its own.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from forest_addon.api import Result, World
from forest_addon.base.places import version
from forest_addon.formats.atomic import replacing
from forest_addon.sensing.audit import Audit
from forest_addon.spec import Scene

from .report import page


def forget_peak() -> None:
    """Have the largest memory counted anew from now on, where the system does so (Linux)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def peak_memory_mb() -> float | None:
    """Megabytes (2^20 bytes) of resident memory at its highest; None where the system does not tell."""
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024**2 if sys.platform == "darwin" else 1024)


def facts_of(world: World) -> dict[str, Any]:
    """Return what run.json says of the evaluated scene: its size, the engine of its rays, what was chosen
    for it."""
    observer = world.observer
    geometry = observer.geometry
    unique = sum(len(mesh.triangles) for mesh in geometry.meshes)
    shown = sum(len(geometry.meshes[m].triangles) for m in geometry.mesh_index)
    facts: dict[str, Any] = {
        "ray_engine": observer.caster.engine,
        "triangles": {"unique": unique, "instanced": shown},
        "instances": len(geometry),
    }
    return facts | ({"chosen": [c.record() for c in world.chosen]} if world.chosen else {})


def made_with(settings: Scene) -> dict[str, Any]:
    """Versions, machine, seed and settings that a run's results come from."""
    import scipy

    return {
        "versions": {
            "forest_sensing": version(),
            "blender": bpy.app.version_string,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        },
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "seed": settings.seed,
        "settings": dataclasses.asdict(settings),
    }


def write_record(
    path: Path,
    settings: Scene,
    facts: Mapping[str, Any],
    findings: Sequence[page.Finding],
    trees: Mapping[str, Audit],
    targets: Mapping[str, Any],
    results: Mapping[str, Result],
    seconds: Mapping[str, float],
    files: Sequence[str],
) -> None:
    """Write run.json.

    facts : of the evaluated scene, see ``facts_of``. trees : audits of what grew.
    targets : what was reached of them, by planting.
    results : of sensors, by their names. seconds : of stages.
    """
    record = {
        **made_with(settings),
        **facts,
        "stage_seconds": seconds,
        "peak_memory_mb": peak_memory_mb(),
        "results": {finding.title: finding.facts for finding in findings},
        "trees": {name: {"audit": audit.record()} for name, audit in trees.items()},
        "targets": targets,
        "sensors": {name: result.record() for name, result in results.items()},
        "files": files,
    }
    with replacing(path) as partial:
        partial.write_text(json.dumps(record, indent=2, default=str) + "\n", encoding="utf-8")
