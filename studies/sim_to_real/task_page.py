"""Tree tasks by a published tool as a part of docs/validation.md."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from headless.report.flights import new_figure
from headless.report.pictures import save_figure

from ..validation.comparison import Comparison, Interval, Picture
from ..validation.page import Subject
from .tasks import TaskFindings, errors_of

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
