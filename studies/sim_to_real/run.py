"""TLSeparation (Vicari et al. 2019, Methods Ecol. Evol. 10:680), the rules that tell wood from leaf.

Version 1.3.3 was written for Python 2 and numpy before 1.20. Words that have gone since are replaced as it
is imported (dictionaries' ``iteritems`` and lists of keys, ``numpy.int``); its rules are as published.
"""

from __future__ import annotations

import contextlib
import io
import re
import sys
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import find_spec
from pathlib import Path
from types import CodeType
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from forest_addon.api import SpecError

from ..inside import (
    Cluster,
    Say,
    disk,
    find_plan,
    make_dataset,
    new_figure,
    read_plan,
    read_tables,
    save_figure,
    stream,
    write_csv,
)
from ..tables import write_rows
from ..validation.run import Comparison, Interval, Picture, Subject
from .clouds import (
    LOWEST,
    NAMES,
    Labelled,
    blurred,
    measured_trees,
    read_folder,
    read_scene,
)

NAME = "tlseparation"
NOW = (
    (r"\.iteritems\(\)", ".items()"),
    (r"(\w+)\.(keys|values)\(\)", r"list(\1.\2())"),
    (r"np\.(int|float|bool)\b(?!_|\d)", r"\1"),
    (r"np\.in1d\b", "np.isin"),
)


def wood_by_rules(points: np.ndarray) -> np.ndarray:
    """(P,) whether the points (P, 3), metres, of a tree are wood, by ``large_tree_3`` as it
    comes; ``generic_tree`` fails where a cloud has no points of its class trunk.

    Raises
    ------
    ImportError : it is not installed.
    """
    finder = _SeparationFinder()
    sys.meta_path.insert(0, finder)
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            from tlseparation.scripts.automated_separation import large_tree_3

            wood = large_tree_3(np.asarray(points, dtype=np.float64))[0]
    finally:
        sys.meta_path.remove(finder)
    is_wood = np.zeros(len(points), dtype=bool)
    if len(wood):
        is_wood[cKDTree(points).query(wood)[1]] = True
    return is_wood


class _SeparationFinder(PathFinder):
    """Finds the modules of TLSeparation, and has them translated."""

    @classmethod
    def find_spec(cls, fullname: str, path=None, target=None) -> ModuleSpec | None:
        """Return the place of a module; None of other packages."""
        if fullname.split(".")[0] != NAME:
            return None
        spec = super().find_spec(fullname, path, target)
        if spec is not None and spec.origin is not None:
            spec.loader = _Translated(fullname, spec.origin)
        return spec


class _Translated(SourceFileLoader):
    """Loads a module of Python 2's time in today's words."""

    def get_code(self, fullname: str) -> CodeType:
        """Return the compiled module; never from a cache, which holds it as it was."""
        path = self.get_filename(fullname)
        text = self.get_data(path).decode("utf-8")
        for old, new in NOW:
            text = re.sub(old, new, text)
        return self.source_to_code(text.encode("utf-8"), path)


# Learning of a class from features, and scores: what is trained, on what, and how well it tells.


CELLS = 10_000  # of a plot that a classifier is trained with
TREES, LEAST = 60, 5  # of the forest, and cells of a leaf of it
FOLDS = 5
LENT = 0.1  # share of the blocks of real clouds that are lent to a classifier of ours
HEAVIER = 5.0  # weight of a lent cell


@dataclass(frozen=True)
class Score:
    """Mean of the two intersections over unions, and the F1 of the class itself."""

    iou: float
    f1: float

    @staticmethod
    def of(truth: np.ndarray, told: np.ndarray) -> Score:
        """Score of labels told (N,) bool."""
        both, either = (truth & told).sum(), (truth | told).sum()
        neither, not_both = (~truth & ~told).sum(), (~truth | ~told).sum()
        iou = (both / max(either, 1) + neither / max(not_both, 1)) / 2
        return Score(float(iou), float(2 * both / max(truth.sum() + told.sum(), 1)))


@dataclass(frozen=True)
class Taught:
    """Rows to learn from: features (N, F), labels (N,) bool, weights (N,)."""

    features: np.ndarray
    label: np.ndarray
    weight: np.ndarray

    def with_more(self, more: Taught) -> Taught:
        """Join both."""
        pairs = ((self.features, more.features), (self.label, more.label))
        return Taught(*(np.concatenate(pair) for pair in (*pairs, (self.weight, more.weight))))


def taught(clouds: Sequence[Labelled], what: str, seed: int) -> Taught:
    """Rows of some clouds for the label ``what``, at most ``CELLS`` of each."""
    rng = stream(seed, "taught", what)
    features, label = [], []
    for cloud in clouds:
        rows = rng.permutation(cloud.counted())[:CELLS]
        features.append(cloud.features[rows])
        label.append(getattr(cloud, what)[rows])
    flags = np.concatenate(label)
    return Taught(np.concatenate(features), flags, np.ones(len(flags)))


def train(rows: Taught, seed: int, network: bool = False) -> Any:
    """Return a classifier: a random forest (Breiman 2001), or a network of two layers of 64."""
    # An extra: see [project.optional-dependencies] study.
    from sklearn.ensemble import RandomForestClassifier
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.neural_network import MLPClassifier
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    if network:
        layers = MLPClassifier((64, 64), max_iter=12, batch_size=512, random_state=seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # twelve rounds are meant
            return make_pipeline(StandardScaler(), layers).fit(rows.features, rows.label)
    forest = RandomForestClassifier(
        TREES,
        min_samples_leaf=LEAST,
        max_samples=0.5,
        class_weight="balanced_subsample",
        random_state=seed,
    )
    return forest.fit(rows.features, rows.label, rows.weight)


def told_by(learner: Any, cloud: Labelled) -> np.ndarray:
    """(C,) bool labels of a cloud's cells: the mean of what a classifier says of each and those around it."""
    return np.asarray(cloud.near @ learner.predict_proba(cloud.features)[:, 1] > 0.5)


def scored(
    learner: Any, cloud: Labelled, what: str, high: float = np.inf, but: np.ndarray | None = None
) -> Score:
    """Score on a cloud below a height; ``but`` (C,) bool: cells that do not count."""
    rows = cloud.counted(LOWEST, high)
    if but is not None:
        rows = rows[~but[rows]]
    return Score.of(getattr(cloud, what)[rows], told_by(learner, cloud)[rows])


def cross_validated(cloud: Labelled, what: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Labels told of a cloud's cells by classifiers of its other blocks, and the cells."""
    rows = cloud.counted()
    fold = _folds(cloud, seed, FOLDS)[rows]
    truth, told = getattr(cloud, what)[rows], np.zeros(len(rows), dtype=bool)
    for number in range(FOLDS):
        own = fold == number
        if not own.any() or len(np.unique(truth[~own])) < 2:
            continue
        mine = Taught(cloud.features[rows[~own]], truth[~own], np.ones(int((~own).sum())))
        told[own] = told_by(train(mine, seed), cloud)[rows[own]]
    return rows, told


def lent(cloud: Labelled, what: str, seed: int) -> tuple[Taught, np.ndarray]:
    """Rows of a tenth of a cloud's blocks, weighted, and which cells (C,) they are of."""
    lent_cells = _folds(cloud, seed, round(1 / LENT)) == 0
    rows = cloud.counted()
    rows = rows[lent_cells[rows]]
    weight = np.full(len(rows), HEAVIER)
    return Taught(cloud.features[rows], getattr(cloud, what)[rows], weight), lent_cells


def _folds(cloud: Labelled, seed: int, count: int) -> np.ndarray:
    """(C,) fold of each cell: blocks dealt by chance."""
    blocks, of_cell = np.unique(cloud.block(), return_inverse=True)
    dealt = stream(seed, "folds", cloud.name, count).permutation(len(blocks)) % count
    return np.asarray(dealt[of_cell])


# Train on plots of ours, test on real clouds: scores beside those of training on real ones and of rules.
#
# Every seed learns from another two thirds of our plots; intervals hold 90 % of the seeds. Scores count
# cells of 5 cm above 0.3 m, as far up as labels hold.


PLAN = "measured-stands"
EDGE = 1.0  # metres at a plot's edge that do not count
SHARE = 2 / 3  # of the plots that a seed learns from
BLUR = (
    0.0,
    0.03,
)  # metres, least and most that points of a plot are blurred by before they are learned from
LOW = 4.0  # metres: the heights that matter for diameters
JOINED = "vary.sensors[*].noise.registration_sd={ log_uniform = [0.003, 0.012] }"  # m, of stations
WAYS = ("ours", "not blurred", "network", "real", "ours + 10 % real", "rules")


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
        """Words for what is told of which cloud."""
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


Importance = dict[str, dict[str, np.ndarray]]  # by label: (F,) of ours and of each cloud, summed


def run_study(
    data: Path | None,
    folder: Path | None,
    out: Path,
    plots: int,
    seeds: int,
    seed: int,
    say: Say = print,
) -> tuple[list[StudyRow], Importance]:
    """Make plots, learn, test on the measurements and a folder of the user's; writes scores.csv to ``out``.

    Raises
    ------
    SpecError : an extra or the measurements are missing.
    """
    needs_extras()
    began = time.process_time()
    plan = read_plan(find_plan(PLAN), [f"count={plots}", f"seed={seed}", JOINED])
    make_dataset(plan, out / "plots", Cluster(workers=1), quiet=False)
    plain = read_plots(out / "plots")
    ours = blurred_plots(plain, seed)
    real = list(measured_trees(data / "wood")) if data else []
    real += read_folder(folder) if folder else []
    if not real:
        raise SpecError(
            "--data",
            "no real cloud is there; give --data with wood/ in it, or --real with a folder of LAS",
        )
    rows = [row for cloud in real for row in _rows(cloud)]
    importance: Importance = {"stem": {}, "wood": {}}
    for number in range(seeds):
        drawn = [some_of(some, seed * 1000 + number) for some in (ours, plain)]
        for what, sums in importance.items():
            clouds = [cloud for cloud in real if getattr(cloud, what) is not None]
            if clouds:
                mine = [row for row in rows if row.what == what]
                _one_seed(*drawn, clouds, what, mine, sums)
        say(f"seed {number + 1} of {seeds}: {time.process_time() - began:.0f} CPU s")
    _by_rules(real, rows, say)
    importance = {what: sums for what, sums in importance.items() if sums}
    _write(rows, importance, out)
    return rows, importance


def read_plots(folder: Path) -> list[Labelled]:
    """Return the plots of a dataset of ours, all scans of a plot together, without its edge."""
    plots = []
    for one in disk.scenes_done(folder):
        scene = read_tables(one.folder / "scene.toml")["forest"]
        low = np.array(scene.get("origin", (0.0, 0.0))) + EDGE
        high = low + np.array(scene["size"]) - 2 * EDGE
        within = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
        plots.append(read_scene(one.folder, within, str(one.record.get("base", ""))))
    return plots


def blurred_plots(ours: Sequence[Labelled], seed: int) -> list[Labelled]:
    """Our plots, each blurred by a spread of its own, drawn within ``BLUR``."""
    spreads = stream(seed, "blur").uniform(*BLUR, len(ours)).tolist()
    return [blurred(cloud, spread, seed) for cloud, spread in zip(ours, spreads, strict=True)]


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
    plain: Sequence[Labelled],
    real: Sequence[Labelled],
    what: str,
    rows: Sequence[StudyRow],
    importance: dict[str, np.ndarray],
) -> None:
    """Learn once from each and note the scores."""
    seed = sum(len(row.scores.get("ours", ())) for row in rows)
    base = taught(ours, what, seed)
    learners = {
        "ours": train(base, seed),
        "not blurred": train(taught(plain, what, seed), seed),
        "network": train(base, seed, network=True),
    }
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
    if find_spec(NAME) is None:
        say("tlseparation is not installed: no scores of rules (pip install forest-sensing[study])")
        return
    for cloud in real:
        for row in rows:
            if row.cloud == cloud.name and row.what == "wood" and cloud.wood is not None:
                cells = cloud.counted()
                cells = cells[~row.left_out(cloud)[cells]]
                told = wood_by_rules(cloud.cells.centre)
                row.add("rules", Score.of(cloud.wood[cells], told[cells]))


def _write(rows: Sequence[StudyRow], importance: Importance, out: Path) -> None:
    write_rows(
        out / "scores.csv",
        (
            {"cloud": row.cloud, "label": row.what, "below_m": row.high, "sure": int(row.sure)}
            | {"cells": row.cells, "way": way, "seed": number, "miou": score.iou, "f1": score.f1}
            for row in rows
            for way, scores in row.scores.items()
            for number, score in enumerate(scores)
        ),
    )
    for what, sums in importance.items():
        shares = {name: (total / total.sum()).tolist() for name, total in sums.items()}
        write_csv(out / f"importance-{what}.csv", {"feature": list(NAMES), **shares})


# The study as a part of docs/validation.md: learning from ours beside learning from real clouds.


GOAL = 0.03  # of mIoU, below training on real clouds
SHOWN = 6  # features whose importance differs most
COLOURS = ("#2f7d32", "#9e9d24", "#8bc34a", "#333333", "#1565c0", "#c62828")
TITLE = "Training for the real world"
SUMMARY = """\
What a classifier that knew only our plots makes of real clouds. `python -m studies study sim-to-real
--data FOLDER --docs docs` makes this part. Plots are those of `assets/plans/measured-stands.toml`: measured
pines, spruces and broadleaved trees (half of these stands bare or losing their leaves) with undergrowth and
dead branches, five tripods each. Features are on cells of 5 cm, so that instrument and density hardly matter
(`studies/sim_to_real/clouds.py`).
Before ours are learned from, the cells of each plot are moved by chance, with a spread between 0 and 3 cm:
real points lie beside what they are of, as scans do not quite fit each other and trees move. *Not blurred*
are plots as they are, whose stations are joined amiss by 3 to 12 mm along each axis, which is what stems of
joined plots show. Cells within 10 cm vote. Real are the pine and the spruce of TreeLS (GPL-3) and the
broadleaved tree of aRchi (CeCILL). *Measured* is a classifier that learned from the other layers, of 1 m, of
the very cloud (five folds); *simulated* is one that learned from ours alone. Both are random forests; scores
are mIoU over class and rest, of cells above 0.3 m. *Sure labels* leave out cells within 10 cm of a cylinder
that are not on it. Intervals are over seeds, each with another two thirds of our plots. *Agrees*: for stems
within 0.03, for wood better than the rules of TLSeparation 1.3.3 (Vicari et al. 2019).
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


def subject_of(rows: Sequence[StudyRow], importance: Importance, out: Path) -> Subject:
    """The part of the page, its pictures drawn into ``out/training``."""
    folder = out / "training"
    folder.mkdir(parents=True, exist_ok=True)
    pictures = (
        Picture(
            draw_scores(rows, folder / "training-scores.png"), "mIoU by what was learned from."
        ),
        Picture(
            draw_importance(importance, folder / "training-importance.png"),
            "Importance of features to a forest that learned from ours and from each real cloud: where "
            "they differ most.",
        ),
    )
    comparisons = [_comparison(row, pictures) for row in rows]
    comparisons += [_comparison(row, pictures, "not blurred") for row in rows]
    return Subject(
        "training", TITLE, SUMMARY, f"{_largest(importance)}\n\n{TERMS}", tuple(comparisons)
    )


def _comparison(row: StudyRow, pictures: tuple[Picture, ...], way: str = "ours") -> Comparison:
    ours, real = _interval(row, way), _interval(row, "real")
    if row.what == "wood":
        agrees = ours.value > _interval(row, "rules").value if "rules" in row.scores else None
    else:
        agrees = ours.value > real.value - GOAL
    others = [
        f"{name}: mIoU {_interval(row, name).text()}, F1 {np.median([s.f1 for s in scores]):.3f}"
        for name, scores in sorted(row.scores.items(), key=lambda item: WAYS.index(item[0]))
    ]
    words = f"{row.cells:,} cells, {100 * row.share:.0f} % of them {row.what}. {'; '.join(others)}."
    name = f"{row.name}, mIoU" if way == "ours" else f"{row.name}, {way}, mIoU"
    return Comparison(name, "", real, ours, agrees, words, pictures=pictures)


def _interval(row: StudyRow, way: str) -> Interval:
    return Interval.of(np.array([score.iou for score in row.scores[way]]))


def _largest(importance: Importance) -> str:
    """Say in the classifier's terms where ours and the real clouds differ most."""
    lines = [
        "The largest differences between ours and the real clouds, in the classifier's terms:",
        "",
    ]
    for what, sums in importance.items():
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


def draw_scores(rows: Sequence[StudyRow], path: Path) -> Path:
    """Draw bars of mIoU, a group a row; returns the picture's path."""
    figure, axes = new_figure(1, (8.0, 3.4))
    axes = np.ravel(axes)[0]
    wide = 0.8 / len(WAYS)
    for number, (way, colour) in enumerate(zip(WAYS, COLOURS, strict=True)):
        for place, row in enumerate(rows):
            if way in row.scores:
                value = _interval(row, way)
                error = [[value.value - (value.low or 0)], [(value.high or 0) - value.value]]
                label = way if place == len(rows) - 1 or (way != "rules" and not place) else None
                x = place + (number - len(WAYS) / 2 + 0.5) * wide
                axes.bar(x, value.value, wide, color=colour, yerr=error, label=label)
    axes.set_xticks(range(len(rows)), [row.name.replace(" of ", "\n") for row in rows])
    axes.tick_params(axis="x", labelsize=6)
    axes.set_ylim(0, 1)
    axes.set_ylabel("mIoU")
    handles, labels = axes.get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))
    axes.legend(named.values(), named.keys(), fontsize=6, ncols=len(WAYS), loc="upper center")
    return save_figure(figure, path)


def draw_importance(importance: Importance, path: Path) -> Path:
    """Draw importances that differ most between ours and each real cloud; returns the picture's path."""
    pairs = [(w, n) for w, sums in importance.items() for n in sums if n != "ours"]
    figure, panels = new_figure(max(len(pairs), 1), (3.0 * max(len(pairs), 1), 3.0))
    for axes, (what, name) in zip(np.ravel(panels), pairs, strict=True):
        sums = importance[what]
        best = _most_unlike(sums, name)[:SHOWN][::-1]
        for offset, who, colour in ((0.2, "ours", COLOURS[0]), (-0.2, name, COLOURS[3])):
            place = np.arange(len(best)) + offset
            axes.barh(place, _share(sums, who)[best], 0.4, color=colour, label=who)
        axes.set_yticks(range(len(best)), [NAMES[k] for k in best], fontsize=6)
        axes.set_title(f"{what}, {name}", fontsize=7)
        axes.legend(fontsize=6)
    return save_figure(figure, path)
