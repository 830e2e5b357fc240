"""A dataset packed as WebDataset tars: files of a scene beside each other, scenes of a split in order.

A file ``tls.laz`` of scene 000017 is named ``000017.tls.laz`` (a sample's key ends at the first dot). No
dates and no owners are noted, so equal scenes are equal tars.
"""

from __future__ import annotations

import json
import tarfile
from pathlib import Path

from forest_addon.formats.atomic import replacing
from forest_addon.formats.ownership import claim, remove

from . import disk
from .plan import SPLITS

FOLDER, INDEX = "shards", "index.json"


def write_shards(root: Path, size: int) -> list[Path]:
    """Pack every split into tars of about ``size`` bytes; returns them. Earlier ones are replaced.

    Raises
    ------
    OSError : one cannot be written.
    """
    folder = root / FOLDER
    folder.mkdir(exist_ok=True)
    before = _packed(folder / INDEX)
    claim(folder / INDEX)
    written = []
    done = list(disk.scenes_done(root))
    for split in SPLITS:
        held: list[disk.Done] = []
        number = 0
        mine = [one for one in done if one.record["split"] == split]
        for place, one in enumerate(mine):
            held.append(one)
            if sum(each.size for each in held) >= size or place == len(mine) - 1:
                written.append(_pack(folder / f"{split}-{number:06d}.tar", held))
                held, number = [], number + 1
    counts, index = {path.name: path.stat().st_size for path in written}, folder / INDEX
    for old in before - set(counts):
        remove(folder / old)
    with replacing(index) as text:
        text.write_text(json.dumps(counts, indent=1) + "\n", encoding="utf-8")
    return written


def _packed(index: Path) -> set[str]:
    """Names of the tars that an earlier command packed."""
    try:
        return {Path(name).name for name in json.loads(index.read_text(encoding="utf-8"))}
    except (OSError, ValueError, TypeError):
        return set()


def _pack(path: Path, scenes: list[disk.Done]) -> Path:
    with replacing(path) as partial, tarfile.open(partial, "w", format=tarfile.USTAR_FORMAT) as tar:
        for one in scenes:
            for name in sorted([*one.record["files"], disk.RECORD]):
                info = tarfile.TarInfo(f"{one.folder.name}.{name}")
                info.size = (one.folder / name).stat().st_size
                with open(one.folder / name, "rb") as file:
                    tar.addfile(info, file)
    return path
