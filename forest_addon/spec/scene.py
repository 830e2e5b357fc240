"""Scene: forest, air, wind, sensors, and what is written."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import ClassVar

from .base import AUTO, Settings, SpecError, param
from .flight import Flight
from .forest import Forest, Planting, Stems
from .lidar import Airborne, Mobile, Terrestrial, Tractor
from .reverb import Reverb
from .sensor import Sensor
from .sonar import Sonar

MOST_TILES = 1e6
LONGEST_NAME = 200  # bytes of a sensor's name: file systems take 255, with what is put behind it


class Air(Settings):
    """The air that sound travels through."""

    temperature_c: float = param(20.0, unit="°C", help="temperature", ge=-40, le=50)
    humidity: float = param(50.0, unit="%", help="relative humidity", gt=0, le=100)
    pressure_kpa: float = param(101.325, unit="kPa", help="pressure", ge=20, le=120)
    sound_speed: float | None = param(
        None,
        unit="m/s",
        help="speed of sound; left out: 343.2·√(T/293.15 K) of ISO 9613-1",
        ge=250,
        le=450,
    )

    def speed(self) -> float:
        """Speed of sound in m/s."""
        if self.sound_speed is not None:
            return self.sound_speed
        return 343.2 * math.sqrt((self.temperature_c + 273.15) / 293.15)


class Wind(Settings):
    """The wind in which trees sway while LiDARs and sonars look; each tree its own way, by the seed."""

    speed: float = param(
        0.0,
        unit="m/s",
        help="mean speed at the height of the trees' tops; 0: trees stand still",
        ge=0,
        le=30,
    )
    direction_deg: float = param(
        240.0, unit="deg", help="where it blows to, from +X towards +Y", ge=-360, le=360
    )
    turbulence: float = param(
        0.3, help="standard deviation of the speed along the wind, over the mean", ge=0, le=0.6
    )


@dataclass(frozen=True)
class Choice:
    """A value that was left to "auto". bound : on the error that it makes, as a share, or in ``unit``, that
    of the value. why : in words.

    asked : what was set, where that was not "auto" but can only be had otherwise.
    sensor : name of the one whose results it concerns; empty: all.
    """

    key: str
    value: float
    bound: float
    why: str
    asked: float | str = AUTO
    unit: str = ""
    sensor: str = ""

    def __str__(self) -> str:
        if self.asked != AUTO:
            return f"{self.key} {self.asked:.0e} is kept {self.why}."
        unit = f" {self.unit}" if self.unit else ""
        value = f"{self.value:.1e}{unit}" if self.value else "none"
        bound = f"off by at most {self.bound:.1e}{unit}" if self.bound else "no change"
        return f"{self.key} was left to auto: {value}, {bound} {self.why}."

    def record(self) -> dict[str, float | str]:
        """Contents of run.json."""
        return asdict(self)


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
        help="share of a result that is computed again to check it; 0: no check",
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
    glb: bool = param(True, help="write forest.glb, for other programs")
    usd: bool = param(False, help="write forest.usdc, Universal Scene Description")
    qsm: bool = param(
        False,
        help="write all branches as cylinders: cylinders.csv, and qsm/ with a TreeQSM file a tree",
    )
    preview: bool | str = param(
        True,
        help='draw preview.png by rays, within seconds; "cycles": render it',
        choices=("cycles",),
    )
    preview_from: str = param(
        "whole",
        help="where the preview is taken from",
        choices=("whole", "walker"),
    )
    preview_size: tuple[int, int] = param(
        (1280, 640), unit="px", help="width and height of the preview", ge=16, le=8192
    )
    preview_samples: int = param(20, help="samples a pixel where Cycles renders", ge=1, le=65536)

    @property
    def blend_or_preview(self) -> bool:
        """Return whether the size of a picture counts."""
        return bool(self.blend or self.preview)


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
        help="point clouds: one file of each scan, one file of each tile, both, or a COPC file of each tile "
        "with a STAC catalogue and a virtual point cloud",
        choices=("merged", "tiles", "both", "copc"),
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
        across = [side / self.tiles.size if self.tiles.size else 1.0 for side in self.forest.size]
        if math.prod(across) > MOST_TILES:
            raise SpecError(
                "tiles.size",
                f"{self.tiles.size:g} m cuts the field into {math.prod(across):,.3g} tiles; give at least "
                f"{math.sqrt(math.prod(self.forest.size) / MOST_TILES):.3g} m",
            )
        seen: dict[str, int] = {}
        for index, sensor in enumerate(self.sensors):
            name = sensor.name
            if not name or not all(c.isalnum() or c in "-_" for c in name):
                raise SpecError(
                    f"sensors[{index}].name", f'"{name}" must be letters, digits, "-" and "_"'
                )
            if len(name.encode()) > LONGEST_NAME:
                raise SpecError(
                    f"sensors[{index}].name",
                    f"has more than {LONGEST_NAME} bytes; give a shorter one",
                )
            if name in seen:
                raise SpecError(
                    f"sensors[{index}].name",
                    f'"{name}" is taken by sensors[{seen[name]}]; give each sensor a name of its own',
                )
            seen[name] = index
