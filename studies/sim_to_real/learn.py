"""Learning of a class from features, and scores: what is trained, on what, and how well it tells."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from forest_addon.base.rng import stream

from .clouds import LOWEST, Labelled

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
        """Both together."""
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
    mine = _folds(cloud, seed, round(1 / LENT)) == 0
    rows = cloud.counted()
    rows = rows[mine[rows]]
    weight = np.full(len(rows), HEAVIER)
    return Taught(cloud.features[rows], getattr(cloud, what)[rows], weight), mine


def _folds(cloud: Labelled, seed: int, count: int) -> np.ndarray:
    """(C,) fold of each cell: blocks dealt by chance."""
    blocks, of_cell = np.unique(cloud.block(), return_inverse=True)
    dealt = stream(seed, "folds", cloud.name, count).permutation(len(blocks)) % count
    return np.asarray(dealt[of_cell])
