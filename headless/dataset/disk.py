"""State of a dataset on the disk: a folder a scene, whole or not there.

::

    DIR/scenes/000017/          files of the scene, and scene.json with their SHA-256, written last
    DIR/scenes/.000017.*        a scene in the making; it is renamed when all of it is on the disk
    DIR/status/000017.json      how long it took, or the error for which it was set aside
    DIR/manifest.csv, splits/   what there is, read from these folders and nothing else
    DIR/shards/                 scenes of a split packed in order as WebDataset tars: tls.laz of scene 000017
                                is 000017.tls.laz, without dates and owners, so equal scenes are equal tars

Whoever finishes a scene that another has finished meanwhile throws his away: they are the same bytes.
Folders and names are synchronised before and after the rename, so that a power cut leaves one or the
other.

``dataset --check`` holds every file against its SHA-256, and every label against the truth beside it: a
point's tree is one of trees.csv and of that species, its leaf one that this tree has; the areas of voxels.npz
are those of trees.csv (leaves) within 1e-9; a cylinder's parent is of the same tree and stands before it; no
two splits share a grown tree unless the plan says so; no result is empty, likewise.
"""

from __future__ import annotations

import csv
import errno
import hashlib
import json
import os
import re
import secrets
import shutil
import tarfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from forest_addon.base.trimesh import PART_NAMES
from forest_addon.formats.atomic import replacing, write_whole
from forest_addon.formats.ownership import claim, digest_of, remove
from forest_addon.formats.table import write_csv
from forest_addon.formats.toml_file import read_tables
from forest_addon.spec import SpecError

from ..command import IncompleteError
from .plan import SPLITS, Recipe

SCENES, STATUS, RECORD = "scenes", "status", "scene.json"
MADE = re.compile(r"\.\d{6,}\.\d+-[0-9a-f]{8}\.partial")  # a scene in the making


@dataclass(frozen=True)
class Done:
    """A scene that is done: its folder and what its record says."""

    folder: Path
    record: dict[str, Any]

    @property
    def number(self) -> int:
        """Number of the scene."""
        return int(self.record["scene"])

    @property
    def size(self) -> int:
        """Bytes of its files."""
        return sum(int(one["bytes"]) for one in self.record["files"].values())


def scene_name(number: int) -> str:
    """The name of a scene's folder."""
    return f"{number:06d}"


def begin(root: Path, number: int) -> Path:
    """An empty folder to make a scene in."""
    folder = root / SCENES / f".{scene_name(number)}.{os.getpid()}-{secrets.token_hex(4)}.partial"
    folder.mkdir(parents=True)
    return folder


def finish(partial: Path, root: Path, record: Mapping[str, Any]) -> Path:
    """Record the files of a finished scene and give it its name; returns its folder.

    record : what is noted of the scene besides its files; ``scene`` is its number.
    """
    files = {
        path.name: {"sha256": digest_of(path), "bytes": path.stat().st_size}
        for path in sorted(partial.iterdir())
    }
    whole = {**record, "files": files, "digest": digest_of_files(files)}
    write_whole(partial / RECORD, json.dumps(whole, indent=1, sort_keys=True) + "\n")
    sync(partial)
    final = root / SCENES / scene_name(int(record["scene"]))
    try:
        os.rename(partial, final)
    except OSError as problem:
        if problem.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.EACCES) or not final.is_dir():
            raise
        shutil.rmtree(partial, ignore_errors=True)
    sync(final.parent)
    return final


def digest_of_files(files: Mapping[str, Mapping[str, Any]]) -> str:
    """One SHA-256 of the names and digests of all files of a scene."""
    lines = (f"{one['sha256']}  {name}\n" for name, one in sorted(files.items()))
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def sync(folder: Path) -> None:
    """Have the names of a folder written to the disk, where the system can."""
    with suppress(OSError):  # Windows opens no folders
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def scenes_done(root: Path) -> Iterator[Done]:
    """Every scene that stands on the disk, in order.

    A folder without a record that can be read, or whose files have not the sizes it says, is none.
    """
    for path in sorted((root / SCENES).glob("*")):
        if path.name.isdigit() and (found := read_scene(path)) is not None:
            yield found


def table_of(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file of a scene."""
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def clouds_of(folder: Path, name: str) -> Iterator[tuple[str, Any]]:
    """Files of a cloud of a scene, each with its arrays by field."""
    if (folder / f"{name}.laz").is_file():
        import laspy

        cloud = laspy.read(folder / f"{name}.laz")
        labels = {key: np.asarray(cloud[key]) for key in ("tree", "leaf", "organ", "species")}
        yield f"{name}.laz", {"xyz": np.asarray(cloud.xyz), **labels}
    if (folder / f"{name}-points.npz").is_file():
        with np.load(folder / f"{name}-points.npz") as data:
            place = np.stack([data[axis] for axis in "xyz"], axis=1)
            yield f"{name}-points.npz", {"xyz": place, **data}


def read_scene(folder: Path) -> Done | None:
    """A scene's folder, None where it is not whole."""
    try:
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        whole = all(
            (folder / name).stat().st_size == one["bytes"] for name, one in record["files"].items()
        )
        return Done(folder, record) if whole and int(record["scene"]) == int(folder.name) else None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def remove_scene(root: Path, number: int) -> None:
    """Remove a scene that is ours: it has no name any more before its first file goes."""
    folder = root / SCENES / scene_name(number)
    if folder.exists():
        partial = folder.with_name(f".{folder.name}.{os.getpid()}-{secrets.token_hex(4)}.partial")
        os.rename(folder, partial)
        shutil.rmtree(partial)
    _note(root, number).unlink(missing_ok=True)


def clean(root: Path) -> None:
    """Remove what scenes that nobody is making any more have left."""
    for path in sorted((root / SCENES).glob(".*")):
        if MADE.fullmatch(path.name):
            shutil.rmtree(path, ignore_errors=True)


def claim_scene(root: Path, number: int) -> None:
    """Make sure that a scene may be made anew.

    Raises
    ------
    SpecError : what is there in its place is the user's.
    """
    folder, note = root / SCENES / scene_name(number), _note(root, number)
    whole = not folder.is_dir() or folder.is_symlink()
    for path in [folder] if whole else sorted(folder.iterdir()):
        claim(path, ours=is_ours(folder))
    claim(note, ours="status" in read_status(root, number))


def is_ours(folder: Path) -> bool:
    """Return whether all that is in a folder is what its record says; some of it, or all, may be missing."""
    try:
        if not any(folder.iterdir()):
            return True
        record = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        named = int(record["scene"]) == int(folder.name) and not folder.is_symlink()
        return named and all(
            path.name == RECORD or digest_of(path) == record["files"][path.name]["sha256"]
            for path in folder.iterdir()
        )
    except (OSError, ValueError, KeyError, TypeError):
        return False


def write_status(root: Path, number: int, status: Mapping[str, Any]) -> None:
    """Note how a scene went; it is no part of the dataset's bytes."""
    (root / STATUS).mkdir(parents=True, exist_ok=True)
    # the dataset looked before it began
    write_whole(_note(root, number), json.dumps(status, indent=1, sort_keys=True) + "\n", ours=True)


def read_status(root: Path, number: int) -> dict[str, Any]:
    """Status of a scene; empty where that is not known."""
    return _read_json(_note(root, number))


def _read_json(path: Path) -> dict[str, Any]:
    """A table of a file of ours; empty where it cannot be read."""
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
        return table if isinstance(table, dict) else {}
    except (OSError, ValueError):
        return {}


def _note(root: Path, number: int) -> Path:
    return root / STATUS / f"{scene_name(number)}.json"


MANIFEST = "manifest.csv"
COLUMNS = (
    *("scene", "split", "seed", "base", "status", "seconds", "cpu_seconds"),
    *("trees", "points", "files", "bytes", "settings", "digest", "error"),
)


def rows_of(root: Path, recipes: Sequence[Recipe]) -> list[dict[str, Any]]:
    """A row for every scene of the plan, and for every other that is there."""
    done = {one.number: one for one in scenes_done(root)}
    wanted = {recipe.number: recipe for recipe in recipes}
    numbers = [*wanted, *sorted(done.keys() - wanted.keys())]
    return [_row(root, number, wanted.get(number), done.get(number)) for number in numbers]


def _row(root: Path, number: int, recipe: Recipe | None, done: Done | None) -> dict[str, Any]:
    status = read_status(root, number)
    cpu = status.get("cpu") or {}
    row: dict[str, Any] = dict.fromkeys(COLUMNS, "")
    row |= {"scene": scene_name(number), "status": "missing"}
    if recipe is not None:
        row |= {"split": recipe.split, "seed": recipe.seed, "base": recipe.base}
        row["settings"] = recipe.digest
    if done is not None:
        record = done.record
        row |= {
            **{
                key: record[key] for key in ("split", "seed", "base", "trees", "settings", "digest")
            },
            "status": "done",
            "points": sum(record["points"].values()),
            "files": len(record["files"]),
            "bytes": done.size,
        }
    elif status.get("status") == "failed":
        row |= {"status": "failed", "error": f"{status.get('kind')}: {status.get('why')}"}
    if cpu or status.get("status") == "failed":
        row |= {
            "seconds": round(status.get("seconds", 0.0), 2),
            "cpu_seconds": round(sum(cpu.values()), 2),
        }
    return row


def shared_trees(records: Sequence[dict[str, Any]]) -> int:
    """Number of grown trees that stand in scenes of more than one split."""
    splits: dict[str, set[str]] = {}
    for record in records:
        for digest in record["variants"].values():
            splits.setdefault(digest, set()).add(record["split"])
    return sum(len(found) > 1 for found in splits.values())


def write_manifest(root: Path, recipes: Sequence[Recipe]) -> list[dict[str, Any]]:
    """Write the manifest and the splits' lists of scenes that are done; returns the rows."""
    rows = rows_of(root, recipes)
    write_csv(root / MANIFEST, {name: [row[name] for row in rows] for name in COLUMNS})
    folder = root / "splits"
    folder.mkdir(exist_ok=True)
    done = [row for row in rows if row["status"] == "done"]
    for split in SPLITS:
        names = "".join(f"{row['scene']}\n" for row in done if row["split"] == split)
        write_whole(folder / f"{split}.txt", names or "\n")
    return rows


FOLDER, INDEX = "shards", "index.json"


def write_shards(root: Path, size: int) -> list[Path]:
    """Pack every split into tars of about ``size`` bytes; returns them. Earlier ones are replaced.

    Raises
    ------
    OSError : one cannot be written.
    """
    folder = root / FOLDER
    folder.mkdir(exist_ok=True)
    # the tars that an earlier command packed
    before = {Path(name).name for name in _read_json(folder / INDEX)}
    claim(folder / INDEX)
    written = []
    done = list(scenes_done(root))
    for split in SPLITS:
        held: list[Done] = []
        number = 0
        of_split = [one for one in done if one.record["split"] == split]
        for place, one in enumerate(of_split):
            held.append(one)
            if sum(each.size for each in held) >= size or place == len(of_split) - 1:
                written.append(_pack(folder / f"{split}-{number:06d}.tar", held))
                held, number = [], number + 1
    counts, index = {path.name: path.stat().st_size for path in written}, folder / INDEX
    for old in before - set(counts):
        remove(folder / old)
    write_whole(index, json.dumps(counts, indent=1) + "\n")
    return written


def _pack(path: Path, scenes: list[Done]) -> Path:
    with replacing(path) as partial, tarfile.open(partial, "w", format=tarfile.USTAR_FORMAT) as tar:
        for one in scenes:
            for name in sorted([*one.record["files"], RECORD]):
                info = tarfile.TarInfo(f"{one.folder.name}.{name}")
                info.size = (one.folder / name).stat().st_size
                with open(one.folder / name, "rb") as file:
                    tar.addfile(info, file)
    return path


AREA = 1e-9  # relative
NAMED = 20  # faults that are said


def check_dataset(root: Path, say: Callable[[str], None]) -> None:
    """Verify a dataset.

    Raises
    ------
    SpecError : there is none.
    IncompleteError : something is wrong; says what.
    """
    folder = root / SCENES
    if not folder.is_dir():
        raise SpecError(f"--check {root}", "holds no scenes; give the folder of a dataset")
    faults, records, may_be_empty = [], [], _says(root, "keep", "empty")
    for path in sorted(path for path in folder.iterdir() if path.name.isdigit()):
        one = read_scene(path)
        if one is None:
            lost = "scene.json, or a file that it names, is missing or cut off"
            faults.append(f"{path.name}: {lost}")
        else:
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
    with suppress(SpecError):
        return bool(read_tables(root / "plan.toml").get(table, {}).get(key, False))
    return False


def faults_of(one: Done, may_be_empty: bool = False) -> Iterator[str]:
    """Faults of a scene. may_be_empty : what found nothing is none."""
    files = one.record["files"]
    for path in sorted(one.folder.iterdir()):
        if path.name not in files and path.name != RECORD:
            yield f"{path.name} is not in scene.json"
    bad = [name for name, said in files.items() if digest_of(one.folder / name) != said["sha256"]]
    yield from (f"{name} has another SHA-256 than when it was made" for name in bad)
    if one.record["digest"] != digest_of_files(files):
        yield "the digest of all files is wrong"
    if not may_be_empty:
        yield from (f"{name}: {why}" for name, why in one.record.get("empty", {}).items())
    if bad:
        return
    try:
        yield from _wrong_labels(one)
    except (OSError, ValueError, KeyError) as problem:
        yield f"cannot be read: {problem}"


def _wrong_labels(one: Done) -> Iterator[str]:
    trees = table_of(one.folder / "trees.csv")
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
    for kind, fields in clouds_of(folder, name):
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
