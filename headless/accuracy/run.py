"""A scene through all sweeps: a table, a picture, and the scene with the settings recommended."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from forest_addon import api as forest
from forest_addon.base.progress import Say
from forest_addon.blender.sensors.observe import Observer
from forest_addon.formats.table import write_csv
from forest_addon.formats.toml_file import write_settings
from forest_addon.sensing.kinds import choose
from forest_addon.spec import Scene, Sensor, SpecError

from ..progress import Stages, hushed
from .lidar import sweep_scanner, sweep_tractor
from .meshes import Meshes
from .picture import draw_sweeps
from .reverb import sweep_reverb
from .sonar import sweep_sonar
from .sweep import AccuracySweep


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
                sweeps.append(sweep_sensor(sensor, observer, scene, meshes))
    if not sweeps:
        return
    chosen = [sweep.choice(error, seconds) for sweep in sweeps]
    for sweep in sweeps:
        _tell(sweep, error, seconds, say)
    _write(sweeps, out / "accuracy.csv")
    draw_sweeps(sweeps, chosen, out / "accuracy.png")
    better = {
        sweep.sensor.name: replace(sweep.sensor, **point.changes)
        for sweep, point in zip(sweeps, chosen, strict=True)
    }
    sensors = tuple(better.get(sensor.name, sensor) for sensor in scene.sensors)
    engines = {point.engine for point in chosen if point.engine}
    rays = replace(scene.rays, engine=engines.pop()) if len(engines) == 1 else scene.rays
    write_settings(out / "recommended.toml", scene.changed(sensors=sensors, rays=rays))
    say(f"\nWrote {out / 'accuracy.png'}, accuracy.csv and recommended.toml.")


def sweep_sensor(
    sensor: Sensor, observer: Observer, scene: Scene, meshes: Meshes, folder: Path = Path()
) -> AccuracySweep:
    """Sweep the settings of one sensor, of a kind of ``SWEEPS``."""
    sensor, _ = choose(sensor)
    return SWEEPS[sensor.kind](sensor, observer, scene, meshes, folder)


def _of_tractor(
    sensor: Any, observer: Observer, scene: Scene, meshes: Meshes, _folder: Path
) -> AccuracySweep:
    return sweep_tractor(sensor, observer, scene, meshes)


def _of_scanner(
    sensor: Any, observer: Observer, scene: Scene, meshes: Meshes, folder: Path
) -> AccuracySweep:
    return sweep_scanner(sensor, observer, scene, meshes, observer.way(sensor, folder))


def _of_sonar(
    sensor: Any, observer: Observer, scene: Scene, _meshes: Meshes, folder: Path
) -> AccuracySweep:
    return sweep_sonar(sensor, observer, scene, observer.way(sensor, folder), folder)


def _of_reverb(
    sensor: Any, observer: Observer, scene: Scene, _meshes: Meshes, folder: Path
) -> AccuracySweep:
    return sweep_reverb(sensor, observer, scene, folder)


SWEEPS: dict[str, Callable[[Any, Observer, Scene, Meshes, Path], AccuracySweep]] = {
    "tractor": _of_tractor,
    "terrestrial": _of_scanner,
    "mobile": _of_scanner,
    "airborne": _of_scanner,
    "sonar": _of_sonar,
    "reverb": _of_reverb,
}


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
