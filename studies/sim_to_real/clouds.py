"""Clouds with labels: plots of ours and of others by FOR-instance's names, and measured trees.

Labels of the measured trees are not drawn by hand. Stems of pine and spruce (TreeLS) are circles fitted to
layers (``circles``): sure below the crown, less so in it, and none above. Wood of the broadleaved tree
(aRchi) is what is near its published cylinders (TreeQSM): twigs without a cylinder count as other than wood.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from forest_addon.base.rng import stream
from forest_addon.formats.las import read_las
from forest_addon.spec import SpecError

from .circles import follow_stem
from .features import VoxelCells, cells_of, features_of, ground_below, means_of

STEM, CLASSES = 4, 7
LOWEST = 0.3  # metres above the ground: below is ground and litter, which no score counts
NEAR, LUMP = 0.02, 0.25  # metres, and share of its radius, from a cylinder within which is wood
VOTERS = 0.1  # metres around a cell, whose cells vote on its class
FAR = 0.10  # metres from every cylinder, beyond which is surely no wood
ENDINGS = ("*.las", "*.laz")
TREES = {"pine": "treels_pine.laz", "spruce": "treels_spruce.laz"}
BROADLEAF = ("aRchi_1.las", "aRchi_1_qsm.txt")


@dataclass(frozen=True)
class Labelled:
    """Cells of a cloud with what is known of them.

    stem, wood : (C,) bool, or None where nobody knows. top : metres above the ground up to which labels
    hold. base : of ours, the kind of stand. sure : (C,) bool, where labels of wood are beyond doubt; None:
    everywhere. given : (C, F) features, where they are known already.
    """

    name: str
    cells: VoxelCells
    stem: np.ndarray | None
    wood: np.ndarray | None
    top: float = np.inf
    base: str = ""
    sure: np.ndarray | None = None
    given: np.ndarray | None = None

    @cached_property
    def features(self) -> np.ndarray:
        """(C, F) features of the cells."""
        return features_of(self.cells) if self.given is None else self.given

    def counted(self, low: float = LOWEST, high: float = np.inf) -> np.ndarray:
        """Numbers of the cells between two heights that scores count."""
        height = self.cells.height
        return np.flatnonzero((height > low) & (height < min(high, self.top)))

    @cached_property
    def near(self) -> csr_matrix:
        """(C, C) weights of the cells within ``VOTERS`` of each, itself among them; each row's sum is 1."""
        pairs = cKDTree(self.cells.centre).query_pairs(VOTERS, output_type="ndarray")
        count = len(self.cells.centre)
        rows = np.concatenate([pairs[:, 0], pairs[:, 1], np.arange(count)])
        columns = np.concatenate([pairs[:, 1], pairs[:, 0], np.arange(count)])
        weight = 1.0 / np.bincount(rows, minlength=count)[rows]
        return csr_matrix((weight, (rows, columns)), (count, count))

    def block(self) -> np.ndarray:
        """(C,) blocks for cross-validation: 2 m squares of a plot, layers of 1 m of a lone tree."""
        centre = self.cells.centre
        if np.ptp(centre[:, :2], axis=0).max() > 20.0 or np.ptp(centre[:, :2], axis=0).min() > 6.0:
            square = np.floor(centre[:, :2] / 2.0).astype(np.int64)
            return square[:, 0] * 1000 + square[:, 1]
        return np.floor(self.cells.height).astype(np.int64)


def measured_trees(folder: Path) -> Iterator[Labelled]:
    """Yield the measured trees that are in a folder; none is no fault."""
    for name, file in TREES.items():
        if (folder / file).is_file():
            points = np.asarray(read_las(folder / file).xyz)
            cells = cells_of(points)
            height = points[:, 2] - ground_below(points)
            stem = follow_stem(points, height)
            if stem is not None:
                on = cells.majority(stem.holds(points, height)) > 0.5
                yield Labelled(name, cells, on, None, stem.top)
    cloud, cylinders = (folder / name for name in BROADLEAF)
    if cloud.is_file() and cylinders.is_file():
        points = np.asarray(read_las(cloud).xyz)
        cells = cells_of(points)
        # Cut out of its plot, it has no ground.
        above = cells.centre[:, 2] - cells.centre[:, 2].min()
        cells = VoxelCells(cells.centre, above, cells.of_point)
        table = np.loadtxt(cylinders)
        wood = cells.majority(near_cylinders(points, table)) > 0.5
        sure = wood | ~near_cylinders(cells.centre, table, FAR)
        yield Labelled("broadleaf", cells, None, wood, sure=sure)


def near_cylinders(points: np.ndarray, table: np.ndarray, near: float = NEAR) -> np.ndarray:
    """(P,) whether points are on a cylinder of TreeQSM (K, 8+): radius, length, start, axis; metres."""
    found = np.zeros(len(points), dtype=bool)
    for radius, length, *place in table[:, :8].tolist():
        start, axis = np.array(place[:3]), np.array(place[3:])
        step = points - start
        along = np.clip(step @ axis, 0.0, length)
        away = np.linalg.norm(step - along[:, None] * axis, axis=1) - radius
        found |= np.abs(away) < near + LUMP * radius
    return found


def blurred(cloud: Labelled, spread: float, seed: int) -> Labelled:
    """A cloud whose cells are moved by chance, as scans that do not quite fit and wind move real points.

    spread : metres, standard deviation along each axis. A cell is what most of the cells in it were.
    """
    old = cloud.cells
    moved = stream(seed, "blurred", cloud.name).normal(0.0, spread, old.centre.shape)
    centre, of_old = means_of(old.centre + moved)
    height = np.bincount(of_old, old.height) / np.bincount(of_old)
    cells = VoxelCells(centre, height, of_old)
    labels = (
        flags if flags is None else cells.majority(flags) > 0.5
        for flags in (cloud.stem, cloud.wood)
    )
    return Labelled(cloud.name, cells, *labels, cloud.top, cloud.base)


def read_folder(folder: Path) -> list[Labelled]:
    """Every LAS or LAZ file of a folder, by FOR-instance's names: ``classification`` 4 is stem.

    Raises
    ------
    SpecError : there is none; or one has no class 4 or none but.
    """
    files = sorted(path for ending in ENDINGS for path in folder.rglob(ending))
    if not files:
        raise SpecError(f"--real {folder}", "holds no .las or .laz file")
    return [_read_plot(path.stem, [path], f"--real {path}") for path in files]


def read_scene(folder: Path, within: tuple[float, float, float, float], base: str) -> Labelled:
    """A scene of ours, its scans joined. within : lowest x and y, then highest, metres, that count."""
    files = sorted(folder.glob("*-forinstance.laz"))
    return _read_plot(f"ours {folder.name}", files, str(folder), within, base)


def _read_plot(
    name: str,
    files: list[Path],
    where: str,
    within: tuple[float, float, float, float] | None = None,
    base: str = "",
) -> Labelled:
    clouds = [read_las(path) for path in files]
    points = np.concatenate([cloud.xyz for cloud in clouds])
    classes = np.concatenate([np.asarray(cloud.classification) for cloud in clouds])
    if not (classes == STEM).any() or (classes == STEM).all():
        raise SpecError(
            where,
            "has not both stem and the rest: classification must be FOR-instance's, 4 for stem",
        )
    wood = None
    if all("organ" in cloud.point_format.extra_dimension_names for cloud in clouds):
        organ = np.concatenate([np.asarray(cloud["organ"]) for cloud in clouds])
        wood = (organ == 1) | (organ == 4)
    if within is not None:
        low, high = np.reshape(within, (2, 2))
        inside = ((points[:, :2] > low) & (points[:, :2] < high)).all(axis=1)
        points, classes = points[inside], classes[inside]
        wood = None if wood is None else wood[inside]
    cells = cells_of(points)
    on = cells.majority(classes == STEM) > 0.5
    is_wood = None if wood is None else cells.majority(wood) > 0.5
    return Labelled(name, cells, on, is_wood, base=base)
