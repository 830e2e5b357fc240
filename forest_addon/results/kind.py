"""Record of what a sensor GIVES: one a kind, filled in by the file of each sensor in this room.

The record turns what a sensor found into figures and sentences for panel and report, files, a picture, a
sound, points. Whoever shows or writes results looks it up by the ``kind`` of the sensor's settings
(``kinds``) and knows no result by its class. What a sensor *is* is the record of the same kind in
``sensing``.

Only figures and arrays are needed; a result that says no more becomes an NPZ, a table, and lines in panel
and report.

Figures are said once, for the report, run.json and Blender's panel: the report shows those with a ``name``,
the narrow panel those with a ``short`` one, which translators know; the value is the same in both. A figure
that one of them says elsewhere, in a sentence or a note, has no name for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ..base.trimesh import DEAD, GROUND, LEAF, WOOD
from ..drawing.strips import Plot
from ..sensing.kind import Seen
from ..sensing.lidar.cloud import Cloud
from ..sensing.sonar.echo import Contributions
from ..stand.forest import GrownForest
from ..stand.plan import PLANTS
from .coordinates import Offset


@dataclass(frozen=True)
class Figure:
    """One figure: its names, and its value.

    pattern, values : the value, of which the pattern can be translated; numbers and their units are filled
    in already and have no pattern. by_octave : the value of each octave, where there is one of each; the
    report makes a table of such figures.
    """

    name: str
    short: str
    text: str
    pattern: str = ""
    values: Mapping[str, float | str] = field(default_factory=dict)
    by_octave: Mapping[str, str] = field(default_factory=dict)


def numbers(name: str, short: str, text: str) -> Figure:
    """A figure that reads the same in every language: numbers, their units, a name."""
    return Figure(name, short, text)


def words(name: str, short: str, pattern: str, /, **values: float | str) -> Figure:
    """A figure that is said in words: a pattern of ``str.format`` and what fills it."""
    return Figure(name, short, pattern.format(**values) if values else pattern, pattern, values)


def facts(figures: Sequence[Figure]) -> dict[str, str]:
    """Lines of figures for the report and run.json."""
    return {each.name: each.text for each in figures if each.name}


def of_forest(forest: GrownForest, own: int) -> list[Figure]:
    """Trees, undergrowth, leaves and triangles of a forest; own : plantings of its scene file."""
    stand = forest.stand
    low = [row >= own or kind.name in PLANTS for row, kind in enumerate(forest.species)]
    below = int(stand.counts()[low].sum())
    variants = [forest.variant_of(tree) for tree in range(len(stand))]
    triangles = sum(len(tree.mesh.triangles) for tree in variants)
    unique = sum(len(tree.mesh.triangles) for tree in forest.variants.values())
    leaves = sum(len(tree.leaves) for tree in variants)
    density = float(stand.density()[np.logical_not(low)].sum() * 1e4)
    counts = zip(forest.labels, stand.counts(), strict=True)
    figures = [
        numbers("trees", "Trees", f"{len(stand) - below:,}"),
        *([numbers("undergrowth", "Undergrowth", f"{below:,}")] if below else ()),
        *(numbers(label, label.title(), f"{count:,}") for label, count in counts),
        numbers("leaves", "Leaves", f"{leaves:,}"),
        numbers("triangles", "Triangles", f"{triangles:,}"),
        numbers("triangles of the variants", "Held Once", f"{unique:,}"),
        words("density", "Density", "{density:,.0f} trees/ha", density=density),
    ]
    if stand.removed:
        removed, before = int(stand.removed), len(stand) + int(stand.removed)
        figures.append(
            words(
                "",
                "Spacing",
                "{removed:,} of {before:,} removed",
                removed=removed,
                before=before,
            )
        )
    if stand.off_ground.any():
        lost = int(stand.off_ground.sum())
        figures.append(words("", "No Ground", "{count:,} left out", count=lost))
    return figures


def organ_figures(organ: np.ndarray) -> Iterator[Figure]:
    """Return the shares of wood, leaves and ground among what was hit, by organ."""
    yield numbers("wood", "Wood", share(organ == WOOD))
    yield numbers("leaves", "Leaves", share(organ == LEAF))
    yield numbers("ground", "Ground", share(organ == GROUND))
    if (organ == DEAD).any():
        yield numbers("dead wood", "Dead Wood", share(organ == DEAD))


def share(mask: np.ndarray) -> str:
    """Share of a mask that is true, in per cent."""
    return f"{100 * float(np.mean(mask)):.1f} %" if mask.size else "0 %"


def sound_columns(samples: np.ndarray, rate: float) -> dict[str, list[float]]:
    """Return the table of a sound: time, and a column for each channel of (C, N) samples at ``rate`` Hz."""
    time = {"time_s": (np.arange(samples.shape[1]) / rate).tolist()}
    return time | {f"channel_{n}": row.tolist() for n, row in enumerate(samples, 1)}


Finding = Any  # what a sensor found: a Cloud, an Echo, ...
Variables = Mapping[str, tuple[tuple[str, ...], np.ndarray, str]]  # dimensions, values, unit


@dataclass(frozen=True)
class ResultKind:
    """Record of a result; its functions take the sensor's settings and what it found.

    figures : its figures; the scene, where it is known, for those that need it. arrays : named arrays of
        what was found, with ``units`` by name; what is written where ``write``, ``saves`` say nothing else.
    labelled : the same for tables: variables and coordinates by name, each its dimensions, values and unit;
        what is known by ``arrays`` alone has dimensions without names.
    sentence : the most telling figure in a few words, ``keep``-ed for translators; empty: the first figure.

    title, story, notes : heading, sentence and remarks in the report.
    doubts : what a user should be warned of, as a tolerance that was not reached.
    files : what a run's files are called after the sensor's name; "": it may be a folder.
    write : the files of a run in a folder, with the offset of the scene; the one of the data first.
    saves : how it is exported, by the ending of the file, the usual one first.
    plot : a picture of it; None: there is nothing to draw. points : it as points in the scene; None: it has
        none. is_cloud : points are all that it is. marks : what sounded where, to show in the scene.
    sound : samples (N, C) and rate in Hz, as it is played; None: it is silent. is_response : other sounds are
        played through it. wet : a dry sound (M,) of a rate as it is heard, (N, C) and its rate.
    """

    figures: Callable[[Any, Finding, Seen | None], list[Figure]]
    arrays: Callable[[Finding], dict[str, np.ndarray]] | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    labelled: Callable[[Finding], tuple[Variables, Variables]] | None = None
    sentence: Callable[[Finding], str] = lambda *_: ""
    title: Callable[[Any], str] = lambda one: f"{one.TITLE or one.kind.title()}: {one.name}"
    story: Callable[[Any, Finding], str] = lambda *_: ""
    notes: Callable[[Any, Finding], tuple[str, ...]] = lambda *_: ()
    doubts: Callable[[Any, Finding], tuple[str, ...]] = lambda *_: ()
    files: tuple[str, ...] = (".npz",)
    write: Callable[[Path, Any, Finding, Offset], list[Path]] | None = None
    saves: Mapping[str, Callable[[Path, Any, Finding, Offset], None]] = field(default_factory=dict)
    plot: Callable[[Any, Finding], Plot | None] = lambda *_: None
    points: Callable[[Any, Finding], Cloud | None] = lambda *_: None
    is_cloud: bool = False
    marks: Callable[[Finding], Contributions | None] = lambda *_: None
    sound: Callable[[Any, Finding], tuple[np.ndarray, float]] | None = None
    is_response: bool = False
    wet: Callable[[Any, Finding, np.ndarray, float], tuple[np.ndarray, float]] | None = None

    @property
    def endings(self) -> tuple[str, ...]:
        """Endings of files that a result is exported to, the usual one first."""
        return tuple(self.saves) or (".npz", ".csv")
