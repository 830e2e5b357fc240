"""``python -m headless lidar FILE.blend``: scan any Blender scene with a real instrument, into a file.

Nothing of a forest of ours need be in the scene. The scan is written chunk by chunk; one that was
interrupted, or killed, goes on with ``--resume``.
"""

from __future__ import annotations

import argparse
import re
import sys
import time
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from forest_addon.formats.scanner_file import PLATFORMS, merged, read_scanner, scanner_names
from forest_addon.formats.toml_file import structure
from forest_addon.spec import SENSORS, Airborne, Mobile, Rays, Scanner, SpecError, Terrestrial

from ..progress import Stages, hushed

FORMATS = ("laz", "las", "ply", "npz")

EPILOG = """\
examples:
  python -m headless lidar --list
  python -m headless lidar park.blend --scanner riegl-vz-400i --at 0,0,1.6
  python -m headless lidar park.blend --scanner riegl-vz-400i --at 0,0,1.6 \\
      --azimuth=-30,30 --set angle_step_deg=0.1 --set beam.subrays=37 --out scan.ply
  python -m headless lidar park.blend --scanner riegl-minivux-1uav --along FlightPath
  python -m headless lidar park.blend --scanner riegl-vq-780i --at 0,-200,800 --azimuth 90

--set takes any setting of a scene file's sensor. A scan that was interrupted goes on
with the same command and --resume, to the same bytes."""


def add_lidar(commands: argparse._SubParsersAction) -> None:
    """The command's arguments."""
    lidar = commands.add_parser(
        "lidar",
        help="scan a .blend of your own with a real instrument",
        description="Scan a Blender scene as it is evaluated, and write a point cloud with labels.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    lidar.add_argument("blend", type=Path, nargs="?", metavar="FILE.blend", help="the scene")
    lidar.add_argument("--list", action="store_true", help="print the scanners that are known")
    lidar.add_argument("--scanner", metavar="NAME", help="a scanner of --list, or a .toml file")
    lidar.add_argument("--at", metavar="X,Y,Z", help="where it stands, or where a flight starts, m")
    lidar.add_argument("--along", metavar="OBJECT", help="curve or animated object that it follows")
    lidar.add_argument(
        "--azimuth", metavar="DEG", help="FROM,TO of a tripod, heading of a flight; from +X to +Y"
    )
    lidar.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="any other setting"
    )
    lidar.add_argument("--seed", type=int, default=0, help="seed of noise and chances (default 0)")
    lidar.add_argument(
        "--offset", metavar="X,Y,Z", help="added to coordinates as they are written (UTM), m"
    )
    lidar.add_argument("--out", type=Path, metavar="FILE", help="default out/FILE-NAME.laz")
    lidar.add_argument("--format", choices=FORMATS, help="default: as --out ends, else laz")
    lidar.add_argument("--resume", action="store_true", help="go on with an unfinished scan")
    lidar.add_argument("--chunk", type=int, metavar="N", help="pulses between two savings")
    lidar.add_argument(
        "--engine", default="auto", choices=("auto", "bvhtree", "embree"), help="who casts rays"
    )
    lidar.add_argument("--quiet", action="store_true", help="say nothing but errors")
    lidar.set_defaults(do=run_lidar)


def with_values_joined(words: Sequence[str]) -> list[str]:
    """Arguments in which ``--at -1,2,3`` is one word; argparse takes -1,2,3 for an option."""
    joined: list[str] = []
    for word in words:
        if joined and joined[-1] in ("--at", "--azimuth", "--offset") and re.match(r"-[\d.]", word):
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return joined


def target_of(chosen: argparse.Namespace) -> Path:
    """The file that a scan goes to."""
    if chosen.out is None:
        blend = chosen.blend.stem if chosen.blend else "scan"
        name = f"{blend}-{Path(chosen.scanner or 'lidar').stem}"
        return Path("out") / f"{name}.{chosen.format or 'laz'}"
    if chosen.format and chosen.out.suffix != f".{chosen.format}":
        return Path(f"{chosen.out}.{chosen.format}")
    return Path(chosen.out)


def run_lidar(chosen: argparse.Namespace) -> int:
    """List scanners, or scan.

    Raises
    ------
    SpecError : an argument or a scene that cannot be used.
    OSError : a file that cannot be read or written; what was scanned is kept.
    """
    if chosen.list:
        list_scanners()
        return 0
    if chosen.seed < 0:
        raise SpecError("--seed", f"{chosen.seed} is out of range; use at least 0")
    if chosen.chunk is not None and chosen.chunk < 1:
        raise SpecError("--chunk", f"{chosen.chunk} is out of range; use at least 1")
    sensor = sensor_of(chosen)
    offset = _numbers("--offset", chosen.offset, 3) if chosen.offset else (0.0, 0.0, 0.0)
    target = target_of(chosen)
    if target.suffix.lstrip(".") not in FORMATS:
        raise SpecError(f"--out {target}", f"must end in one of .{', .'.join(FORMATS)}")
    _scan(chosen, sensor, target, offset)
    return 0


def list_scanners() -> None:
    """Print every preset: platforms, range, divergence, rate."""
    print(f"{'scanner':<20}{'instrument':<34}{'on':<22}{'range, m':>10}{'mrad':>12}{'kHz':>7}")
    for name in scanner_names():
        file = read_scanner(name)
        kind, table = next(iter(file.tables.items()))
        sensor = structure(table, SENSORS[kind])
        assert isinstance(sensor, Scanner)
        spread = " x ".join(f"{a:g}" for a in dict.fromkeys(sensor.beam.divergence_mrad))
        print(
            f"{name:<20}{file.title:<34}{', '.join(file.tables):<22}"
            f"{sensor.max_range:>10g}{spread:>12}{sensor.pulse_rate / 1e3:>7.0f}"
        )


def sensor_of(chosen: argparse.Namespace) -> Scanner:
    """The sensor that the arguments say.

    Raises
    ------
    SpecError : what is missing or cannot be used.
    """
    if chosen.blend is None:
        raise SpecError("lidar", "needs a .blend file; --list prints the scanners")
    if not chosen.scanner:
        raise SpecError("--scanner", "is missing; --list prints the scanners")
    tables = read_scanner(chosen.scanner).tables
    kind = _kind(chosen, tables)
    table: dict[str, Any] = {"name": "scan", "scanner": chosen.scanner}
    if chosen.at:
        table["position"] = _numbers("--at", chosen.at, 3)
    if chosen.along:
        table["follow"] = chosen.along
    if chosen.azimuth and kind == "terrestrial":
        table["azimuth_deg"] = _numbers("--azimuth", chosen.azimuth, 2)
    elif chosen.azimuth:
        table["heading_deg"] = _numbers("--azimuth", chosen.azimuth, 1)[0]
    for word in chosen.set:
        table = merged(table, _setting(word))
    settings: type[Scanner] = {"terrestrial": Terrestrial, "mobile": Mobile, "airborne": Airborne}[
        kind
    ]
    return structure(merged(tables[kind], table), settings)


def _kind(chosen: argparse.Namespace, tables: Mapping[str, Any]) -> str:
    """The platform: what it follows makes it mobile, a place a tripod or an aircraft."""
    if chosen.along:
        able: tuple[str, ...] = ("mobile",)
    elif chosen.at:
        able = ("terrestrial", "airborne")
    else:
        raise SpecError("--at", "is missing; say where the scanner stands: --at x,y,z")
    kind = next((k for k in able if k in tables), None)
    if kind is None:
        needed = "--at" if chosen.along else "--along OBJECT"
        raise SpecError(
            "--scanner",
            f'"{chosen.scanner}" is no {" or ".join(able)} scanner; use {needed}, or one of '
            + ", ".join(n for n in scanner_names() if set(able) & set(read_scanner(n).tables)),
        )
    assert kind in PLATFORMS
    return kind


def _numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        shown = ",".join(("1.5", "0", "2")[:count])
        raise SpecError(option, f'"{text}" is not {count} numbers with commas, as in {shown}')
    return numbers


def _setting(word: str) -> dict[str, Any]:
    key, equals, value = word.partition("=")
    lines = (f"{key} = {value}", f'{key} = "{value}"')  # a text needs no quotes here
    for line in lines if equals else ():
        try:
            return tomllib.loads(line)
        except tomllib.TOMLDecodeError:
            continue
    raise SpecError("--set", f'"{word}" is not KEY=VALUE, as in beam.subrays=19')


def _scan(
    chosen: argparse.Namespace, sensor: Scanner, target: Path, offset: tuple[float, ...]
) -> None:
    stages = Stages(chosen.quiet)
    if not chosen.blend.is_file():
        raise SpecError(str(chosen.blend), "there is no such file; check the path")
    target.parent.mkdir(parents=True, exist_ok=True)
    with hushed():
        import bpy
    try:
        with stages.stage(f"open {chosen.blend.name}"), hushed(errors=True):
            _open(chosen.blend)
        _scan_opened(chosen, sensor, target, offset, stages)
    finally:
        with hushed():  # with an evaluated scene at hand, bpy 4.5 never ends
            bpy.ops.wm.read_factory_settings(use_empty=True)


def _open(blend: Path) -> None:
    import bpy

    try:
        bpy.ops.wm.open_mainfile(filepath=str(blend.resolve()), load_ui=False, use_scripts=False)
    except RuntimeError:
        raise SpecError(str(blend), "is no .blend file that Blender can open") from None


def _scan_opened(
    chosen: argparse.Namespace,
    sensor: Scanner,
    target: Path,
    offset: tuple[float, ...],
    stages: Stages,
) -> None:
    import bpy

    from forest_addon.blender.observe import Observer
    from forest_addon.blender.platform import path_of_object
    from forest_addon.formats.scan_file import write_scan
    from forest_addon.sensing.lidar.scan import Scan

    with stages.stage("read evaluated scene"):
        observer = Observer(bpy.context.evaluated_depsgraph_get(), Rays(engine=chosen.engine))
        if not len(observer.geometry):
            raise SpecError(
                str(chosen.blend), "has nothing to scan: no visible object of its scene has faces"
            )
        caster = observer.caster
    if observer.warning:
        stages.say(f"  Warning: {observer.warning}")
    path = path_of_object(bpy.context.scene, sensor) if isinstance(sensor, Mobile) else None
    scan = Scan(sensor, caster, chosen.seed, path)  # type: ignore[arg-type]
    started = time.perf_counter()
    with stages.stage(f"scan {scan.pulses:,} pulses") as progress:
        done = write_scan(
            target,
            scan,
            chosen.seed,
            offset=offset,  # type: ignore[arg-type]
            resume=chosen.resume,
            at_once=chosen.chunk,
            progress=progress,
        )
    took = time.perf_counter() - started
    stages.say(
        f"{done.path}: {done.points:,} points of {done.pulses:,} pulses by {caster.engine}, "
        f"{(done.pulses - done.resumed_at) / took:,.0f} pulses/s"
    )
    for lost in done.lost:
        text = f"Not measured, by a fault of this program that is worth a report: {lost}"
        print(text, file=sys.stderr, flush=True)  # whoever wants no words but errors wants this one
