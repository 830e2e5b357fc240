"""Clouds as SemanticKITTI (Behley et al. 2019, arXiv 1904.01416): a sequence a scene, a frame a scan.

::

    sequences/00/velodyne/000000.bin    float32 x, y, z from the scanner, remission 0 to 1
    sequences/00/labels/000000.label    uint32: class in the lower 16 bits, tree in the upper
    sequences/00/poses.txt, calib.txt, times.txt
    semantic-kitti.yaml                 names, colours and sequences of each split, as its tools read them
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from forest_addon.formats.atomic import replacing
from forest_addon.spec import SpecError

from ..disk import Done
from ..for_instance import CLASSES
from .source import COLOURS, LabelledScan, scans_of

MOST_TREES = 2**16 - 1  # that a label's upper half can name
SPLIT_NAMES = {"train": "train", "validation": "valid", "test": "test"}  # as its tools call them
STILL = "1 0 0 0 0 1 0 0 0 0 1 0"


def write_kitti(done: Sequence[Done], out: Path) -> int:
    """Write all scenes; returns how many clouds.

    Raises
    ------
    SpecError : a scene has more trees than a label can name.
    OSError : it cannot be written.
    """
    count = 0
    for one in done:
        folder = out / "sequences" / f"{one.number:02d}"
        for part in ("velodyne", "labels"):
            (folder / part).mkdir(parents=True, exist_ok=True)
        poses = []
        for number, scan in enumerate(scans_of(one)):
            poses.append(_write_frame(scan, folder, number))
            count += 1
        _write_text(folder / "poses.txt", poses)
        _write_text(folder / "calib.txt", [f"{key}: {STILL}" for key in ("P0", "P1", "Tr")])
        _write_text(folder / "times.txt", [str(float(number)) for number in range(len(poses))])
    _write_text(out / "semantic-kitti.yaml", _config(done))
    return count


def _write_frame(scan: LabelledScan, folder: Path, number: int) -> str:
    """Write one cloud about its scanner, of a moving one about its middle; returns the pose."""
    if scan.tree.max(initial=0) > MOST_TREES:
        raise SpecError(
            f"scene {scan.scene:06d}", f"has more than {MOST_TREES} trees; make smaller plots"
        )
    middle = scan.place.mean(axis=0).round() if scan.stands is None else scan.stands
    rows = np.column_stack([scan.place - middle, scan.level]).astype("<f4")
    label = scan.classes.astype("<u4") | (scan.tree.astype("<u4") << 16)
    for part, ending, values in (("velodyne", "bin", rows), ("labels", "label", label)):
        with replacing(folder / part / f"{number:06d}.{ending}") as partial:
            values.tofile(partial)
    x, y, z = middle.tolist()
    return f"1 0 0 {x!r} 0 1 0 {y!r} 0 0 1 {z!r}"


def _config(done: Sequence[Done]) -> list[str]:
    """Return the lines of the file that SemanticKITTI's tools and loaders ask for names and splits."""
    numbers = range(len(CLASSES))
    lines = ["labels:", *(f"  {k}: {CLASSES[k]!r}" for k in numbers)]
    lines += ["color_map: # blue, green, red"]
    lines += [f"  {k}: [{COLOURS[k][2]}, {COLOURS[k][1]}, {COLOURS[k][0]}]" for k in numbers]
    for key in ("learning_map", "learning_map_inv"):
        lines += [f"{key}:", *(f"  {k}: {k}" for k in numbers)]
    lines += ["learning_ignore:", *(f"  {k}: {str(k in (0, 3)).lower()}" for k in numbers)]
    lines += ["split:"]
    for split, name in SPLIT_NAMES.items():
        mine = [one.number for one in done if one.record["split"] == split]
        lines.append(f"  {name}: {mine}")
    return lines


def _write_text(path: Path, lines: Sequence[str]) -> None:
    with replacing(path) as text:
        text.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
