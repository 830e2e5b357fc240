"""A scene through all sweeps: a table, a picture, and the scene with the settings recommended."""

from __future__ import annotations

import argparse
import math
import textwrap
from dataclasses import replace
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from forest_addon import api as forest
from forest_addon.base.progress import Say
from forest_addon.drawing.figures import blank_figure, save_figure
from forest_addon.drawing.palette import FAINT, INK, LEAF_GREEN, RED
from forest_addon.formats.table import write_csv
from forest_addon.formats.toml_file import write_settings
from forest_addon.sensing.kinds import choose
from forest_addon.spec import SpecError

from ..progress import Stages, hushed
from .sensors import SWEEPS, AccuracySweep, Meshes, Point

FLOOR = 1e-16  # an error of 0 is drawn here
COLUMNS = 2
WIDE = 34  # letters of a line of the key
ROOM = 0.08  # of an axis, at each end


def run(chosen: argparse.Namespace, say: Say = print) -> None:
    """Sweep every sensor of a scene file; write accuracy.csv, accuracy.png and recommended.toml.

    Raises
    ------
    SpecError : the scene cannot be used, or has no sensor; an error or a time that is not above 0.
    """
    out, error, seconds = chosen.out, chosen.error, chosen.seconds
    for key, value in (("--error", error), ("--seconds", seconds)):
        if not value > 0:
            raise SpecError(key, f"{value:g} is out of range; use more than 0")
    scene = forest.read(chosen.scene)
    if not scene.sensors:
        raise SpecError(str(chosen.scene), "has no sensor; give it [[sensors]]")
    out.mkdir(parents=True, exist_ok=True)
    stages = Stages(quiet=False)
    with stages.stage("grow and build the forest"), hushed():
        site = forest.Site.of(scene)
        world = site.build(site.grow(), as_assets=False)
        meshes = Meshes(site, world)
    sweeps = []
    with world.still() as observer:
        for sensor in scene.sensors:
            if sensor.kind not in SWEEPS:
                say(f"{sensor.name} is left as it is: a {sensor.kind} has no settings to try")
                continue
            with stages.stage(f"try settings of {sensor.name}"):
                sensor, _ = choose(sensor)
                sweep = SWEEPS[sensor.kind]
                sweeps.append(sweep(sensor, observer, scene, meshes, Path()))
    if not sweeps:
        return
    for sweep in sweeps:
        _tell(sweep, error, seconds, say)
    _write(sweeps, out / "accuracy.csv")
    columns = min(len(sweeps), COLUMNS)
    rows = math.ceil(len(sweeps) / columns)
    figure = blank_figure((6.6 * columns, 3.7 * rows))
    better, engines = {}, set()
    for number, sweep in enumerate(sweeps, 1):
        best = sweep.choice(error, seconds)
        _draw(figure.add_subplot(rows, columns, number), sweep, best)
        better[sweep.sensor.name] = replace(sweep.sensor, **best.changes)
        engines |= {best.engine} - {""}
    save_figure(figure, out / "accuracy.png")
    sensors = tuple(better.get(sensor.name, sensor) for sensor in scene.sensors)
    rays = replace(scene.rays, engine=engines.pop()) if len(engines) == 1 else scene.rays
    write_settings(out / "recommended.toml", scene.changed(sensors=sensors, rays=rays))
    say(f"\nWrote {out / 'accuracy.png'}, accuracy.csv and recommended.toml.")


def _tell(sweep: AccuracySweep, error: float, seconds: float, say: Say) -> None:
    unit = f" {sweep.unit}" if sweep.unit else ""
    say(f"\n{sweep.sensor.name} ({sweep.sensor.kind}): {sweep.what}")
    front = sweep.frontier()
    for point in sorted(sweep.all, key=lambda p: p.seconds):
        mark = "*" if point in front else " "
        now = "  <- today" if point is sweep.today else ""
        now += f"  ({point.elsewhere})" if point.elsewhere else ""
        spread = f" ± {point.spread:.0e}" if point.spread else ""
        say(
            f" {mark} {point.label:34} {point.seconds:9.3g} s  {point.error:.1e}{spread}{unit}{now}"
        )
    if sweep.model is not None:
        say(f"   the model itself: {sweep.model[0]:.1e} ({sweep.model[1]})")
    for note in sweep.notes:
        say(f"   {note}")
    if largest := sweep.dominant():
        say(f"   today, {largest}")
    say(f"   -> {sweep.verdict(error, seconds)}")


def _write(sweeps: list[AccuracySweep], path: Path) -> None:
    rows = [(sweep, point) for sweep in sweeps for point in sweep.all]
    write_csv(
        path,
        {
            "sensor": [sweep.sensor.name for sweep, _ in rows],
            "settings": [point.label for _, point in rows],
            "set_elsewhere": [point.elsewhere for _, point in rows],
            "today": [int(point is sweep.today) for sweep, point in rows],
            "cpu_seconds": [point.seconds for _, point in rows],
            "error": [point.error for _, point in rows],
            "standard_error": [point.spread for _, point in rows],
            "unit": [sweep.unit or "share" for sweep, _ in rows],
        },
    )


def _draw(axes: Axes, sweep: AccuracySweep, best: Point) -> None:
    """Numbered by seconds; the key beside it says what each is."""
    front = sweep.frontier()
    axes.plot([p.seconds for p in front], [_height(p) for p in front], color=FAINT, zorder=1)
    key = []
    for number, point in enumerate(sorted(sweep.all, key=lambda p: p.seconds), 1):
        place = point.seconds, _height(point)
        colour = RED if point is sweep.today else INK
        low = min(point.spread, 0.9 * place[1]) or None
        axes.errorbar(*place, yerr=low, fmt="none", ecolor=colour, zorder=2)
        disc = {"color": colour, "mec": "white", "mew": 0.8}
        if point is best:
            disc |= {"mec": LEAF_GREEN, "mew": 2.5}
        if point.elsewhere:  # hollow: no setting of the scene file
            disc = {"color": "white", "mec": INK, "mew": 1.2}
        axes.plot(*place, "o", ms=12, zorder=3, **disc)
        axes.annotate(
            str(number),
            place,
            color=INK if point.elsewhere else "white",
            fontsize=8,
            ha="center",
            va="center_baseline",
            zorder=4,
        )
        roles = (("today", sweep.today), ("recommended", best))
        said = [" and ".join(role for role, one in roles if point is one)]
        said += [point.elsewhere and f"hollow: {point.elsewhere}", "off by 0" * (point.error == 0)]
        told = "; ".join(filter(None, said))
        words = f"{number}  {point.label}" + (f"\n    ({told})" if told else "")
        key.append(Line2D([], [], marker="o", ls="", ms=8, label=words, **disc))
    if sweep.model is not None and sweep.model[0] > 0:
        axes.axhline(sweep.model[0], color=RED, ls=":", lw=1)
        words = textwrap.fill(f"the model itself: {sweep.model[1]}", WIDE, subsequent_indent="    ")
        key.append(Line2D([], [], color=RED, ls=":", label=words))
    axes.set(xscale="log", yscale="log", xlabel="CPU seconds")
    axes.margins(ROOM)
    axes.set_title(f"{sweep.sensor.name}: {sweep.what}")
    axes.set_ylabel("error" + (f", {sweep.unit}" if sweep.unit else ", share"))
    axes.legend(handles=key, loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


def _height(point: Point) -> float:
    return point.error if FLOOR < point.error < math.inf else FLOOR
