"""``dataset --check``: every file against its SHA-256, every label against the truth beside it.

Labels: a point's tree is one of trees.csv and of that species, its leaf one that this tree has; the areas of
voxels.npz are those of trees.csv (leaves) within 1e-9; a cylinder's parent is of the same tree and stands
before it; no two splits share a grown tree unless the plan says so; no result is empty, likewise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from forest_addon.base.trimesh import PART_NAMES
from forest_addon.spec import SpecError

from ..command import IncompleteError
from . import disk
from .card import shared_trees

AREA = 1e-9  # relative
NAMED = 20  # faults that are said


def check_dataset(root: Path, say: Callable[[str], None]) -> None:
    """Verify a dataset.

    Raises
    ------
    SpecError : there is none.
    IncompleteError : something is wrong; says what.
    """
    folder = root / disk.SCENES
    if not folder.is_dir():
        raise SpecError(f"--check {root}", "holds no scenes; give the folder of a dataset")
    faults, records, may_be_empty = [], [], _says(root, "keep", "empty")
    for path in sorted(folder.iterdir()):
        if not path.name.isdigit():
            continue
        one = disk.read_scene(path)
        if one is None:
            faults.append(
                f"{path.name}: scene.json, or a file that it names, is missing or cut off"
            )
            continue
        records.append(one.record)
        faults += [f"{path.name}: {fault}" for fault in faults_of(one, may_be_empty)]
    shared = shared_trees(records)
    if shared and not _says(root, "splits", "share_trees"):
        faults.append(
            f"{shared} grown trees stand in scenes of more than one split: a species of the plan knows no "
            "chance; "
            "choose another, or splits.share_trees = true"
        )
    for fault in faults[:NAMED]:
        say(f"  {fault}")
    if faults:
        raise IncompleteError(
            f"{root}: {len(faults)} faults in {len(records)} scenes; first: {faults[0]}"
        )
    say(
        f"{len(records)} scenes, {sum(len(r['files']) for r in records)} files: every hash and label is right"
    )


def _says(root: Path, table: str, key: str) -> bool:
    """Return whether the plan of a dataset says yes to a key."""
    import tomllib

    try:
        plan = tomllib.loads((root / "plan.toml").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return bool(plan.get(table, {}).get(key, False))


def faults_of(one: disk.Done, may_be_empty: bool = False) -> Iterator[str]:
    """Faults of a scene. may_be_empty : what found nothing is none."""
    files = one.record["files"]
    for path in sorted(one.folder.iterdir()):
        if path.name not in files and path.name != disk.RECORD:
            yield f"{path.name} is not in scene.json"
    bad = [
        name for name, said in files.items() if disk.digest_of(one.folder / name) != said["sha256"]
    ]
    yield from (f"{name} has another SHA-256 than when it was made" for name in bad)
    if one.record["digest"] != disk.digest_of_files(files):
        yield "the digest of all files is wrong"
    if not may_be_empty:
        yield from (f"{name}: {why}" for name, why in one.record.get("empty", {}).items())
    if bad:
        return
    try:
        yield from _wrong_labels(one)
    except (OSError, ValueError, KeyError) as problem:
        yield f"cannot be read: {problem}"


def _wrong_labels(one: disk.Done) -> Iterator[str]:
    trees = disk.table_of(one.folder / "trees.csv")
    known = {int(tree["tree"]): tree for tree in trees}
    if len(known) != one.record["trees"]:
        yield f"trees.csv has {len(known)} trees, scene.json says {one.record['trees']}"
    leaves = np.zeros(max(known, default=-1) + 1, np.int64)
    for number, tree in known.items():
        leaves[number] = int(tree["leaves"])
    for name, count in one.record["points"].items():
        if count:
            yield from _wrong_points(one.folder, name, count, leaves)
    if (one.folder / "voxels.npz").is_file():
        with np.load(one.folder / "voxels.npz") as data:
            area = float(data["leaf_area_density"].sum() * data["edge"] ** 3)
        wanted = sum(float(tree["leaf_area_m2"]) for tree in trees)
        if abs(area - wanted) > AREA * max(wanted, 1e-12):
            yield f"voxels.npz has {area!r} m² of leaves, trees.csv {wanted!r}"
    if (one.folder / "cylinders.csv").is_file():
        yield from _wrong_cylinders(one.folder / "cylinders.csv", known)


def _wrong_points(folder: Path, name: str, count: int, leaves: np.ndarray) -> Iterator[str]:
    for kind, fields in disk.clouds_of(folder, name):
        tree, leaf, organ, species = (fields[key] for key in ("tree", "leaf", "organ", "species"))
        if len(tree) != count:
            yield f"{kind} has {len(tree)} points, scene.json says {count}"
        if (tree >= len(leaves)).any() or (tree < -1).any():
            yield f"{kind} names trees that trees.csv has not"
            continue
        if ((organ < 0) | (organ >= len(PART_NAMES))).any():
            yield f"{kind} has organs that there are not"
        of_tree = tree >= 0
        if (leaf[of_tree] >= leaves[tree[of_tree]]).any():
            yield f"{kind} names leaves that its trees have not"
        if ((leaf >= 0) != (organ == 2))[of_tree].any():
            yield f"{kind}: leaf and organ do not agree"
        pairs = np.unique(np.stack([tree[of_tree], species[of_tree]], 1), axis=0)
        if len(np.unique(pairs[:, 0])) != len(pairs):
            yield f"{kind}: a tree has two species"


def _wrong_cylinders(path: Path, known: dict[int, Any]) -> Iterator[str]:
    table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2, usecols=(0, 1, 2))
    if not len(table):
        return
    tree, own, parent = table.astype(np.int64).T
    if not set(np.unique(tree).tolist()) <= set(known):
        yield "cylinders.csv names trees that trees.csv has not"
    if (parent >= own).any() or (parent < 0).any():
        yield "cylinders.csv: a parent does not stand before its children"
