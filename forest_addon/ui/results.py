"""What a run found, put where a user sees it: points in the scene, figures in the panel, a file.

The panel keeps the last result of each kind, the newest first.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..blender.cloud import show_cloud, show_heard
from ..blender.layout import RESULTS, part
from ..blender.sound import give_sound
from ..growth.mesh.trimesh import GROUND, LEAF, WOOD
from ..sensing.lidar.cloud import Cloud
from ..sensing.lidar.tractor import TractorScan, to_cloud
from ..sensing.reverb import metrics
from ..sensing.reverb.response import ImpulseResponse, channels_of
from ..sensing.sonar.flight import Flight
from ..sensing.sonar.ping import Echo
from ..spec import Scene, Sensor, Tractor
from ..stand.forest import Forest
from . import images, plots
from .selection import show
from .words import Kept, keep, say

Figures = dict[str, str]


def keep_forest(context: bpy.types.Context, settings: Scene, forest: Forest, seconds: float) -> str:
    """Note what stands now; results of the forest before go. Returns the figures in a sentence."""
    props = context.scene.forest_sensing
    props.results.clear()
    figures = forest_figures(forest)
    _note(props, "forest", "forest", settings.name, figures | {keep("Time"): f"{seconds:.1f} s"})
    trees, leaves = figures["Trees"], figures["Leaves"]
    if len(forest.stand) == 1:
        return say("1 tree with {leaves} leaves in {seconds:.1f} s", leaves=leaves, seconds=seconds)
    return say(
        "{trees} trees with {leaves} leaves in {seconds:.1f} s",
        trees=trees,
        leaves=leaves,
        seconds=seconds,
    )


def keep_finding(
    context: bpy.types.Context,
    thing: bpy.types.Object,
    sensor: Sensor,
    found: TractorScan | Cloud | Echo | Flight | ImpulseResponse,
    seconds: float,
) -> str:
    """Show, note and draw what a sensor found. Returns the key figures in a sentence."""
    props = context.scene.forest_sensing
    figures, sentence = figures_of(found)
    plot = _plot(found, sensor)
    picture = images.show(f"Forest {sensor.name}", plot) if plot else None
    if isinstance(found, ImpulseResponse) and thing.type == "SPEAKER":
        give_sound(thing, sensor.name, channels_of(found), found.sample_rate)
    result = _note(  # what needs disk space is done
        props, thing.name, sensor.kind, thing.name, figures | {keep("Time"): f"{seconds:.1f} s"}
    )
    result.picture, result.caption = picture, plot.caption if plot else ""
    if isinstance(found, TractorScan | Cloud):
        cloud = to_cloud(found, sensor) if isinstance(sensor, Tractor) else found
        points = show_cloud(part(context.scene, RESULTS), sensor.name, cloud)
        show(context, points)  # selected, all points would be orange
        result.shown = points.name
    elif isinstance(found, Echo):
        home = part(context.scene, RESULTS)
        result.shown = show_heard(home, sensor.name, found.heard).name
    return say("{found} in {seconds:.1f} s", found=sentence, seconds=seconds)


def save_finding(
    context: bpy.types.Context,
    folder: Path,
    name: str,
    sensor: Sensor,
    found: Any,
    offset: tuple[float, float, float],
) -> Path:
    """Write a result to a folder and note the file in the panel, at the result of this name.

    Raises
    ------
    OSError : it cannot be written.
    """
    from ..formats.findings import (
        write_finding,  # brings in laspy, which showing a result does not need
    )

    path = write_finding(folder, sensor, found, offset)[0]
    context.scene.forest_sensing.results[name].file = str(path)
    return path


def forest_figures(forest: Forest) -> Figures:
    """Trees, leaves and triangles of a forest."""
    stand = forest.stand
    variants = [forest.variant_of(tree) for tree in range(len(stand))]
    figures = {keep("Trees"): f"{len(stand):,}"}
    figures |= {
        label.title(): f"{count:,}"
        for label, count in zip(forest.labels, stand.counts(), strict=True)
    }
    per_hectare = float(stand.density().sum() * 1e4)
    figures[keep("Density")] = keep("{density:,.0f} trees/ha", density=per_hectare)
    figures[keep("Leaves")] = f"{sum(len(tree.leaves) for tree in variants):,}"
    figures[keep("Triangles")] = f"{sum(len(tree.mesh.triangles) for tree in variants):,}"
    if stand.removed:
        figures[keep("Too Close")] = keep("{count:,} taken away", count=int(stand.removed))
    if stand.off_ground.any():
        figures[keep("No Ground")] = keep("{count:,} left out", count=int(stand.off_ground.sum()))
    return figures


def figures_of(found: TractorScan | Cloud | Echo | Flight | ImpulseResponse) -> tuple[Figures, str]:
    """The key figures of a result, and the most telling of them in a few words."""
    if isinstance(found, TractorScan):
        hits = int(np.count_nonzero(found.organ >= 0))
        figures = {keep("Beams"): f"{found.organ.size:,}", keep("Points"): f"{hits:,}"}
        return figures | _organs(found.organ, found.engine), say("{count:,} points", count=hits)
    if isinstance(found, Cloud):
        seen = np.unique(found.returns.tree[found.returns.tree >= 0])
        points = len(found.position)
        figures = {
            keep("Beams"): f"{found.pulses:,}",
            keep("Points"): f"{points:,}",
            keep("Trees Seen"): f"{len(seen):,}",
        }
        figures |= _organs(found.returns.organ, found.engine)
        return figures, say("{count:,} points", count=points)
    if isinstance(found, ImpulseResponse):
        return _reverb_figures(found)
    if isinstance(found, Flight):
        loudest = max(found.echoes, key=lambda echo: float(echo.envelope.max(initial=0.0)))
        figures, sentence = _echo_figures(loudest)
        pings = say("{count:,} pings, the loudest: {found}", count=len(found), found=sentence)
        return {keep("Pings"): f"{len(found):,}"} | figures, pings
    return _echo_figures(found)


def _plot(found: Any, sensor: Any) -> plots.Plot | None:
    """What is drawn of a result; of a flight one ping after the other."""
    if isinstance(found, TractorScan):
        return plots.matrix_plot(found)
    if isinstance(found, Cloud):
        return plots.cloud_plot(found, sensor)
    if isinstance(found, ImpulseResponse):
        return plots.sound_plot(found.samples, found.sample_rate, decay=True)
    if isinstance(found, Flight):
        pings = found.stacked("waveforms")[:, 0].ravel()
        return plots.sound_plot(pings, found.echoes[0].sample_rate)
    return plots.sound_plot(found.waveforms[0], found.sample_rate)


def _organs(organ: np.ndarray, engine: str) -> Figures:
    named = {keep("Leaves"): LEAF, keep("Wood"): WOOD, keep("Ground"): GROUND}
    figures = {name: _share(organ == code) for name, code in named.items()}
    if np.any(organ < 0):
        figures[keep("Sky")] = _share(organ < 0)
    return figures | {keep("Rays By"): engine}


def _echo_figures(echo: Echo) -> tuple[Figures, str]:
    heard = echo.leaves_heard
    figures = {
        keep("Leaves Heard"): keep("{heard:,} of {leaves:,}", heard=heard, leaves=echo.leaves),
        keep("Behind Wood"): f"{echo.hidden:,}",
    }
    peak = int(np.argmax(echo.envelope)) if np.any(echo.envelope) else None
    if peak is None:
        silence = say("silence: nothing in the beam")
        return figures | {keep("Level"): keep("silence")}, silence
    away = float(echo.time[peak] * echo.sound_speed / 2)
    figures[keep("Strongest")] = keep("{distance:.2f} m away", distance=away)
    level = float(20 * np.log10(echo.envelope[peak]))
    figures[keep("Level")] = keep("{level:.1f} dB re 1 m", level=level)
    return figures, say("{count:,} leaves heard", count=heard)


def _reverb_figures(response: ImpulseResponse) -> tuple[Figures, str]:
    seconds = metrics.reverberation_time(
        response.samples, response.sample_rate, left_db=float(response.left_db[0])
    )
    clarity = metrics.clarity_db(response.samples, response.sample_rate)
    figures = {
        keep("Trunks Heard"): f"{response.trunks:,}",
        keep("Beyond Field"): f"{response.continued:,}",
        **({keep("After the End"): f"{response.late:,}"} if response.late else {}),
        keep("Reverb Time"): f"{seconds:.2f} s" if np.isfinite(seconds) else keep("not reached"),
        keep("Clarity C50"): f"{clarity:.1f} dB" if np.isfinite(clarity) else keep("no late sound"),
        keep("Direct Path"): keep("clear") if response.direct_clear else keep("blocked by wood"),
    }
    return figures, say("{count:,} trunks heard", count=response.trunks)


def _share(mask: np.ndarray) -> str:
    return f"{100 * float(np.mean(mask)):.1f} %" if mask.size else "0 %"


def _note(props: Any, name: str, kind: str, title: str, figures: Figures) -> Any:
    """A new entry of this name at the top of the panel, in place of an earlier one."""
    earlier = props.results.find(name)
    if earlier >= 0:
        props.results.remove(earlier)
    for other in props.results:
        other.opened = False
    props.results.add()
    props.results.move(len(props.results) - 1, 0)
    result = props.results[0]
    result.name, result.kind, result.title = name, kind, title
    for label, value in figures.items():
        figure = result.figures.add()
        figure.name, figure.value = label, value
        figure.made_of = value.made_of if isinstance(value, Kept) else ""
    return result
