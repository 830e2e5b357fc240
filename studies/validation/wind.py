"""Sway of grown trees: skeletons of measured size, their modes and what a gauge at their foot would tell."""

from __future__ import annotations

import argparse
import lzma
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import butter, filtfilt, welch

from forest_addon.api import Forest, Planting, Scene, SpecError, Wind

from ..inside import (
    BARK,
    DISPLACED,
    DRAG,
    FAINT,
    INK,
    LAYERS,
    LEAF_GREEN,
    ROUGH,
    WOOD_DRAG,
    ForestSite,
    SwayResponse,
    SwayShape,
    Wanted,
    WindField,
    blade_of,
    blank_figure,
    curved,
    find_species,
    grow_measured,
    has_curves,
    leaf_areas,
    load_species,
    measures_drawn as drawn,
    response_of,
    save_figure,
    scaled_to,
    shape_with,
    stream,
    sway_of,
    table_of,
    wood_of_species,
)
from .ears import displaced, of_ears
from .run import Comparison, Interval, Picture

CONIFER_PRESETS = {"Picea": "norway-spruce", "Abies": "silver-fir", "Pseudotsuga": "douglas-fir"}
BROADLEAF_PRESETS = {
    "Acer": "norway-maple",
    "Quercus": "pedunculate-oak",
    "Fraxinus": "european-ash",
    "Betula": "silver-birch",
}


PINES = ("Pinus", "Agathis", "Cupressus")


@dataclass(frozen=True)
class MeasuredSway:
    """A measured tree: its genus, diameter and height in m, sway frequency in Hz."""

    genus: str
    dbh: float
    height: float
    frequency: float

    @property
    def preset(self) -> str:
        """The species of ours that is nearest: of its genus, else a pine or a beech."""
        return {**CONIFER_PRESETS, **BROADLEAF_PRESETS}.get(self.genus, "")

    @property
    def stand_in(self) -> str:
        """The species of ours that it is grown as."""
        return self.preset or ("scots-pine" if self.genus in PINES else "european-beech")


def shape_as(tree: MeasuredSway, preset: str, rng: np.random.Generator, vary: bool) -> SwayShape:
    """Grow a skeleton of a measured diameter and height, and find its modes.

    vary : crown and leaf area are drawn as the species' allometry has them, else its medians.

    Raises
    ------
    SpecError : no tree of the species has such a diameter and height.
    """
    species, kind = load_species(find_species(preset, Path()))
    chance = rng.random((1, 4)) if vary else np.full((1, 4), 0.5)
    given = np.array([[tree.height, np.nan, np.nan, np.nan]])
    row = drawn(kind.allometry, np.array([tree.dbh]), given, chance, preset, np.zeros(4))[0]
    blade, wanted = blade_of(species, kind.blade), Wanted(*row.tolist())
    skeleton, sites, _ = grow_measured(species, wanted, blade, rng)
    if has_curves(species):
        skeleton, sites = curved(skeleton, sites, species.crown.collar if species.crown else 0.0)
        skeleton = scaled_to(skeleton, wanted.dbh)
    area = np.bincount(
        np.maximum(sites.segment, 0), leaf_areas(sites, blade), minlength=len(skeleton)
    )
    return shape_with(skeleton, area, wood_of_species(species))


def strain(shape: SwayShape, amplitude: np.ndarray) -> np.ndarray:
    """(T, 2) bending of the stem's foot at amplitudes (T, M), as two gauges have it, rad/m."""
    low, high = shape.ends
    length = float(np.linalg.norm(shape.members.end[0] - shape.members.start[0]))
    return np.asarray(amplitude @ ((high - low)[0, :, 3:5] / length))


def trunk_motion(
    shape: SwayShape, response: SwayResponse, share: float, time: np.ndarray
) -> np.ndarray:
    """(T, 2) level displacement in m of the stem at a share of the tree's height."""
    nodes = shape.members.nodes
    height = share * float(nodes[:, 2].max())
    chain = _stem(shape)
    order = np.argsort(nodes[chain, 2])
    level = nodes[chain, 2][order]
    modes = shape.modes.shape[chain][order][:, :, :2]
    at = np.stack(
        [
            [np.interp(height, level, modes[:, m, axis]) for axis in range(2)]
            for m in range(modes.shape[1])
        ]
    )
    return response.exact(time)[0] @ at


def _stem(shape: SwayShape) -> np.ndarray:
    """Nodes of the stem, from the ground on: the thickest member that goes on from each."""
    members, chain = shape.members, [0]
    while True:
        onward = np.flatnonzero(members.node[:, 0] == chain[-1])
        if not len(onward):
            return np.array(chain)
        chain.append(int(onward[np.argmax(members.radius[onward, 0])]) + 1)


# Measured sway: frequencies of trees, hour-long records of trunks, and the slope of a record's spectrum.


BAND = (0.05, 2.0)  # Hz, of the slope
NOMINAL = 4.0  # Hz
CUT = 0.0017  # Hz, of the high pass


def measured_trees(folder: Path, clade: str, place: str) -> list[MeasuredSway]:
    """Trees of a clade (Conifer, Broadleaf) and a place (Forest, Open) with all three measures."""
    return [
        MeasuredSway(
            (row["species"].split() or [""])[0],
            float(row["dbh_m"]),
            float(row["height_m"]),
            float(row["f0_hz"]),
        )
        for row in table_of(folder / "sway_trees.csv")
        if row["clade"] == clade and row["environment"] == place
        if row["dbh_m"] and row["height_m"] and row["f0_hz"]
    ]


@dataclass(frozen=True)
class SwayRecord:
    """A record of trunk motion: two channels or more (T, C) at a rate in Hz, by a kind of sensor of a clade.

    published : slope of its spectrum as its authors give it, NaN where they give none.
    """

    name: str
    clade: str
    sensor: str
    rate: float
    published: float
    motion: np.ndarray


def measured_records(folder: Path) -> list[SwayRecord]:
    """Read the measured records."""
    records = []
    for row in table_of(folder / "records" / "records.csv"):
        name = row["Filename"]
        with lzma.open(folder / "records" / f"{name}.csv.xz", "rt") as text:
            motion = np.genfromtxt(text, delimiter=",")
        published = float(row["sh_s_slope_005_2"])
        rate = float(row["Res_Hz"])
        records.append(SwayRecord(name, row["Clade2"], row["Sensor"], rate, published, motion))
    return records


def slope_of(motion: np.ndarray, rate: float = NOMINAL) -> float:
    """Slope of log power over log frequency, 0.05 to 2 Hz, of motion (T, C), as the records' authors find it.

    High pass of fourth order, the first principal component, Welch's spectrum of eight Hamming windows that
    overlap by half, least squares over its evenly spaced lines (Jackson et al. 2021,
    ``calculate_features_fn7``, ``slope_of_spectrum2``). They take every record for one of 4 Hz, so that
    the bands of faster ones lie 1.25 or 2.5 times higher.
    """
    high = butter(4, CUT / (rate / 2), "high")
    calm = filtfilt(*high, motion - motion.mean(axis=0), axis=0)
    calm -= calm.mean(axis=0)
    main = calm @ np.linalg.svd(calm, full_matrices=False)[2][0]
    frequency, power = spectrum_of(main, rate)
    rows = (frequency >= BAND[0]) & (frequency <= BAND[1]) & (power > 0)
    return float(np.polyfit(np.log(frequency[rows]), np.log(power[rows]), 1)[0])


def spectrum_of(series: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz and power density of a series (T,), as Matlab's ``pwelch`` has them unasked."""
    piece = int(len(series) / 4.5)  # of eight that overlap by half
    lines = max(256, 2 ** int(np.ceil(np.log2(piece))))
    return welch(series, rate, "hamming", piece, noverlap=piece // 2, nfft=lines, detrend=False)


def floor_of(record: SwayRecord) -> float:
    """Share of a record's variance that white noise at the level of its highest fifth of frequencies has."""
    motion = record.motion - record.motion.mean(axis=0)
    main = motion @ np.linalg.svd(motion, full_matrices=False)[2][0]
    frequency, power = spectrum_of(main, record.rate)
    level = float(np.median(power[frequency > 0.4 * record.rate]))
    return level * record.rate / 2 / float(np.trapezoid(power, frequency))


# Loads on stems in a stand: the largest turning moment within an hour and how far gusts exceed the mean.


TURNING = 111.7  # kg/m³: the moment over diameter² height speed²
HOUR = np.arange(0.0, 3600.0, 0.5)
LEAF_AREA_INDEX = 4.0


def _loads(swayed: Swayed, seed: int, speed: float, many: int = 40) -> list[Comparison]:
    """Turning moments, gust factors and sway of the tops of conifers in a stand of their like."""
    peak, gust, published, lean, sway = [], [], [], [], []
    pairs = zip(swayed.trees[:many], swayed.shapes[:many], strict=True)
    for number, (tree, shape) in enumerate(pairs):
        response = respond(shape, speed, seed + number)
        stiff, swayed = _stiffness(tree, shape), response.exact(HOUR)[0]
        moment = stiff * np.linalg.norm(strain(shape, swayed), axis=1)
        steady = stiff * np.linalg.norm(strain(shape, response.mean))
        peak.append(moment.max() / (TURNING * tree.dbh**2 * tree.height * speed**2))
        gust.append(moment.max() / steady)
        apart = np.sqrt(2 * shape.leafy.sum() / LEAF_AREA_INDEX) / tree.height
        published.append(gust_factor(apart))
        top = int(np.argmax(shape.members.nodes[:, 2]))
        tops = swayed @ shape.modes.shape[top, :, :2]
        lean.append(100 * np.linalg.norm(tops.mean(axis=0)) / tree.height)
        sway.append(100 * np.sqrt(tops.var(axis=0).sum()) / tree.height)
    ours, gusts = Interval.of(np.array(peak)), Interval.of(np.array(gust))
    words = (
        f"{len(peak)} conifers at {speed:g} m/s at the tops, one hour each, nothing fitted. 1: the "
        "regression of Hale et al. 2012 on conifers of British stands, its figure as ForestGALES has it "
        "(Locatelli et al. 2022), R² 0.95."
    )
    return [
        Comparison(
            "largest turning moment of conifers within an hour, over 111.7 dbh² h U²",
            "",
            Interval(1.0),
            ours,
            ours.meets(Interval(1.0)),
            words,
        ),
        Comparison(
            "largest turning moment within an hour over the mean one",
            "",
            Interval.of(np.array(published)),
            gusts,
            None,
            "Measured: of wind tunnel and field by spacing over height (Gardiner et al. 1997), deep in a "
            "stand. Ours are of normal gusts; those over real canopies are skewed.",
        ),
        Comparison(
            f"mean lean of conifers' tops at {speed:g} m/s",
            "% of the height",
            None,
            Interval.of(np.array(lean)),
            None,
        ),
        Comparison(
            f"sway of conifers' tops about it at {speed:g} m/s, deviation",
            "% of the height",
            None,
            Interval.of(np.array(sway)),
            None,
        ),
    ]


def gust_factor(spacing: float) -> float:
    """Largest over mean turning moment deep in a stand, by its trees' spacing over their height (Gardiner et
    al.
    1997, as ForestGALES has it, from nine heights on)."""
    s = float(np.clip(spacing, 0.075, 0.45))
    most = 2.7193 * s - 0.061 + (-1.273 * s + 0.9701) * (1.1127 * s + 0.0311) ** 9
    return most / (0.68 * s - 0.0385 + (-0.68 * s + 0.4785) * (1.7239 * s + 0.0316) ** 9)


def _stiffness(tree: MeasuredSway, shape: SwayShape) -> float:
    """Bending stiffness of the stem's foot, N m²."""
    species, _ = load_species(find_species(tree.stand_in, Path()))
    wood, radius = wood_of_species(species), float(shape.members.radius[0].mean())
    return wood.modulus * np.pi / 4 * (wood.inside * radius) ** 4


# Sway of trees in the wind: frequencies of grown skeletons, spectra, damping and scanned stems, held to
# measurement.


TITLE = "Wind: how trees sway"
SUMMARY = """\
Measured: 501 trees with diameter, height and sway frequency, and twelve hour-long records of trunks (Jackson
et al. 2021, *The motion of trees in the wind: a data synthesis*, Biogeosciences 18; most conifers from Moore
& Maguire 2004). Simulated: skeletons grown to the diameter and height of such trees, as beams of green wood
of the tables' modulus and density, with bark, leaves and their own weight; nothing is fitted. A genus
that we do not grow is a pine or a beech of ours. *Middle* trees have the crown and leaf area that are the
median of their diameter and height; *drawn* ones have them drawn as trees of one study differ.
"""
TERMS = """\
Bark, which weighs and does not stiffen, and the weight that a stem carries are in the model, both from
the literature; limbs are as long as scans show them and have the modulus of branches (Cannell & Morgan
1987). Without bark and weight conifers and broadleaves sway 1.3 times too fast. The foot is clamped:
roots that give (the foot turns by 0.25° at 0.4 of its strength, as arborists' pulling tests have it;
Forests 14:533, 2023) slow trees by 0 to 4 %. Of the ear motions the tone tells more, and the sweep less,
than published: our ear has one lobe that changes little over the sweep, real ones have many.

Of the first 70 of the drawn conifers ten miss the band. Too fast, by 1.6 to 1.9, are five spruces whose
crowns begin below 0.17 of the height; the measured ones of their size have 0.9 to 1.4 of the law (111 of
the 115 measured spruces are Sitka spruces, ours Norway spruces). Too slow, 0.62 to 0.73 of the law, are
three pines with twice the leaf area of their size and a Douglas fir whose crown begins at 0.88 of the
height. Frequency over the law falls with the crown's base (correlation -0.43), not with leaf area (0.03).

Broadleaves in forests: 33 of the 60 are of genera that are not grown and stand as beeches, tropical trees
among them; their spread is 1.99 (measured 1.59), that of the 27 of maple, oak, ash and birch 1.32 (1.18).
Ours follow diameter over height squared as beams do (power 0.81), the measured ones hardly (0.34).

Too slow are those whose first mode is that of a long limb (0.01 to 0.1 of its bending is the stem's). Tried
on 60 others (mean 0.209 Hz, measured 0.210; spread 1.84 and 1.49; 0.53 within 1.35) and left out: limbs no
steeper than 65°, and so shorter (0.239 Hz, 1.74, 0.48); limbs as thick as nine in ten of the scanned ones by
their length to 1.5 (0.216 Hz, 1.90, 0.53; branches then weigh more than the stem); the mode that bends the
stem's foot most (0.263 Hz, 1.74, 0.50). Measured ones lie within 1.29 of their own best power law.

![One slice of the demo, scanned still and in 9 m/s](pictures/wind-scan.png)

The demo of ours, a slice 1.5 m deep scanned from one tripod, still and in 9 m/s at the tops: how far each
point is off its place at rest (`packaging/wind_pictures.py`; [wind](wind.md) has frames of it, too).
"""
CONIFERS = 200
BROADLEAVES = 60
LARGEST = 1.3  # metres of diameter that are grown
FACTOR, SHARE = 1.35, 0.9
SLOPES = {"Conifer": -3.2, "Broadleaf": -2.6}
MANY = {"Conifer": "conifers", "Broadleaf": "broadleaves"}
OFF = 0.5
SPEED = 7.0  # m/s
CALM, STILL_TOP, TURN = 9.0, 0.28, 180.0  # m/s; share of the height; seconds a turn of the scanner
STATION, BLEND = 9.0, 60.0  # m/s at a weather station; m where profiles meet
LOW_SHARES = (0.06, 0.12, 0.2, 0.27)  # of the height
OTHERS = (3.0, 9.0)  # m/s


@dataclass(frozen=True)
class Swayed:
    """Measured trees and ours of their size, one that grew each."""

    trees: list[MeasuredSway]
    shapes: list[SwayShape]

    @property
    def slenderness(self) -> np.ndarray:
        """(N,) diameter over height squared, 1/m."""
        return np.array([t.dbh / t.height**2 for t in self.trees])

    @property
    def frequency(self) -> np.ndarray:
        """(N,) of ours, Hz."""
        return np.array([s.modes.frequency[0] for s in self.shapes])

    @property
    def measured(self) -> np.ndarray:
        """(N,) Hz."""
        return np.array([t.frequency for t in self.trees])


def validate(data: Path, out: Path, arguments: argparse.Namespace) -> list[Comparison]:
    """Hold grown trees to measured sway; empty where the measurements are not there."""
    folder = data / "sway"
    if not (folder / "sway_trees.csv").is_file():
        return []
    seed = arguments.seed
    conifers = measured_trees(folder, "Conifer", "Forest")
    middle = grow_like(conifers, CONIFERS, seed, vary=False)
    varied = grow_like(conifers, CONIFERS, seed, vary=True)
    park = grow_like(measured_trees(folder, "Broadleaf", "Open"), BROADLEAVES, seed, vary=True)
    wood = grow_like(measured_trees(folder, "Broadleaf", "Forest"), BROADLEAVES, seed, vary=True)
    picture = _draw({"conifers": middle, "broadleaves, open": park}, out)
    rows = [
        replace(_conifers("middle", middle), pictures=(picture,)),
        _conifers("drawn", varied),
        *_broadleaves("in the open", park),
        *_broadleaves("in forests", wood),
        _slope("Conifer", middle, folder, seed),
        _slope("Broadleaf", wood, folder, seed),
        *_damping(middle, seed),
        *_loads(middle, seed, CALM),
        *_stems(middle, seed),
        _tops(seed),
        *of_ears(seed),
    ]
    return rows


def grow_like(trees: list[MeasuredSway], count: int, seed: int, *, vary: bool) -> Swayed:
    """Grow skeletons like ``count`` measured trees, drawn without return; what no tree can be falls out."""
    rng = stream(seed, "wind validation")
    chosen, trees_like, shapes = rng.permutation(len(trees)), [], []
    for row in chosen.tolist():
        tree = trees[row]
        if len(trees_like) == count:
            break
        if tree.dbh > LARGEST:
            continue
        try:
            shapes.append(shape_as(tree, tree.stand_in, stream(seed, "wind tree", row), vary))
        except SpecError:
            continue
        trees_like.append(tree)
    return Swayed(trees_like, shapes)


def conifer_law(slenderness: np.ndarray) -> np.ndarray:
    """(N,) sway frequency of conifers of forests by diameter over height squared (1/m), Hz."""
    return np.asarray(96.9 * slenderness**0.80)


def _conifers(kind: str, swayed: Swayed) -> Comparison:
    ratio = swayed.frequency / conifer_law(swayed.slenderness)
    share = float((np.abs(np.log(ratio)) <= np.log(FACTOR)).mean())
    theirs = swayed.measured / conifer_law(swayed.slenderness)
    own = float((np.abs(np.log(theirs)) <= np.log(FACTOR)).mean())
    middle, low, high = np.quantile(ratio, [0.5, 0.05, 0.95])
    return Comparison(
        f"sway frequency of conifers, {kind} trees within {FACTOR} of 96.9 x^0.80",
        "share",
        Interval(own),
        Interval(share),
        share >= SHARE,
        f"{len(ratio)} trees; over the law: {middle:.2f} ({low:.2f} to {high:.2f} hold 90 %); {SHARE} is "
        "asked for.",
    )


def _broadleaves(place: str, swayed: Swayed) -> list[Comparison]:
    ours, theirs = np.log(swayed.frequency), np.log(swayed.measured)
    count = len(ours)
    mean = [
        Interval(*np.exp([x.mean(), *(x.mean() + np.array([-1.96, 1.96]) * x.std() / count**0.5)]))
        for x in (theirs, ours)
    ]
    factor = [Interval(*np.exp(x.std() * np.array([1, *_spread(count)]))) for x in (theirs, ours)]
    words = f"{count} trees of the same diameters and heights; geometric mean, 95 % interval."
    return [
        Comparison(
            f"sway frequency of broadleaves {place}, mean",
            "Hz",
            *mean,
            mean[0].meets(mean[1]),
            words,
        ),
        Comparison(
            f"sway frequency of broadleaves {place}, spread",
            "factor of one standard deviation",
            *factor,
            factor[0].meets(factor[1]),
        ),
    ]


def _spread(count: int) -> np.ndarray:
    """Ends of the 95 % interval of a standard deviation over it (normal law)."""
    from scipy.stats import chi2

    return np.sqrt((count - 1) / chi2.ppf([0.975, 0.025], count - 1))


def respond(shape: SwayShape, speed: float, seed: int) -> SwayResponse:
    """A tree amid a stand of its like, in wind of a speed at its top."""
    height = float(shape.members.nodes[:, 2].max())
    field = WindField.drawn(Wind(speed=speed), height, drag_area_of_like(shape, height), seed)
    return response_of(shape, field, np.zeros(3), 0.0)


def drag_area_of_like(shape: SwayShape, height: float) -> np.ndarray:
    """(LAYERS,) drag area over the ground's of a stand of trees like one, of the leaf area index here."""
    middle = shape.at_members()[0][:, 2]
    layer = np.clip((middle / height * LAYERS).astype(np.int64), 0, LAYERS - 1)
    area = 2 * DRAG * shape.leafy + 0.5 * WOOD_DRAG * shape.woody
    ground = max(2 * float(shape.leafy.sum()) / LEAF_AREA_INDEX, 1e-6)
    return np.bincount(layer, area, minlength=LAYERS) / ground


def _slope(clade: str, swayed: Swayed, folder: Path, seed: int) -> Comparison:
    time = np.arange(0.0, 3600.0, 0.25)
    records = [record for record in measured_records(folder) if record.clade == clade]
    floor = float(np.median([floor_of(r) for r in records if r.sensor == "Strain gauge"]))
    slopes, clean = [], []
    for number, shape in enumerate(swayed.shapes[:40]):
        bent = strain(shape, respond(shape, SPEED, seed + number).exact(time)[0])
        clean.append(slope_of(bent))
        noise = stream(seed, "gauge", number).normal(size=bent.shape)
        slopes.append(slope_of(bent + np.sqrt(floor * bent.var(axis=0).sum()) * noise))
    off = max(abs(r.published - slope_of(r.motion)) for r in records if np.isfinite(r.published))
    target, ours = SLOPES[clade], Interval.of(np.array(slopes))
    return Comparison(
        f"slope of the trunk's spectrum, {MANY[clade]}",
        "",
        Interval(target, target - OFF, target + OFF),
        ours,
        abs(ours.value - target) <= OFF,
        f"Bending of the stem's foot over an hour at {SPEED:g} m/s, 40 trees, by the records' authors' own "
        f"estimator; measured: their mean ± {OFF}. It finds the slopes of their {len(records)} records "
        f"here within {off:.2f} of what they publish. Ours have white noise as the records' strain gauges: "
        f"its level is that of their highest fifth of frequencies, {100 * floor:.2g} % of the variance "
        f"(median); without it the slope is {np.median(clean):.1f}. They end at the twelfth mode.",
    )


def _damping(swayed: Swayed, seed: int) -> list[Comparison]:
    rows = []
    for speed, least in ((3.0, 0.03), (9.0, 0.08)):
        damping = [respond(shape, speed, seed).damping[0] for shape in swayed.shapes]
        ours, published = Interval.of(np.array(damping)), Interval(0.2, least, 0.95)
        rows.append(
            Comparison(
                f"damping of the first mode of conifers at {speed:g} m/s",
                "of the critical one",
                published,
                ours,
                ours.meets(published),
                "Published: wood below 0.05; with the crown 0.08 to near critical, growing with the wind.",
            )
        )
    return rows


def _stems(swayed: Swayed, seed: int) -> list[Comparison]:
    height = float(np.median([tree.height for tree in swayed.trees]))
    speed = at_the_tops(STATION, height)
    shares = np.array([*LOW_SHARES, 0.4, 0.55, 0.7])
    change = _changes(swayed, 40, speed, seed, shares)
    low, high = change[:, shares < STILL_TOP], change[:, shares > STILL_TOP]
    worst, still = Interval.of(low.max(axis=1)), Interval(2.0, 0.0, 2.0)
    share = float((low.max(axis=1) < 2.0).mean())
    others = [
        (np.median(_changes(swayed, 20, other, seed, np.array(LOW_SHARES)).max(axis=1)), other)
        for other in OTHERS
    ]
    return [
        Comparison(
            f"diameters of stems below {STILL_TOP} of the height, largest change of a tree in wind",
            "mm",
            still,
            worst,
            worst.meets(still),
            f"{len(low)} conifers; {share:.0%} of them stay below 2 mm. One tripod, 10 m away, a turn in "
            "3 minutes, circles fitted. Measured on one Scots pine in "
            f"{STATION:g} m/s at a nearby weather station (Vaaja et al. 2016): {speed:.1f} m/s at tops "
            f"of {height:.0f} m by logarithmic profiles that meet at 60 m (Wieringa 1986). "
            "By the speed at the tops (median of 20 trees): "
            + ", ".join(f"{mm:.1f} mm in {other:g} m/s" for mm, other in others)
            + ".",
        ),
        Comparison(
            f"diameters of stems above {STILL_TOP} of the height, change in the same wind",
            "mm",
            None,
            Interval.of(high.ravel()),
            None,
            "Measured ones scatter, no figure is published.",
        ),
    ]


def at_the_tops(station: float, height: float) -> float:
    """Mean speed in m/s at the tops of a wide stand of a height in m, by that at 10 m above open ground.

    Logarithmic profiles over grass (roughness length 0.03 m) and over the stand (displaced by 0.7, roughness
    0.1 of its height) have the same speed at 60 m (Wieringa 1986, Q. J. R. Meteorol. Soc. 112).
    """
    high = station * np.log(BLEND / 0.03) / np.log(10 / 0.03)
    down = np.log((1 - DISPLACED) / ROUGH) / np.log((BLEND - DISPLACED * height) / (ROUGH * height))
    return float(high * down)


def _changes(swayed: Swayed, many: int, speed: float, seed: int, shares: np.ndarray) -> np.ndarray:
    """(N, S) changes in mm of fitted diameters of the first trees, at shares of their height."""
    return np.abs(
        [
            [diameter_change(shape, respond(shape, speed, seed + n), share) for share in shares]
            for n, shape in enumerate(swayed.shapes[:many])
        ]
    )


def _tops(seed: int) -> Comparison:
    """Sway of the tops of a small stand of beeches."""
    scene = Scene(
        seed=seed,
        forest=Forest(size=(30.0, 30.0)),
        plantings=(Planting(species="european-beech", expected=20, variants=3),),
    )
    grown = ForestSite.read(scene).grow()
    sway = sway_of(grown, Wind(speed=CALM), seed)
    time, spreads = np.linspace(0.0, 60.0, 300), []
    for tree in range(len(grown.stand)):
        leaves = grown.variant_of(tree).leaves
        top = np.array([int(leaves.centre[:, 2].argmax())])
        moved = [displaced(sway, tree, leaves.centre[top], top, t)[0] for t in time.tolist()]
        spread = np.sqrt(np.var(moved, axis=0).sum()) * grown.stand.scale[tree]
        spreads.append(100 * float(spread))
    words = f"{len(spreads)} beeches on 30 x 30 m, one minute; deviation about the lean, flutter included."
    name = f"sway of the crowns' tops in {CALM:g} m/s, beeches"
    return Comparison(name, "cm", None, Interval.of(np.array(spreads)), None, words)


def diameter_change(shape: SwayShape, response: SwayResponse, share: float) -> float:
    """Change in mm of a stem's fitted diameter by its sway while a scanner 10 m away turns past it."""
    stem = shape.members
    height = share * float(stem.nodes[:, 2].max())
    radius = float(
        np.interp(height, [0.0, float(stem.nodes[:, 2].max())], [stem.radius[0, 0], 0.01])
    )
    angle = np.linspace(-0.45 * np.pi, 0.45 * np.pi, 60)
    circle = radius * np.stack([-np.cos(angle), np.sin(angle)], axis=1)
    time = 30.0 + TURN / (2 * np.pi) * circle[:, 1] / 10.0
    seen = circle + trunk_motion(shape, response, share, time)
    matrix = np.column_stack([2 * seen, np.ones(len(seen))])
    x, y, c = np.linalg.lstsq(matrix, (seen**2).sum(axis=1), rcond=None)[0]
    return float(2000 * (np.sqrt(c + x * x + y * y) - radius))


def _draw(kinds: dict[str, Swayed], out: Path) -> Picture:
    figure = blank_figure((8.0, 3.6))
    for number, (name, swayed) in enumerate(kinds.items()):
        axes = figure.add_subplot(1, len(kinds), number + 1)
        x = swayed.slenderness
        axes.loglog(x, swayed.measured, "o", ms=3, color=BARK, alpha=0.6, label="measured")
        axes.loglog(x, swayed.frequency, "o", ms=3, color=LEAF_GREEN, alpha=0.6, label="grown")
        line = np.geomspace(x.min(), x.max(), 50)
        law = conifer_law(line) if number == 0 else 0.106 + 173 * line
        axes.loglog(line, law, color=INK, lw=1)
        axes.set_title(name, fontsize=9)
        axes.set_xlabel("diameter / height², 1/m")
        axes.set_ylabel("sway frequency, Hz")
        axes.grid(color=FAINT, lw=0.5)
        axes.legend(fontsize=7, frameon=False)
    path = out / "wind-frequencies.png"
    save_figure(figure, path)
    return Picture(
        path,
        "Sway frequencies of measured trees and of grown ones of their size; lines: measured laws.",
    )
