"""The 42 orchards of Méndez et al.'s experiment, as far as the paper says what they are, and as scenes of
ours.

Four numbers of iterations, three diameters d_m, one or four trees, pruned or not, stochastic or not make 96
orchards; which 42 of them S built is not said. Ours change one thing at a time. One stochastic, pruned
tree is the base, and four of them in a row; both at all iterations, which are the eight rows of Méndez et
al.'s Table 3. Then one tree that is not pruned and one that is not stochastic, from 5 iterations on,
because at 4 pruning takes hardly anything. 14 structures, three diameters each.

Two lengths are not given either. The first internode h0 makes crowns as wide as Méndez et al.'s scans are
long: its numbers of beams are all multiples of 601, so a scan has 601 beams (150° by 0.25°) and the drives
past one tree are 1.68 to 1.93 m long. Trees stand 2.1 m apart, which gives the drives past four.
"""

from __future__ import annotations

import ast
import csv
import time
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from forest_addon.api import (
    Detail,
    Forest as Field,
    GrownForest,
    Progress,
    Rays,
    Scene,
    SpecError,
    Species,
    Stand,
    Tractor,
)

from ..inside import (
    BARK,
    FAINT,
    INK,
    LEAF_GREEN,
    RED,
    Observer,
    Stages,
    blank_figure,
    find_species,
    grow,
    hushed,
    is_wood,
    load_species,
    save_figure,
    skeleton_of,
    stream,
    wood_of_skeleton,
)
from ..tables import table, write_rows

DIAMETERS = (0.005, 0.006, 0.007)  # d_m
ITERATIONS = (4, 5, 6, 7)
DRIVES = (
    930,
    935,
    840,
    965,
)  # scans past one tree: Méndez et al.'s beams by 601, of which all are multiples
STEP, ANGLE_STEP_DEG = 0.002, 0.25
HALF_FAN_DEG = 75.0  # 601 beams of 0.25° are 150°; ours lie about the horizontal
SCANNER = (1.0, 1.0)  # x0 and z0 of S
ROW = 2.5  # x of the trees
SPACING = 2.1
CALIBRATED_ON = 12  # trees for each number of iterations
TOLERANCE = 0.0002  # metres between a branch and its mesh


@dataclass(frozen=True)
class Orchard:
    """One orchard: what its trees are and how many stand in it."""

    iterations: int
    trees: int
    smallest: float  # d_m, metres
    pruned: bool = True
    stochastic: bool = True


def experiment(quick: bool = False) -> list[Orchard]:
    """All orchards, the smallest first; ``quick``: only those of 4 and 5 iterations."""
    iterations = ITERATIONS[:2] if quick else ITERATIONS
    return [
        orchard
        for n in iterations
        for smallest in DIAMETERS
        for orchard in (
            Orchard(n, 1, smallest),
            Orchard(n, 4, smallest),
            *([Orchard(n, 1, smallest, pruned=False)] if n > 4 else []),
            *([Orchard(n, 1, smallest, stochastic=False)] if n > 4 else []),
        )
    ]


@cache
def first_internode() -> float:
    """h0 in metres, to the millimetre, at which crowns are as wide as Méndez et al.'s drives past one tree
    are long.

    The width of a crown grows with h0. It is the mean extent along x and y of stochastic, pruned trees,
    which are always the same: h0 depends on no seed.
    """
    widths = []
    for n in ITERATIONS:
        species = species_of(Orchard(n, 1, 0.006), 1.0)
        for tree in range(CALIBRATED_ON):
            skeleton, _ = skeleton_of(species, stream(0, "simlidar", "calibration", n, tree))
            widths.append(np.ptp(skeleton.end[:, :2], axis=0).mean())
    return round(float(np.mean(DRIVES) * STEP / np.mean(widths)), 3)


def species_of(orchard: Orchard, internode: float) -> Species:
    """The leafless apple tree of an orchard."""
    preset = "apple-stochastic" if orchard.stochastic else "apple-leafless"
    species, _ = load_species(find_species(preset, Path()))
    return replace(
        species,
        rules=replace(
            species.rules,
            generations=orchard.iterations,
            constants=(f"h0 = {internode!r}", f"dm = {orchard.smallest!r}"),
            prune_descending=orchard.pruned,
        ),
        leaf=replace(species.leaf, on=False),
        detail=Detail(tolerance=TOLERANCE),
    )


def plant(orchard: Orchard, internode: float, seed: int) -> GrownForest:
    """Grow the trees of an orchard and stand them in a row along y.

    A tree's draws depend on the iterations and its number only: orchards that differ in diameter, in
    pruning or in the number of trees have the same trees.
    """
    species = species_of(orchard, internode)
    kinds = orchard.trees if orchard.stochastic else 1
    variants = {
        (0, k): grow(species, None, stream(seed, "simlidar", "tree", orchard.iterations, k))
        for k in range(kinds)
    }
    number = np.arange(orchard.trees)
    place = np.zeros((orchard.trees, 3))
    place[:, 0], place[:, 1] = ROW, SPACING * number
    stand = Stand(
        position=place,
        rotation=2 * np.pi * stream(seed, "simlidar", "turn").random(orchard.trees),
        scale=np.ones(orchard.trees),
        species=np.zeros(orchard.trees, dtype=np.int64),
        variant=number % kinds,
        id=number,
        number=number,
        sink=np.zeros(orchard.trees),
        too_near=np.zeros(1, dtype=np.int64),
        off_ground=np.zeros(1, dtype=np.int64),
        off_field=np.zeros(1, dtype=np.int64),
        expected=np.array([float(orchard.trees)]),
        error=np.zeros(1),
        area=SPACING**2 * orchard.trees,
    )
    return GrownForest(stand, ("apple",), (species,), variants)


def tractor_for(forest: GrownForest, splits: int, gap: int = 0) -> Tractor:
    """Méndez et al.'s scanner, driving past all of an orchard; its drive is a whole number of centimetres,
    as Méndez et al.'s."""
    low, high = extent_along(forest)
    low, high = np.floor(low * 100) / 100, np.ceil(high * 100) / 100
    slope = np.tan(np.deg2rad(HALF_FAN_DEG))
    x, z = SCANNER
    return Tractor(
        position=(x, float(low), z),
        track=float(high - low) - STEP,
        step=STEP,
        gap=gap,
        angle_step_deg=ANGLE_STEP_DEG,
        reach=float(z / slope),
        top=2 * z,
        splits=splits,
    )


def extent_along(forest: GrownForest) -> tuple[float, float]:
    """Smallest and largest y of all wood above the ground."""
    ends = []
    for tree, matrix in enumerate(forest.transforms()):
        skeleton = forest.variant_of(tree).skeleton
        for points in (skeleton.start, skeleton.end):
            ends.append(points @ matrix[1, :3] + matrix[1, 3])
    along = np.concatenate(ends)
    return float(along.min()), float(along.max())


def scene_of(tractor: Tractor) -> Scene:
    """The settings that the Blender scene of an orchard is built from: the ground, and the scanner."""
    length = max(tractor.track, 1.0)
    field = Field(size=(4.0, length), origin=(0.0, tractor.position[1]), margin=5.0)
    return Scene(name="orchard", forest=field, sensors=(tractor,))


# The rows of Méndez et al.'s experiment, and the two files that grow with every orchard that is finished.


WOOD = ("volume_m3", "area_m2", "projected_m2")
ASKED = (
    "iterations",
    "trees",
    "smallest_m",
    "pruned",
    "stochastic",
)  # columns that say which orchard
SETTINGS = ("seed", "internode_m", "gap", "engine")
Row = dict[
    str, Any
]  # of orchards.csv: ASKED, SETTINGS and what came out; of trees.csv: one tree of one orchard


def orchard_of(row: Row) -> Orchard:
    """Orchard that a row is of."""
    return Orchard(*(row[name] for name in ASKED))


def read_rows(path: Path) -> list[Row]:
    """Rows of a file of ours, none where there is no file.

    Raises
    ------
    SpecError : it is not such a file.
    """
    if not path.is_file():
        return []
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    if any(not set(ASKED) <= set(row) or None in row.values() for row in rows):
        raise SpecError(str(path), "is not of this experiment; remove it, or choose another --out")
    return [{name: _value(text) for name, text in row.items()} for row in rows]


def _value(text: str) -> Any:
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):  # a word
        return text


# The report of Méndez et al.'s experiment: Table 3 and the regressions, Méndez et al.'s numbers beside
# ours, and their picture.


# S, Table 3: iterations, trees, branches, beams, minutes.
TABLE_3 = (
    (4, 1, 360, 558_930, 2),
    (5, 1, 1_497, 561_935, 4),
    (6, 1, 5_564, 504_840, 11),
    (7, 1, 15_168, 579_965, 26),
    (4, 4, 2_064, 1_634_720, 15),
    (5, 4, 4_991, 2_482_130, 32),
    (6, 4, 20_020, 2_404_000, 135),
    (7, 4, 44_658, 2_467_105, 210),
)
# S, its fits through the origin: slope and R².
THEIRS = {"projected_m2": ("A_PR", 3.6166, 0.7002), "area_m2": ("A_L", 10.812, 0.7756)}
BEAMS = {
    "impacted_m2": "one ray",
    "impacted_solid_m2": "solid beam, P = 2",
    "impacted_eq14_m2": "solid beam, θ from the vertical (eq. 14)",
}

DISCUSSION = """\
Where and why they differ:
- Méndez et al.'s A_IM is smaller than ours for the same wood. Its thick beam is not the reason: a
  solid beam is hit as
  soon as anything is in its sector, here about 2 by 6.5 mm and so as large as the twigs (5 to 7 mm), which
  makes A_IM larger and slopes smaller than one ray does. One ray sees the wood as thick as it is.
- θ from the vertical, as Méndez et al.'s eq. 14 can be read, may be a part of it: then level beams
  count for nothing,
  slopes grow towards Méndez et al.'s and R² falls a little. How much depends on how far off the trees stand.
- That distance, h0, and which 42 of 96 orchards S built are not given (studies/papers/simlidar.py has ours),
  nor whether leaves stood in the way. Ours have none.
- Méndez et al.'s two slopes have the ratio 2.99 and unequal R²; Σπdh and Σdh over the same
  internodes have the ratio
  π and equal R², as ours. So Méndez et al.'s A_PR and A_L cannot both be these sums.
- Our R² are higher; it may help that our orchards share trees, which differ in diameter and pruning only.
- A_PR and A_L count all wood, A_IM what is in sight; the more branches, the more they hide each other. So
  slopes grow with the iterations, which no one line follows."""


def print_report(found: Sequence[Row], out: Path) -> None:
    """Print both tables and what is to be said of them."""
    first = found[0]
    print(
        f"SIMLIDAR's experiment: {len(found)} orchards, seed {first['seed']}, "
        f"h0 = {first['internode_m']:g} m,"
        f" rays by {', '.join(sorted({row['engine'] for row in found}))}"
        + (f", every {first['gap'] + 1}th scan" if first["gap"] else "")
    )
    print(
        "\nTable 3, d_m = 6 mm; CPU seconds of growing, building, reading and scanning (one ray):\n"
    )
    table(
        print,
        [
            *("iterations", "trees", "branches", "S", "beams", "S"),
            *("triangles", "CPU s", "S, minutes", "beams/CPU s", "P = 2, scan: CPU s"),
        ],
        list(_table_3(found)),
    )
    print("\nRegressions through the origin, A_IM of the whole orchard:\n")
    table(print, ["fit", "beam", "slope", "S", "R²", "S"], list(_regressions(found)))
    print(f"\nThe solid beam's A_IM is {_growth(found):.2f} times that of one ray (median).\n")
    print(DISCUSSION)
    print(f"\nAll orchards: {out / 'orchards.csv'}; their trees: {out / 'trees.csv'}")


def _table_3(found: Sequence[Row]) -> list[list[str]]:
    rows = []
    for iterations, trees, branches, beams, minutes in TABLE_3:
        wanted = Orchard(iterations, trees, 0.006)
        for row in (row for row in found if orchard_of(row) == wanted):
            seconds = row["build_s"] + row["scan_s"]
            rows.append(
                [
                    *(f"{iterations}", f"{trees}", f"{row['branches']:,}", f"{branches:,}"),
                    *(f"{row['beams']:,}", f"{beams:,}", f"{row['triangles']:,}"),
                    *(f"{seconds:.2f}", f"{minutes}", f"{row['beams'] / row['scan_s']:,.0f}"),
                    f"{row['scan_solid_s']:.2f}",
                ]
            )
    return rows


def line_through_origin(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope and R² of y = slope·x by least squares without an intercept, as S fits A_PR and A_L on A_IM.

    R² is 1 - Σ(y - slope·x)² / Σ(y - ȳ)².

    Raises
    ------
    ValueError : fewer than two points, or all x are 0.
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if len(x) < 2 or not x.any():
        raise ValueError("a line needs at least two points, and an x that is not 0")
    slope = float(x @ y / (x @ x))
    scatter = float(((y - y.mean()) ** 2).sum())
    missed = float(((y - slope * x) ** 2).sum())
    return slope, 1.0 - missed / scatter if scatter > 0 else float(missed == 0)


# Wood indices of a tractor scan (Méndez et al.): the impacted area, and lines through the origin.
#
# A beam that meets wood at distance l stands for the area Δy·l·(sin(θ + Δθ) - sin θ); A_IM is their sum.
# With θ from the horizontal, as Méndez et al.'s eq. 8 has it, that is the size of the sector where it is
# level; with θ from the vertical, as its eq. 14 can be read, level beams stand for nothing. Ours is the
# former. What it is compared with, the volume V_L, area A_L and projected area A_PR of all wood, is the
# truth of the skeleton (``growth.truth``). A gap between scans is not filled: A_IM is of what was scanned.


def beam_areas(scan: Any, tractor: Tractor, *, from_vertical: bool = False) -> np.ndarray:
    """(N, M) m² of wood that each beam stands for, 0 where it met none.

    from_vertical : measure θ from the vertical, as eq. 14 can be read; the amount of the difference.
    """
    angle = np.pi / 2 - scan.angle if from_vertical else scan.angle
    step = np.deg2rad(tractor.angle_step_deg) * (-1 if from_vertical else 1)
    wide = np.abs(np.sin(angle + step) - np.sin(angle))
    return tractor.step * np.where(is_wood(scan.organ), scan.distance, 0.0) * wide


def impacted_by_tree(scan: Any, tractor: Tractor, trees: int) -> np.ndarray:
    """(trees,) A_IM of the trees numbered from 0, m²; wood of no tree is left out."""
    tree = scan.returns.tree
    known = (tree >= 0) & (tree < trees)
    area = beam_areas(scan, tractor).ravel()
    return np.bincount(tree[known], area[known], minlength=trees)


def fits(found: Sequence[Row]) -> dict[tuple[str, str], tuple[float, float]]:
    """Slopes and R² by (what, beam): A_PR and A_L on A_IM of either beam."""
    return {
        (what, beam): line_through_origin(_column(found, beam), _column(found, what))
        for what in THEIRS
        for beam in BEAMS
    }


def _regressions(found: Sequence[Row]) -> list[list[str]]:
    rows = []
    for (what, beam), (slope, r2) in fits(found).items():
        name, *theirs = THEIRS[what]
        rows.append(
            [
                *(f"{name} = k·A_IM", BEAMS[beam]),
                *(f"{slope:.4f}", f"{theirs[0]:g}", f"{r2:.4f}", f"{theirs[1]:.4f}"),
            ]
        )
    return rows


def draw(found: Sequence[Row], path: Path) -> Path:
    """A_PR and A_L against A_IM: points, our lines and Méndez et al.'s."""
    figure = blank_figure((10, 4.4))
    for axes, (what, (name, theirs, _)) in zip(figure.subplots(1, 2), THEIRS.items(), strict=True):
        y = _column(found, what)
        most = max(_column(found, beam).max() for beam in BEAMS)
        ends = np.array([0.0, 1.05 * most])
        for (beam, label), colour in zip(BEAMS.items(), (BARK, RED, LEAF_GREEN), strict=True):
            x = _column(found, beam)
            slope, r2 = line_through_origin(x, y)
            four = np.array([row["trees"] == 4 for row in found])
            axes.scatter(x[~four], y[~four], s=16, c=colour, linewidths=0)
            axes.scatter(x[four], y[four], s=22, c=colour, marker="s", linewidths=0)
            axes.plot(
                ends,
                slope * ends,
                c=colour,
                linewidth=1.2,
                label=f"{label}: k = {slope:.3g}, R² = {r2:.2f}",
            )
        axes.plot(ends, theirs * ends, c=FAINT, linewidth=1.6, label=f"S: k = {theirs:g}")
        axes.set_title(f"{name} against A_IM")
        axes.set_xlabel("impacted area A_IM, m²")
        axes.set_ylabel(f"{name}, m²")
        axes.set_xlim(0, ends[1])
        axes.set_ylim(0, 1.35 * y.max())  # room for the legend
        axes.legend(loc="upper left", fontsize=8, frameon=True, framealpha=1.0, edgecolor="none")
    figure.text(0.995, 0.005, "squares: four trees", ha="right", va="bottom", fontsize=7, color=INK)
    return save_figure(figure, path)


def _growth(found: Sequence[Row]) -> float:
    return float(np.median(_column(found, "impacted_solid_m2") / _column(found, "impacted_m2")))


def _column(found: Sequence[Row], name: str) -> np.ndarray:
    return np.array([row[name] for row in found])


# Méndez et al.'s experiment with 42 orchards, its table and regressions beside ours.
#
# Each orchard is grown, built as a Blender scene, and scanned on the evaluated depsgraph twice: with one
# ray a beam, and with Méndez et al.'s solid beam (P = 2). Its row is written when it is finished; an
# experiment that was interrupted goes on where it was.


SOLID = 2  # Méndez et al.'s P
QUICK_GAP = 9


def run_experiment(
    out: Path, *, quick: bool = False, seed: int = 1, engine: str = "auto", quiet: bool = False
) -> list[Row]:
    """Do what is not done yet, print the report, draw the picture.

    Raises
    ------
    ValueError : the engine cannot be used; rows in the folder that cannot be read.
    OSError : a file could not be written; what was finished before is kept.
    """
    out.mkdir(parents=True, exist_ok=True)
    stages = Stages(quiet)
    with stages.stage("calibrate the first internode"):
        internode = first_internode()
    gap = QUICK_GAP if quick else 0
    rows, trees = read_rows(out / "orchards.csv"), read_rows(out / "trees.csv")
    asked = {"seed": seed, "internode_m": internode, "gap": gap}
    wanted, found = experiment(quick), []
    for number, orchard in enumerate(wanted):
        done = [row for row in rows if orchard_of(row) == orchard and asked.items() <= row.items()]
        row = next((row for row in done if engine in ("auto", row["engine"])), None)
        if row is None:
            with stages.stage(_name(number, len(wanted), orchard)) as progress:
                row, own = observe(orchard, internode, seed, gap, engine, progress)
            rows = [*(other for other in rows if orchard_of(other) != orchard), row]
            finished = {orchard_of(row) for row in rows} - {orchard}
            trees = [*(tree for tree in trees if orchard_of(tree) in finished), *own]
            write_rows(out / "trees.csv", trees)
            write_rows(out / "orchards.csv", rows)  # last: what stands here is finished
        found.append(row)
    print_report(found, out)
    draw(found, out / "regressions.png")
    return found


def observe(
    orchard: Orchard,
    internode: float,
    seed: int,
    gap: int,
    engine: str,
    progress: Progress | None = None,
) -> tuple[Row, list[Row]]:
    """Grow, build and scan one orchard. With a gap, each scan stands for those that are left out.

    Raises
    ------
    ValueError : the engine cannot be used; says why.
    """
    begin = time.process_time()
    forest = plant(orchard, internode, seed)
    thin = tractor_for(forest, 0, gap)
    scene = scene_of(thin)
    observer = stand_up(forest, scene, Rays(engine=engine))
    caster = observer.caster
    built = time.process_time()

    scan = observer.observe(thin, scene)
    area = (gap + 1) * impacted_by_tree(scan, thin, orchard.trees)
    seen = time.process_time()
    solid = tractor_for(forest, SOLID, gap)
    thick = observer.observe(solid, scene, progress)
    solid_area = (gap + 1) * impacted_by_tree(thick, solid, orchard.trees)
    upright = (gap + 1) * beam_areas(thick, solid, from_vertical=True)
    done = time.process_time()

    same = dict(zip(ASKED, astuple(orchard), strict=True))
    trees = []
    for number in range(orchard.trees):
        skeleton = forest.variant_of(number).skeleton
        wood = wood_of_skeleton(skeleton)
        sizes = dict(zip(WOOD, (wood.volume, wood.area, wood.projected), strict=True))
        areas = {"impacted_m2": float(area[number]), "impacted_solid_m2": float(solid_area[number])}
        trees.append(same | {"tree": number, "branches": len(skeleton)} | sizes | areas)
    geometry = observer.geometry
    whole = same | dict(
        zip(SETTINGS, (seed, internode, gap, caster.engine), strict=True),
        branches=sum(tree["branches"] for tree in trees),
        triangles=sum(len(geometry.meshes[m].triangles) for m in geometry.mesh_index),
        scans=len(scan.track),
        beams=scan.distance.size,
        **{
            name: sum(tree[name] for tree in trees)
            for name in (*WOOD, "impacted_m2", "impacted_solid_m2")
        },
        impacted_eq14_m2=float(upright.sum()),
        hits=int((scan.returns.tree >= 0).sum()),
        hits_solid=int((thick.returns.tree >= 0).sum()),
        build_s=built - begin,
        scan_s=seen - built,
        scan_solid_s=done - seen,
    )
    return whole, trees


def stand_up(forest: GrownForest, scene: Scene, rays: Rays) -> Observer:
    """Build an orchard as a Blender scene, in place of all there is, and read what it evaluates to.

    Raises
    ------
    ValueError : the engine cannot be used; says why.
    """
    with hushed():
        import bpy

        from ..inside import Observer, build_scene as build, empty_file

        empty_file()
    build(bpy.context.scene, scene, forest)
    return Observer(bpy.context.evaluated_depsgraph_get(), rays)


def _name(number: int, count: int, orchard: Orchard) -> str:
    kind = f"{orchard.iterations} it, {orchard.trees} x {1000 * orchard.smallest:g} mm"
    other = "" if orchard.pruned else ", unpruned"
    return f"{number + 1}/{count} {kind}{other}{'' if orchard.stochastic else ', one rule'}"
