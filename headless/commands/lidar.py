"""``python -m headless lidar FILE.blend``: scan any Blender scene with a real instrument, into a file."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from forest_addon.spec import SpecError

from ..command import Command, refuse_negative

if TYPE_CHECKING:
    from forest_addon.results.coordinates import Offset

FORMATS = ("laz", "las", "copc.laz", "ply", "npz")


class LidarCommand(Command):
    name = "lidar"
    help = "scan a .blend of your own with a real instrument"
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
        parser.add_argument("blend", type=Path, nargs="?", metavar="FILE.blend", help="the scene")
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
        parser.add_argument("--quiet", action="store_true", help="say nothing but errors")

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
        from .work.lidar import list_scanners, scan_blend, sensor_of

        if chosen.list:
            list_scanners()
            return
        refuse_negative(chosen.seed)
        if chosen.chunk is not None and chosen.chunk < 1:
            raise SpecError("--chunk", f"{chosen.chunk} is out of range; use at least 1")
        if chosen.like:
            self._write_like(chosen)
            return
        if chosen.trajectory:
            raise SpecError("--trajectory", "belongs to --like REAL.laz")
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
        if chosen.out.suffix.lstrip(".") not in FORMATS:
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
        from .work.like import write_like

        words = ("blend", "survey", "at", "along", "azimuth", "set", "resume", "chunk", "format")
        for word in words:
            if getattr(chosen, word):
                option = "FILE.blend" if word == "blend" else f"--{word}"
                raise SpecError(option, "does not go with --like, which writes a scene")
        if chosen.out.suffix != ".toml":
            raise SpecError(f"--out {chosen.out}", "must end in .toml: --like writes a scene")
        write_like(chosen.like, chosen.out, chosen.scanner, chosen.trajectory, chosen.crs)

    def _run_survey(self, chosen: argparse.Namespace) -> None:
        """Run a survey of HELIOS++.

        Raises
        ------
        SpecError : words that do not go with a survey, or a survey that cannot be used.
        """
        from .work.survey import ScanChoice, scan_survey

        words = ("blend", "scanner", "at", "along", "azimuth", "set", "resume", "chunk")
        for word in words:
            if getattr(chosen, word):
                option = "FILE.blend" if word == "blend" else f"--{word}"
                raise SpecError(option, "does not go with --survey, which says all that itself")
        if chosen.out.suffix.lstrip(".") not in FORMATS:
            raise SpecError(f"--out {chosen.out}", f"must end in one of .{', .'.join(FORMATS)}")
        scan_survey(
            chosen.survey,
            chosen.out,
            assets=chosen.assets,
            reference=chosen.reference,
            offset=_offset(chosen),
            choice=ScanChoice(chosen.seed, chosen.engine, chosen.echoes or "survey"),
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

    from .work.lidar import numbers

    if chosen.crs and not can_tell_crs():
        raise SpecError("--crs", "needs pyproj; install it by pip install pyproj")
    wkt_of(chosen.crs)
    metres = numbers("--offset", chosen.offset, 3) if chosen.offset else (0.0, 0.0, 0.0)
    return Offset(metres, chosen.crs)
