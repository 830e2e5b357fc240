"""Previews as COCO panoptic has them (Kirillov et al. 2019): images, PNGs of segments, and JSON a split.

A pixel's segment is red + 256 green + 65536 blue of its PNG; class and tree follow from it alone, too: it is
tree times 8 + class.

::

    images/000000.png  panoptic/000000.png  panoptic_train.json  panoptic_validation.json  panoptic_test.json
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from forest_addon.formats.atomic import replacing
from forest_addon.formats.raster_file import read_png
from forest_addon.spec import SpecError

from ..disk import Done
from ..for_instance import CLASSES, LIVE, STEM, WOODY
from ..plan import SPLITS
from .source import COLOURS

IMAGE, SEGMENTS = "preview.png", "preview-segments.png"
EIGHT = 8  # a segment is its tree times so many, and its class
THINGS = (STEM, LIVE, WOODY)  # one of a tree; the rest is stuff


def write_panoptic(done: Sequence[Done], out: Path) -> int:
    """Write all previews with their segments; returns how many.

    Raises
    ------
    SpecError : a scene has no preview.
    OSError : it cannot be written.
    """
    for part in ("images", "panoptic"):
        (out / part).mkdir(parents=True, exist_ok=True)
    told: dict[str, dict[str, Any]] = {
        split: {"images": [], "annotations": [], "categories": _categories()} for split in SPLITS
    }
    for one in done:
        if not (one.folder / SEGMENTS).is_file():
            raise SpecError(
                str(one.folder), "has no preview: make the dataset with keep.preview = true"
            )
        name = f"{one.folder.name}.png"
        for source, part in ((IMAGE, "images"), (SEGMENTS, "panoptic")):
            with replacing(out / part / name) as partial:
                shutil.copyfile(one.folder / source, partial)
        segment = segments_from((one.folder / SEGMENTS).read_bytes())
        high, wide = segment.shape
        mine = told[one.record["split"]]
        mine["images"].append({"id": one.number, "file_name": name, "width": wide, "height": high})
        mine["annotations"].append(
            {"image_id": one.number, "file_name": name, "segments_info": _segments(segment)}
        )
    for split, record in told.items():
        with replacing(out / f"panoptic_{split}.json") as text:
            text.write_text(json.dumps(record) + "\n", encoding="utf-8")
    return len(done)


def _categories() -> list[dict[str, Any]]:
    return [
        {
            "id": number,
            "name": name,
            "supercategory": "tree" if number in THINGS else "ground",
            "isthing": int(number in THINGS),
            "color": list(COLOURS[number]),
        }
        for number, name in enumerate(CLASSES)
        if number
    ]


def _segments(segment: np.ndarray) -> list[dict[str, Any]]:
    """Return what an image (H, W) of segments holds: area in pixels, box as x, y, width, height."""
    found = []
    for number in np.unique(segment[segment > 0]).tolist():
        rows, columns = np.nonzero(segment == number)
        left, top = int(columns.min()), int(rows.min())
        box = [left, top, int(columns.max()) - left + 1, int(rows.max()) - top + 1]
        found.append(
            {
                "id": number,
                "category_id": number % EIGHT,
                "area": len(rows),
                "bbox": box,
                "iscrowd": 0,
            }
        )
    return found


def segments_from(data: bytes) -> np.ndarray:
    """(H, W) int64 segments of a PNG's bytes.

    Raises
    ------
    ValueError : it is no PNG.
    """
    pixels = read_png(data)[0].astype(np.int64)
    return np.asarray(pixels[..., 0] + 256 * pixels[..., 1] + 65536 * pixels[..., 2])
