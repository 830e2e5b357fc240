"""The formats that a dataset is converted to, by name, and the command's work."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from forest_addon.spec import SpecError, unknown

from ..disk import Done
from .kitti import write_kitti
from .panoptic import write_panoptic
from .s3dis import write_s3dis
from .source import LEGEND, done_scenes, write_legend

FORMATS: dict[str, Callable[[Sequence[Done], Path], int]] = {
    "semantic-kitti": write_kitti,
    "s3dis": write_s3dis,
    "coco-panoptic": write_panoptic,
}


def convert_dataset(root: Path, kind: str, out: Path, say: Callable[[str], None]) -> None:
    """Write a made dataset in another format, with the legend of its classes, to a new folder.

    Raises
    ------
    SpecError : the format is unknown; there is no dataset, or not what it needs; the folder is not empty.
    OSError : it cannot be written.
    """
    if kind not in FORMATS:
        raise unknown("--to", kind, FORMATS)
    done = done_scenes(root)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise SpecError(f"--out {out}", "is there already; choose another folder, or empty it")
    out.mkdir(parents=True, exist_ok=True)
    count = FORMATS[kind](done, out)
    write_legend(out / LEGEND)
    say(f"{count} items of {len(done)} scenes as {kind} in {out}")
