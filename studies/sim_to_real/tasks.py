"""Stem map, DBH and height by a published tool, run unchanged on clouds of ours and on real ones.

The tool is 3DFin (Laino et al. 2024, Forestry 97:479), which does what dendromatics does, by its own command
line and with its own default settings. It asks for packages older than ours, so it stands in an environment
of its own and is run as a program. Truth of ours is trees.csv; of the real trees circles fitted to layers and
the highest point, which the tool knows nothing of.
"""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import laspy
import numpy as np
from scipy.optimize import linear_sum_assignment

from forest_addon.api import SpecError

from ..inside import (
    Cluster,
    Say,
    disk,
    find_plan,
    make_dataset,
    new_figure,
    read_las,
    read_plan,
    replacing,
    save_figure,
)
from ..tables import write_rows
from ..validation.run import Comparison, Interval, Picture, Subject
from .clouds import TREES, follow_stem, ground_below
from .run import PLAN

PROGRAM = "3DFin"
NEAR = 0.5  # metres between a stem and what was told of it
THINNEST = 0.06  # metres: the tool's least diameter
BREAST = 1.3
STEP = 0.001  # metres between coordinates of the file that the tool reads
TIMEOUT = 1800.0  # s of one cloud
SETTINGS = "three_d_fin/3DFinconfig.ini"


@dataclass(frozen=True)
class TaskTree:
    """A tree as it is and as it was told; NaN where nothing was. place : x, y. Metres, all of it."""

    cloud: str
    kind: str
    x: float
    y: float
    dbh: float
    height: float
    told_dbh: float
    told_height: float
    away: float


@dataclass(frozen=True)
class TaskFindings:
    """Findings: trees, and by kind of cloud how many stems were told where none stands. failed : clouds on
    which the tool stopped, with its words."""

    trees: list[TaskTree]
    false: dict[str, int]
    failed: dict[str, str]


def run_tasks(
    tool: str, data: Path | None, out: Path, plots: int, seed: int, say: Say = print
) -> TaskFindings:
    """Make plots, run the tool on them and on the measured trees; writes trees.csv to ``out``.

    Raises
    ------
    SpecError : the tool is not there.
    """
    program = shutil.which(tool)
    if program is None:
        said = "is not there; in an environment of its own: pip install 3DFin 'scipy<1.17'"
        raise SpecError(f"--tool {tool}", said)
    plan = read_plan(find_plan(PLAN), [f"count={plots}", f"seed={seed}"])
    make_dataset(plan, out / "plots", Cluster(workers=1), quiet=True)
    findings = TaskFindings([], {}, {})
    for name, kind, points, truth in [*_ours(out / "plots"), *_real(data)]:
        told = run_tool(program, points, out / "tool" / name)
        if isinstance(told, str):
            findings.failed[name] = told
            told = np.empty((0, 4))
        trees, false = matched(name, kind, truth, told)
        findings.trees.extend(trees)
        findings.false[kind] = findings.false.get(kind, 0) + false
        hits = sum(np.isfinite(tree.away) for tree in trees)
        say(f"{name}: {hits} of {len(trees)} stems, {false} that are none")
    write_rows(out / "trees.csv", findings.trees)
    return findings


def run_tool(program: str, points: np.ndarray, folder: Path) -> np.ndarray | str:
    """(T, 4) height, DBH, x, y that the tool tells of points (P, 3), 0 where it cannot; or why it stopped."""
    folder.mkdir(parents=True, exist_ok=True)
    low = np.floor(points.min(axis=0))
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, STEP), low
    las = laspy.LasData(header)
    las.x, las.y, las.z = points.T
    with replacing(folder / "cloud.laz") as partial, open(partial, "wb") as file:
        las.write(file, do_compress=True)
    root = Path(program).resolve().parents[1]
    settings = next(iter(sorted(root.rglob(SETTINGS))), None)
    if settings is None:
        raise SpecError(f"--tool {program}", f"has no {SETTINGS} beside it; give that of its venv")
    words = ["cli", "--normalize", "--export_txt", str(folder / "cloud.laz"), str(folder)]
    try:
        ended = subprocess.run(
            [program, *words, str(settings)], capture_output=True, text=True, timeout=TIMEOUT
        )
    except subprocess.TimeoutExpired:
        return f"took more than {TIMEOUT:.0f} s"
    table = folder / "cloud_dbh_and_heights.txt"
    (folder / "cloud.laz").unlink()
    if ended.returncode or not table.is_file():
        return (ended.stderr.strip().splitlines() or ["it said nothing"])[-1]
    return np.loadtxt(table, ndmin=2)


def matched(
    name: str, kind: str, truth: np.ndarray, told: np.ndarray
) -> tuple[list[TaskTree], int]:
    """Trees (N, 4) of x, y, DBH, height with what was told of each, and how many told stems are of none.

    Pairs are those of least distance together, at most ``NEAR`` apart. told : (T, 4) height, DBH, x, y.
    """
    away = np.linalg.norm(truth[:, None, :2] - told[None, :, 2:4], axis=2)
    rows, columns = linear_sum_assignment(np.where(away > NEAR, 1e3, away))
    pair = {r: c for r, c in zip(rows, columns, strict=True) if away[r, c] <= NEAR}
    trees = []
    for number, tree in enumerate(truth.tolist()):
        height, dbh, far = np.nan, np.nan, np.nan
        if number in pair:
            height, dbh = told[pair[number], :2].tolist()
            far = float(away[number, pair[number]])
        trees.append(TaskTree(name, kind, *tree, dbh if dbh > 0 else np.nan, height, far))
    return trees, len(told) - len(pair)


def _ours(folder: Path) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """Name, kind, points (P, 3) and truth (N, 4) of plots of ours."""
    for one in disk.scenes_done(folder):
        files = sorted(one.folder.glob("*-forinstance.laz"))
        points = np.concatenate([read_las(path).xyz for path in files])
        keys, rows = ("x_m", "y_m", "dbh_m", "height_m"), disk.table_of(one.folder / "trees.csv")
        table = np.array([[float(row[key]) for key in keys] for row in rows]).reshape(-1, 4)
        grown = (table[:, 2] >= THINNEST) & (table[:, 3] > BREAST)
        yield f"ours-{one.folder.name}", str(one.record["base"]), points, table[grown]


def _real(data: Path | None) -> Iterator[tuple[str, str, np.ndarray, np.ndarray]]:
    """The same of the measured trees, by circles."""
    for name, file in TREES.items() if data is not None else ():
        if not (data / "wood" / file).is_file():
            continue
        points = np.asarray(read_las(data / "wood" / file).xyz)
        height = points[:, 2] - ground_below(points)
        stem = follow_stem(points, height)
        if stem is not None:
            centre, radius = stem.at(np.array([BREAST]))
            truth = [*centre[0].tolist(), 2 * float(radius[0]), float(height.max())]
            yield f"real-{name}", f"real {name}", points, np.array([truth])


def errors_of(trees: Sequence[TaskTree]) -> dict[str, np.ndarray]:
    """Told less true, of the trees of which it was told: metres of DBH, height and place."""
    dbh = np.array([tree.told_dbh - tree.dbh for tree in trees])
    height = np.array([tree.told_height - tree.height for tree in trees])
    away = np.array([tree.away for tree in trees])
    return {
        key: values[np.isfinite(values)]
        for key, values in (("dbh", dbh), ("height", height), ("place", away))
    }


# Tree tasks by a published tool as a part of docs/validation.md.


TITLE = "Tree tasks by a published tool"
REAL = "real"
SUMMARY = """\
What 3DFin 0.6.0 (Laino et al. 2024, on dendromatics 0.7.0), as it comes, with its own default settings, makes
of our clouds and of real ones: stem map, DBH and height, told less true. `python -m studies study tree-tasks
--tool 3DFIN --data FOLDER --docs docs` makes this part; the tool asks for a scipy below 1.17 and stands in an
environment of its own. Plots are those of `assets/plans/measured-stands.toml`, five tripods each, nothing
thinned out. Truth of ours is trees.csv, of trees of at least 6 cm, which is the tool's least diameter; of
the real pine and spruce (TreeLS, GPL-3) circles fitted to layers, and the highest point.
"""
COLOURS = {"pine": "#2f7d32", "spruce": "#1565c0", "broadleaf": "#c62828"}


def task_subject(found: TaskFindings, out: Path) -> Subject:
    """The part of the page, its picture drawn into ``out/tasks``."""
    folder = out / "tasks"
    folder.mkdir(parents=True, exist_ok=True)
    words = "DBH and height as told against as they are; real trees are stars."
    picture = Picture(draw_tasks(found, folder / "tasks.png"), words)
    rows = []
    for kind in dict.fromkeys(tree.kind for tree in found.trees):
        rows += _rows(found, kind, (picture,))
    return Subject("tasks", TITLE, SUMMARY, _terms(found), tuple(rows))


def _rows(found: TaskFindings, kind: str, pictures: tuple[Picture, ...]) -> list[Comparison]:
    trees = [tree for tree in found.trees if tree.kind == kind]
    errors, rows = errors_of(trees), []
    real = kind.startswith(REAL)
    for key, name, unit, scale in (
        ("dbh", "DBH", "mm", 1000.0),
        ("height", "height", "m", 1.0),
        ("place", "distance of the stem", "cm", 100.0),
    ):
        values = scale * errors[key]
        words = f"{len(values)} of {len(trees)} trees"
        if len(values):
            words += (
                f"; mean {values.mean():+.3g}, root mean square {np.sqrt((values**2).mean()):.3g}"
            )
        if key == "place":
            words += f"; {found.false.get(kind, 0)} stems told where none stands"
        told = Interval.of(values) if len(values) > 1 else None
        told = Interval(float(values[0])) if len(values) == 1 else told
        both = (told, None) if real else (None, told)
        name = f"{kind}: {name}, told less true"
        rows.append(Comparison(name, unit, *both, None, f"{words}.", pictures=pictures))
    return rows


def _terms(found: TaskFindings) -> str:
    lines = [
        "*Measured* is the tool on a real cloud, *simulated* on ours: median, and what holds 90 % of "
        "the trees."
    ]
    lines += [
        f"The tool stopped on {name}: {why.rstrip('.')}." for name, why in found.failed.items()
    ]
    lines += [
        "It tells no base of the crown, so none is compared. Where a section has fewer points than it asks "
        "for (80 in 5 cm of height), it tells no DBH: our pulses are 0.12 to 0.25° apart, coarser than in a "
        "scan that is made for stems. "
        "Heights are of the highest point near the axis, so a taller neighbour that reaches over counts."
    ]
    return "\n".join(lines)


def draw_tasks(found: TaskFindings, path: Path) -> Path:
    """Draw told against true DBH and height; returns the picture's path."""
    figure, panels = new_figure(2, (8.0, 3.8))
    for axes, key, unit in zip(np.ravel(panels), ("dbh", "height"), ("cm", "m"), strict=True):
        scale = 100.0 if key == "dbh" else 1.0
        for kind in dict.fromkeys(tree.kind for tree in found.trees):
            mine = [tree for tree in found.trees if tree.kind == kind]
            true = scale * np.array([getattr(tree, key) for tree in mine])
            told = scale * np.array([getattr(tree, f"told_{key}") for tree in mine])
            star = "*" if kind.startswith(REAL) else "."
            colour = COLOURS.get(kind.split()[-1], "#333333")
            size = 10 if star == "*" else 5
            axes.plot(true, told, star, color=colour, label=kind, markersize=size)
        high = scale * max(getattr(tree, key) for tree in found.trees)
        axes.plot([0, high], [0, high], color="#999999", linewidth=0.8)
        axes.set_xlabel(f"true {'DBH' if key == 'dbh' else key}, {unit}")
        axes.set_ylabel(f"told, {unit}")
        axes.legend(fontsize=6)
    return save_figure(figure, path)
