"""The data card of a dataset: README.md with its pictures, the legend of every file and of every name in
one, and the loader.

Pictures are a contact sheet of random scenes and histograms of what varied. In ``legend.csv`` a ``*`` in
a name stands for anything; ``NAME_unit`` beside an array is its unit as text.
"""

from __future__ import annotations

import html
import platform
import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import PART_NAMES
from forest_addon.drawing.figures import save_figure
from forest_addon.drawing.palette import INK, LEAF_GREEN, LINES, ORGANS, species_colour
from forest_addon.formats.atomic import write_whole
from forest_addon.formats.table import write_csv
from forest_addon.formats.toml_file import structure
from forest_addon.spec import Forest

from ..command import installed
from ..progress import plain
from . import disk
from .disk import Done
from .formats import CLASSES
from .plan import SPLITS, Plan, Recipe

FILES = {
    "scene.json": "number, split, seed, what was drawn, digests of all grown trees, SHA-256 of every file",
    "scene.toml": "the settings as they were run; a scene file of Forest Sensing",
    "trees.csv": "a row a tree: species, place, DBH at 1.3 m above the ground, height, crown base and "
    "width, wood "
    "volume and area, leaf area and count",
    "leaf_angles.csv": "distribution of leaf inclinations by planting",
    "cylinders.csv": "a row a branch segment of every tree: ends, radii, parent, axis, order, in the "
    "columns of "
    "aRchi and rTwig (IDs from 1 within a tree, 0: none)",
    "voxels.npz": "leaf (one side) and wood area density in m²/m³ of cubic cells (`cell` times `edge` plus "
    "`origin` is the lowest corner), and which trees are in which cell",
    "NAME-occlusion.npz": "by cell: pulses that went in, hit, or were blocked before it",
    "NAME-hidden.npz": "every tree on the axes of some pulses, and whether the pulse saw it",
    "NAME-points.npz": "points of a scan with all labels, an array a field",
    "NAME.laz": "point clouds, LAS 1.4: tree, species, organ, leaf, normal, true range as extra bytes",
    "NAME-forinstance.laz": "point clouds in the terms of FOR-instance: `classification` 0 unclassified, "
    "1 low vegetation (lying stems and stumps, too), 2 terrain, 3 out points (none here), 4 stem, 5 live "
    "branches with their leaves, 6 woody branches, which are dead; `treeID` the tree of trees.csv + 1, 0 "
    "none; `organ` as above; `order` 0 the stem, 1 its branches and so on, -1 unknown",
    "NAME-route.csv": "poses of a sonar's route, in the scene's coordinates, without its offset",
    "coordinates.txt": "what coordinates are, of a scene with an offset",
    "NAME.wav": "echoes slowed down, or impulse responses, as sound",
    "leaves.npz": "centre, normal, axis and size of every leaf",
    "terrain.npy": "heights of the ground, first row the north edge",
    "forest.blend": "the scene in Blender",
    "forest.glb": "the scene as glTF",
    "preview.png": "a render",
    "preview-segments.png": "what each pixel of the render shows: red + 256 green + 65536 blue is tree of "
    "trees.csv + 1, times 8, plus the class of FOR-instance; black: sky, or what has no class",
}
LIMITS = (
    "Trees are models: grown by grammars or from templates, not measured ones; leaves are flat.",
    "`cylinders.csv` holds all wood of trees with `all_branches` = 1 in trees.csv; of trees that are "
    "grafted from "
    "templates only trunk and first-level branches.",
    "Wood goes on a little below the ground; its area there counts in `voxels.npz`.",
    "Occlusion takes a pulse as the axis of its beam, and counts every n-th pulse (`every`).",
    "The same bytes need the same versions of the packages above, and the same ray engine (`engine` in "
    "scene.json).",
)


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

    trees = disk.table_of(one.folder / "trees.csv")
    place = np.array([[float(t["x_m"]), float(t["y_m"])] for t in trees]).reshape(-1, 2)
    sensors, _, offset = _told(one.folder)
    place -= offset  # sensors are drawn beside them
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
    for sensor in sensors:
        if sensor["kind"] in ("terrestrial", "sonar", "reverb"):  # all others move
            for place in filter(None, map(sensor.get, ("position", "source", "receiver"))):
                if isinstance(place, list):  # the receiver of a scanner is a table
                    axes.plot(*place[:2], "^", color=INK, ms=5, mew=0)
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
        sound, time = data["waveform" if "waveform" in data else "samples"], data["time"]
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
    _, forest, offset = _told(folder)
    low = np.array(forest.origin) + offset
    high = low + forest.size
    middle = _most_trees(folder, (low[1] + high[1]) / 2)
    some, shades, drawn = [], [], []
    for name in sorted(clouds, key=lambda key: -clouds[key]):
        (cloud,) = [each for _, each in disk.clouds_of(folder, name)][-1:]
        place, organ = cloud["xyz"], cloud["organ"]
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
    y = np.array([float(tree["y_m"]) for tree in disk.table_of(folder / "trees.csv")])
    if not len(y):
        return otherwise
    near = np.abs(y[:, None] - y) < SLICE / 2
    return float(y[near[np.argmax(near.sum(axis=1))]].mean())


def _told(folder: Path) -> tuple[list[dict[str, Any]], Forest, np.ndarray]:
    """Sensors, the field and the (2,) metres that are added to what is written, of a scene's settings."""
    told = tomllib.loads((folder / "scene.toml").read_text(encoding="utf-8"))
    offset = np.array(told.get("offset", (0.0, 0.0))[:2], dtype=np.float64)
    return told.get("sensors", []), structure(told.get("forest", {}), Forest), offset


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
        for tree in disk.table_of(one.folder / "trees.csv"):
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


LOADER = Path(__file__).parent / "loader.py"  # read, never imported here
LEGEND = "legend.csv"
CARD = ("README.md", "loader.py", LEGEND, "overview.png", "varied.png")
PACKAGES = ("forest-sensing", "bpy", "numpy", "scipy", "laspy", "lazrs")


def write_card(plan: Plan, wanted: Sequence[Recipe], root: Path) -> None:
    """Write README.md, loader.py, legend.csv, overview.png and varied.png of a dataset."""
    done = list(disk.scenes_done(root))
    write_whole(root / "loader.py", LOADER.read_bytes())
    rows = [(file, name, words) for file, known in NAMES.items() for name, words in known.items()]
    file, name, words = zip(*rows, strict=True)
    write_csv(root / LEGEND, {"file": list(file), "name": list(name), "meaning": list(words)})
    if done:
        draw_overview(done, plan.head.seed, root / "overview.png")
        draw_varied(done, root / "varied.png")
    write_whole(root / "README.md", card_text(plan, wanted, done))


def card_text(plan: Plan, wanted: Sequence[Recipe], done: Sequence[disk.Done]) -> str:
    """The text of README.md."""
    records = [one.record for one in done]
    points = sum(sum(record["points"].values()) for record in records)
    species = sorted({name for record in records for name in record["species"]})
    lost = len(wanted) - len(done)
    files = [disk.RECORD, *(name for record in records for name in record["files"])]
    whys = [why for record in records for why in record.get("empty", {}).values()]
    lines = [
        f"# {_text(plan.head.name)}",
        "",
        f"{len(done):,} of {len(wanted):,} scenes of a simulated forest, with the truth of every tree"
        + (f"; {lost} could not be made (manifest.csv says why)" if lost > 0 else "")
        + ".",
        "",
        "![Some scenes](overview.png)",
        "",
        "| | |",
        "|---|---|",
        f"| trees | {sum(record['trees'] for record in records):,} |",
        f"| leaves | {sum(record['leaves'] for record in records):,} |",
        f"| leaf area | {sum(record['leaf_area_m2'] for record in records):,.0f} m² |",
        f"| species | {_text(', '.join(species)) or 'none'} |",
        f"| points | {points:,} |",
        *([f"| empty | {len(whys):,} results; first: {_text(whys[0])} |"] if whys else []),
        f"| size | {sum(one.size for one in done) / 1e9:.2f} GB |",
        *(
            f"| {split} | {sum(r['split'] == split for r in records):,} scenes |"
            for split in SPLITS
        ),
        f"| licence | {_text(plan.head.licence)} |",
        "",
        "## How it was made",
        "",
        f"Forest Sensing, plan `{_code(plan.path.name)}` (`plan.toml` is the plan as it was used), seed "
        f"{plan.head.seed}, "
        f"trees: {plan.head.trees}. {_shared(plan, records)}",
        "",
        "Made with " + ", ".join(f"{name} {number}" for name, number in versions().items()) + ".",
        "",
        *_what_varied(plan),
        "## What a scene's folder holds",
        "",
        *(
            f"- `{name}`: {what}"
            for name, what in FILES.items()
            if any(file.endswith(name.replace("NAME", "").replace("*", "")) for file in files)
        ),
        "",
        "![What varied](varied.png)",
        "",
        "`loader.py` reads scenes and clouds by number; `legend.csv` explains every column, array and field; "
        "`manifest.csv` has a row a scene, `splits/` names the scenes "
        "of each "
        "split.",
        "",
        "## Known limits",
        "",
        *(f"- {limit}" for limit in LIMITS),
        "",
    ]
    return "\n".join(lines)


def _text(words: str) -> str:
    """Words as Markdown shows them: no tag, no link, no cell of their own."""
    shown = html.escape(" ".join(plain(words).split()), quote=False)
    return re.sub(r"[|`*\[\]\\]", lambda found: f"&#{ord(found[0])};", shown)


def _code(words: str) -> str:
    """Words between backticks of a table: an entity would be shown as it is."""
    return " ".join(plain(words).replace("`", "'").replace("|", "\\|").split())


def _what_varied(plan: Plan) -> list[str]:
    if not plan.varied:
        return []
    rows = [
        f"| `{_code(one.path)}` | {_text(f'{one.kind} {one.given}')} | "
        f"{'grid' if one.kind == 'grid' else one.design} |"
        for one in plan.varied
    ]
    return ["## What varied", "", "| key | values | design |", "|---|---|---|", *rows, ""]


def _shared(plan: Plan, records: Sequence[dict[str, Any]]) -> str:
    count = disk.shared_trees(records)
    if not count:
        return "No two splits share a grown tree."
    meant = (
        "as the plan says" if plan.splits.share_trees else "because their species know no chance"
    )
    return f"{count} grown trees stand in scenes of more than one split, {meant}."


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that decide the bytes, by name."""
    packages = {name: installed(name) or "unknown" for name in PACKAGES}
    return {"python": platform.python_version()} | packages


ORGAN_NUMBERS = ", ".join(f"{number} {name}" for number, name in enumerate(PART_NAMES))
_POINT = {
    "tree": "tree of trees.csv; -1 none",
    "species": "planting of scene.toml, from 0, undergrowth after the rest; -1 none",
    "organ": ORGAN_NUMBERS,
    "leaf": "leaf of its tree, a row of leaves.npz; -1 none",
    "object": "instance in the scene; -1 none",
    "amplitude": "energy that came back; 1: a white surface that faces at 1 m",
    "width": "standard deviation of the echo, ns",
    "range": "as measured, m",
    "true_range": "without noise, m",
    **{f"n{axis}": f"{axis} of the surface's unit normal" for axis in "xyz"},
    "incidence": "between beam and normal, degrees",
    "bounce": "of scanners that follow bounces: 0 direct, 1 ghost, 2 through glass, 3 refracted",
}
_GRID = {
    "edge": "of a cell, m",
    "origin": "that is added to coordinates, m; cells count from it",
}
_CSV_TREES = {
    "tree": "number of the tree",
    "species": "its species",
    "planting": "label of its planting",
    "variant": "which of the planting's grown trees it is",
    **{f"{axis}_m": f"{axis} of its foot, m" for axis in "xyz"},
    "rotation_rad": "turn about its axis, rad",
    "scale": "its size relative to the grown tree",
    "height_m": "above the ground, m",
    "dbh_m": "diameter 1.3 m above the ground, m; 0: not so high",
    "crown_width_m": "of the crown seen from above, m",
    "crown_base_m": "height below which a fiftieth of the leaf area is, m",
    "foot_radius_m": "of all stems at the foot together, m",
    "leaves": "how many",
    "leaf_area_m2": "one side, m²",
    "wood_volume_m3": "of all its wood, m³",
    "wood_area_m2": "surface of all its wood, m²",
    "projected_wood_m2": "length times diameter of all its wood, m²",
    "target_*": "what it was to measure; empty: nothing was asked",
    "in_band": "1: all of it is as measured trees have it",
    "not_met": "names of targets that it misses",
    "all_branches": "1: cylinders.csv holds all its branches; 0: trunk and first-level branches",
}
_CYLINDERS = {
    "tree": "tree of trees.csv",
    "cyl_ID": "from 1 within the tree",
    "parent_ID": "the cylinder that it stands on; 0 none",
    "extension_ID": "the one that goes on from it; 0 none",
    "axis_ID": "of its axis, from 1",
    "branching_order": "0 the stem, 1 its branches and so on",
    **{f"{end}{axis}": f"{axis} of its {end}, m" for end in ("start", "end") for axis in "XYZ"},
    "radius_cyl": "of the cylinder of equal volume, m",
    "radius_start": "at its start, m",
    "radius_end": "at its end, m",
    "length": "m",
    "volume": "m³",
}
_ECHOES = {
    "time": "of the columns of impulse_response and waveform, s",
    "impulse_response": "by pose, ear and time, re call at 1 m",
    "waveform": "the echo of the call, likewise, re call at 1 m",
    "spectrum": "of one ping, by frequency, re call at 1 m",
    "frequency": "of the spectrum, Hz",
    "position": "of the sonar at each pose, m",
    "axis": "unit vector along which it pings",
    "sound_speed": "m/s",
    "sample_rate": "Hz",
    "wav_gain": "factor from the waveform to NAME.wav",
}
_HEARD = {
    "pose": "number of the pose",
    "kind": "what gave the echo, in words",
    "instance": "instance in the scene; -1 none",
    "tree": "tree of trees.csv; -1 none",
    "number": "of the leaf, or the part, within it",
    "position": "m",
    "distance": "from the sonar, m",
    "delay": "there and back, s",
    "amplitude": "re call at 1 m",
    "velocity": "at the ping's time, m/s; of a scene that moves",
    "rest": "where it is as the scene stands still, m; of a scene that moves",
}
_RESPONSE = {
    "channel": "of the receiver",
    "time": "of the samples, s",
    "samples": "impulse response by channel and time, re source's impulse at 1 m",
    **{part: f"its part by the {part}" for part in ("ground", "trees")},
    "direct": "its direct sound",
    "source": "where it is, m",
    "receiver": "where each channel is, m",
    "moment": "at which it is, of what moves, s",
    "direct_delay": "of the direct sound, s",
    "left_out": "energy after the record's end, dB, by channel and band",
    "energy_decay": "energy still to come, dB, by channel and time",
    "band": "middle of the octave; 0 the whole band, Hz",
    "edt": "time of a fall by 60 dB, from the first 10 dB, s",
    **{
        f"t{fall}": f"the same, from -5 to -{5 + fall} dB; nan: not reached, s"
        for fall in (20, 30, 60)
    },
    **{f"c{early}": f"energy before over after {early} ms, dB" for early in (50, 80)},
    "d50": "share of the energy before 50 ms",
    "centre_time": "mean time of the energy after the onset, s",
    "echo_density_time": "of echo_density, s",
    "echo_density": "by channel; 1: as dense as noise",
}
NAMES: dict[str, dict[str, str]] = {
    "NAME.npz (sonar)": _ECHOES,
    "NAME-heard.npz": _HEARD,
    "NAME.npz (reverb)": _RESPONSE,
    "NAME-route.csv": {
        **{f"{axis}_m": f"{axis} of the pose, m" for axis in "xyz"},
        "azimuth_deg": "from +X towards +Y, degrees",
        "elevation_deg": "from the horizon up, degrees",
        "time_s": "of the ping, s",
    },
    "trees.csv": _CSV_TREES,
    "cylinders.csv": _CYLINDERS,
    "leaf_angles.csv": {
        "from_deg": "lower end of the class of inclinations, degrees",
        "to_deg": "its upper end, degrees",
        "*_per_rad": "density of a planting's leaf area, per radian; empty or 0: no leaf",
    },
    "voxels.npz": {
        **_GRID,
        "cell": "of each row: its numbers along x, y, z",
        "leaf_area_density": "one side, m²/m³",
        "wood_area_density": "m²/m³",
        "tree_cell": "row of cell, beside the tree that is in it",
        "tree": "that is in that cell; tree of trees.csv",
    },
    "NAME-occlusion.npz": {
        **_GRID,
        "low": "numbers of the lowest cell",
        "every": "one of so many pulses was counted",
        "pulses": "how many were counted",
        "pulses_in": "that went into each cell",
        "pulses_hit": "that met something there",
        "pulses_blocked": "that would have gone in, had nothing stood before it",
    },
    "NAME-hidden.npz": {
        "pulse": "number of the pulse",
        "tree": "tree of trees.csv on its line",
        "distance": "to it, m",
        "seen": "whether the pulse met it",
        "every": "one of so many pulses was taken",
    },
    "leaves.npz": {
        "centre": "m",
        "normal": "unit vector",
        "axis": "unit vector along the leaf",
        "length": "m",
        "width": "m",
        "radius": "of the disc of equal area, m",
        "branch": "first-level branch of its tree",
        "leaf": "number within its tree",
        "tree": "tree of trees.csv",
        "species": "planting, from 0",
    },
    "NAME.laz": _POINT,
    "NAME-points.npz": {
        **dict.fromkeys("xyz", "m"),
        "time": "s",
        **_POINT,
        "scan_angle": "degrees",
        "pulse": "number of the pulse",
        "return_number": "from 1",
        "number_of_returns": "of its pulse",
    },
    "NAME-forinstance.laz": {
        "classification": ", ".join(f"{number} {name}" for number, name in enumerate(CLASSES)),
        "treeID": "tree of trees.csv + 1; 0 none",
        "organ": ORGAN_NUMBERS,
        "order": "0 the stem, 1 its branches and so on; -1 unknown",
    },
}
