"""Train on plots of ours, test on real clouds: scores beside those of training on real ones and of rules.

Every seed learns from another two thirds of our plots; intervals hold 90 % of the seeds. Scores count cells
of 5 cm above 0.3 m, as far up as labels hold.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from forest_addon.base.progress import Say
from forest_addon.base.rng import stream
from forest_addon.formats.atomic import replacing
from forest_addon.formats.table import write_csv
from forest_addon.spec import SpecError
from headless.dataset import disk
from headless.dataset.engine import Cluster
from headless.dataset.factory import Asked, make_dataset
from headless.dataset.plan import find_plan, read_plan

from .clouds import Labelled, blurred, measured_trees, read_folder, read_scene
from .features import NAMES
from .learn import Score, Taught, cross_validated, lent, scored, taught, train
from .rules import can_separate, wood_by_rules

PLAN = "measured-stands"
EDGE = 1.0  # metres at a plot's edge that do not count
SHARE = 2 / 3  # of the plots that a seed learns from
BLUR = (
    0.0,
    0.03,
)  # metres, least and most that points of a plot are blurred by before they are learned from
LOW = 4.0  # metres: the heights that matter for diameters
WAYS = ("ours", "network", "real", "ours + 10 % real", "rules")


@dataclass(frozen=True)
class Request:
    """Request of a user: plots, seeds, where measurements are, folders of his own."""

    plots: int = 12
    seeds: int = 3
    seed: int = 1
    data: Path | None = None
    real: Path | None = None


@dataclass
class StudyRow:
    """Scores of one label of one cloud: of every way to learn, a score a seed."""

    cloud: str
    what: str
    high: float
    cells: int
    share: float
    sure: bool = False
    scores: dict[str, list[Score]] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Return what is told of which cloud, in words."""
        return (
            f"{self.what} of {self.cloud}"
            + (f" below {self.high:g} m" if self.high < 1e3 else "")
            + (", sure labels" if self.sure else "")
        )

    def left_out(self, cloud: Labelled) -> np.ndarray:
        """(C,) bool: cells of its cloud that do not count because their label is in doubt."""
        known = cloud.sure if self.sure and cloud.sure is not None else None
        return np.zeros(len(cloud.features), dtype=bool) if known is None else ~known

    def add(self, way: str, score: Score) -> None:
        """Note a score."""
        self.scores.setdefault(way, []).append(score)


@dataclass(frozen=True)
class StudyFindings:
    """Findings of the study. importance : of each label, (F,) importances of ours and of each cloud."""

    rows: list[StudyRow]
    importance: dict[str, dict[str, np.ndarray]]
    plots: int
    seconds: dict[str, float]


def run_study(asked: Request, out: Path, say: Say = print) -> StudyFindings:
    """Make plots, learn, test; writes scores.csv, importance.csv and study.json to ``out``.

    Raises
    ------
    SpecError : an extra or the measurements are missing.
    """
    needs_extras()
    began = time.process_time()
    plan = read_plan(find_plan(PLAN), [f"count={asked.plots}", f"seed={asked.seed}"])
    make_dataset(plan, out / "plots", Asked(Cluster(workers=1), quiet=False))
    made = _seconds_of(out / "plots")
    say(f"{asked.plots} plots: {made:.0f} CPU s when they were made")
    ours = blurred_plots(read_plots(out / "plots"), asked.seed)
    real = list(measured_trees(asked.data / "wood")) if asked.data else []
    real += read_folder(asked.real) if asked.real else []
    if not real:
        raise SpecError(
            "--data",
            "no real cloud is there; give --data with wood/ in it, or --real with a folder of LAS",
        )
    rows = [row for cloud in real for row in _rows(cloud)]
    importance: dict[str, dict[str, np.ndarray]] = {}
    for number in range(asked.seeds):
        seed = asked.seed * 1000 + number
        for what in ("stem", "wood"):
            clouds = [cloud for cloud in real if getattr(cloud, what) is not None]
            if clouds:
                sums = importance.setdefault(what, {})
                _one_seed(
                    some_of(ours, seed), clouds, what, [r for r in rows if r.what == what], sums
                )
        say(f"seed {number + 1} of {asked.seeds}: {time.process_time() - began:.0f} CPU s")
    _by_rules(real, rows, say)
    seconds = {"plots": made, "learning": time.process_time() - began}
    found = StudyFindings(rows, importance, asked.plots, seconds)
    _write(found, out)
    return found


def read_plots(folder: Path) -> list[Labelled]:
    """Return the plots of a dataset of ours, all scans of a plot together, without its edge."""
    found = []
    for one in disk.scenes_done(folder):
        scene = read_scene_table(one.folder)
        low = np.array(scene.get("origin", (0.0, 0.0))) + EDGE
        high = low + np.array(scene["size"]) - 2 * EDGE
        within = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        found.append(read_scene(one.folder, within, str(one.record.get("base", ""))))
    return found


def blurred_plots(ours: Sequence[Labelled], seed: int) -> list[Labelled]:
    """Our plots, each blurred by a spread of its own, drawn within ``BLUR``."""
    spreads = stream(seed, "blur").uniform(*BLUR, len(ours)).tolist()
    return [blurred(cloud, spread, seed) for cloud, spread in zip(ours, spreads, strict=True)]


def read_scene_table(folder: Path) -> dict:
    """Return the table ``forest`` of the scene of a folder."""
    import tomllib

    with open(folder / "scene.toml", "rb") as file:
        return tomllib.load(file)["forest"]


def needs_extras() -> None:
    """Refuse to go on without the extra ``study``.

    Raises
    ------
    SpecError : what is missing.
    """
    from importlib.util import find_spec

    missing = [name for name in ("pgeof", "sklearn") if find_spec(name) is None]
    if missing:
        raise SpecError(
            "study", f"needs {' and '.join(missing)}; pip install forest-sensing[study]"
        )


def _seconds_of(folder: Path) -> float:
    said = [json.loads(path.read_text()) for path in sorted((folder / "status").glob("*.json"))]
    return float(sum(sum(one.get("cpu", {}).values()) for one in said))


def _rows(cloud: Labelled) -> list[StudyRow]:
    found = []
    for what, highs in (("stem", (LOW, np.inf)), ("wood", (np.inf,))):
        truth = getattr(cloud, what)
        if truth is None:
            continue
        for high in highs:
            cells = cloud.counted(high=high)
            found.append(StudyRow(cloud.name, what, high, len(cells), float(truth[cells].mean())))
        if what == "wood" and cloud.sure is not None:
            cells = cloud.counted()
            cells = cells[cloud.sure[cells]]
            share = float(truth[cells].mean())
            found.append(StudyRow(cloud.name, what, np.inf, len(cells), share, True))
    return found


def some_of(ours: Sequence[Labelled], seed: int) -> list[Labelled]:
    """Two thirds of our plots, drawn by a seed."""
    chosen = stream(seed, "plots").permutation(len(ours))[: max(1, round(SHARE * len(ours)))]
    return [ours[number] for number in sorted(chosen.tolist())]


def _one_seed(
    ours: Sequence[Labelled],
    real: Sequence[Labelled],
    what: str,
    rows: Sequence[StudyRow],
    importance: dict[str, np.ndarray],
) -> None:
    """Learn once from each and note the scores."""
    seed = sum(len(row.scores.get("ours", ())) for row in rows)
    base = taught(ours, what, seed)
    learners = {"ours": train(base, seed), "network": train(base, seed, network=True)}
    _add(importance, "ours", learners["ours"].feature_importances_)
    lends = {cloud.name: lent(cloud, what, seed) for cloud in real}
    more = base
    for some, _ in lends.values():
        more = more.with_more(some)
    mixed = train(more, seed)
    for cloud in real:
        mine = [row for row in rows if row.cloud == cloud.name]
        counted, told = cross_validated(cloud, what, seed)
        truth, height = getattr(cloud, what), cloud.cells.height
        for row in mine:
            out = row.left_out(cloud)
            for way, learner in learners.items():
                row.add(way, scored(learner, cloud, what, row.high, out))
            but = out | lends[cloud.name][1]
            row.add("ours + 10 % real", scored(mixed, cloud, what, row.high, but))
            below = (height[counted] < row.high) & ~out[counted]
            row.add("real", Score.of(truth[counted][below], told[below]))
        known = Taught(cloud.features[counted], truth[counted], np.ones(len(counted)))
        _add(importance, cloud.name, train(known, seed).feature_importances_)


def _add(sums: dict[str, np.ndarray], name: str, values: np.ndarray) -> None:
    sums[name] = sums.get(name, 0.0) + values


def _by_rules(real: Sequence[Labelled], rows: Sequence[StudyRow], say: Say) -> None:
    """Note the scores of TLSeparation where the wood of a tree is known."""
    if not can_separate():
        say("tlseparation is not installed: no scores of rules (pip install forest-sensing[study])")
        return
    for cloud in real:
        for row in rows:
            if row.cloud == cloud.name and row.what == "wood" and cloud.wood is not None:
                cells = cloud.counted()
                cells = cells[~row.left_out(cloud)[cells]]
                told = wood_by_rules(cloud.cells.centre)
                row.add("rules", Score.of(cloud.wood[cells], told[cells]))


def _write(found: StudyFindings, out: Path) -> None:
    table: dict[str, list] = {
        key: []
        for key in ("cloud", "label", "below_m", "sure", "cells", "way", "seed", "miou", "f1")
    }
    for row in found.rows:
        for way, scores in row.scores.items():
            for number, score in enumerate(scores):
                values = (row.cloud, row.what, row.high, int(row.sure), row.cells, way, number)
                for key, value in zip(table, (*values, score.iou, score.f1), strict=True):
                    table[key].append(value)
    write_csv(out / "scores.csv", table)
    for what, sums in found.importance.items():
        shares = {name: (total / total.sum()).tolist() for name, total in sums.items()}
        write_csv(out / f"importance-{what}.csv", {"feature": list(NAMES), **shares})
    with replacing(out / "study.json") as text:
        record = {"plots": found.plots, "cpu_seconds": found.seconds}
        text.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
