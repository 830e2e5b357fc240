"""Gaps between the returns of a pulse from a tripod among conifers, beside those of a real VZ-400i scan.

The real scan (975,000 pulses; its stand is not described) had the quantiles in ``REAL`` and the shares in
``SHARES``. Ours is the pine plot of ``living``, by the instrument's own file, between 4 and 30 m.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.spatial import cKDTree

from forest_addon import api
from forest_addon.api import Rays, Terrestrial

from ..inside import (
    INK,
    LEAF_GREEN,
    LIGHT,
    Waveforms,
    blank_figure,
    decompose,
    environment_of_child,
    make_caster,
    save_figure,
    scan,
    settings_of,
    structure,
    write_like,
)
from .flights import compare_flights, shares_of
from .own_cloud import CloudReturns, compare_own, read_cloud
from .plots import drones_plot, geometry_of, pine_stems, site_of
from .run import Comparison, Interval, Picture
from .stems import compare_stems, compare_twigs
from .tapes import compare_diameters, compare_residuals

REAL = {0.001: 0.36, 0.01: 0.54, 0.05: 0.76, 0.1: 0.87}  # metres
SHARES = (92.8, 7.04, 0.15)  # %
NEAR_GAP = 0.1  # m that count as the same, stated before the run
RANGES = (4.0, 30.0)
STEP = 0.25  # degrees


def compare_gaps(seed: int) -> list[Comparison]:
    """Quantiles of the gaps between returns of a pulse, and what share of pulses has one."""
    site = site_of(pine_stems(seed), "scots-pine", seed)
    plain = structure(settings_of("riegl-vz-400i", "terrestrial", Path()), Terrestrial)
    scanner = plain.changed(position=(5.0, 5.0, 1.6), angle_step_deg=STEP)
    cloud = scan(scanner, make_caster(geometry_of(site, site.grow()), Rays()), seed)
    near, far = RANGES
    same = (np.diff(cloud.pulse) == 0) & (cloud.true_range[:-1] > near)
    gap = np.diff(cloud.returns.distance)[same & (cloud.true_range[1:] < far)]
    first = cloud.number == 1
    shares = 100 * shares_of(cloud.count[first])
    words = (
        f"Of {len(gap):,} gaps in {first.sum():,} pulses; pulses with 1, 2 and 3 returns "
        f"{shares[0]:.1f}, {shares[1]:.2f}, {shares[2]:.2f} %, in the real scan "
        f"{SHARES[0]}, {SHARES[1]}, {SHARES[2]}. Within 0.1 m; another stand."
    )
    return [
        Comparison(
            f"VZ-400i, gap between returns of a pulse, {100 * share:g} % are smaller",
            "m",
            Interval(real),
            Interval(float(np.quantile(gap, share))),
            bool(abs(float(np.quantile(gap, share)) - real) <= NEAR_GAP),
            words="" if k else words,
        )
        for k, (share, real) in enumerate(REAL.items())
    ]


# Waveforms of an airborne digitiser over a deciduous forest, beside ours over stands like it.
#
# Measured are 500 received pulses over Harvard Forest (NEON, by way of R's waveformlidar, Zhou et al. 2017).
# Their places, which the file tells, are one transect of 60 x 3 m, so that each of ours is such a transect as
# well. Of the stand nothing is known but that it is closed: ours are stands of oak and maple with 500 stems a
# hectare of 27 cm (8 cm standard deviation), 31 m² of basal area. Both are measured by the
# same functions: Gaussians fitted to each waveform, and moments of its light.

STANDS, BESIDE = 3, 8  # and transects of each
LENGTH, WIDE, MARGIN = 60.0, 3.0, 5.0  # m, of a transect, and of the stand around them
PULSES = 500  # of a transect
DENSITY, DBH = 0.05, (0.27, 0.08)  # stems a m²; m, mean and standard deviation
NAMES = ("pedunculate-oak", "norway-maple")
CREST, DARK = (
    0.15,
    0.02,
)  # of a waveform's peak: from where on a crest is one, and light is no noise
SAMPLE, SIGMA = (
    1e-9 * LIGHT / 2,
    8.3e-9 * LIGHT / 2,
)  # m, of samples, and of the pulse that fits begin with
BASE = 8  # samples before the light, whose median is the baseline
MEASURES = {
    "Gaussians of a waveform, mean": "",
    "waveforms of one Gaussian": "%",
    "waveforms of three and more": "%",
    "width of the first Gaussian, median": "ns",
    "standard deviation of the light, median": "ns",
    "standard deviation of the light, 90 % are below": "ns",
    "skew of the light, median": "",
    "skew of the light, 90 % are below": "",
}


def measures_of_waves(waves: Waveforms) -> list[float]:
    """Values of ``MEASURES`` of waveforms with a step of ``SAMPLE``, baseline at 0."""
    first = np.flatnonzero(np.diff(waves.pulse, prepend=-1))
    many = np.diff(np.append(first, len(waves.pulse)))
    power = waves.value / np.repeat(np.maximum.reduceat(waves.value, first), many)
    pulse, _, _, width = decompose(replace(waves, value=power), SIGMA, CREST)
    begin = np.flatnonzero(np.diff(pulse, prepend=-1))
    found = np.diff(np.append(begin, len(pulse)))
    light = np.where(power > DARK, power, 0.0)
    light /= np.repeat(np.add.reduceat(light, first), many)
    away = waves.index - np.repeat(np.add.reduceat(light * waves.index, first), many)
    spread = np.sqrt(np.add.reduceat(light * away**2, first))
    skew = np.add.reduceat(light * away**3, first) / spread**3
    return [
        *(found.mean(), 100 * (found == 1).mean(), 100 * (found >= 3).mean()),
        np.median(width[begin]) / SAMPLE,
        *np.quantile(spread, [0.5, 0.9]),
        *np.quantile(skew, [0.5, 0.9]),
    ]


def received(file: Path) -> Waveforms:
    """Measured waveforms, less their baselines."""
    counts = np.load(file)["received"].astype(float)
    kept = counts > 0
    base = np.array([np.median(row[row > 0][:BASE]) for row in counts])
    pulse, index = np.nonzero(kept)
    return Waveforms(pulse, index, (counts - base[:, None])[kept], SAMPLE)


def simulated(seed: int) -> list[Waveforms]:
    """Waveforms of the transects of a stand of oaks and maples."""
    half = np.array([LENGTH, BESIDE * WIDE]) / 2 + MARGIN
    targets = api.Targets(dbh=api.Normal(mean=DBH[0], sd=DBH[1]))
    trees = tuple(
        api.Planting(species=name, variants=3, density=DENSITY / len(NAMES), targets=targets)
        for name in NAMES
    )
    field = api.Forest(origin=tuple((-half).tolist()), size=tuple((2 * half).tolist()))
    world = api.build(api.Scene(seed=seed, forest=field, plantings=trees))
    plain = structure(settings_of("optech-gemini", "airborne", Path()), api.Airborne)
    high = plain.position[2]
    side = float(np.degrees(np.arctan(BESIDE * WIDE / 2 / high)))
    found = world.scan(
        plain.changed(
            position=(-LENGTH / 2, 0.0, high),
            track=LENGTH,
            heading_deg=0.0,
            field_deg=(-side, side),
            pulse_rate=BESIDE * PULSES / (LENGTH / plain.speed),
            receiver=plain.receiver.changed(echoes="crests"),
        )
    ).found
    transect = np.full(int(found.waves.pulse.max(initial=0)) + 1, -1)
    transect[found.pulse] = np.floor(found.position[:, 1] / WIDE + BESIDE / 2)
    of = transect[found.waves.pulse]
    rows = [of == k for k in range(BESIDE)]
    pulse, index, value = found.waves.pulse, found.waves.index, found.waves.value - 1000.0
    return [Waveforms(pulse[own], index[own], value[own], SAMPLE) for own in rows]


def compare_waveforms(data: Path, seed: int) -> list[Comparison]:
    """Rows of the measured waveforms and of ours over ``STANDS`` stands."""
    real = received(data / "neon_waveforms.npz")
    values = measures_of_waves(real)
    ours = [measures_of_waves(waves) for k in range(STANDS) for waves in simulated(seed + k)]
    intervals = [Interval.of(each) for each in np.array(ours).T]
    words = f"Agrees within the 90 % of {len(ours)} transects of {STANDS} stands."
    return [
        Comparison(
            f"digitiser over oaks and maples, {name}",
            *(unit, Interval(float(value)), interval, interval.meets(Interval(value))),
            words=words,
        )
        for (name, unit), value, interval in zip(MEASURES.items(), values, intervals, strict=True)
    ]


# A measured plot beside its twin: Chablais 3, whose every tree and whose airborne cloud are known.
#
# The twin is what ``lidar --like REAL.laz --trees TABLE`` writes: each tree of the table where it stands
# and of its size, on the cloud's ground class, flown along the lines that the cloud tells, with the light of
# the instrument that made it, a RIEGL LMS-Q560 (lidaRtRee's documentation), whose threshold is that of the
# cloud's faintest echoes. Both clouds are measured by the same functions, ``EDGE`` and more within the box of
# the trees: crowns of trees outside the plot, which no table has, reach over its rim.
#
# The file numbers a pulse's first return 1 of 2, its last 2 of 2 and all between 2 of 3, so that it tells
# single pulses, and how many returns lie between a first and a last, but not how many a pulse has.

SPECIES = ("PIAB=norway-spruce", "FASY=european-beech", "ABAL=silver-fir")
OTHERS = "FASY"  # whose place the few trees of other species take
INSTRUMENT, SEEDS = "riegl-lms-q560", 4
EDGE = 5.0  # m
WITHIN = {"%": 5.0, "m": 0.5, "": 0.2}  # a row agrees, stated before the run
LOW, FLOOR, TALL = 2.0, 0.5, 15.0  # m
CELL, LEAST = 0.5, 5.0  # m, of the canopy model and of a summit's height
NEAR, A_METRE = (
    2.1,
    0.14,
)  # m, and for a metre of height, that a summit may be off its tree (Monnet 2010)

CLOUDS_ALONE = """
[accuracy]
detail = "auto"

[output]
pictures = false
leaves = false
report = false
blend = false
glb = false
"""

SLICES = {"spruces and firs": (40.0, 46.0), "beeches": (22.0, 28.0)}  # m from the plot's south
HIGH, LONG, DOTS = 38.0, 42.0, 7000  # m, m, and points of a slice that are drawn
Slice = tuple[
    str, np.ndarray, np.ndarray
]  # title, and (N, 2) along it and over the ground, m: real, ours

UNITS = {
    "overlap of profiles by height": "",
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


def measures_of_plot(
    cloud: CloudReturns, trees: np.ndarray, layers: np.ndarray | None = None
) -> tuple[dict[str, float], np.ndarray]:
    """Measures of a cloud of a plot with trees (N, 3) x, y, height, m, by the names of ``UNITS``, and (60,)
    shares of returns above 1 m by metre of height. layers : such shares that they are held to; None: their
    own."""
    height = cloud.heights()
    first, last = cloud.number == 1, cloud.number == cloud.count
    high = height[first & (height > LOW)]
    around = cKDTree(cloud.place[:, :2]).query_ball_point(trees[:, :2], 1.0)
    over = np.array([max(height[rows], default=0.0) for rows in around]) - trees[:, 2]
    over = over[trees[:, 2] > TALL]
    found, false = detected(cloud.place[:, :2], height, trees)
    spread = float(np.ptp(np.quantile(over, [0.16, 0.84])) / 2)
    layer = np.bincount(height[(height > 1) & (height < 60)].astype(int), minlength=60)
    layer = layer / layer.sum()
    values = [
        np.minimum(layer, layer if layers is None else layers).sum(),
        100 * cloud.shares()[0][0],
        100 * ((cloud.number > 1) & ~last).sum() / first.sum(),
        100 * (height[first] > LOW).mean(),
        100 * (height[last] < FLOOR).mean(),
        *np.quantile(high, [0.05, 0.5, 0.95]),
        *(float(np.median(over)), spread),
        *(100 * found, 100 * false),
    ]
    return dict(zip(UNITS, map(float, values), strict=True)), layer


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


def flown_twin(cloud: Path, table: Path, seed: int) -> CloudReturns:
    """The returns of a plot's twin, in the coordinates of its cloud.

    It is run by the command, in a process of its own: what a twin takes (12 GB) is given back.
    """
    names = np.genfromtxt(table, delimiter=",", names=True, dtype=None, encoding="utf-8")["species"]
    known = {word.split("=")[0]: word for word in SPECIES}
    stand_in = known[OTHERS].split("=")[1]
    words = [known.get(name, f"{name}={stand_in}") for name in np.unique(names).tolist()]
    with TemporaryDirectory() as folder:
        scene, out = Path(folder) / "twin.toml", Path(folder) / "out"
        write_like(cloud, scene, INSTRUMENT, trees=table, species=words, say=lambda _: None)
        with scene.open("a", encoding="utf-8") as file:
            file.write(CLOUDS_ALONE)
        run = [sys.executable, "-m", "headless", "run", str(scene), "--quiet"]
        run += ["--seed", str(seed), "--out", str(out)]
        subprocess.run(run, env=environment_of_child(), check=True)
        lines = [read_cloud(file) for file in sorted(out.glob("line-*.laz"))]
    parts = ((line.place, line.number, line.count, line.ground) for line in lines)
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
    real, layers = measures_of_plot(cloud, trees)
    given = file.resolve(), table.resolve()
    twins = [flown_twin(*given, seed + k).within(low, high) for k in range(SEEDS)]
    ours = [measures_of_plot(twin, trees, layers)[0] for twin in twins]
    slices = _pines(data / "clouds" / "spanner_UAS.laz", seed) + _slices(cloud, twins[0], low)
    drawn = (draw_slices(slices, out / "slices.png"),)
    found = []
    for name, unit in UNITS.items():
        values = np.array([each[name] for each in ours])
        simulated = Interval(*map(float, (values.mean(), values.min(), values.max())))
        near = bool(abs(simulated.value - real[name]) <= WITHIN[unit])
        words = f"Agrees within {WITHIN[unit]:.2g} {unit}.".replace(" .", ".")
        title = f"Chablais 3 and its twin, {name}"
        row = Comparison(title, unit, Interval(real[name]), simulated, near, words)
        found.append(row if found else replace(row, pictures=drawn))
    return found


# LiDAR against measured clouds: returns of a pulse, stems found from a tripod, and thin branches.
#
# Parts: a plot of conifers by drone and aircraft, line by line (``clouds.flights``), gaps between returns
# (``clouds.gaps``), stems of measured plots from one tripod scan (``stems``), their diameters beside
# those by hand (``tapes``), and of thin branches in a scan with and without errors (``twigs``).


TITLE = "LiDAR"
SUMMARY = """\
Measured: one 27 x 26 m plot of conifers by drone (352 pulses/m²) and by aircraft (22 pulses/m²), from the R
package spanner (GPL-3); 16 plots of pine in La Rioja, every tree by hand and as one terrestrial scan found
it, from FORTLS (GPL-3); volumes of two ashes by Demol et al. (2022); one plot of 50 x 50 m in the French Alps
with every tree and its airborne cloud, from lidaRtRee (GPL-3); 500 waveforms of an airborne digitiser over
Harvard Forest, from NEON by way of waveformlidar (Zhou et al. 2017, GPL-3). Simulated are stands with what is
known of the plots (trees as the clouds tell them; stems in the places, diameters and heights of four of
the 16); beams, which are not stated with the data, are assumed as typical.
"""
TERMS = """\
**Lines of the drone and the aircraft.** Heights, crowns and leaf area of the plot's trees, reflectances
and the threshold are read from the clouds, never from shares of returns. Ours is the mean of four stands
of the same trees, which differ by their seeds, with the lowest and the highest of them; a line agrees
whose mean is within 5 points. The slanted lines' file lacks the ground, so only pulses that meet a plant
first are compared there.

The files name neither species nor instrument. They lie on the Mogollon Rim of Arizona (470.6 and 3,810.2
km of UTM zone 12N, 2,280 m), where ponderosa pine is the common tree, and are of 19 and 22 September
2020. The drone's scanner sends some 0.75 M pulses and 83 lines a second and sees beyond 60 degrees to
both sides.

Four things limit what these rows can say:

- **Leaf area.** To hold back as much light as the aircraft's cloud shows, the stand has to bear 15 to 18
  m² of leaves a square metre; evenly spread shoots would need 4.9, and no pine stand is known to bear so
  much. Our shoots of ponderosa pine shade their own needles too much: Law et al. (2001, Agric. For.
  Meteorol. 108, 1) measured 4 STAR of 0.8, which our shoot has with 105 needles in place of 435. With 105
  needles the stand bears 7.7 m², but pulses of the drone are split too often.
- **Pulses.** 5 % of the gaps between two returns from crowns are below 1.10 m in the drone's line at 26
  degrees and 1.13 to 1.18 m in the aircraft's; with the pulses of 3 and 4 ns that are assumed ours are
  below 0.63 and 0.75 m. Pulses of 6.1 and 6.5 ns give the gaps as measured and bring the aircraft's lines
  within 5 to 10 points, but move the drone's out of agreement.
- **The aircraft's instrument.** The drone's pulses, put together to beams of 0.4 m, see the real trees as
  the aircraft should: at a threshold of 9 % of a whole echo 26, 38, 26 and 9 % of pulses have 1, 2, 3 and
  4 returns, at 13 % 33, 48, 17 and 2. The aircraft has 42, 32, 19 and 6. Put together with pulses of 7 ns
  they give 41, 35, 19 and 5: so the receiver is the most likely reason why the aircraft's lines do not
  agree.
- **Crowns.** Crowns of ponderosa pine as published (Hann & Hanus 2001) and a second storey, as the clouds
  show it, bring the drone's lines nearer and the aircraft's farther away. Finer shoots (60 blades in
  place of 18) change the drone's lines by 4 to 5 points and no verdict; angles of branches and the
  threshold change less than stands differ by.

Points classed as noise, 2.2 % of the aircraft's, are left out; with them its lines had 39 to 43 % of single
returns, ours 36 to 41. Echoes are seen by their peaks: by all of their light (and with the noise) the
aircraft's lines were 1 to 5 points farther from the cloud's, the drone's 1 to 3 nearer. What is left has one
sign: in real crowns the drone's pulses are split more often than in ours, by 8 to 18 points, and the
aircraft's have more third and fourth returns. That asks for foliage that is finer within a tuft, and for
tufts that stand farther apart; no measurement of either was found.

**Diameters of one scan.** Lists of La Rioja differ from the hand by 13 plots' means of -3.4 to -0.8 cm,
and neither a plot nor the scale of a scan is the cause. FORTLS's own algorithm on our boles with bark
makes 0.5 of the 2.2 cm: a tape spans furrows and reads 0.8 cm more than the area, a mean of distances
leaves part of them out, and sparse cells, with limbs in them, are dropped. Not explained are 1.7 cm, and
a spread of 4.7 cm in place of 1.4: 29 % of their stems are partly hidden, none of ours. Nearness and the
years between both measurements are left.

**Residuals of circles** are of slices of 30 cm from several tripods. Without an error of joining ours are
4.4 mm in the mean; stations that are joined amiss by 5, 8 and 12 mm along each axis make 5.2, 6.0 and 7.0
mm, so that the 8.2 mm of a joined plot ask for some 15 mm. A measured pine (TreeLS) is less round than
ours: its sectors of 10 degrees vary by 3.6 to 4.9 mm, ours by 2.5 to 3.2.

**Chablais 3** is what `lidar --like` writes from the cloud and its table, flown as it was, with the light
of the instrument that made it, a RIEGL LMS-Q560. Rows agree within 5 points, 0.5 m, or 0.2 of the overlap;
they are of four seeds. Trees of other species than spruce, fir and beech
stand as beeches; trees below 7.5 cm are in no table. Of the cloud itself two things of the receiver are
read: its threshold, 0.17 at 1,500 m, from its faintest echoes, and its pulse. Gaps between echoes of a
pulse in the canopy are 1.2 times as long as with the 4 ns that are sent: 1, 5, 25 and 50 % are below 0.68,
0.86, 1.31 and 1.89 m in the cloud's line at 500 m, below 0.52, 0.70, 1.09 and 1.60 m with 4 ns. With 4.9
ns, which are taken for the pulse as received, they are 0.65, 0.86, 1.30 and 1.86 m.

What passes and what splits have different causes. They were told apart in the line at 500 m (seed 1, before
the changes that are named), light by what the ground returns alone.

- **Light that passes is the stand's.** 17 % of it reach the ground in the real cloud, 32 % did in ours.
  Circles as wide as our crowns left 18 % open, and crowns let 16 % through their circles. By distance from
  a stem over its crown's radius (to 0.5, 0.7, 0.8, 0.9, 1.0, 1.1 and 1.2) light at the ground is 5, 9, 13,
  21, 26, 35 and 42 % in the real cloud and was 10, 19, 32, 44, 59, 72 and 83 % in ours: real crowns go on
  beyond those radii. A rule that narrowed crowns of near neighbours was one cause: laws of width are of
  trees in stands, so that neighbours counted twice. It took 29 % of the crowns' area, and their circles'
  cover from 88 to 80 %. The law's beech of 15 cm is 5.5 m wide, as by SILVA's equation (Pretzsch et al.
  2002; 15.3 cm and 16 m: 5.4 m), the narrowed one 4.8 m. The rule is gone: 25 % reach the ground, and cover
  is 84 % where it was 76.
- **A crown's rim is open.** A beech alone (20 cm, 80 m² of leaves, 5 m wide) hides 98 % of what is within
  0.7 of its radius and half of what is beyond; evenly strewn leaves hide 61 %, leaves nearer to the surface
  60, both 65, and 1.5 times as many leaves make the hidden part of the whole circle 79 % in place of 75.
  Where real crowns of beeches end is not measured well enough to choose.
- **Echoes that split are not from light that passes.** Within 0.7 m of beeches' stems 6 and 9 % of the
  light reach the ground, yet of pulses that meet the canopy 51 % have one return in the real cloud and 13 %
  in ours. In the beech alone, where 2 % pass, 8 % have one. Whatever changes the crown keeps that between 5
  and 16 % (leaves evenly strewn, in clumps three times as large, in flat sprays, nearer to the surface),
  and 61 sub-rays give 8 as 19 do. A threshold twice as high makes it 24 %, pulses of 8 ns 26 %, pulses of
  4.9 ns 15 %, and a beech of 35 cm with 5.7 m² of leaves a m² of crown and pulses of 4.9 ns 28 %. The
  strongest echo of a pulse is over 0.7 of the ground's in 28 % of the real ones and in 9 % of ours: foliage
  that takes most of the light within half a metre, as dense crowns do, would make that. No measurement of it
  was found.
- **The receiver is not the cause.** One that tells fewer faint echoes beside strong ones would show in the
  cloud: of 18,689 pairs of neighbouring echoes in the line at 500 m, from 0.8 m apart on, the weakest
  fiftieth of the weaker ones is 0.06 to 0.07 of the ground's single echoes, beside strong ones (0.8 to 1.2)
  as beside faint ones. What such an instrument tells is the peak of an echo, not its light; so do ours, which
  takes single returns from 39 to 42 % (seed 1). Lines differ in power: their faintest echoes are 0.22, 0.16,
  0.17 and 0.06 of their ground's at 1,006, 967, 714 and 480 m, ours by one threshold 0.22, 0.20, 0.11 and
  0.05. With each line's own, single returns would be 47 % and those between 34. Real canopies are brighter,
  too: single echoes have 0.65 of the ground's in the median at 480 m, ours 0.47.

Variants matter: with six a species, each in the size of its trees' diameters, beeches have crowns of 0.29
m² a square metre where their targets said 0.45, heights are up to 3 m amiss, and cover was 10 points lower.
A species of a twin has up to twenty variants. Which trees they are of is drawn: of the four twins one (seed
4) has first returns 1.9 m higher in the median than the others, an overlap of 0.83 and fewer trees found.

**Waveforms.** The 500 lie on one transect of 60 x 3 m, so ours are transects of that size. Echoes of the
digitiser are never as narrow as what it sends: Gaussians fitted to sent pulses have a standard deviation
of 6.9 ns, to the narrowest twentieth of single echoes 8.3 ns and less. The scanner `optech-gemini`
therefore has the mean of the 25 narrowest for its pulse; nothing else is from these data. First echoes are as
wide as measured, and as many waveforms have one; but ours have more of three and more, and their light is
spread over 3.1 m (standard deviation, without the pulse's) where the real one is over 1.4 m. Of real pulses
with several echoes nine in ten end within 10 m of the first. Before neighbours ceased to narrow crowns,
echoes were as many as measured: the crowns of this stand, 500 stems/ha of 27 cm, now sum to 2.6 m² a m², with
5.6 m² of leaves. So both clouds say the same: real crowns stop light sooner than ours, which are wide and
thin. In slices of Chablais 3 real spruces are shells of points, ours are filled with them.
Leaves that pass 45 % of the light, as at 1064 nm, make it no better.

**A VZ-400i's gaps** between returns agree without a dead zone: the length of the pulse alone makes that
edge. Shares of returns are not judged, as the stand of the real scan is not described. They depend on the
threshold: without one, 7, 19, 61 and 300 sub-rays give 88.3, 85.7, 83.4 and 81.0 % single returns (real
92.8); with 4 % of the light of a white surface that fills the beam, and pulses of 3.6 ns, 61 sub-rays have
92.6, 7.1 and 0.3 % of 1, 2 and 3 returns (92.8, 7.04, 0.15). From 1 % on 19 sub-rays are enough ([how
many](lidar.md#one-pulse)).

`python -m studies validate lidar CLOUD.laz --scene MY.toml` compares the clouds of a scene with one of
your own.

### Two clouds compared

`python -m studies validate lidar A.laz B.laz` compares two clouds, real or simulated, by measures
that do not depend on how dense they are. Where the scanner was is read from the pulses themselves (first and
last return of a pulse lie on its beam), or told (`--origin X,Y,Z`). A distance agrees that is not above the
95th percentile of 40 random halvings of either cloud's blocks of 5 m; distances between flight lines of one
cloud stand beside it. The drone's cloud of the plot against the aircraft's:

| measure | drone | aircraft | distance | of halves | of lines | |
|---|---|---|---|---|---|---|
| light that passes a voxel of 1 m | 0.937 | 0.962 | 0.0267 | to 0.0259 | 0.00511 to 0.0436 | no |
| voxels of 1 m that 10 beams meet | 0.216 | 0.161 | 0.0623 | to 0.0862 | 0.02 to 0.0897 | agrees |
| profile of light, m, median | 22.2 | 22.4 | 0.0397 | to 0.181 | 0.0412 to 0.187 | agrees |
| light that reaches the ground | 0.176 | 0.324 | 0.29 | to 0.12 | 0.0649 to 0.206 | no |
| pulses by returns and angle, % single | 64.5 | 41.1 | 0.131 | to 0.0469 | 0.0372 to 0.0885 | no |
| ranges, m, median | 137 | 1.64e+03 | 1 | to 0.0936 | 0.447 to 1 | no |
| intensity over single ones' | 0.862 | 0.725 | 0.192 | to 0.0769 | 0.0325 to 0.183 | no |
| gaps between returns of a pulse, m, median | 3.22 | 4.21 | 0.133 | to 0.0988 | 0.0324 to 0.137 | no |

Stems are too few in points from above for circles. Two real clouds of one plot differ by more than their
halves do wherever angle, footprint or instrument come in: no simulation of one need come nearer to the other
than that.
"""


def validate(data: Path, out: Path, arguments: argparse.Namespace) -> list[Comparison]:
    """All parts; or a cloud of the user's own against a scene."""
    if arguments.file:
        return compare_own(arguments.file, arguments.scene)
    found = compare_flights(data / "clouds", arguments.seed)
    found += compare_twin(data, out, arguments.seed)
    found += compare_waveforms(data / "waveforms", arguments.seed)
    found += compare_gaps(arguments.seed)
    found += compare_stems(data / "rioja", out, arguments.seed)
    found += compare_diameters(data / "rioja", arguments.seed)
    found.append(compare_residuals(data / "wood", arguments.seed))
    return [*found, *compare_twigs(out, arguments.seed)]
