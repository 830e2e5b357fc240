"""Figures of a result in words: each once, for the report, run.json and Blender's panel.

A forest or what a sensor found goes in, ``Figure``s come out. The report shows those with a ``name``, the
narrow panel those with a ``short`` one, which translators know; the value is the same in both. A figure
that one of them says elsewhere, in a sentence or a note, has no name for it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..base.trimesh import DEAD, GROUND, LEAF, WOOD
from ..stand.forest import GrownForest


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


def octave_table(figures: Sequence[Figure]) -> dict[str, Mapping[str, str]]:
    """Return the figures that have a value for each octave: name, then octave and value."""
    return {each.name: each.by_octave for each in figures if each.name and each.by_octave}


def of_forest(forest: GrownForest) -> list[Figure]:
    """Trees, leaves and triangles of a forest."""
    stand = forest.stand
    variants = [forest.variant_of(tree) for tree in range(len(stand))]
    triangles = sum(len(tree.mesh.triangles) for tree in variants)
    unique = sum(len(tree.mesh.triangles) for tree in forest.variants.values())
    leaves = sum(len(tree.leaves) for tree in variants)
    density = float(stand.density().sum() * 1e4)
    figures = [numbers("trees", "Trees", f"{len(stand):,}")]
    figures += [
        numbers(label, label.title(), f"{count:,}")
        for label, count in zip(forest.labels, stand.counts(), strict=True)
    ]
    figures += [
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
