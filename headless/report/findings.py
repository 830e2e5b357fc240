"""Findings of each stage of a run: sentences, figures (``results/figures``), and notes about accuracy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from forest_addon.results.figures import facts, octave_table, of_forest
from forest_addon.results.kinds import results_of
from forest_addon.sensing.kind import Seen
from forest_addon.spec import Scene, Sensor
from forest_addon.stand.forest import GrownForest
from forest_addon.stand.targets import TargetsMet, facts_of, sentences

from .page import Finding

if TYPE_CHECKING:  # its estimates bring scipy.optimize
    from forest_addon.stand.statistics.goodness import Goodness


def forest_finding(settings: Scene, forest: GrownForest, picture: Path | None) -> Finding:
    """Trees, leaves and triangles of the forest, and where its trees stand."""
    wide, deep = settings.forest.size
    return Finding(
        "Forest",
        f"{_stand_in_words(settings, forest.stand.removed)} on {wide:g} by {deep:g} m.",
        facts(of_forest(forest)),
        tuple(_stand_notes(settings, forest)),
        picture,
    )


LAYOUTS = {
    "clusters": "Trees in groups",
    "strauss": "Trees that keep apart (a Strauss process)",
    "rows": "Rows of trees",
    "list": "Trees from a list",
}


def _stand_in_words(settings: Scene, removed: int) -> str:
    """Return how the trees of a scene are placed, as its settings say; ``removed``: to keep distances."""
    layouts = {planting.layout for planting in settings.plantings}
    if not layouts:
        return "A field without trees"
    if len(layouts) > 1:
        return "Trees placed in several ways"
    (layout,) = layouts
    if layout != "poisson":
        return LAYOUTS[layout]
    uneven = any(
        planting.gaussians or planting.rasters or planting.painted
        for planting in settings.plantings
    )
    poisson = "An inhomogeneous Poisson forest" if uneven else "A Poisson forest"
    return f"{poisson}, thinned to keep distances," if removed else poisson


def _stand_notes(settings: Scene, forest: GrownForest) -> Iterator[str]:
    """Return what was expected, what was taken away and why."""
    stand = forest.stand
    sums = [
        f"{label} {value:,.1f} ± {error:.2g}"
        if error
        else f"{label} {value:,.1f}".removesuffix(".0")
        for label, value, error in zip(forest.labels, stand.expected, stand.error, strict=True)
    ]
    if sums:
        yield f"Expected: {', '.join(sums)} trees."
    if stand.removed:
        lost = zip(forest.labels, stand.too_near, strict=True)
        rule = {"matern": "Matérn II", "greedy": "greedy removal"}[settings.forest.spacing_rule]
        yield (
            f"{stand.removed:,} trees were removed to keep their distances ({rule}): "
            + ", ".join(f"{label} {count:,}" for label, count in lost if count)
            + "."
        )
    for note in forest.notes:
        yield f"{note}."
    if stand.off_ground.any():
        yield f"{stand.off_ground.sum():,} trees were left out where the terrain has no ground."
    if stand.off_field.any():
        yield f"{stand.off_field.sum():,} places of rows or lists lie beyond the field."
    yield from forest.detail


def targets_finding(met: Sequence[TargetsMet]) -> Finding | None:
    """Return what trees were to measure and what they do; None where nobody asked."""
    if not met:
        return None
    told: dict[str, str] = {}
    notes: list[str] = []
    for one in met:
        told |= facts_of(one)
        notes += sentences(one)
    kinds = sorted({one.kind for one in met if one.kind})
    band = (
        f" The band holds nine of ten measured trees of the same diameter ({', '.join(kinds)})."
        if kinds
        else ""
    )
    return Finding(
        "What the trees were to measure",
        "Target and reached; each tree is its variant in the size at which its stem has its diameter 1.3 m "
        "up." + band,
        told,
        tuple(notes) or ("Every target is met.",),
    )


def goodness_finding(found: Goodness, picture: Path | None) -> Finding:
    """Return whether trees stand as their intensity says."""
    bands, quadrats = found.excess, found.quadrats
    return Finding(
        "Where the trees stand",
        "The inhomogeneous L function of the trees and their counts in quadrats, against "
        f"{bands.simulations} other stands of the same settings. L(r) - r is 0 for a Poisson process, below "
        "it where trees keep apart.",
        {
            "trees tested": f"{found.trees:,}",
            "L function": f"p = {bands.p_value:.3f}",
            f"quadrats ({quadrats.classes} classes)": f"p = {found.quadrat_p_value:.3f}",
        },
        (
            "Edge correction by translation, within the region where the intensity is at least a tenth of "
            "its mean over trees. The global envelope is the studentised maximum deviation at 5 %; one "
            "stand in twenty lies beyond it by chance.",
        ),
        picture,
    )


def finding_of(sensor: Sensor, found: Any, picture: Path | None, seen: Seen) -> Finding:
    """Return what a sensor has to say of what it found in a scene."""
    record = results_of(sensor)
    figures = record.figures(sensor, found, seen)
    return Finding(
        record.title(sensor),
        record.story(sensor, found),
        facts(figures),
        record.notes(sensor, found),
        picture,
        octaves=octave_table(figures),
        warnings=record.doubts(sensor, found),
    )
