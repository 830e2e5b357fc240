"""A scene through all sweeps: a table, a picture, and the scene with the settings recommended."""

from __future__ import annotations

import argparse
import math
import textwrap
from dataclasses import replace
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

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
ROOM, LEAST = 0.08, 1.3  # share of the decades, and decades
FEW = 100.0  # times


def run(chosen: argparse.Namespace) -> None:
    """Sweep the scene that was chosen."""
    sweep_scene(chosen.scene, chosen.out, chosen.error, chosen.seconds)


def sweep_scene(path: Path, out: Path, error: float, seconds: float, say: Say = print) -> None:
    """Sweep every sensor of a scene file; write accuracy.csv, accuracy.png and recommended.toml.

    Raises
    ------
    SpecError : the scene cannot be used, or has no sensor; an error or a time that is not above 0.
    """
    for key, value in (("--error", error), ("--seconds", seconds)):
        if not value > 0:
            raise SpecError(key, f"{value:g} is out of range; use more than 0")
    scene = forest.read(path)
    if not scene.sensors:
        raise SpecError(str(path), "has no sensor; give it [[sensors]]")
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
    chosen = [sweep.choice(error, seconds) for sweep in sweeps]
    for sweep in sweeps:
        _tell(sweep, error, seconds, say)
    _write(sweeps, out / "accuracy.csv")
    columns = min(len(sweeps), COLUMNS)
    rows = math.ceil(len(sweeps) / columns)
    figure = blank_figure((6.6 * columns, 3.7 * rows))
    for number, (sweep, best) in enumerate(zip(sweeps, chosen, strict=True)):
        _draw(figure.add_subplot(rows, columns, number + 1), sweep, best)
    save_figure(figure, out / "accuracy.png")
    better = {
        sweep.sensor.name: replace(sweep.sensor, **point.changes)
        for sweep, point in zip(sweeps, chosen, strict=True)
    }
    sensors = tuple(better.get(sensor.name, sensor) for sensor in scene.sensors)
    engines = {point.engine for point in chosen if point.engine}
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
        colour = RED if point is sweep.today else INK
        low = min(point.spread, 0.9 * _height(point)) or None
        axes.errorbar(point.seconds, _height(point), yerr=low, fmt="none", ecolor=colour, zorder=2)
        ring = {"mec": LEAF_GREEN, "mew": 2.5} if point is best else {"mec": "white", "mew": 0.8}
        inner = "white"
        if point.elsewhere:  # hollow: no setting of the scene file
            ring, inner, colour = {"mec": INK, "mew": 1.2}, INK, "white"
        axes.plot(point.seconds, _height(point), "o", ms=12, color=colour, zorder=3, **ring)
        axes.annotate(
            str(number),
            (point.seconds, _height(point)),
            color=inner,
            fontsize=8,
            ha="center",
            va="center_baseline",
            zorder=4,
        )
        roles = (("today", sweep.today), ("recommended", best))
        said = " and ".join(role for role, one in roles if point is one)
        said = said or (point.elsewhere and f"hollow: {point.elsewhere}")
        if point.error == 0:
            said = f"{said}; off by 0" if said else "off by 0"
        words = f"{number}  {point.label}" + (f"\n    ({said})" if said else "")
        key.append(Line2D([], [], marker="o", ls="", ms=8, color=colour, label=words, **ring))
    heights, seconds = [_height(p) for p in sweep.all], [p.seconds for p in sweep.all]
    if sweep.model is not None and sweep.model[0] > 0:
        axes.axhline(sweep.model[0], color=RED, ls=":", lw=1)
        heights.append(sweep.model[0])
        words = textwrap.fill(f"the model itself: {sweep.model[1]}", WIDE, subsequent_indent="    ")
        key.append(Line2D([], [], color=RED, ls=":", label=words))
    axes.set(xscale="log", yscale="log", xlabel="CPU seconds")
    axes.set_xlim(*_around(seconds))
    axes.set_ylim(*_around(heights))
    axes.set_title(f"{sweep.sensor.name}: {sweep.what}")
    axes.set_ylabel("error" + (f", {sweep.unit}" if sweep.unit else ", share"))
    for axis, values in ((axes.xaxis, seconds), (axes.yaxis, heights)):
        low, high = _around(values)
        few = high / low < FEW  # decades: numbers between them too
        axis.set_minor_locator(LogLocator(subs=(2.0, 5.0) if few else tuple(range(2, 10))))
        axis.set_minor_formatter(FuncFormatter(lambda x, _: f"{x:.1g}") if few else NullFormatter())
        if few:
            axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:.1g}"))
    axes.legend(handles=key, loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=8)


def _height(point: Point) -> float:
    return max(point.error, FLOOR) if math.isfinite(point.error) else FLOOR


def _around(values: list[float]) -> tuple[float, float]:
    """Limits around values with room for a mark, at least LEAST decades apart."""
    low, high = math.log10(min(values)), math.log10(max(values))
    more = max(ROOM * (high - low), (LEAST - (high - low)) / 2)
    return 10.0 ** (low - more), 10.0 ** (high + more)
