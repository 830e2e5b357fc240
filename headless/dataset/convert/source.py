"""Scenes of a made dataset as converters take them: clouds with classes and trees, by split.

Classes are those of FOR-instance, so a dataset needs ``keep.for_instance = true``; intensities stand in the
scan's own file, whose points are the same in the same order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from forest_addon.formats.atomic import replacing
from forest_addon.formats.las import read_las
from forest_addon.formats.toml_file import read_tables
from forest_addon.spec import SpecError

from .. import disk
from ..for_instance import CLASSES

ENDING = "-forinstance.laz"
COLOURS = (  # red, green, blue of each class, for viewers
    *((120, 120, 120), (170, 200, 90), (140, 110, 80), (0, 0, 0)),
    *((110, 70, 40), (40, 140, 50), (190, 150, 110)),
)
LEGEND = "legend.csv"


@dataclass(frozen=True)
class LabelledScan:
    """One cloud of a scene. place : (P, 3) metres, on the map. level : (P,) 0 to 1, the echo's strength.

    classes : (P,) uint8, of ``CLASSES``. tree : (P,) int32, 0 where there is none.
    stands : where the scanner stood, metres; None where it moved.
    """

    scene: int
    split: str
    name: str
    place: np.ndarray
    level: np.ndarray
    classes: np.ndarray
    tree: np.ndarray
    stands: np.ndarray | None


def done_scenes(root: Path) -> list[disk.Done]:
    """Return the scenes that a dataset has, in order.

    Raises
    ------
    SpecError : there is none.
    """
    done = list(disk.scenes_done(root)) if (root / disk.SCENES).is_dir() else []
    if not done:
        raise SpecError(
            f"--convert {root}", "holds no finished scene; give the folder of a dataset"
        )
    return done


def scans_of(one: disk.Done) -> Iterator[LabelledScan]:
    """Clouds of a scene, by name.

    Raises
    ------
    SpecError : it has clouds without classes.
    """
    settings = read_tables(one.folder / "scene.toml")
    sensors = {sensor["name"]: sensor for sensor in settings.get("sensors", [])}
    offset = np.array(settings.get("offset", (0.0, 0.0, 0.0)))
    for name in sorted(name for name, points in one.record["points"].items() if points):
        path = one.folder / f"{name}{ENDING}"
        if not path.is_file():
            raise SpecError(
                str(one.folder),
                f"{name} has no classes: make the dataset with keep.for_instance = true",
            )
        cloud = read_las(path)
        sensor = sensors[name]
        stands = offset + sensor["position"] if sensor["kind"] == "terrestrial" else None
        yield LabelledScan(
            scene=one.number,
            split=one.record["split"],
            name=name,
            place=np.asarray(cloud.xyz),
            level=_levels(one.folder, name, len(cloud.points)),
            classes=np.asarray(cloud.classification, dtype=np.uint8),
            tree=np.asarray(cloud["treeID"], dtype=np.int32),
            stands=stands,
        )


def _levels(folder: Path, name: str, count: int) -> np.ndarray:
    """Return strengths of echoes, as LAS has them, between 0 and 1; 1 where no file tells."""
    if (folder / f"{name}.laz").is_file():
        return np.asarray(read_las(folder / f"{name}.laz").intensity) / 65535.0
    return np.ones(count)


def write_legend(path: Path) -> None:
    """Write the classes' numbers, names and colours as CSV."""
    rows = [
        f"{number},{name},{r},{g},{b}"
        for number, (name, (r, g, b)) in enumerate(zip(CLASSES, COLOURS, strict=True))
    ]
    with replacing(path) as text:
        text.write_text("\n".join(["class,name,red,green,blue", *rows, ""]), encoding="utf-8")
