"""Pictures of a dataset: a contact sheet of random scenes, and histograms of what varied."""

from __future__ import annotations

import csv
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forest_addon.base.rng import stream
from forest_addon.drawing.figures import save_figure
from forest_addon.drawing.palette import INK, LEAF_GREEN, LINES, ORGANS, species_colour
from forest_addon.formats.toml_file import structure
from forest_addon.spec import Forest

from .disk import Done

SHOWN = 12  # scenes
COLUMNS = 4
POINTS = 60_000  # of a scene
ENOUGH = 2  # times so many are looked for: a sample of those is spread evenly
BESIDE = 3.0  # m of the slice on both sides of the field
SLICE = 8.0  # m of a plot's depth that a side view shows


def draw_overview(done: Sequence[Done], seed: int, path: Path) -> None:
    """Draw random scenes: a map of trees and sensors, and what was measured, seen from the side or heard."""
    chosen = stream(seed, "overview").permutation(len(done))[:SHOWN]
    some = [done[k] for k in sorted(chosen.tolist())]
    columns = min(COLUMNS, len(some))
    rows = -(-len(some) // columns)
    figure = Figure(figsize=(4.2 * columns, 4.6 * rows), dpi=90, layout="constrained")
    grid = figure.add_gridspec(2 * rows, columns, height_ratios=[1.25, 1.0] * rows)
    species = sorted({name for one in some for name in one.record["species"]})
    colour = {name: species_colour(k) for k, name in enumerate(species)}
    for place, one in enumerate(some):
        row, column = divmod(place, columns)
        _draw_map(figure.add_subplot(grid[2 * row, column]), one, colour)
        _draw_found(figure.add_subplot(grid[2 * row + 1, column]), one)
    save_figure(figure, path)


def _draw_map(axes: Axes, one: Done, colour: dict[str, str]) -> None:
    from matplotlib.collections import EllipseCollection

    trees = _table(one.folder / "trees.csv")
    place = np.array([[float(t["x_m"]), float(t["y_m"])] for t in trees]).reshape(-1, 2)
    place -= _offset(one.folder / "scene.toml")  # sensors are drawn beside them
    wide = np.array([float(t["crown_width_m"]) for t in trees])
    faces = [colour[t["species"]] for t in trees]
    if len(place):
        for size, alpha in ((wide, 0.35), (np.full(len(wide), 0.3), 1.0)):
            axes.add_collection(
                EllipseCollection(
                    *(size, size, np.zeros(len(size))),
                    units="xy",
                    offsets=place,
                    offset_transform=axes.transData,
                    facecolors=faces,
                    alpha=alpha,
                )
            )
        axes.update_datalim(np.concatenate([place - wide[:, None] / 2, place + wide[:, None] / 2]))
    for name in sorted(one.record["files"]):
        if name.endswith("-route.csv"):
            route = np.loadtxt(one.folder / name, delimiter=",", skiprows=1, ndmin=2)
            axes.plot(route[:, 0], route[:, 1], ".-", color=INK, lw=0.8, ms=4)
    for x, y in _standing(one.folder / "scene.toml"):
        axes.plot(x, y, "^", color=INK, ms=5, mew=0)
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.tick_params(labelsize=6)
    kinds = {name: colour[name] for name in one.record["species"]}
    title = ", ".join(kinds) or "no trees"
    axes.set_title(
        f"{one.folder.name} {one.record['split']}: {len(trees)} trees\n{title}",
        fontsize=7.5,
        color=INK,
    )


def _standing(path: Path) -> list[tuple[float, float]]:
    """Return where sensors stand that do not move."""
    found = []
    for sensor in tomllib.loads(path.read_text(encoding="utf-8")).get("sensors", []):
        for key in ("position", "source", "receiver"):
            place = sensor.get(key)  # the receiver of a scanner is a table
            if isinstance(place, list) and sensor["kind"] in ("terrestrial", "sonar", "reverb"):
                found.append((place[0], place[1]))
    return found


def _draw_found(axes: Axes, one: Done) -> None:
    """The scene's clouds from the side, else the first echo or response."""
    axes.tick_params(labelsize=6)
    files = one.record["files"]
    clouds = {name: count for name, count in one.record["points"].items() if count}
    if clouds:
        _draw_clouds(axes, one.folder, clouds)
        return
    sounds = sorted(name for name in files if name.endswith(".wav"))
    if not sounds:
        axes.axis("off")
        return
    stem = sounds[0].removesuffix(".wav")
    with np.load(one.folder / f"{stem}.npz") as data:
        key = "waveform" if "waveform" in data else "samples"
        sound, time = data[key], data["time"]
    sound = sound.reshape(-1, sound.shape[-1])[:4]
    axes.set_title(stem, fontsize=7, color=INK)
    peak = max(float(np.abs(sound).max()), 1e-30)
    for number, line in enumerate(sound):
        axes.plot(1e3 * time[: len(line)], line / peak - 1.5 * number, lw=0.5, color=LINES[number])
    axes.set_xlabel("ms", fontsize=6)
    axes.set_yticks([])


def _draw_clouds(axes: Axes, folder: Path, clouds: dict[str, int]) -> None:
    """A slice of the field where most trees stand, of the largest clouds that have points enough for it;
    far points first.
    """
    low, high = _field(folder / "scene.toml")
    middle = _most_trees(folder, (low[1] + high[1]) / 2)
    some, shades, drawn = [], [], []
    for name in sorted(clouds, key=lambda key: -clouds[key]):
        place, organ = read_points(folder, name)
        x, y, _ = place.T
        near = (np.abs(y - middle) < SLICE / 2) & (x > low[0] - BESIDE) & (x < high[0] + BESIDE)
        some.append(place[near])
        shades.append(organ[near])
        drawn.append(name)
        if sum(map(len, some)) > ENOUGH * POINTS:
            break
    place, organ = np.concatenate(some), np.concatenate(shades)
    rows = stream(0, "overview", "points").permutation(len(place))[:POINTS]
    rows = rows[np.argsort(-place[rows, 1])]
    shade = [ORGANS[one][1] for one in np.clip(organ[rows], 0, max(ORGANS)).tolist()]
    axes.scatter(place[rows, 0], place[rows, 2], s=0.35, c=shade, lw=0, rasterized=True)
    axes.set_aspect("equal")
    title = f"{', '.join(drawn)}: a slice of {SLICE:g} m; {sum(clouds.values()):,} points in all"
    axes.set_title(title, fontsize=7, color=INK)


def _most_trees(folder: Path, otherwise: float) -> float:
    """The y about which a slice holds most trunks."""
    y = np.array([float(tree["y_m"]) for tree in _table(folder / "trees.csv")])
    if not len(y):
        return otherwise
    near = np.abs(y[:, None] - y) < SLICE / 2
    return float(y[near[np.argmax(near.sum(axis=1))]].mean())


def _offset(path: Path) -> np.ndarray:
    """(2,) metres that are added to what is written of a scene."""
    told = tomllib.loads(path.read_text(encoding="utf-8")).get("offset", (0.0, 0.0, 0.0))
    return np.array(told[:2], dtype=np.float64)


def _field(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """(2,) lowest and (2,) highest corner of a scene's field."""
    table = tomllib.loads(path.read_text(encoding="utf-8")).get("forest", {})
    forest = structure(table, Forest)
    low = np.array(forest.origin) + _offset(path)
    return low, low + forest.size


def read_points(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Places (P, 3) and organs (P,) of a cloud of a scene."""
    packed = folder / f"{name}-points.npz"
    if packed.is_file():
        with np.load(packed) as data:
            return np.stack([data[axis] for axis in "xyz"], axis=1), data["organ"]
    import laspy

    cloud = laspy.read(folder / f"{name}.laz")
    return np.asarray(cloud.xyz), np.asarray(cloud["organ"])


def draw_varied(done: Sequence[Done], path: Path) -> None:
    """Draw a histogram of everything that varied from scene to scene, and of the trees that came of it."""
    columns: dict[str, list[Any]] = {}
    for one in done:
        for key, value in one.record["varied"].items():
            shown = (
                value[0] if isinstance(value, list) and len(set(map(str, value))) == 1 else value
            )
            columns.setdefault(key, []).append(shown)
        columns.setdefault("trees of a scene", []).append(one.record["trees"])
        columns.setdefault("leaf area of a scene, m²", []).append(one.record["leaf_area_m2"])
        if sum(one.record["points"].values()):
            columns.setdefault("points of a scene", []).append(sum(one.record["points"].values()))
        for tree in _table(one.folder / "trees.csv"):
            for key, factor, words in (
                ("dbh_m", 100, "DBH, cm"),
                ("height_m", 1, "height of a tree, m"),
                ("crown_width_m", 1, "width of a crown, m"),
            ):
                columns.setdefault(words, []).append(factor * float(tree[key]))
            columns.setdefault("species of a tree", []).append(tree["species"])
    wide = 4
    rows = max(1, -(-len(columns) // wide))
    figure = Figure(figsize=(12.5, 2.4 * rows), dpi=90, layout="constrained")
    for number, (key, values) in enumerate(columns.items()):
        axes = figure.add_subplot(rows, wide, number + 1)
        axes.tick_params(labelsize=6.5)
        axes.set_title(key, fontsize=8, color=INK)
        if all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values):
            axes.hist(values, bins=min(24, max(4, len(values) // 4)), color=LEAF_GREEN)
        else:
            names, counts = np.unique([str(value) for value in values], return_counts=True)
            axes.barh(names, counts, color=LEAF_GREEN)
    save_figure(figure, path)


def _table(path: Path) -> list[dict[str, str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))
