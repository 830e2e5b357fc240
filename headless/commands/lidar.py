"""``python -m headless lidar FILE.blend``: scan any Blender scene with a real instrument, into a file.

Nothing of a forest of ours need be in the scene. The scan is written chunk by chunk; one that was
interrupted, or killed, goes on with ``--resume``.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from forest_addon.spec import SENSORS, Airborne, Mobile, Rays, Scanner, SpecError, Terrestrial

from ..command import Command, refuse_beyond
from ..progress import Stages, hushed

if TYPE_CHECKING:
    from forest_addon.results.coordinates import Offset


FORMATS = ("laz", "las", "copc.laz", "ply", "double.ply", "pcd", "npz")


class LidarCommand(Command):
    name = "lidar"
    help = "scan a .blend or mesh file of your own with a real instrument"
    is_folder = False
    description = "Scan a Blender scene as it is evaluated, and write a point cloud with labels."
    epilog = """\
examples:
  python -m headless lidar --list
  python -m headless lidar park.blend --scanner riegl-vz-400i --at 0,0,1.6
  python -m headless lidar park.blend --scanner riegl-vz-400i --at 0,0,1.6 \\
      --azimuth=-30,30 --set angle_step_deg=0.1 --set beam.subrays=37 --out scan.ply
  python -m headless lidar park.blend --scanner riegl-minivux-1uav --along FlightPath
  python -m headless lidar park.blend --scanner riegl-vq-780i --at 0,-200,800 --azimuth 90
  python -m headless lidar --like real.laz --scanner riegl-vux-1uav --out out/like.toml
  python -m headless lidar --survey data/surveys/demo/tls_plane.xml --out plane.laz

--set takes any setting of a scene file's sensor. A scan that was interrupted goes on
with the same command and --resume, to the same bytes."""

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument(
            "blend",
            type=Path,
            nargs="?",
            metavar="FILE.blend",
            help="the scene: .blend, or glTF (.glb, .gltf), .obj, .ply, .stl, USD",
        )
        parser.add_argument(
            "--survey",
            type=Path,
            metavar="FILE.xml",
            help="a survey of HELIOS++ with all it names, in place of a .blend; a file a leg",
        )
        parser.add_argument(
            "--assets", type=Path, metavar="FOLDER", help="where paths in the survey start"
        )
        parser.add_argument(
            "--reference",
            type=Path,
            metavar="FILE.json",
            help="points and pulses by returns of each leg, to be held beside ours",
        )
        parser.add_argument(
            "--echoes",
            choices=("survey", "waveform"),
            help="with --survey: echoes as HELIOS++ finds them, by the survey's bins and window (default), "
            "or of the waveform without bins, as in our own scans",
        )
        parser.add_argument(
            "--like",
            type=Path,
            metavar="REAL.laz",
            help="write a scene that is flown as this cloud was; --scanner takes an instrument's light",
        )
        parser.add_argument(
            "--trajectory",
            type=Path,
            metavar="FILE",
            help="with --like: its way, as CSV (time_s, x_m, y_m, z_m, heading_deg, pitch_deg, "
            "roll_deg) or SBET",
        )
        parser.add_argument(
            "--trees",
            type=Path,
            metavar="TABLE",
            help="with --like: the trees that stand there, planted as measured on the cloud's ground",
        )
        parser.add_argument(
            "--species",
            action="append",
            default=[],
            metavar="NAME=PRESET",
            help="with --trees: what to plant for a name of the table, or PRESET alone for all",
        )
        parser.add_argument("--list", action="store_true", help="print the scanners that are known")
        parser.add_argument(
            "--scanner", metavar="NAME", help="a scanner of --list, or a .toml file"
        )
        parser.add_argument(
            "--at", metavar="X,Y,Z", help="where it stands, or where a flight starts, m"
        )
        parser.add_argument(
            "--along", metavar="OBJECT", help="curve or animated object that it follows"
        )
        parser.add_argument(
            "--azimuth",
            metavar="DEG",
            help="FROM,TO of a tripod, heading of a flight; from +X to +Y",
        )
        parser.add_argument(
            "--set", action="append", default=[], metavar="KEY=VALUE", help="any other setting"
        )
        parser.add_argument(
            "--seed", type=int, default=0, help="seed of noise and chances (default 0)"
        )
        parser.add_argument(
            "--offset", metavar="X,Y,Z", help="added to coordinates as they are written (UTM), m"
        )
        parser.add_argument(
            "--crs", default="", metavar="EPSG:N", help="their coordinate system, told in LAS files"
        )
        parser.add_argument("--out", type=Path, metavar="FILE", help="default out/FILE-NAME.laz")
        parser.add_argument("--format", choices=FORMATS, help="default: as --out ends, else laz")
        parser.add_argument("--resume", action="store_true", help="go on with an unfinished scan")
        parser.add_argument("--chunk", type=int, metavar="N", help="pulses between two savings")
        parser.add_argument(
            "--engine", default="auto", choices=("auto", "bvhtree", "embree"), help="who casts rays"
        )
        parser.add_argument(
            "--quiet", action="store_true", help="say nothing but warnings and errors"
        )

    def output(self, chosen: argparse.Namespace) -> Path:
        if chosen.out is None:
            if chosen.like:
                return Path("out") / f"like-{chosen.like.stem}.toml"
            if chosen.survey:
                return Path("out") / f"{chosen.survey.stem}.{chosen.format or 'laz'}"
            blend = chosen.blend.stem if chosen.blend else "scan"
            name = f"{blend}-{Path(chosen.scanner or 'lidar').stem}"
            return Path("out") / f"{name}.{chosen.format or 'laz'}"
        if chosen.format and not chosen.out.name.endswith(f".{chosen.format}"):
            return Path(f"{chosen.out}.{chosen.format}")
        return Path(chosen.out)

    def lock(self, chosen: argparse.Namespace) -> Path | None:
        return None if chosen.list else chosen.out.with_name(f".{chosen.out.stem}.lock")

    def kept(self, chosen: argparse.Namespace) -> str:
        if chosen.like:
            return "nothing was written"
        if chosen.survey:
            return f"legs that were finished are kept beside {chosen.out}"
        return f"what was scanned is kept beside {chosen.out}; --resume goes on with it"

    def run(self, chosen: argparse.Namespace) -> None:
        if chosen.list:
            list_scanners()
            return
        refuse_beyond("--seed", chosen.seed, 0)
        refuse_beyond("--chunk", 1 if chosen.chunk is None else chosen.chunk, 1)
        if chosen.like:
            self._write_like(chosen)
            return
        for option in ("trajectory", "trees", "species"):
            if getattr(chosen, option):
                raise SpecError(f"--{option}", "belongs to --like REAL.laz")
        if chosen.survey:
            self._run_survey(chosen)
            return
        for option in ("assets", "reference", "echoes"):
            if getattr(chosen, option):
                raise SpecError(f"--{option}", "belongs to --survey FILE.xml")
        if chosen.blend is None:
            raise SpecError("lidar", "needs a .blend file; --list prints the scanners")
        sensor = sensor_of(chosen.scanner, chosen.at, chosen.along, chosen.azimuth, chosen.set)
        offset = _offset(chosen)
        if chosen.out.suffix.lower().lstrip(".") not in FORMATS:
            raise SpecError(f"--out {chosen.out}", f"must end in one of .{', .'.join(FORMATS)}")
        scan_blend(
            chosen.blend,
            sensor,
            chosen.out,
            seed=chosen.seed,
            offset=offset,
            engine=chosen.engine,
            resume=chosen.resume,
            at_once=chosen.chunk,
            quiet=chosen.quiet,
        )

    def _write_like(self, chosen: argparse.Namespace) -> None:
        """Write the scene of a cloud.

        Raises
        ------
        SpecError : words that do not go with it, or a cloud that cannot be used.
        """
        from ..surveys import write_like

        words = ("blend", "survey", "at", "along", "azimuth", "set", "resume", "chunk", "format")
        for word in words:
            if getattr(chosen, word):
                option = "FILE.blend" if word == "blend" else f"--{word}"
                raise SpecError(option, "does not go with --like, which writes a scene")
        if chosen.out.suffix != ".toml":
            raise SpecError(f"--out {chosen.out}", "must end in .toml: --like writes a scene")
        planted = {"trees": chosen.trees, "species": chosen.species}
        write_like(
            chosen.like, chosen.out, chosen.scanner, chosen.trajectory, chosen.crs, **planted
        )

    def _run_survey(self, chosen: argparse.Namespace) -> None:
        """Run a survey of HELIOS++.

        Raises
        ------
        SpecError : words that do not go with a survey, or a survey that cannot be used.
        """
        from ..surveys import scan_survey

        words = ("blend", "scanner", "at", "along", "azimuth", "set", "resume", "chunk")
        for word in words:
            if getattr(chosen, word):
                option = "FILE.blend" if word == "blend" else f"--{word}"
                raise SpecError(option, "does not go with --survey, which says all that itself")
        if chosen.out.suffix.lower().lstrip(".") not in FORMATS:
            raise SpecError(f"--out {chosen.out}", f"must end in one of .{', .'.join(FORMATS)}")
        scan_survey(
            chosen.survey,
            chosen.out,
            assets=chosen.assets,
            reference=chosen.reference,
            offset=_offset(chosen),
            seed=chosen.seed,
            engine=chosen.engine,
            echoes=chosen.echoes or "survey",
            quiet=chosen.quiet,
        )


def _offset(chosen: argparse.Namespace) -> Offset:
    """Return what is added to coordinates, and their system.

    Raises
    ------
    SpecError : not three numbers; a system that PROJ does not know, or cannot be told without it.
    """
    from forest_addon.formats.crs import can_tell_crs, wkt_of
    from forest_addon.results.coordinates import Offset

    if chosen.crs and not can_tell_crs():
        raise SpecError("--crs", "needs pyproj; install it by pip install pyproj")
    wkt_of(chosen.crs)
    metres = numbers("--offset", chosen.offset, 3) if chosen.offset else (0.0, 0.0, 0.0)
    return Offset(metres, chosen.crs)


def list_scanners() -> None:
    """Print every preset: platforms, range, divergence, rate."""

    from forest_addon.formats.toml_file import read_scanner, scanner_names, structure

    print(f"{'scanner':<20}{'instrument':<34}{'on':<22}{'range, m':>10}{'mrad':>12}{'kHz':>7}")
    for name in scanner_names():
        file = read_scanner(name)
        kind, table = next(iter(file.tables.items()))
        sensor = structure(table, SENSORS[kind])
        spread = " x ".join(f"{a:g}" for a in dict.fromkeys(sensor.beam.divergence_mrad))
        print(
            f"{name:<20}{file.title:<34}{', '.join(file.tables):<22}"
            f"{sensor.max_range:>10g}{spread:>12}{sensor.pulse_rate / 1e3:>7.0f}"
        )


def sensor_of(
    scanner: str | None,
    at: str | None,
    along: str | None,
    azimuth: str | None,
    changes: Sequence[str] = (),
) -> Scanner:
    """The sensor of a preset at a place "x,y,z" or along an object, with changes "key=value".

    Raises
    ------
    SpecError : what is missing or cannot be used.
    """

    from forest_addon.formats.toml_file import merged, read_scanner, structure

    if not scanner:
        raise SpecError("--scanner", "is missing; --list prints the scanners")
    tables = read_scanner(scanner).tables
    kind = _kind(scanner, at, along, tables)
    table: dict[str, Any] = {"name": "scan", "scanner": scanner}
    if at:
        table["position"] = numbers("--at", at, 3)
    if along:
        table["follow"] = along
    if azimuth and hasattr(SENSORS[kind], "azimuth_deg"):  # a window, on a tripod
        table["azimuth_deg"] = numbers("--azimuth", azimuth, 2)
    elif azimuth:
        table["heading_deg"] = numbers("--azimuth", azimuth, 1)[0]
    for word in changes:
        table = merged(table, _setting(word))
    settings: type[Scanner] = {"terrestrial": Terrestrial, "mobile": Mobile, "airborne": Airborne}[
        kind
    ]
    return structure(merged(tables[kind], table), settings)


def _kind(scanner: str, at: str | None, along: str | None, tables: Mapping[str, Any]) -> str:
    """The platform: what it follows makes it mobile, a place a tripod or an aircraft."""

    from forest_addon.formats.toml_file import PLATFORMS, read_scanner, scanner_names

    if along:
        able: tuple[str, ...] = ("mobile",)
    elif at:
        able = ("terrestrial", "airborne")
    else:
        raise SpecError("--at", "is missing; say where the scanner stands: --at x,y,z")
    kind = next((k for k in able if k in tables), None)
    if kind is None:
        needed = "--at" if along else "--along OBJECT"
        raise SpecError(
            "--scanner",
            f'"{scanner}" is no {" or ".join(able)} scanner; use {needed}, or one of '
            + ", ".join(n for n in scanner_names() if set(able) & set(read_scanner(n).tables)),
        )
    assert kind in PLATFORMS
    return kind


def numbers(option: str, text: str, count: int) -> tuple[float, ...]:
    """So many numbers with commas between them.

    Raises
    ------
    SpecError : it is something else.
    """
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != count:
        shown = ",".join(("1.5", "0", "2")[:count])
        raise SpecError(option, f'"{text}" is not {count} numbers with commas, as in {shown}')
    return numbers


def _setting(word: str) -> dict[str, Any]:
    from forest_addon.formats.toml_file import parse_tables

    key, equals, value = word.partition("=")
    lines = (f"{key} = {value}", f'{key} = "{value}"')  # a text needs no quotes here
    for line in lines if equals else ():
        try:
            return parse_tables(line, "--set")
        except SpecError:
            continue
    raise SpecError("--set", f'"{word}" is not KEY=VALUE, as in beam.subrays=19')


def scan_blend(
    blend: Path,
    sensor: Scanner,
    target: Path,
    *,
    seed: int = 0,
    offset: Offset,
    engine: str = "auto",
    resume: bool = False,
    at_once: int | None = None,
    quiet: bool = False,
) -> None:
    """Scan a .blend file into a file of points.

    resume : go on with a scan that was not finished. at_once : pulses between two savings.

    Raises
    ------
    SpecError : a scene that cannot be used.
    OSError : a file that cannot be read or written; what was scanned is kept.
    """

    import numpy as np

    from forest_addon.formats.helios.parts import lost_materials
    from forest_addon.results.scan_file import write_scan
    from forest_addon.sensing.kind import why_nothing
    from forest_addon.sensing.kinds import kind_of
    from forest_addon.sensing.lidar.pattern import pattern_of
    from forest_addon.sensing.lidar.scan import Scan

    stages = Stages(quiet)
    with hushed():
        import bpy

        from forest_addon.blender.files.export import empty_file, open_file
        from forest_addon.blender.sensors.observe import Observer
    try:
        with stages.stage(f"open {blend.name}"), hushed(errors=True):
            open_file(blend)
        for lost in lost_materials(blend):
            stages.warn(lost)
        with stages.stage("read evaluated scene"):
            observer = Observer(bpy.context.evaluated_depsgraph_get(), Rays(engine=engine))
            if not len(observer.geometry):
                raise SpecError(
                    str(blend), "has nothing to scan: no visible object of its scene has faces"
                )
            caster = observer.caster
        if observer.warning:
            stages.warn(observer.warning)
        way = observer.way(sensor)
        cost = kind_of(sensor).cost(sensor, way, caster.engine)
        stages.say(f"  {replace(cost, memory=0)}")  # points go to the disk as they come
        observer.prepare(sensor, way)
        scan = Scan(sensor, observer.eyes(sensor), seed, way)  # type: ignore[arg-type]
        started = time.perf_counter()
        with stages.stage(f"scan {scan.pulses:,} pulses") as progress:
            done = write_scan(
                target,
                scan,
                seed,
                offset=offset,
                resume=resume,
                at_once=at_once,
                progress=progress,
            )
        took = time.perf_counter() - started
        if not done.points:
            some = np.linspace(0, scan.pulses - 1, 50).astype(np.int64)
            where = pattern_of(sensor, way).pulses(some).origin
            nothing = why_nothing("0 points", where, sensor.max_range, observer.geometry)
            stages.warn(nothing)
        stages.say(
            f"{done.path}: {done.points:,} points of {done.pulses:,} pulses by {caster.engine}, "
            f"{(done.pulses - done.resumed_at) / took:,.0f} pulses/s"
        )
        if done.unfollowed:
            stages.say(
                f"  {done.unfollowed:,} turned rays met a second mirror, glass or water, and end there"
            )
        for lost in done.lost:
            text = f"Not measured, by a fault of this program that is worth a report: {lost}"
            print(
                text, file=sys.stderr, flush=True
            )  # whoever wants no words but errors wants this one
    finally:
        with hushed():  # with an evaluated scene at hand, bpy 4.5 never ends
            empty_file()
