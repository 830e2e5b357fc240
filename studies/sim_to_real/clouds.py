"""Stem labels of one tree's cloud, by circles fitted to layers of it and followed upwards from the ground.

Each circle is found by random sampling near the one below (Fischler & Bolles 1981, RANSAC), then fitted to
its own points by least squares, outliers counting less. A circle that strays from its neighbours takes their
median. Above the first metre and a half in which no circle fits, nothing is labelled: what stem there is
cannot be told from branches by a circle, so those heights do not count in any score.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import griddata
from scipy.ndimage import maximum_filter, median_filter, uniform_filter
from scipy.optimize import least_squares
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from forest_addon.api import SpecError

from ..inside import read_las, stream

CIRCLE_LAYER = 0.2  # metres, height of a layer
TRIES = 400  # circles drawn in a layer
CLOSE = 0.012  # metres from the circle within which a point is one of its own while it is sought
THICK = (
    0.03  # metres from the circle within which a point is stem: bark, lean within a layer, noise
)
SMALLEST, LARGEST = 0.05, 0.6  # metres, radii
FEWEST = 20  # points on a circle
AROUND = 0.35  # share of the circle's circumference that has points, at least
FLARE = 1.3  # times the median radius of the lowest circles: more is undergrowth or a root, not the stem
LOST = 1.5  # metres without a circle after which the stem is lost


@dataclass(frozen=True)
class Stem:
    """Circles of a stem: height (K,), centre (K, 2), radius (K,), metres; ``top``: up to where they hold."""

    height: np.ndarray
    centre: np.ndarray
    radius: np.ndarray
    top: float

    def at(self, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(P, 2) centres and (P,) radii at heights (P,)."""
        x, y = (np.interp(height, self.height, axis) for axis in self.centre.T)
        return np.stack([x, y], axis=1), np.interp(height, self.height, self.radius)

    def holds(self, points: np.ndarray, height: np.ndarray) -> np.ndarray:
        """(P,) whether points are on the stem, or within it."""
        centre, radius = self.at(height)
        away = np.linalg.norm(points[:, :2] - centre, axis=1)
        return np.asarray((away < radius + THICK) & (height < self.top))


def follow_stem(points: np.ndarray, height: np.ndarray, seed: int = 0) -> Stem | None:
    """The stem of the tree that stands nearest to the middle of a cloud; None where no circle fits.

    points : (P, 3) metres. height : (P,) metres above the ground.
    """
    rng = stream(seed, "circles")
    rows, last, misses = [], None, 0
    layers = np.arange(0.3, height.max(), CIRCLE_LAYER)
    for low in layers:
        layer_points = points[(height >= low) & (height < low + CIRCLE_LAYER), :2]
        if last is not None:
            layer_points = layer_points[
                np.linalg.norm(layer_points - last[:2], axis=1) < last[2] + 0.15
            ]
        circle = _circle(layer_points, last, rng)
        if circle is None:
            misses += last is not None
            if misses * CIRCLE_LAYER > LOST:
                break
            continue
        rows.append((low + CIRCLE_LAYER / 2, *circle))
        last, misses = np.array(circle), 0
    if len(rows) < 5:
        return None
    found = np.array(rows)
    found = found[found[:, 3] < FLARE * np.median(found[:10, 3])]
    smooth = np.stack([median_filter(axis, 5, mode="nearest") for axis in found[:, 1:].T], axis=1)
    return Stem(found[:, 0], smooth[:, :2], smooth[:, 2], float(found[-1, 0] + CIRCLE_LAYER / 2))


def _circle(
    points: np.ndarray, last: np.ndarray | None, rng: np.random.Generator
) -> tuple[float, float, float] | None:
    """Centre and radius of the circle that most points of a layer (N, 2) are on; None: none is good."""
    if len(points) < FEWEST:
        return None
    first = points[rng.integers(len(points), size=TRIES)]
    pick = points[rng.integers(len(points), size=(TRIES, 2))]
    x, y, r = _through(first, pick[:, 0], pick[:, 1])
    good = np.isfinite(r) & (r > SMALLEST) & (r < LARGEST)
    if last is not None:
        good &= (
            (np.hypot(x - last[0], y - last[1]) < 0.08) & (r < 1.1 * last[2]) & (r > 0.7 * last[2])
        )
    if not good.any():
        return None
    x, y, r = x[good], y[good], r[good]
    away = np.hypot(points[:, None, 0] - x, points[:, None, 1] - y) - r
    score = (np.abs(away) < CLOSE).sum(axis=0) - 2.0 * (away < -3 * CLOSE).sum(axis=0)
    best = int(np.argmax(score))
    own = np.abs(away[:, best]) < 2 * CLOSE
    if own.sum() < FEWEST:
        return None
    fitted = least_squares(
        lambda v: np.hypot(points[own, 0] - v[0], points[own, 1] - v[1]) - v[2],
        (x[best], y[best], r[best]),
        loss="soft_l1",
        f_scale=0.01,
    ).x
    turn = np.arctan2(points[own, 1] - fitted[1], points[own, 0] - fitted[0])
    covered = len(np.unique(np.floor(turn / (np.pi / 18)))) / 36
    near = np.hypot(points[:, 0] - fitted[0], points[:, 1] - fitted[1]) < fitted[2] - 3 * CLOSE
    if covered < AROUND or near.sum() > 0.25 * own.sum():
        return None
    return float(fitted[0]), float(fitted[1]), float(fitted[2])


def _through(
    a: np.ndarray, b: np.ndarray, c: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centres and radii of circles through three points each (N, 2); infinite where they are on a line."""
    u, v = b - a, c - a
    cross = 2 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (v[:, 1] * (u**2).sum(1) - u[:, 1] * (v**2).sum(1)) / cross
        y = (u[:, 0] * (v**2).sum(1) - v[:, 0] * (u**2).sum(1)) / cross
    return a[:, 0] + x, a[:, 1] + y, np.hypot(x, y)


# Shapes around the points of a cloud, as a classifier sees them, alike for every instrument and density.
#
# A cloud is reduced to the means of its points in cells of 5 cm, so that how many points there were no
# longer matters; heights are above the ground, which is the lowest of each square metre. Around each mean
# follow, at several radii, the eigenvalue features of Weinmann et al. (2015, ISPRS J. 105:286) by pgeof,
# and how far what is there goes on straight up and down and how much of it is near: stems go on, branches
# do not.


EDGE = 0.05  # metres, of a cell
SCALES = ((0.05, 0.125), (0.05, 0.25), (0.1, 0.5), (0.2, 1.0))  # metres: cells and ball around them
MOST = 200  # neighbours that count; a level surface has 79 cells in each of the larger balls
KINDS = ("Linearity", "Planarity", "Scattering", "VerticalityPGEOF", "Verticality", "Curvature")
WORDS = ("linearity", "planarity", "scattering", "verticality", "wall", "curvature")
REACH, LAYER = 1.0, 0.1  # metres up and down an upright column, and of a layer of it
COLUMNS = (1, 3)  # layers' heights that a column is wide
BOXES = ((3, 7), (5, 13))  # layers' heights that two level slabs, three high, are wide
NAMES = (
    *(f"{word} {radius:g} m" for _, radius in SCALES for word in WORDS),
    *(f"{way} {wide * LAYER:.1f} m" for wide in COLUMNS for way in ("above", "below")),
    *(f"inner {inner * LAYER:.1f} m" for inner, _ in BOXES),
)


@dataclass(frozen=True)
class VoxelCells:
    """Cells of a cloud that hold a point.

    centre : (C, 3) metres, the mean of their points. height : (C,) metres above the ground.
    of_point : (P,) the cell of each point.
    """

    centre: np.ndarray
    height: np.ndarray
    of_point: np.ndarray

    def majority(self, flags: np.ndarray) -> np.ndarray:
        """(C,) share of the points (P,) of each cell that have a flag."""
        count = np.bincount(self.of_point, minlength=len(self.centre))
        return np.bincount(self.of_point, flags, len(self.centre)) / count


def cells_of(points: np.ndarray, edge: float = EDGE) -> VoxelCells:
    """Reduce points (P, 3), metres, to the means of cells."""
    centre, of_point = means_of(points, edge)
    return VoxelCells(centre, centre[:, 2] - ground_below(centre), of_point)


def means_of(points: np.ndarray, edge: float = EDGE) -> tuple[np.ndarray, np.ndarray]:
    """(C, 3) means of the points of each cell of a grid, and (P,) the cell of each point."""
    index = np.floor((points - points.min(axis=0)) / edge).astype(np.int64)
    wide = index.max(axis=0) + 1
    key = (index[:, 0] * wide[1] + index[:, 1]) * wide[2] + index[:, 2]
    _, of_point = np.unique(key, return_inverse=True)
    count = np.bincount(of_point)
    return np.stack([np.bincount(of_point, axis) / count for axis in points.T], 1), of_point


def ground_below(points: np.ndarray, edge: float = 1.0) -> np.ndarray:
    """(P,) height of the ground below points (P, 3): the lowest of squares, where it is like its neighbours.

    A square whose lowest point is more than its size above the lowest of its neighbours saw no ground; the
    ground goes on there between the others.
    """
    cell = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / edge).astype(int)
    low = np.full(cell.max(axis=0) + 1, np.inf)
    np.minimum.at(low, tuple(cell.T), points[:, 2])
    seen = np.isfinite(low)
    middle = median_filter(np.where(seen, low, np.median(low[seen])), size=3)
    good = seen & (np.abs(low - middle) < edge)
    if good.sum() < 4:
        return np.full(len(points), np.percentile(points[:, 2], 0.5))
    known, value = (np.argwhere(good) + 0.5) * edge, low[good]
    place = points[:, :2] - points[:, :2].min(axis=0)
    flat = np.ptp(known, axis=0).min() == 0  # a line of squares has no triangles
    heights = np.full(len(place), np.nan) if flat else griddata(known, value, place)
    nearest = value[cKDTree(known).query(place)[1]]
    return np.where(np.isnan(heights), nearest, heights)


def features_of(cells: VoxelCells) -> np.ndarray:
    """(C, len(NAMES)) float32 features of cells."""
    centre = cells.centre - cells.centre.min(axis=0)
    shapes = [_shapes(centre, *scale) for scale in SCALES]
    features = np.column_stack([*shapes, *_columns(centre), *_boxes(centre)])
    return np.nan_to_num(features, nan=0.0).astype(np.float32)


def _shapes(centre: np.ndarray, edge: float, radius: float) -> np.ndarray:
    """(C, len(KINDS)) eigenvalue features of balls around cells; wide balls are taken of coarser cells."""
    import pgeof  # an extra: see [project.optional-dependencies] study

    wanted = [getattr(pgeof.EFeatureID, kind) for kind in KINDS]
    coarse, of_fine = means_of(centre, edge) if edge > EDGE else (centre, slice(None))
    near = np.ascontiguousarray(coarse, dtype=np.float32)
    return np.asarray(pgeof.compute_features_selected(near, radius, MOST, wanted))[of_fine]


def _columns(centre: np.ndarray) -> list[np.ndarray]:
    """Shares of the layers above and below a cell in which a thin upright column holds something."""
    index = np.floor((centre - centre.min(axis=0)) / LAYER).astype(int)
    layers = round(REACH / LAYER)
    filled = np.zeros(np.add(index.max(axis=0), (1, 1, 1 + 2 * layers)), dtype=bool)
    index[:, 2] += layers
    filled[tuple(index.T)] = True
    shares = []
    for wide in COLUMNS:
        column = maximum_filter(filled, size=(wide, wide, 1))
        sums = np.cumsum(column, axis=2, dtype=np.uint16)
        x, y, z = index.T
        above = sums[x, y, z + layers] - sums[x, y, z]
        below = sums[x, y, z - 1] - np.where(z > layers, sums[x, y, z - layers - 1], 0)
        shares += [above / layers, below / layers]
    return shares


def _boxes(centre: np.ndarray) -> list[np.ndarray]:
    """Shares of what a level slab holds that stands near its middle."""
    index = np.floor((centre - centre.min(axis=0)) / LAYER).astype(int)
    filled = np.zeros(index.max(axis=0) + 1, dtype=np.float32)
    filled[tuple(index.T)] = 1.0
    shares = []
    for inner, outer in BOXES:
        few, many = (
            wide**2 * uniform_filter(filled, (wide, wide, 3), mode="constant")[tuple(index.T)]
            for wide in (inner, outer)
        )
        shares.append(few / np.maximum(many, 1e-6))
    return shares


# Clouds with labels: plots of ours and of others by FOR-instance's names, and measured trees.
#
# Labels of the measured trees are not drawn by hand. Stems of pine and spruce (TreeLS) are circles fitted
# to layers (``circles``): sure below the crown, less so in it, and none above. Wood of the broadleaved
# tree (aRchi) is what is near its published cylinders (TreeQSM): twigs without a cylinder count as other
# than wood.


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
    near_any = np.zeros(len(points), dtype=bool)
    for radius, length, *place in table[:, :8].tolist():
        start, axis = np.array(place[:3]), np.array(place[3:])
        step = points - start
        along = np.clip(step @ axis, 0.0, length)
        away = np.linalg.norm(step - along[:, None] * axis, axis=1) - radius
        near_any |= np.abs(away) < near + LUMP * radius
    return near_any


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
