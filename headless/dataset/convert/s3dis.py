"""Clouds as S3DIS has them (Armeni et al. 2016): an area a split, a room a scene, a text file an object.

::

    Area_1/scene_000000/scene_000000.txt              x y z r g b, all points; 1 train, 2 validation, 3 test
    Area_1/scene_000000/Annotations/stem_12.txt       those of tree 12's stem; names end at the first _

Colours are grey: the strength of the echo. Scans of a scene are joined.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from forest_addon.formats.atomic import replacing

from ..disk import Done
from ..for_instance import CLASSES
from ..plan import SPLITS
from .source import scans_of

WORDS = tuple(name.replace(" ", "") for name in CLASSES)


def write_s3dis(done: Sequence[Done], out: Path) -> int:
    """Write all scenes; returns how many.

    Raises
    ------
    OSError : it cannot be written.
    """
    for one in done:
        scans = list(scans_of(one))
        area = f"Area_{1 + SPLITS.index(one.record['split'])}"
        room = out / area / f"scene_{one.folder.name}"
        (room / "Annotations").mkdir(parents=True, exist_ok=True)
        if not scans:
            continue
        place = np.concatenate([scan.place for scan in scans])
        grey = np.concatenate([scan.level for scan in scans]) * 255.0
        label = np.concatenate([scan.classes for scan in scans]).astype(np.int64)
        tree = np.concatenate([scan.tree for scan in scans]).astype(np.int64)
        key = tree * len(CLASSES) + label
        turn = np.argsort(key, kind="stable")
        lines = _lines(place[turn], grey[turn])
        _write(room / f"{room.name}.txt", lines)
        found, first = np.unique(key[turn], return_index=True)
        ends = [*first[1:].tolist(), len(key)]
        for what, start, end in zip(found.tolist(), first.tolist(), ends, strict=True):
            name = f"{WORDS[what % len(CLASSES)]}_{what // len(CLASSES)}.txt"
            _write(room / "Annotations" / name, lines[start:end])
    return len(done)


def _lines(place: np.ndarray, grey: np.ndarray) -> list[str]:
    levels = grey.round().astype(int).tolist()
    rows = zip(*place.T.tolist(), levels, strict=True)
    return [f"{x:.3f} {y:.3f} {z:.3f} {g} {g} {g}\n" for x, y, z, g in rows]


def _write(path: Path, lines: Sequence[str]) -> None:
    with replacing(path) as text:
        text.write_text("".join(lines), encoding="ascii")
