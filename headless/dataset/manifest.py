"""``manifest.csv`` and ``splits/*.txt``: what the dataset has, read from its folders and nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from forest_addon.formats.atomic import replacing
from forest_addon.formats.table import write_csv

from . import disk
from .plan import SPLITS, Recipe

MANIFEST = "manifest.csv"
COLUMNS = (
    *(
        "scene",
        "split",
        "seed",
        "base",
        "status",
        "seconds",
        "cpu_seconds",
        "trees",
        "points",
        "files",
    ),
    *("bytes", "settings", "digest", "error"),
)


def rows_of(root: Path, recipes: Sequence[Recipe]) -> list[dict[str, Any]]:
    """A row for every scene of the plan, and for every other that is there."""
    done = {one.number: one for one in disk.scenes_done(root)}
    rows = []
    for recipe in recipes:
        rows.append(_row(root, recipe, done.pop(recipe.number, None)))
    rows += [_row(root, None, one) for _, one in sorted(done.items())]
    return rows


def _row(root: Path, recipe: Recipe | None, done: disk.Done | None) -> dict[str, Any]:
    number = done.number if done is not None else recipe.number if recipe is not None else -1
    status = disk.read_status(root, number)
    cpu = status.get("cpu") or {}
    row: dict[str, Any] = dict.fromkeys(COLUMNS, "")
    row |= {"scene": disk.scene_name(number), "status": "missing"}
    if recipe is not None:
        row |= {
            "split": recipe.split,
            "seed": recipe.seed,
            "base": recipe.base,
            "settings": recipe.digest,
        }
    if done is not None:
        record = done.record
        row |= {
            key: record[key] for key in ("split", "seed", "base", "trees", "settings", "digest")
        }
        row |= {"status": "done", "points": sum(record["points"].values())}
        row |= {"files": len(record["files"]), "bytes": done.size}
    elif status.get("status") == "failed":
        row |= {"status": "failed", "error": f"{status.get('kind')}: {status.get('why')}"}
    if cpu or status.get("status") == "failed":
        row |= {
            "seconds": round(status.get("seconds", 0.0), 2),
            "cpu_seconds": round(sum(cpu.values()), 2),
        }
    return row


def write_manifest(root: Path, recipes: Sequence[Recipe]) -> list[dict[str, Any]]:
    """Write the manifest and the splits' lists of scenes that are done; returns the rows."""
    rows = rows_of(root, recipes)
    write_csv(root / MANIFEST, {name: [row[name] for row in rows] for name in COLUMNS})
    folder = root / "splits"
    folder.mkdir(exist_ok=True)
    for split in SPLITS:
        mine = [row["scene"] for row in rows if row["split"] == split and row["status"] == "done"]
        with replacing(folder / f"{split}.txt") as text:
            text.write_text("".join(f"{name}\n" for name in mine) or "\n", encoding="utf-8")
    return rows
