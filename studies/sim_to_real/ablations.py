"""Plots of ours made again without one thing at a time: what a classifier loses on real clouds without it.

All plots of all ways have the same seed, so the same stands, and every seed of the learning takes the same of
them: differences are of pairs. The way ``all`` has everything that is switched off elsewhere: an instrument
with beams of sub-rays, noise and a threshold, dead branches, undergrowth and relief of the bark.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from forest_addon.api import SpecError

from ..inside import (
    ASSETS,
    Cluster,
    Say,
    find_plan,
    make_dataset,
    new_figure,
    put,
    read_plan,
    read_tables,
    save_figure,
    stream,
    write_whole,
)
from ..tables import write_rows
from ..validation.run import Comparison, Interval, Picture, Subject
from .clouds import Labelled, measured_trees
from .run import PLAN, needs_extras, read_plots, scored, some_of, taught, train

ALL, CURVE = "all", "plots"
TRIPODS, STEP = 3, (0.30, 0.40)  # of a plot, and degrees between their pulses
MORE_TRIPODS = 12
SENSORS = "scenes[*].scene.sensors[*]"
NOISE, ANGLE = "vary.sensors[*].noise.range_sd", "vary.sensors[*].angle_step_deg"
Changes = Mapping[str, Any]  # values by their paths in a table; None: without it
# Plots of the way ``all``: a short instrument whose threshold is met within a plot, and bark in relief.
BASE: Changes = {
    "place[0].count": TRIPODS,
    ANGLE: {"uniform": list(STEP)},
    f"{SENSORS}.max_range": 40.0,
    f"{SENSORS}.faintest": 0.4,
    f"{SENSORS}.beam": {
        "divergence_mrad": [0.68, 0.68],
        "exit_diameter": 0.0038,
        "subrays": 7,
    },
    f"{SENSORS}.noise": {"range_ppm": 300.0},
    "scenes[*].scene.accuracy": {"relief": True},
}
WIDER = (MORE_TRIPODS / TRIPODS) ** 0.5  # the same pulses over more tripods


@dataclass(frozen=True)
class Away:
    """One way to make plots: its name, what it changes in the plan, and in the files of its species."""

    name: str
    plan: Changes = field(default_factory=dict)
    species: Changes = field(default_factory=dict)


WAYS_MADE = (
    Away(ALL),
    Away("no noise", {NOISE: {"fixed": 0.0}, f"{SENSORS}.noise.range_ppm": 0.0}),
    Away("no sub-rays", {f"{SENSORS}.beam": {}}),
    Away("no threshold", {f"{SENSORS}.faintest": 0.0}),
    Away("no dead branches", species={"architecture.dead.density": 0.0}),
    Away("no undergrowth", {"vary.forest.undergrowth": {"fixed": "none"}}),
    Away(
        "little occlusion",
        {
            "place[0].count": MORE_TRIPODS,
            "place[0].apart": 2.0,
            ANGLE: {"uniform": [WIDER * step for step in STEP]},
        },
    ),
    Away("leaves at any angle", species={"inclination": {"mean_deg": 57.3, "sd_deg": 21.5}}),
    Away("no bark relief", {"scenes[*].scene.accuracy": {"relief": False}}),
    Away(
        "nothing varies",
        {
            "vary": {},
            ANGLE: {"fixed": sum(STEP) / 2},
            NOISE: {"fixed": 0.003},
            "vary.terrain.relief": {"fixed": 0.7},
        },
    ),
    Away(
        'randomise = "measured"',
        {
            "vary": {},
            "randomise": "measured",
            ANGLE: None,
            **{f"{SENSORS}.{key}": None for key in ("max_range", "faintest", "beam", "noise")},
            f"{SENSORS}.angle_step_deg": sum(STEP) / 2,
        },
    ),
    Away("wind", {"scenes[*].scene.wind": {"speed": 5.0}}),
)


def changed(table: dict[str, Any], changes: Changes) -> dict[str, Any]:
    """A plan or a species with values set, and keys of the value None left out."""
    table = copy.deepcopy(table)
    for path, value in changes.items():
        whole, dot, key = path.partition(".")
        if whole == "vary" and dot:  # what follows is one key, dots and all
            table["vary"][key] = value
        else:
            put(table, path, copy.deepcopy(value))
    return _without_none(table)


def _without_none(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_none(each) for key, each in value.items() if each is not None}
    return [_without_none(each) for each in value] if isinstance(value, list) else value


@dataclass(frozen=True)
class AblationScore:
    """mIoU of one seed of one way on one real cloud. plots : how many were learned from."""

    way: str
    plots: int
    cloud: str
    what: str
    seed: int
    iou: float
    f1: float


def run_ablations(
    data: Path, out: Path, plots: int, seeds: int, seed: int, say: Say = print
) -> list[AblationScore]:
    """Make plots each way, learn, test on the clouds of ``data/wood``; ablations.csv grows as it goes on.

    Raises
    ------
    SpecError : an extra or the measurements are missing.
    """
    needs_extras()
    real = list(measured_trees(data / "wood"))
    if not real:
        raise SpecError(f"--data {data}", "has no measured tree in wood/")
    scores: list[AblationScore] = []
    for way in WAYS_MADE:
        count = 2 * plots if way.name == ALL else plots
        path = write_plan_of(way, out / way.name.replace('"', "").replace(" ", "-"), count, seed)
        began = time.process_time()
        make_dataset(read_plan(path), path.parent / "plots", Cluster(workers=1), quiet=True)
        ours = read_plots(path.parent / "plots")
        scores += _scores(way.name, ours[:plots], real, seeds, seed)
        if way.name == ALL:
            scores += _curve(ours, real, seeds, seed)
        write_rows(out / "ablations.csv", scores)
        here = [f"{row.what} {row.cloud} {row.iou:.3f}" for row in scores if row.way == way.name]
        say(f"{way.name}: {time.process_time() - began:.0f} CPU s of learning; {', '.join(here)}")
    return scores


def write_plan_of(way: Away, folder: Path, count: int, seed: int) -> Path:
    """Write the plan of one way, and the species that it changes, to a folder; returns the plan."""
    folder.mkdir(parents=True, exist_ok=True)
    plan = read_tables(find_plan(PLAN))
    plan |= {"name": way.name, "count": count, "seed": seed}
    plan = changed(plan, {"vary": way.plan.get("vary", plan["vary"])} | BASE | way.plan)
    plantings = [one for base in plan["scenes"] for one in base["scene"]["plantings"]]
    for planting in plantings if way.species else ():
        table = read_tables(ASSETS / "species" / f"{planting['species']}.toml")
        planting["species"] = f"{planting['species']}-changed.toml"
        write_whole(folder / planting["species"], tomli_w.dumps(changed(table, way.species)))
    write_whole(folder / "plan.toml", tomli_w.dumps(plan))
    return folder / "plan.toml"


def _scores(
    way: str, ours: Sequence[Labelled], real: Sequence[Labelled], seeds: int, seed: int
) -> list[AblationScore]:
    """Scores of learning from two thirds of some plots, by seed and cloud."""
    scores = []
    for number in range(seeds):
        chosen_plots = some_of(ours, seed * 1000 + number) if len(ours) > 2 else list(ours)
        scores += _learned(way, chosen_plots, real, number)
    return scores


def _curve(
    ours: Sequence[Labelled], real: Sequence[Labelled], seeds: int, seed: int
) -> list[AblationScore]:
    """Scores by how many plots were learned from, each seed in an order of its own."""
    scores = []
    for count in sorted({2**k for k in range(10) if 2**k < len(ours)} | {len(ours)}):
        for number in range(seeds):
            turn = stream(seed, "curve", number).permutation(len(ours))[:count]
            scores += _learned(CURVE, [ours[k] for k in turn.tolist()], real, number)
    return scores


def _learned(
    way: str, plots: Sequence[Labelled], real: Sequence[Labelled], number: int
) -> list[AblationScore]:
    """Scores on the real clouds of a classifier that learned from some plots."""
    scores = []
    for what in ("stem", "wood"):
        clouds = [cloud for cloud in real if getattr(cloud, what) is not None]
        learner = train(taught(plots, what, number), number) if clouds else None
        for cloud in clouds:
            got = scored(learner, cloud, what)
            scores.append(AblationScore(way, len(plots), cloud.name, what, number, got.iou, got.f1))
    return scores


def differences(found: Sequence[AblationScore]) -> Mapping[tuple[str, str, str], np.ndarray]:
    """mIoU of each way less that of ``all``, by way, label and cloud, a value a seed."""
    of: dict[tuple[str, str, str], dict[int, float]] = {}
    for row in found:
        of.setdefault((row.way, row.what, row.cloud), {})[row.seed] = row.iou
    ways = [key for key in of if key[0] not in (ALL, CURVE)]
    return {
        key: np.array([iou - of[(ALL, *key[1:])][seed] for seed, iou in of[key].items()])
        for key in ways
    }


# The ablations as a part of docs/validation.md: a table of differences, and one picture.


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
    made = round(plots * 3 / 2)  # of which two thirds were learned from
    summary = SUMMARY.format(plots=made, seeds=seeds)
    return Subject("ablations", TITLE, summary, f"{_table(found)}\n\n{TERMS}", tuple(rows))


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
