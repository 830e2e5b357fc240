"""A dataset from a plan: what is there is counted, what is missing is made, and the folder is described."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomli_w
from tqdm import tqdm

from forest_addon.formats.atomic import write_whole
from forest_addon.formats.ownership import claim
from forest_addon.spec import SpecError

from ..command import IncompleteError
from ..lock import only_one
from ..progress import plain
from ..store import claim_store, fetch, put
from . import disk
from .card import CARD, versions, write_card
from .disk import MANIFEST, write_manifest
from .engine import Cluster, SceneJob, SceneOutcome, make_all
from .plan import Plan, Recipe, recipes

NAMED = 8  # scenes that a message names
REFRESH = 30.0  # s between two manifests, at least
SHARE_OF_MANIFESTS = 0.01  # of the time, at most; those of a large dataset take seconds
MANY = 10_000  # scenes, whose settings take a second to draw
DESCRIBED = ("plan.toml", MANIFEST, *CARD)


def make_dataset(
    plan: Plan,
    out: Path,
    cluster: Cluster | None = None,
    *,
    replace: bool = False,
    quiet: bool = False,
    store: Path | None = None,
) -> None:
    """Make what is missing of a dataset; what is done stays as it is.

    cluster : where scenes are made; None: on all cores. replace : scenes of other settings are made anew.
    store : that has the dataset, too.

    Raises
    ------
    SpecError : the plan cannot be used; scenes in the folder are of other settings; another command is at
    work.
    OSError : it cannot be written; what is finished stays.
    IncompleteError : scenes were set aside; all others are there.
    """
    if not quiet and plan.count > MANY:
        print(f"Drawing the settings of {plan.count:,} scenes", file=sys.stderr, flush=True)
    wanted = recipes(plan)
    with only_one(out):
        out = out.resolve()
        disk.clean(out)
        claim(*(out / name for name in DESCRIBED))
        if store is not None:
            claim_store(store, "a dataset", goes_on=True)
            _fetch_scenes(store, out)
        missing = _missing(wanted, out, replace)
        made = ", ".join(f"{name} {number}" for name, number in versions().items())
        head = f"# The plan of this dataset as it was used, base scenes within.\n# Made with {made}"
        write_whole(out / "plan.toml", f"{head}\n\n{tomli_w.dumps(plan.tables)}")
        rows = make_scenes(plan, wanted, missing, out, cluster or Cluster(), quiet, store)
        if missing or not (out / "README.md").is_file():
            write_card(plan, wanted, out)
        if store is not None:
            copy_to(store, out)
    lost = [row["scene"] for row in rows if row["status"] != "done"]
    if not quiet:
        print(f"Done: {len(rows) - len(lost)} of {len(rows)} scenes in {out}", file=sys.stderr)
    if lost:
        raise IncompleteError(
            f"{_named(lost)} could not be made; manifest.csv says why, the others are in {out}. "
            "The same command tries again"
        )


def _fetch_scenes(store: Path, out: Path) -> None:
    """Take finished scenes from a store that the folder has not."""
    there = store / disk.SCENES
    for scene in sorted(there.iterdir()) if there.is_dir() else ():
        final = out / disk.SCENES / scene.name
        if scene.name.isdigit() and not final.exists() and (scene / disk.RECORD).is_file():
            partial = disk.begin(out, int(scene.name))
            fetch(scene, partial)
            os.rename(partial, final)


def _copy_scene(folder: Path, store: Path) -> None:
    """Copy a finished scene to a store that has it not yet, its record last: it says that all is there."""
    there = store / disk.SCENES / folder.name
    record = there / disk.RECORD
    if not (record.is_file() and record.read_bytes() == (folder / disk.RECORD).read_bytes()):
        names = sorted(path.name for path in folder.iterdir() if path.name != disk.RECORD)
        put(folder, (*names, disk.RECORD), there)


def copy_to(store: Path, out: Path) -> None:
    """Copy to a store what it has not yet of a dataset: finished scenes, then what describes them.

    Raises
    ------
    OSError : one cannot be written; the folder has it.
    """
    for done in disk.scenes_done(out):
        _copy_scene(done.folder, store)
    folders = [path for name in ("splits", disk.FOLDER) for path in sorted(out.glob(f"{name}/*"))]
    told = [*(out / name for name in DESCRIBED), *folders]
    put(out, [path.relative_to(out).as_posix() for path in told if path.is_file()], store)


def make_scenes(
    plan: Plan,
    wanted: Sequence[Recipe],
    missing: Sequence[Recipe],
    out: Path,
    cluster: Cluster,
    quiet: bool = False,
    store: Path | None = None,
) -> list[dict[str, Any]]:
    """Make those of a plan's scenes that are missing; returns the manifest's rows, of all scenes.

    Raises
    ------
    SpecError : the cluster cannot be used.
    OSError : a scene cannot be written, or the cluster went away; what is finished stays.
    """
    memory, threads = cluster.shares(len(missing), plan.running)
    jobs = [SceneJob(out, recipe, plan.running, memory, threads) for recipe in missing]
    refresh = time.monotonic() + REFRESH
    with tqdm(
        total=len(wanted),
        initial=len(wanted) - len(missing),
        unit="scene",
        disable=quiet,
        file=sys.stderr,
        smoothing=0.1,
    ) as bar:

        def report(outcome: SceneOutcome) -> None:
            nonlocal refresh
            bar.update()
            if store is not None and outcome.kind == "done":
                _copy_scene(out / disk.SCENES / disk.scene_name(outcome.scene), store)
            if outcome.kind not in ("done", "stopped") and not quiet:
                said = f"  scene {outcome.scene:06d} is set aside: {outcome.why}"
                bar.write(plain(said), file=sys.stderr)
            if time.monotonic() > refresh:
                started = time.monotonic()
                write_manifest(out, wanted)
                took = time.monotonic() - started
                refresh = started + max(REFRESH, took / SHARE_OF_MANIFESTS)

        try:
            make_all(jobs, cluster, report)
        except BaseException:
            if not cluster.is_elsewhere:
                disk.clean(out)  # of scenes that were being made
            raise
        finally:
            rows = write_manifest(out, wanted)
    return rows


def _missing(wanted: Sequence[Recipe], out: Path, replace: bool) -> list[Recipe]:
    """Scenes that are to be made, of which nothing is left in the folder.

    Raises
    ------
    SpecError : scenes that are there are of other settings.
    """
    digest_of = {recipe.number: recipe.digest for recipe in wanted}
    done = {one.number: one.record["settings"] for one in disk.scenes_done(out)}
    other = [number for number, digest in done.items() if digest_of.get(number) != digest]
    if other and not replace:
        raise SpecError(
            f"--out {out}",
            f"{_named([disk.scene_name(n) for n in other])} there {'are' if len(other) > 1 else 'is'} not "
            "of this "
            "plan: its settings have changed; choose another folder, or --replace to make them anew",
        )
    missing = [recipe for recipe in wanted if done.get(recipe.number) != recipe.digest]
    anew = sorted({*other, *(recipe.number for recipe in missing)})
    for number in anew:
        disk.claim_scene(out, number)
    for number in anew:
        disk.remove_scene(out, number)
    return missing


def _named(scenes: Sequence[str]) -> str:
    shown = ", ".join(scenes[:NAMED])
    more = f" and {len(scenes) - NAMED} more" if len(scenes) > NAMED else ""
    return f"scene{'s' if len(scenes) > 1 else ''} {shown}{more}"
