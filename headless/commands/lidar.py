"""``python -m headless lidar FILE.blend``: scan any Blender scene with a real instrument, into a file."""

from __future__ import annotations

import argparse
from pathlib import Path

from forest_addon.spec import SpecError

from ..command import Command, refuse_negative

FORMATS = ("laz", "las", "ply", "npz")


class LidarCommand(Command):
    name = "lidar"
    help = "scan a .blend of your own with a real instrument"
    description = "Scan a Blender scene as it is evaluated, and write a point cloud with labels."
    epilog = """\
examples:
  python -m headless lidar --list
  python -m headless lidar park.blend --scanner riegl-vz-400i --at 0,0,1.6
  python -m headless lidar park.blend --scanner riegl-vz-400i --at 0,0,1.6 \\
      --azimuth=-30,30 --set angle_step_deg=0.1 --set beam.subrays=37 --out scan.ply
  python -m headless lidar park.blend --scanner riegl-minivux-1uav --along FlightPath
  python -m headless lidar park.blend --scanner riegl-vq-780i --at 0,-200,800 --azimuth 90

--set takes any setting of a scene file's sensor. A scan that was interrupted goes on
with the same command and --resume, to the same bytes."""

    def arguments(self, parser: argparse.ArgumentParser) -> None:
        parser.add_argument("blend", type=Path, nargs="?", metavar="FILE.blend", help="the scene")
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
            blend = chosen.blend.stem if chosen.blend else "scan"
            name = f"{blend}-{Path(chosen.scanner or 'lidar').stem}"
            return Path("out") / f"{name}.{chosen.format or 'laz'}"
        if chosen.format and chosen.out.suffix != f".{chosen.format}":
            return Path(f"{chosen.out}.{chosen.format}")
        return Path(chosen.out)

    def lock(self, chosen: argparse.Namespace) -> Path | None:
        return None if chosen.list else chosen.out.with_name(f".{chosen.out.stem}.lock")

    def kept(self, chosen: argparse.Namespace) -> str:
        return f"what was scanned is kept beside {chosen.out}; --resume goes on with it"

    def run(self, chosen: argparse.Namespace) -> None:
        from .work.lidar import list_scanners, numbers, scan_blend, sensor_of

        if chosen.list:
            list_scanners()
            return
        refuse_negative(chosen.seed)
        if chosen.chunk is not None and chosen.chunk < 1:
            raise SpecError("--chunk", f"{chosen.chunk} is out of range; use at least 1")
        if chosen.blend is None:
            raise SpecError("lidar", "needs a .blend file; --list prints the scanners")
        sensor = sensor_of(chosen.scanner, chosen.at, chosen.along, chosen.azimuth, chosen.set)
        offset = numbers("--offset", chosen.offset, 3) if chosen.offset else (0.0, 0.0, 0.0)
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
