"""A measured plot beside its twin: Chablais 3, whose every tree and whose airborne cloud are known.

The twin is what ``lidar --like REAL.laz --trees TABLE`` writes: each tree of the table where it stands
and of its size, on the cloud's ground class, flown along the lines that the cloud tells, with the light of
the instrument that made it, a RIEGL LMS-Q560 (lidaRtRee's documentation), whose threshold is that of the
cloud's faintest echoes. Both clouds are measured by the same functions, ``EDGE`` and more within the box of
the trees: crowns of trees outside the plot, which no table has, reach over its rim.

The file numbers a pulse's first return 1 of 2, its last 2 of 2 and all between 2 of 3, so that it tells
single pulses, and how many returns lie between a first and a last, but not how many a pulse has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial import cKDTree

from forest_addon import api

from ..inside import INK, LEAF_GREEN, blank_figure, save_figure, write_like
from .own_cloud import CloudReturns, read_cloud
from .plots import drones_plot
from .run import Comparison, Interval, Picture

SPECIES = ("PIAB=norway-spruce", "FASY=european-beech", "ABAL=silver-fir")
OTHERS = "FASY"  # whose place the few trees of other species take
LIGHT, SEEDS = "riegl-lms-q560", 4
EDGE = 5.0  # m
POINTS, METRES, OVERLAP = 5.0, 0.5, 0.8  # within which a row agrees, stated before the run
LOW, FLOOR, TALL = 2.0, 0.5, 15.0  # m
CELL, LEAST = 0.5, 5.0  # m, of the canopy model and of a summit's height
NEAR, A_METRE = (
    2.1,
    0.14,
)  # m, and for a metre of height, that a summit may be off its tree (Monnet 2010)

SLICES = {"spruces and firs": (40.0, 46.0), "beeches": (22.0, 28.0)}  # m from the plot's south
HIGH, LONG, DOTS = 38.0, 42.0, 7000  # m, m, and points of a slice that are drawn
Slice = tuple[
    str, np.ndarray, np.ndarray
]  # title, and (N, 2) along it and over the ground, m: real, ours

Measures = dict[str, float]
UNITS = {
    "pulses with 1 return": "%",
    "returns between a first and a last, of pulses": "%",
    "cover, first returns above 2 m": "%",
    "gaps, last returns within half a metre of the ground": "%",
    "first returns above 2 m, 5 % are lower": "m",
    "first returns above 2 m, 50 % are lower": "m",
    "first returns above 2 m, 95 % are lower": "m",
    "canopy over trees above 15 m less their height, median": "m",
    "canopy over trees above 15 m less their height, spread": "m",
    "trees found": "%",
    "summits that are no tree": "%",
}


def measured(cloud: CloudReturns, trees: np.ndarray) -> tuple[Measures, np.ndarray]:
    """Measures of a cloud of a plot with trees (N, 3) x, y, height, m, by the names of ``UNITS``, and (60,)
    shares of returns above 1 m by metre of height."""
    height = cloud.heights()
    first, last = cloud.number == 1, cloud.number == cloud.count
    high = height[first & (height > LOW)]
    around = cKDTree(cloud.place[:, :2]).query_ball_point(trees[:, :2], 1.0)
    over = np.array([max(height[rows], default=0.0) for rows in around]) - trees[:, 2]
    over = over[trees[:, 2] > TALL]
    found, false = detected(cloud.place[:, :2], height, trees)
    spread = float(np.ptp(np.quantile(over, [0.16, 0.84])) / 2)
    values = [
        100 * cloud.shares()[0][0],
        100 * ((cloud.number > 1) & ~last).sum() / first.sum(),
        100 * (height[first] > LOW).mean(),
        100 * (height[last] < FLOOR).mean(),
        *np.quantile(high, [0.05, 0.5, 0.95]),
        *(float(np.median(over)), spread),
        *(100 * found, 100 * false),
    ]
    layer = np.bincount(height[(height > 1) & (height < 60)].astype(int), minlength=60)
    return dict(zip(UNITS, map(float, values), strict=True)), layer / layer.sum()


def detected(place: np.ndarray, height: np.ndarray, trees: np.ndarray) -> tuple[float, float]:
    """Share of trees (N, 3) that summits of the canopy stand for, and share of summits that stand for none.

    Summits are highest within a window as wide as crowns of their height, 2.515 + 0.00901 h² (Popescu & Wynne
    2004, Photogramm. Eng. Remote Sens. 70, 589, all species together), of a canopy model of half a metre.
    From the tallest on each tree takes the nearest free summit, in height as well, within 2.1 m + 0.14 h
    (Monnet et al. 2010).
    """
    low = place.min(axis=0)
    cell = np.floor((place - low) / CELL).astype(int)
    canopy = np.zeros(cell.max(axis=0) + 1)
    np.maximum.at(canopy, tuple(cell.T), height)
    where = np.argwhere(canopy > LEAST)
    tall = canopy[tuple(where.T)]
    top = np.column_stack([(where + 0.5) * CELL + low, tall])
    near = cKDTree(top[:, :2]).query_ball_point(top[:, :2], (2.515 + 0.00901 * tall**2) / 2)
    top = top[[tall[rows].max() == tall[k] for k, rows in enumerate(near)]]
    free = np.ones(len(top), dtype=bool)
    for tree in trees[np.argsort(-trees[:, 2])]:
        away = np.where(free, np.linalg.norm(top - tree, axis=1), np.inf)
        if len(top) and away.min() < NEAR + A_METRE * tree[2]:
            free[away.argmin()] = False
    return float((~free).sum() / len(trees)), float(free.mean())


def flown_twin(cloud: Path, table: Path, folder: Path, seed: int) -> CloudReturns:
    """The returns of a plot's twin, in the coordinates of its cloud."""
    names = np.genfromtxt(table, delimiter=",", names=True, dtype=None, encoding="utf-8")["species"]
    known = {word.split("=")[0]: word for word in SPECIES}
    stand_in = known[OTHERS].split("=")[1]
    words = [known.get(name, f"{name}={stand_in}") for name in np.unique(names).tolist()]
    target = folder / "twin.toml"
    write_like(cloud, target, LIGHT, trees=table, species=words, say=lambda _: None)
    settings = api.read(target)
    settings = settings.changed(seed=seed, accuracy=settings.accuracy.changed(detail="auto"))
    world = api.build(settings, folder=folder)
    parts = []
    for sensor in settings.sensors:
        found = world.scan(sensor).found
        place = found.position + np.array(settings.offset)
        parts.append((place, found.number, found.count, found.returns.organ == 3))
    return CloudReturns(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def draw_slices(slices: Sequence[Slice], path: Path) -> Picture:
    """Slices of real clouds beside those of ours."""
    figure = blank_figure((9.0, 2.6 * len(slices)))
    rows = figure.subplots(len(slices), 2, sharex=True, sharey=True)
    for axes, (title, *clouds) in zip(rows, slices, strict=True):
        for plot, points, whose in zip(axes, clouds, ("measured", "simulated"), strict=True):
            some = points[:: max(1, len(points) // DOTS)]
            plot.plot(
                *some.T, ".", markersize=0.8, color=LEAF_GREEN if whose != "measured" else INK
            )
            plot.set(xlim=(0, LONG), ylim=(-1, HIGH), aspect="equal", title=f"{title}, {whose}")
    for plot in rows[:, 0]:
        plot.set_ylabel("height, m")
    words = (
        "Slices of a drone's plot of pines, 5 m deep, and Chablais 3, 6 m deep, where spruces and firs stand "
        "and where beeches do, over younger ones: real clouds, and ours of the same trees."
    )
    return Picture(save_figure(figure, path), words)


def _slices(real: CloudReturns, ours: CloudReturns, low: np.ndarray) -> list[Slice]:
    """Slices of the plot and of its twin, from the corner ``low``."""
    found = []
    for title, band in SLICES.items():
        parts = []
        for cloud in (real, ours):
            height, north = cloud.heights(), cloud.place[:, 1] - low[1]
            rows = (north > band[0]) & (north < band[1])
            parts.append(np.column_stack([cloud.place[rows, 0] - low[0], height[rows]]))
        found.append((title, *parts))
    return found


def _pines(file: Path, seed: int) -> list[Slice]:
    """A slice of a drone's plot of pines and of ours."""
    real, floor, ours, _ = drones_plot(file, seed)
    real = np.column_stack([real[:, :2], real[:, 2] - floor])
    cut = [cloud[np.abs(cloud[:, 1] - 13.0) < 2.5][:, [0, 2]] for cloud in (real, ours)]
    return [("pines", *cut)]


def compare_twin(data: Path, out: Path, seed: int) -> list[Comparison]:
    """Rows of Chablais 3 and its twins of ``SEEDS`` seeds; its picture goes to ``out``."""
    file, table = (data / "chablais3" / name for name in ("las_chablais3.laz", "trees.csv"))
    rows = np.genfromtxt(table, delimiter=",", names=True, dtype=None, encoding="utf-8")
    trees = np.column_stack([rows["x"], rows["y"], rows["height_m"]])
    low, high = trees[:, :2].min(axis=0) + EDGE, trees[:, :2].max(axis=0) - EDGE
    trees = trees[((trees[:, :2] > low) & (trees[:, :2] < high)).all(axis=1)]
    cloud = read_cloud(file).within(low, high)
    real, layers = measured(cloud, trees)
    each, overlap, slices = [], [], list[Slice]()
    for k in range(SEEDS):
        with TemporaryDirectory() as folder:
            twin = flown_twin(file.resolve(), table.resolve(), Path(folder), seed + k)
        twin = twin.within(low, high)
        slices += _slices(cloud, twin, low) if not k else []
        values, ours = measured(twin, trees)
        each.append(values)
        overlap.append(np.minimum(layers, ours).sum())
    slices = _pines(data / "clouds" / "spanner_UAS.laz", seed) + slices
    drawn = (draw_slices(slices, out / "slices.png"),)
    found = [
        replace(
            _row("overlap of profiles by height", "", 1.0, overlap, 1 - OVERLAP), pictures=drawn
        )
    ]
    for name, unit in UNITS.items():
        within = POINTS if unit == "%" else METRES
        found.append(_row(name, unit, real[name], [values[name] for values in each], within))
    return found


def _row(name: str, unit: str, real: float, ours: list[float], within: float) -> Comparison:
    mean = float(np.mean(ours))
    simulated = Interval(mean, float(min(ours)), float(max(ours)))
    return Comparison(
        f"Chablais 3 and its twin, {name}",
        unit,
        Interval(real),
        simulated,
        bool(abs(mean - real) <= within),
        words=f"Agrees within {within:.2g} {unit}.".replace(" .", "."),
    )
