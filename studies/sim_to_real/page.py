"""The study as a part of docs/validation.md: learning from ours beside learning from real clouds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from headless.report.flights import new_figure
from headless.report.pictures import save_figure

from ..validation.comparison import Comparison, Interval, Picture
from ..validation.page import Subject
from .features import NAMES
from .run import WAYS, StudyFindings, StudyRow

GOAL = 0.03  # of mIoU, below training on real clouds
SHOWN = 6  # features whose importance differs most
COLOURS = ("#2f7d32", "#8bc34a", "#333333", "#1565c0", "#c62828")
TITLE = "Training for the real world"
SUMMARY = """\
What a classifier that knew only our plots makes of real clouds. `python -m studies study sim-to-real
--data FOLDER --docs docs` makes this part. Plots are those of `assets/plans/measured-stands.toml`: measured
pines, spruces and broadleaved trees (half of these stands bare or losing their leaves) with undergrowth and
dead branches, five tripods each. Features are on cells of 5 cm, so that instrument and density hardly matter
(`studies/sim_to_real/features.py`).
Before ours are learned from, the cells of each plot are moved by chance, with a spread between 0 and 3 cm:
real points lie beside what they are of, as scans do not quite fit each other and trees move. Cells within
10 cm vote. Real are the pine and the spruce of TreeLS (GPL-3) and the broadleaved tree of aRchi (CeCILL).
*Measured* is a classifier that learned from the other layers, of 1 m, of the very cloud (five folds);
*simulated* is one that learned from ours alone. Both are random forests; scores are mIoU over class and
rest, of cells above 0.3 m. *Sure labels* leave out cells within 10 cm of a cylinder that are not on it.
Intervals are over seeds, each with another two thirds of our plots. *Agrees*: for stems within 0.03, for
wood better than the rules of TLSeparation 1.3.3 (Vicari et al. 2019).
"""
TERMS = """\
Labels are not drawn by hand. Stems are circles fitted to layers of 20 cm, which below the crown are sure
and in it less so; above the last circle nothing counts. Wood is within 2 cm, and a quarter of the radius,
of the cylinders of TreeQSM: twigs too thin for a cylinder are other than wood there, and six of ten cells
that are not wood lie within 10 cm of a cylinder, mostly wood that the cylinders miss: that tree hardly
bears leaves. No classifier that knows wood can have a high score; *sure labels* leave those cells out.
Cross-validation by layers of one tree flatters: the layers beside a layer show the same stem. `--real
FOLDER` tests LAS files of your own with FOR-instance's field names.
"""


def subject_of(found: StudyFindings, out: Path) -> Subject:
    """The part of the page, its pictures drawn into ``out/training``."""
    folder = out / "training"
    folder.mkdir(parents=True, exist_ok=True)
    pictures = (
        Picture(
            draw_scores(found, folder / "training-scores.png"), "mIoU by what was learned from."
        ),
        Picture(
            draw_importance(found, folder / "training-importance.png"),
            "Importance of features to a forest that learned from ours and from each real cloud: where "
            "they differ most.",
        ),
    )
    comparisons = [_comparison(row, pictures) for row in found.rows]
    return Subject("training", TITLE, SUMMARY, f"{_largest(found)}\n\n{TERMS}", tuple(comparisons))


def _comparison(row: StudyRow, pictures: tuple[Picture, ...]) -> Comparison:
    ours, real = _interval(row, "ours"), _interval(row, "real")
    if row.what == "wood":
        agrees = ours.value > _interval(row, "rules").value if "rules" in row.scores else None
    else:
        agrees = ours.value > real.value - GOAL
    others = [
        f"{way}: mIoU {_interval(row, way).text()}, F1 {np.median([s.f1 for s in row.scores[way]]):.3f}"
        for way in WAYS
        if way in row.scores
    ]
    words = f"{row.cells:,} cells, {100 * row.share:.0f} % of them {row.what}. {'; '.join(others)}."
    return Comparison(f"{row.name}, mIoU", "", real, ours, agrees, words, pictures=pictures)


def _interval(row: StudyRow, way: str) -> Interval:
    return Interval.of(np.array([score.iou for score in row.scores[way]]))


def _largest(found: StudyFindings) -> str:
    """Say in the classifier's terms where ours and the real clouds differ most."""
    lines = [
        "The largest differences between ours and the real clouds, in the classifier's terms:",
        "",
    ]
    for what, sums in found.importance.items():
        for name in (name for name in sums if name != "ours"):
            best = _most_unlike(sums, name)[:3]
            said = ", ".join(
                f"{NAMES[k]} ({_share(sums, 'ours')[k]:.2f} ours, {_share(sums, name)[k]:.2f} real)"
                for k in best
            )
            lines.append(f"- {what}, {name}: {said}")
    return "\n".join(lines)


def _share(sums: dict[str, np.ndarray], name: str) -> np.ndarray:
    return np.asarray(sums[name] / sums[name].sum())


def _most_unlike(sums: dict[str, np.ndarray], name: str) -> list[int]:
    return np.argsort(-np.abs(_share(sums, "ours") - _share(sums, name))).tolist()


def draw_scores(found: StudyFindings, path: Path) -> Path:
    """Draw bars of mIoU, a group a row; returns the picture's path."""
    figure, axes = new_figure(1, (8.0, 3.4))
    axes = np.ravel(axes)[0]
    wide = 0.8 / len(WAYS)
    for number, (way, colour) in enumerate(zip(WAYS, COLOURS, strict=True)):
        for place, row in enumerate(found.rows):
            if way in row.scores:
                value = _interval(row, way)
                error = [[value.value - (value.low or 0)], [(value.high or 0) - value.value]]
                label = (
                    way if place == len(found.rows) - 1 or (way != "rules" and not place) else None
                )
                x = place + (number - 2) * wide
                axes.bar(x, value.value, wide, color=colour, yerr=error, label=label)
    axes.set_xticks(range(len(found.rows)), [row.name.replace(" of ", "\n") for row in found.rows])
    axes.tick_params(axis="x", labelsize=6)
    axes.set_ylim(0, 1)
    axes.set_ylabel("mIoU")
    handles, labels = axes.get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))
    axes.legend(named.values(), named.keys(), fontsize=6, ncols=len(WAYS), loc="upper center")
    return save_figure(figure, path)


def draw_importance(found: StudyFindings, path: Path) -> Path:
    """Draw importances that differ most between ours and each real cloud; returns the picture's path."""
    pairs = [(w, n) for w, sums in found.importance.items() for n in sums if n != "ours"]
    figure, panels = new_figure(max(len(pairs), 1), (3.0 * max(len(pairs), 1), 3.0))
    for axes, (what, name) in zip(np.ravel(panels), pairs, strict=True):
        sums = found.importance[what]
        best = _most_unlike(sums, name)[:SHOWN][::-1]
        for offset, who, colour in ((0.2, "ours", COLOURS[0]), (-0.2, name, COLOURS[2])):
            place = np.arange(len(best)) + offset
            axes.barh(place, _share(sums, who)[best], 0.4, color=colour, label=who)
        axes.set_yticks(range(len(best)), [NAMES[k] for k in best], fontsize=6)
        axes.set_title(f"{what}, {name}", fontsize=7)
        axes.legend(fontsize=6)
    return save_figure(figure, path)
