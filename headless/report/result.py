"""Pictures of stands and of what sensors found: figures where matplotlib is there, else plain ones."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.blender.sensors.observe import Observer
from forest_addon.drawing.palette import SPECIES
from forest_addon.drawing.strips import Plot, stand_map
from forest_addon.formats.atomic import replacing
from forest_addon.formats.raster_file import write_png
from forest_addon.results.kind import Finding
from forest_addon.results.kinds import results_of
from forest_addon.sensing.rays.geometry import apply_transform
from forest_addon.sensing.sonar.kind import targets_of
from forest_addon.sensing.sonar.ping import EchoTargets
from forest_addon.spec import Scene, Sensor
from forest_addon.stand.forest import GrownForest
from forest_addon.stand.inputs import Inputs
from forest_addon.stand.plan import Stand

from . import can_draw

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEAVES = 60_000  # on a map


def draw_result(
    sensor: Sensor, found: Finding, observer: Observer, forest: GrownForest, path: Path
) -> Path | None:
    """Draw what a sensor found into a PNG; return its path, None where there is nothing to draw."""
    if can_draw() and (figure := _figure_of(sensor, found, observer, forest)) is not None:
        from forest_addon.drawing.figures import save_figure

        return save_figure(figure, path)
    plot = results_of(sensor).plot(sensor, found)
    return _save_plainly(plot, path) if plot else None


def _figure_of(
    sensor: Sensor, found: Finding, observer: Observer, forest: GrownForest
) -> Figure | None:
    from forest_addon.drawing import echoes, figures

    match sensor.kind:
        case "tractor":
            return figures.draw_scan(found)
        case "terrestrial":
            return figures.draw_cloud(found, sensor)
        case "mobile" | "airborne":
            return figures.draw_cloud(found)
        case "reverb":
            return figures.draw_reverb(found)
        case "sonar":
            leaves = sample_leaves(observer.once(targets_of))
            draw = echoes.draw_flight if hasattr(found, "echoes") else echoes.draw_echo
            return draw(found, sensor, leaves, forest.stand.position[:, :2])
    return None


def draw_stand(
    stand: Stand, labels: Sequence[str], settings: Scene, inputs: Inputs, path: Path
) -> Path:
    """Draw the map of a stand into a PNG; returns its path."""
    if not can_draw():
        return _save_plainly(stand_map(stand, settings, inputs), path)
    from forest_addon.drawing import figures, stands

    return figures.save_figure(stands.draw_stand(stand, labels, settings, inputs), path)


def colours_in_words(labels: Sequence[str]) -> str:
    """Return which colour a species has in the map."""
    names = list(SPECIES)
    said = (f"{label} {names[k % len(names)]}" for k, label in enumerate(labels))
    return f"In the map: {', '.join(said)}."


def _save_plainly(plot: Plot, path: Path) -> Path:
    import bpy  # noqa: F401  where Blender is a module, it brings blf and imbuf

    from forest_addon.ui.results.images import drawn

    with replacing(path) as partial:
        partial.write_bytes(write_png(drawn(plot)[::-1]))
    return path


def sample_leaves(targets: EchoTargets, most: int = LEAVES) -> np.ndarray:
    """(M, 2) x and y of at most so many leaves of a scene, drawn at random, the same each time."""
    scene = targets.scene
    firsts = []
    for mesh in scene.meshes:
        facets = np.flatnonzero(mesh.leaf >= 0)
        _, first = np.unique(mesh.leaf[facets], return_index=True)
        firsts.append(mesh.triangles[facets[first]])
    count = np.array([len(firsts[index]) for index in scene.mesh_index], dtype=np.int64)
    share = min(1.0, most / max(int(count.sum()), 1))
    rng = stream(0, "picture", "leaves")
    places = []
    for instance, index in enumerate(scene.mesh_index):
        some = np.flatnonzero(rng.random(len(firsts[index])) < share)
        middle = scene.meshes[index].vertices[firsts[index][some]].mean(axis=1)
        places.append(apply_transform(scene.transform[instance], middle)[:, :2])
    return np.concatenate(places) if places else np.empty((0, 2))
