"""run.json: everything needed to run a scene again, what it took, what came out and how it was checked."""

from __future__ import annotations

import dataclasses
import json
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from forest_addon import kernels
from forest_addon.api import Result, World
from forest_addon.base.places import version
from forest_addon.formats.atomic import write_whole
from forest_addon.sensing.audit import Audit
from forest_addon.spec import Scene

from .progress import Stages, peak_memory_mb
from .report import page


def facts_of(world: World) -> dict[str, Any]:
    """Entry of the evaluated scene in run.json: its size, the engine of its rays, what was chosen
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
            "kernels": kernels.engine(),
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
    stages: Stages,
    files: Sequence[str],
) -> None:
    """Write run.json.

    facts : of the evaluated scene, see ``facts_of``. trees : audits of what grew.
    targets : what was reached of them, by planting.
    results : of sensors, by their names. stages : their seconds, and what was warned of.
    """
    record = {
        **made_with(settings),
        **facts,
        "stage_seconds": stages.seconds,
        "warnings": stages.warnings,
        "peak_memory_mb": peak_memory_mb(),
        "results": {finding.title: finding.facts for finding in findings},
        "trees": {name: {"audit": audit.record()} for name, audit in trees.items()},
        "targets": targets,
        "sensors": {name: result.record() for name, result in results.items()},
        "files": files,
    }
    write_whole(path, json.dumps(record, indent=2, default=str) + "\n")
