"""One yardstick for clouds of plots, measured or simulated: what stands in them, by the same rules."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import laspy
import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter, median_filter
from scipy.spatial import cKDTree

from forest_addon.api import (
    Airborne,
    Beam,
    Forest as Field,
    GrownForest,
    Noise,
    Planting,
    Rays,
    Scene,
    Skeleton,
    Terrestrial,
)

from ..inside import (
    ForestSite,
    SceneGeometry,
    Wanted,
    find_species,
    ground_mesh,
    grow,
    load_species,
    make_caster,
    middle,
    read_allometry,
    scan,
    segment_table,
    stream,
    write_csv,
)
from ..scenes import scene_of_forest
from .cloud_pair import circle, stems_of
from .run import Comparison, Interval

VOXEL, LOWEST, BRANCHY = (
    0.05,
    0.3,
    4.0,
)  # metres: edge of a voxel; heights between which stems are told
COLUMN, ABOVE = 0.2, 2.0  # metres: side of a column, and height from which on it is full or empty
CIRCLE_STEP, TALLEST = 0.4, 12.0  # metres between circles up a stem, and up to where it is followed
ON_STEM = 0.03  # metres from a circle


@dataclass(frozen=True)
class PlotMeasures:
    """stems : (S, 5) x, y, radius, m, arc, residual, m. not_stem : share of the voxels from 0.3 to 4 m.
    empty : share of columns of 20 cm without a voxel above 2 m. profile : (60,) share of the voxels by
    metre.
    """

    stems: np.ndarray
    not_stem: float
    empty: float
    profile: np.ndarray


def measure_plot(points: np.ndarray) -> PlotMeasures:
    """Measure what stands in a cloud (N, 3) of a plot, metres."""
    points = points - points.min(axis=0)
    height = points[:, 2] - ground_below(points)
    stems = stems_of(points, height)
    rows = voxels(points)
    p, h = points[rows], height[rows]
    low = (h > LOWEST) & (h < BRANCHY)
    on = _on_stems(p, h, stems)
    side = np.maximum(np.floor(np.ptp(points[:, :2], axis=0) / COLUMN), 1)
    column = np.minimum(np.floor(p[h > ABOVE, :2] / COLUMN), side - 1)
    return PlotMeasures(
        stems,
        float((low & ~on).sum() / max(low.sum(), 1)),
        float(1 - len(np.unique(column, axis=0)) / side.prod()),
        _profile(h),
    )


def profile(points: np.ndarray, floor: float | np.ndarray = 0.0) -> np.ndarray:
    """(60,) share of the occupied voxels above 0.3 m in each metre of height."""
    return _profile((points[:, 2] - floor)[voxels(points)])


def voxels(points: np.ndarray) -> np.ndarray:
    """The first point of each occupied voxel, by number."""
    return np.unique(np.floor(points / VOXEL).astype(np.int64), axis=0, return_index=True)[1]


def ground_below(points: np.ndarray) -> np.ndarray:
    """(P,) height of the ground below points: the 1st percentile in cells of 1 m, the median of nine."""
    cell = np.floor(points[:, :2] - points[:, :2].min(axis=0)).astype(int)
    low = np.full(cell.max(axis=0) + 1, np.nan)
    key = cell[:, 0] * low.shape[1] + cell[:, 1]
    order = np.argsort(key, kind="stable")
    keys, first = np.unique(key[order], return_index=True)
    for number, part in zip(keys, np.split(points[order, 2], first[1:]), strict=True):
        low.ravel()[number] = np.percentile(part, 1)
    low = np.where(np.isnan(low), np.nanmedian(low), low)
    return np.asarray(median_filter(low, size=3)[tuple(cell.T)])


def _profile(height: np.ndarray) -> np.ndarray:
    count = np.histogram(height[height > LOWEST], np.arange(61.0))[0]
    return np.asarray(count / max(count.sum(), 1))


def _on_stems(points: np.ndarray, height: np.ndarray, found: np.ndarray) -> np.ndarray:
    """(N,) whether a point lies within 3 cm of a circle that was followed up or down its stem."""
    mark, tree = np.zeros(len(points), dtype=bool), cKDTree(points[:, :2])
    for x0, y0, r0 in found[:, :3]:
        for step in (CIRCLE_STEP, -CIRCLE_STEP):
            x, y, r, missed, z = x0, y0, r0, 0, 1.3 if step > 0 else 0.9
            while LOWEST < z < TALLEST and missed < 2:
                some = np.array(tree.query_ball_point([x, y], r + 0.12), dtype=int)
                some = some[np.abs(height[some] - z) < 0.2]
                fit = circle(points[some, :2]) if len(some) >= 15 else None
                if fit is not None and _goes_on(fit, x, y, r0):
                    away = np.hypot(*(points[some, :2] - fit[:2]).T) - fit[2]
                    mark[some[np.abs(away) < ON_STEM]] = True
                    x, y, r, missed = fit[0], fit[1], (r + fit[2]) / 2, 0
                else:
                    missed += 1
                z += step
    return mark


def _goes_on(fit: np.ndarray, x: float, y: float, radius: float) -> bool:
    """Return whether a circle is the same stem's, a little farther along it."""
    near = np.hypot(fit[0] - x, fit[1] - y) < 0.08
    return bool(near and 0.6 * radius < fit[2] < 1.35 * radius and fit[3] > 0.25)


# Stands that are grown from a list of stems, and clouds of them: the same path as a user's forest takes.
#
# The pine plot has 16 stems on 10 x 10 m of 12.8 to 28.5 cm and 15 to 18 m, as a plot had that was
# scanned from tripods; the same stand goes on around it, so that crowns at its edge have neighbours.


SIDE, AROUND = 10.0, 5.0  # metres: of the plot, and of the stand around it
STEMS = 4  # along a side of the plot
DBH, HEIGHT = (0.128, 0.285), (15.0, 18.0)
STATIONS = ((1.0, 1.0), (9.0, 1.0), (9.0, 9.0), (1.0, 9.0), (5.0, 5.0))
STEP = 0.25  # degrees between beams
COLUMNS = ("x", "y", "dbh", "height", "crown_width", "crown_base", "leaf_area")
STANDS = 5  # plots of such stems
BEECH = Wanted(0.517, 22.0, 12.0, 5.5, 330.0)
WORDS = (
    "16 stems on 10 x 10 m, 12.8 to 28.5 cm and 15 to 18 m, from five tripods; measured is a plot of pines "
    "with such stems. Five stands, median and range; stems are told from the rest by circles that are "
    "followed up them, as in the measured plot."
)
PEAK = (
    "It follows the crowns' base, which is drawn, and of which trees of one stand share a part: means "
    "were {base}."
)


def pine_stems(seed: int) -> np.ndarray:
    """(N, 4) stems on a shaken grid: x, y, diameter, height, metres."""
    apart = SIDE / STEMS
    many = int(np.ceil((SIDE + 2 * AROUND) / apart))
    axis = (np.arange(many) - (many - STEMS) / 2 + 0.5) * apart
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    rng = stream(seed, "pine plot")
    place = grid + 0.3 * apart * rng.uniform(-1, 1, grid.shape)
    share = rng.beta(1.6, 1.6, len(place))
    noise = 0.5 * rng.standard_normal(len(place))
    height = np.clip(HEIGHT[0] + share * (HEIGHT[1] - HEIGHT[0]) + noise, *HEIGHT)
    return np.column_stack([place, DBH[0] + share * (DBH[1] - DBH[0]), height])


def site_of(stems: np.ndarray, species: str, seed: int, undergrowth: str = "auto") -> ForestSite:
    """The site of a list of stems (N, 4) of one species, looked at by a scanner.

    Further columns are width and base of the crown, m, and leaf area, m².
    """
    low = stems[:, :2].min(axis=0) - 1.0
    size = np.ptp(stems[:, :2], axis=0) + 2.0
    field = Field(
        origin=(float(low[0]), float(low[1])),
        size=(float(size[0]), float(size[1])),
        undergrowth=undergrowth,
    )
    listed = Planting(species=species, layout="list", trees="stems.csv", variants=len(stems))
    scene = Scene(seed=seed, forest=field, plantings=(listed,), sensors=(Terrestrial(),))
    with TemporaryDirectory() as folder:
        write_csv(
            Path(folder) / "stems.csv",
            dict(zip(COLUMNS[: stems.shape[1]], stems.T.tolist(), strict=True)),
        )
        return ForestSite.read(scene, folder)


def geometry_of(site: ForestSite, forest: GrownForest) -> SceneGeometry:
    """Scene for rays: instances of the grown variants, and the ground."""
    return scene_of_forest(forest, ground_mesh(site.scene.forest, site.ground))


def scanned(site: ForestSite, forest: GrownForest, seed: int, step: float = STEP) -> np.ndarray:
    """(P, 3) points of the plot from tripods at its corners and in its middle."""
    caster, place = make_caster(geometry_of(site, forest), Rays()), []
    for number, (x, y) in enumerate(STATIONS):
        scanner = Terrestrial(
            name=f"station {number}",
            position=(x, y, 1.6),
            elevation_deg=(-60.0, 90.0),
            angle_step_deg=step,
            noise=Noise(range_sd=0.003),
            max_range=60.0,
        )
        place.append(scan(scanner, caster, seed).position)
    points = np.concatenate(place)
    inside = (points[:, :2] > 0).all(axis=1) & (points[:, :2] < SIDE).all(axis=1)
    return points[inside]


def tops_of(points: np.ndarray, height: np.ndarray) -> np.ndarray:
    """(N, 3) x, y and height of the trees of a cloud: the summits of its canopy in cells of half a metre."""
    cell = np.floor(points[:, :2] / 0.5).astype(int)
    canopy = np.zeros(cell.max(axis=0) + 1)
    np.maximum.at(canopy, tuple(cell.T), height)
    smooth = gaussian_filter(canopy, 0.7)
    summit = (smooth == maximum_filter(smooth, size=5)) & (canopy > 4)
    return np.column_stack([(np.argwhere(summit) + 0.5) * 0.5, canopy[summit]])


def flown(site: ForestSite, forest: GrownForest, seed: int, size: np.ndarray) -> np.ndarray:
    """(P, 3) points of a stand of this size (2,), m, from a drone that looks down and far to its sides."""
    caster = make_caster(geometry_of(site, forest), Rays())
    ways = (
        ((-30.0, 0.2 * size[1]), 0.0),
        ((-30.0, 0.8 * size[1]), 0.0),
        ((0.5 * size[0], -30.0), 90.0),
    )
    clouds = []
    for number, ((x, y), heading) in enumerate(ways):
        drone = Airborne(
            name=f"line {number}",
            position=(float(x), float(y), 80.0),
            heading_deg=heading,
            track=90.0,
            field_deg=(-68.0, 68.0),
            max_range=300.0,
            min_range=3.0,
            speed=8.0,
            pulse_rate=60000.0,
            line_rate=60.0,
            beam=Beam(
                divergence_mrad=(0.5, 0.5),
                exit_diameter=0.0045,
                subrays=7,
                pulse_ns=3.0,
                max_returns=5,
            ),
        )
        clouds.append(scan(drone, caster, seed).position)
    points = np.concatenate(clouds)
    inside = (points[:, :2] > 0).all(axis=1) & (points[:, :2] < size).all(axis=1)
    return points[inside]


def compare_living(data: Path, seed: int) -> list[Comparison]:
    """A pine plot from tripods, a plot from a drone, and the wood of a beech, each beside its measurement."""
    rows = _plot_rows(seed)
    drone = data / "clouds" / "spanner_UAS.laz"
    if drone.is_file():
        real, floor, ours, trees = drones_plot(drone, seed)
        alike = float(np.minimum(profile(real, floor), profile(ours)).sum())
        rows.append(
            Comparison(
                *("drone's plot, overlap of profiles by height", "", Interval(1.0)),
                *(Interval(alike), bool(alike >= 0.85)),
                words=f"{trees} trees as high as the cloud's summits, with the diameters that "
                "Scots pines of these heights have.",
            )
        )
    return rows + _beech_rows(data / "wood" / "aRchi_1_qsm.txt", seed)


def drones_plot(file: Path, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Points (P, 3) of a drone's plot and the ground below them (P,), points of a stand of as high pines that
    is flown like it, and how many trees it has."""
    real = np.asarray(laspy.read(file).xyz)
    real = real - real.min(axis=0)
    floor = ground_below(real)
    tops = tops_of(real, real[:, 2] - floor)
    law = read_allometry("pinus-sylvestris", Path())
    dbh = np.linspace(0.05, 1.0, 400)
    stems = np.column_stack(
        [tops[:, :2], np.interp(tops[:, 2], np.exp(middle(law.height, dbh)), dbh), tops[:, 2]]
    )
    stand = site_of(stems, "scots-pine", seed)
    ours = flown(stand, stand.grow(), seed, np.ptp(real[:, :2], axis=0))
    return real, floor, ours, len(stems)


def _plot_rows(seed: int) -> list[Comparison]:
    """Plots of pines from tripods, beside a measured one."""
    measured, base = [], []
    for number in range(STANDS):
        site = site_of(pine_stems(seed + number), "scots-pine", seed + number)
        forest = site.grow()
        listed = [tree for (planting, _), tree in forest.variants.items() if planting == 0]
        base.append(np.mean([tree.wanted.crown_base for tree in listed if tree.wanted]))
        measured.append(measure_plot(scanned(site, forest, seed + number)))
    share, empty, peak, many = (
        Interval.of(np.array(values, dtype=float), 1.0)
        for values in zip(
            *((f.not_stem, f.empty, f.profile.argmax() + 0.5, len(f.stems)) for f in measured),
            strict=True,
        )
    )
    lowest = ", ".join(f"{value:.1f}" for value in base)
    return [
        Comparison(
            *("pine plot, voxels of 0.3 to 4 m that are not stem", "", Interval(0.46)),
            *(share, bool(0.3 <= share.value <= 0.6)),
            words=WORDS,
        ),
        Comparison(
            *("pine plot, empty columns of 20 cm above 2 m", "", Interval(0.03)),
            *(empty, bool(empty.value <= 0.1)),
        ),
        Comparison(
            *("pine plot, height with most voxels", "m", Interval(9.5, 9.0, 10.0)),
            *(peak, Interval(9.5, 9.0, 10.0).meets(peak)),
            words=PEAK.format(base=f"{lowest} m"),
        ),
        Comparison(
            *("pine plot, stems found where 16 stand", "", None, many, None),
            words="Those too many are circles through bundles of dead branches and shrubs.",
        ),
    ]


def _beech_rows(file: Path, seed: int) -> list[Comparison]:
    """Limbs and wood by order of a beech of 0.52 m and 22 m, beside the model of a scanned one."""
    if not file.is_file():
        return []
    table = np.loadtxt(file)
    radius, length, axis, order = (table[:, k] for k in (0, 1, 12, 13))
    volume = np.pi * radius**2 * length * 1000
    limbs = np.unique(axis[order == 1])
    theirs = (
        sum(radius[axis == limb].max() > 0.025 for limb in limbs),
        float(volume[order == 1].sum()),
        float(volume.sum()),
    )
    species, kind = load_species(find_species("european-beech", Path()))
    ours = []
    for number in range(5):
        tree = grow(species, kind, stream(seed, "validate beech", number), BEECH)
        wood = tree.skeleton.some(~tree.skeleton.is_dead)
        cones = segment_table(wood)
        litres = 1000 * np.bincount(cones["order"], cones["volume_m3"])
        ours.append((_thick_limbs(wood), litres[1], litres.sum()))
    rows = (
        ("beech of 22 m, limbs of order 1 over 5 cm", "", lambda a, b: b / 1.5 <= a <= 1.5 * b),
        ("beech of 22 m, wood of order 1", "l", lambda a, b: abs(a / b - 1) <= 0.25),
        ("beech of 22 m, all wood", "l", lambda a, b: abs(a / b - 1) <= 0.15),
    )
    return [
        Comparison(
            *(name, unit, Interval(float(their))),
            *(Interval.of(np.array(mine, dtype=float)), bool(near(float(np.median(mine)), their))),
        )
        for (name, unit, near), their, mine in zip(
            rows, theirs, zip(*ours, strict=True), strict=True
        )
    ]


def _thick_limbs(wood: Skeleton) -> int:
    """Limbs of order 1 that are thicker than 5 cm beyond their collars."""
    feet = np.flatnonzero((wood.order == 1) & (wood.order[np.maximum(wood.parent, 0)] == 0))
    count = 0
    for foot in feet.tolist():
        chain = wood.axis(foot)
        away = np.linalg.norm(wood.end[chain] - wood.start[foot], axis=1)
        at = chain[int(np.argmax(away > 2 * wood.radius[wood.parent[foot]].mean()))]
        count += bool(wood.radius[at].mean() > 0.025)
    return count
