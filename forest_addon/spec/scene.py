"""A whole scene: forest, air, sensors, and what is written."""

from __future__ import annotations

from typing import ClassVar

from .air import Air
from .base import Settings, SpecError, param
from .flight import Flight
from .forest import Forest, Planting, Stems
from .lidar import Airborne, Mobile, Terrestrial, Tractor
from .reverb import Reverb
from .sensor import Sensor
from .sonar import Sonar
from .wind import Wind

SENSORS = Sensor.KINDS
SENSORS |= {
    "tractor": Tractor,
    "terrestrial": Terrestrial,
    "mobile": Mobile,
    "airborne": Airborne,
    "sonar": Sonar,
    "reverb": Reverb,
}


class Rays(Settings):
    """Settings of the ray engine; results do not depend on it."""

    TITLE: ClassVar[str] = "Rays"
    engine: str = param(
        "auto",
        help="Blender's own Embree, its BVHTree, or the first of them that works",
        choices=("auto", "bvhtree", "embree"),
    )
    threads: int = param(0, help="threads of Embree; 0: as many as there are cores", ge=0, le=1024)


class Accuracy(Settings):
    """Accuracy: how results are checked, and how much of a forest is modelled for them."""

    audit: float = param(
        0.05,
        help="time for checking a result, as a share of the time that it took; 0: no check",
        ge=0,
        le=10,
    )
    detail: str = param(
        "full",
        help="what is modelled: all as it is set, or (auto) of that what the scene's sensors can tell apart: "
        "far trees have fewer, larger leaves, thin beams finer branches; each with its bound in the report",
        choices=("full", "auto"),
    )
    relief: bool = param(
        False,
        help="stems with the relief of their bark and their oval shape, for scans that can tell them",
    )


class Output(Settings):
    """Files written besides the sensors' results, ``trees.csv`` and ``run.json``.

    One scene takes what is wanted to look at it; of thousands in a row each picture and test costs more
    than the scan.
    """

    pictures: bool = param(True, help="draw the stand and what each sensor found, as PNG")
    goodness: bool = param(
        True, help="test where trees stand against other stands of the same settings"
    )
    leaves: bool = param(True, help="write leaves.npz, the truth of every leaf")
    report: bool = param(True, help="write report.html")
    blend: bool = param(True, help="write forest.blend")
    glb: bool = param(True, help="write forest.glb")
    usd: bool = param(False, help="write forest.usdc, Universal Scene Description")
    qsm: bool = param(
        False,
        help="write all branches as cylinders: cylinders.csv, and qsm/ with a TreeQSM file a tree",
    )
    preview: bool = param(True, help="render preview.png with Cycles")
    preview_from: str = param(
        "whole",
        help="where the preview is taken from",
        choices=("whole", "walker"),
    )
    preview_size: tuple[int, int] = param(
        (1280, 640), unit="px", help="width and height of the preview", ge=16, le=8192
    )
    preview_samples: int = param(20, help="samples a pixel of the preview", ge=1, le=65536)


class Tiles(Settings):
    """Tiles in which a field is grown and looked at that is larger than memory; results do not depend on it.

    Where trees stand is drawn for the whole field at once. What is built and scanned at a time is a tile with
    a buffer around it.
    """

    TITLE: ClassVar[str] = "Tiles"
    size: float = param(
        0.0, unit="m", help="length of a tile's edges; 0: the field is one scene", ge=0, le=1e5
    )
    buffer: float = param(
        30.0,
        unit="m",
        help="how far beyond its edges a tile's scene has trees; pulses that leave it are followed in a "
        "larger one, and counted",
        ge=0,
        le=1e4,
    )
    files: str = param(
        "merged",
        help="point clouds: one file of each scan, one file of each tile, or both",
        choices=("merged", "tiles", "both"),
    )


class Scene(Settings):
    """A whole scene: forest, air, sensors, output. One seed decides every draw."""

    name: str = param("forest", help="title of the scene")
    seed: int = param(0, help="one seed for the whole scene", ge=0, le=2**63 - 1)
    offset: tuple[float, float, float] = param(
        (0.0, 0.0, 0.0),
        unit="m",
        help="added to coordinates that are written, in double precision: a map's origin (UTM)",
        ge=-1e8,
        le=1e8,
    )
    crs: str = param("", help="coordinate system of what is written, such as EPSG:32632")
    blend: str = param(
        "",
        help="Blender file to start from, whose objects the settings name; left out: an empty one",
    )
    forest: Forest = param(Forest(), help="the field")
    plantings: tuple[Planting, ...] = param((), help="species and where they stand", most=1000)
    stems: tuple[Stems, ...] = param(
        (), help="trees that are cylinders only, for reverb", most=1000
    )
    air: Air = param(Air(), help="the air")
    wind: Wind = param(Wind(), help="the wind in which trees sway")
    rays: Rays = param(Rays(), help="how rays are cast")
    sensors: tuple[Sensor, ...] = param((), help="what looks at the forest", most=10_000)
    flight: Flight = param(Flight(), help="a flyer that finds its way")
    accuracy: Accuracy = param(Accuracy(), help="how results are checked, and what is modelled")
    output: Output = param(Output(), help="what is written")
    tiles: Tiles = param(Tiles(), help="tiles of a field that is larger than memory")

    def check(self) -> None:
        seen: dict[str, int] = {}
        for index, sensor in enumerate(self.sensors):
            name = sensor.name
            if not name or not all(c.isalnum() or c in "-_" for c in name):
                raise SpecError(
                    f"sensors[{index}].name", f'"{name}" must be letters, digits, "-" and "_"'
                )
            if name in seen:
                raise SpecError(
                    f"sensors[{index}].name",
                    f'"{name}" is taken by sensors[{seen[name]}]; give each sensor a name of its own',
                )
            seen[name] = index
