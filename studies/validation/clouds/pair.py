"""``validate lidar A.laz B.laz``: the paired table and the picture of two clouds."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from forest_addon.formats.atomic import replacing
from forest_addon.spec import SpecError
from headless.commands.work.lidar import numbers

from .between import compare_clouds, draw_pair, table_text


def hold_pair(
    subject: str, files: tuple[Path, Path], origins: list[str], chosen: argparse.Namespace
) -> None:
    """Hold a cloud to another; print the table, and keep it as pair.md beside pair.png in DIR/lidar.

    origins : "x,y,z" of the scanner of both clouds, or of each.

    Raises
    ------
    SpecError : another subject, more than two origins, or a cloud that cannot be read.
    """
    if subject != "lidar":
        raise SpecError("validate", f'two files go with lidar, not with "{subject}"')
    if chosen.scene or chosen.stand or chosen.docs:
        raise SpecError("validate", "two clouds go without --scene, --stand and --docs")
    if len(origins) > 2:
        raise SpecError("--origin", f"is given {len(origins)} times; give one for both, or two")
    places = [np.array(numbers("--origin", text, 3)) for text in origins] or [None]
    folder = chosen.out / "lidar"
    folder.mkdir(parents=True, exist_ok=True)
    rows, clouds = compare_clouds(*files, (places[0], places[-1]), chosen.seed)
    text = table_text(rows, clouds)
    with replacing(folder / "pair.md") as written:
        written.write_text(text, encoding="utf-8")
    drawn = draw_pair(rows, clouds, folder / "pair.png", chosen.seed)
    print(text)
    print(f"Wrote {folder / 'pair.md'} and {drawn}.")
