"""The ablations as a part of docs/validation.md: a table of differences, and one picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from headless.report.flights import new_figure
from headless.report.pictures import save_figure

from ..validation.comparison import Comparison, Interval, Picture
from ..validation.page import Subject
from .ablations import ALL, CURVE, AblationScore, differences

TITLE = "What matters to who trains"
COLOURS = ("#2f7d32", "#1565c0", "#c62828", "#6a1b9a")
SUMMARY = """\
Plots made again without one thing at a time, and what a classifier of real clouds gains or loses by it.
`python -m studies study ablations --data FOLDER --docs docs` makes this part: {plots} plots each way, of
the same stands (`assets/plans/measured-stands.toml`), three tripods each with 0.3 to 0.4° between pulses;
*all* has beams of 0.68 mrad in 7 sub-rays, noise, a threshold (reflectance 0.4 at 40 m), dead branches,
undergrowth and relief of the bark. {seeds} seeds, each with two thirds of the plots, the same of every way.
Scores are mIoU on the clouds of the part before; plots
are not blurred here, so that what is away can show.
"""
TERMS = """\
Differences are in thousandths of mIoU, of pairs with the same stands and the same plots learned from:
median (least to most of the seeds). One real tree a label is little: what is below about 10 here may be
another tree's opposite. *little occlusion*: the same pulses from twelve tripods. *leaves at any angle*:
inclinations of a sphere in place of those that the species grow. *nothing varies*: noise, step and relief
of the ground are fixed. *randomise*: the plan's word, with instruments of that platform in place of the one
above: plots differ more then, and are less like these clouds. *wind*: 5 m/s at the tops.
"""


def ablation_subject(found: Sequence[AblationScore], out: Path) -> Subject:
    """The part of the page, its picture drawn into ``out/ablations``."""
    folder = out / "ablations"
    folder.mkdir(parents=True, exist_ok=True)
    picture = Picture(
        draw_ablations(found, folder / "ablations.png"),
        "Left: mIoU on real clouds without one thing, less that with all; lines join the least and the most "
        "of the seeds. Right: by the number of plots that were learned from.",
    )
    rows = [
        Comparison(
            f"{what} of {cloud}, all on, mIoU",
            "",
            None,
            Interval.of(np.array([r.iou for r in found if _is(r, ALL, what, cloud)])),
            None,
            pictures=(picture,),
        )
        for what, cloud in _clouds(found)
    ]
    plots = max(row.plots for row in found if row.way == ALL)
    seeds = 1 + max(row.seed for row in found)
    summary = SUMMARY.format(plots=_made(plots), seeds=seeds)
    return Subject("ablations", TITLE, summary, f"{_table(found)}\n\n{TERMS}", tuple(rows))


def _made(learned: int) -> int:
    """Return how many plots were made, of which two thirds were learned from."""
    return round(learned * 3 / 2)


def _is(row: AblationScore, way: str, what: str, cloud: str) -> bool:
    return (row.way, row.what, row.cloud) == (way, what, cloud)


def _clouds(found: Sequence[AblationScore]) -> list[tuple[str, str]]:
    return list(dict.fromkeys((row.what, row.cloud) for row in found))


def _ways(found: Sequence[AblationScore]) -> list[str]:
    return [w for w in dict.fromkeys(row.way for row in found) if w not in (ALL, CURVE)]


def _table(found: Sequence[AblationScore]) -> str:
    clouds, of = _clouds(found), differences(found)
    lines = ["| | " + " | ".join(f"{what} of {cloud}" for what, cloud in clouds) + " |"]
    lines += ["|" + "---|" * (1 + len(clouds))]
    for way in _ways(found):
        cells = []
        for what, cloud in clouds:
            some = 1000 * of[way, what, cloud]
            cells.append(f"{np.median(some):+.0f} ({some.min():+.0f} to {some.max():+.0f})")
        lines.append(f"| {way} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def draw_ablations(found: Sequence[AblationScore], path: Path) -> Path:
    """Draw differences by way, and the learning curve; returns the picture's path."""
    figure, panels = new_figure(2, (9.0, 3.8))
    left, right = np.ravel(panels)
    clouds, ways, of = _clouds(found), _ways(found), differences(found)
    high = 0.8 / max(len(clouds), 1)
    for number, (what, cloud) in enumerate(clouds):
        colour, name = COLOURS[number % len(COLOURS)], f"{what} of {cloud}"
        some = [of[way, what, cloud] for way in ways]
        middle = np.array([np.median(values) for values in some])
        spread = [
            [m - values.min() for m, values in zip(middle, some, strict=True)],
            [values.max() - m for m, values in zip(middle, some, strict=True)],
        ]
        place = len(ways) - 1 - np.arange(len(ways)) + (1 - number) * high
        left.barh(place, middle, high, xerr=spread, color=colour, label=name)
        curve: dict[int, list[float]] = {}
        for row in found:
            if _is(row, CURVE, what, cloud):
                curve.setdefault(row.plots, []).append(row.iou)
        right.plot(list(curve), [np.median(v) for v in curve.values()], "o-", color=colour)
        low, top = ([end(v) for v in curve.values()] for end in (min, max))
        right.fill_between(list(curve), low, top, color=colour, alpha=0.2, linewidth=0)
    left.set_yticks(range(len(ways)), ways[::-1], fontsize=7)
    left.axvline(0.0, color="#333333", linewidth=0.8)
    left.set_xlabel("mIoU less that of all")
    left.legend(fontsize=6)
    right.set_xscale("log", base=2)
    right.set_xlabel("plots learned from")
    right.set_ylabel("mIoU")
    return save_figure(figure, path)
