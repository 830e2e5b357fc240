"""Shares of pulses by their returns, and how far apart they are between halves of a flight line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from forest_addon.api import Beam, Cloud, Mobile, Rays, SpecError, Surfaces

from ..inside import (
    MOST_TIMES,
    FlightLine,
    FlownCloud,
    RayCaster,
    SceneGeometry,
    band,
    find_species,
    lines_of,
    load_species,
    make_caster,
    middle,
    pattern_like,
    read_allometry,
    read_flown,
    scan,
    scanner_like,
    shoot_of,
    stream,
)
from .own_cloud import CloudReturns, read_cloud
from .plots import geometry_of, ground_below, site_of, tops_of
from .run import Comparison, Interval

BLOCK, HALVES = 5.0, 40  # metres, and halvings of a line's blocks


def shares_of(count: np.ndarray) -> np.ndarray:
    """(4,) shares of pulses (P,) with 1, 2, 3 and 4 returns."""
    return np.bincount(np.minimum(count, 5), minlength=6)[1:5] / max(len(count), 1)


def halves_apart(cloud: FlownCloud, seed: int) -> dict[int, float]:
    """Distance, for each line, between the shares of single returns of random halves of its blocks: the
    95th percentile, as a share."""
    rng, farthest = stream(seed, "validate", "halves of lines"), {}
    for number in np.unique(cloud.line).tolist():
        rows = (cloud.line == number) & (cloud.number == 1)
        cell = np.floor(cloud.place[rows][:, :2] / BLOCK).astype(np.int64)
        block = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
        many = np.maximum(np.bincount(block), 1)
        single = np.bincount(block, cloud.count[rows] == 1)
        apart = []
        for _ in range(HALVES):
            half = rng.random(len(many)) < 0.5
            if half.any() and not half.all():
                each = [single[h].sum() / many[h].sum() for h in (half, ~half)]
                apart.append(abs(each[0] - each[1]))
        farthest[number] = float(np.quantile(apart or [0.0], 0.95))
    return farthest


# Light of a cloud's returns from their intensities: scale, reflectances and the threshold of detection.
#
# Intensities count decibels of reflectance. Where a file does not tell how many, its pulses of two
# returns do, one of a crown and one of the ground: what the crown took the ground lacks, so the light of
# both, each over that of single returns of its kind, sums to one (Armston et al. 2013, Remote Sens.
# Environ. 134, 24), or to what it sums to in a cloud of the same place whose scale is known: single
# returns of crowns are not all whole.


FULL = 65535.0
FAINTEST = 0.05  # share of the echoes that are taken for the threshold
CROWN, GROUND = 8.0, 0.4  # m: returns above are of crowns, below of the ground
SPANS = (5.0, 80.0)  # dB, between which a scale is looked for
SPHERICAL = (
    2 / 3
)  # light from Lambertian facets that are inclined like a sphere's, over that of a plate


@dataclass(frozen=True)
class IntensityScale:
    """Decibels of reflectance that intensities 0 and 65535 stand for."""

    low: float
    high: float

    def reflectance(self, intensity: np.ndarray) -> np.ndarray:
        """(N,) of intensities (N,): that of a facing plate which sends as much back."""
        level = self.low + (self.high - self.low) * np.asarray(intensity) / FULL
        return np.asarray(10 ** (level / 10))


def _sum_of(
    crown: np.ndarray, ground: np.ndarray, alone: tuple[float, float], span: float
) -> float:
    """Light of two returns, each over that of single ones of its kind: the median of their sums."""
    each = [
        10 ** (span * (i - full) / FULL / 10)
        for i, full in zip((crown, ground), alone, strict=True)
    ]
    return float(np.median(each[0] + each[1]))


def scale_of(
    returns: CloudReturns, height: np.ndarray, ground: float, total: float = 1.0
) -> IntensityScale:
    """The scale of a cloud, heights (N,) m, whose ground reflects this share.

    total : what the light of two returns sums to, of single ones'.
    """
    alone = singles(returns, height)
    two = _shared(returns, height)
    span = float(brentq(lambda span: _sum_of(*two, alone, span) - total, *SPANS, xtol=0.01))
    high = 10 * np.log10(ground) + span * (1 - alone[1] / FULL)
    return IntensityScale(high - span, high)


def _shared(returns: CloudReturns, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P,) intensities of pulses that a crown and the ground share, and no other."""
    row = np.flatnonzero((returns.number[:-1] == 1) & (returns.count[:-1] == 2))
    both = (returns.number[row + 1] == 2) & (height[row] > CROWN) & (height[row + 1] < GROUND)
    if returns.time is not None:
        both &= returns.time[row] == returns.time[row + 1]
    row = row[both]
    return returns.intensity[row], returns.intensity[row + 1]


def singles(returns: CloudReturns, height: np.ndarray) -> tuple[float, float]:
    """Median intensities of single returns of crowns, and of the ground."""
    alone = returns.count == 1
    crown, ground = alone & (height > CROWN), alone & (height < GROUND)
    return float(np.median(returns.intensity[crown])), float(np.median(returns.intensity[ground]))


def reflectances(
    returns: CloudReturns, height: np.ndarray, scale: IntensityScale, zenith: float
) -> tuple[float, float]:
    """Reflectance of leaves, inclined like a sphere's, and of level ground, of beams at ``zenith`` degrees.

    What leaves that fill a beam send back is two thirds of what a facing plate would.
    """
    crown, ground = scale.reflectance(np.array(singles(returns, height)))
    return float(crown / SPHERICAL), float(ground / np.cos(np.deg2rad(zenith)))


def threshold(
    returns: CloudReturns, line: np.ndarray, far: np.ndarray, scale: IntensityScale
) -> float:
    """Light, 1/m², of the faintest twentieth of the echoes of several of a pulse: the median of the lines.

    line, far : (N,) number of its line and range, m; inf where it is not known. What lies at the lower end
    of the scale is not counted.
    """
    light = scale.reflectance(returns.intensity) / far**2
    several = (returns.count > 1) & (returns.intensity > 0)
    seen = [
        float(np.quantile(light[several & (line == number)], FAINTEST))
        for number in np.unique(line).tolist()
        if np.isfinite(far[line == number]).all()
    ]
    return float(np.median(seen))


# Trees of a plot as its own clouds tell them: places, heights, crowns and leaf area.
#
# Summits of the canopy are trees; what is nearer to one than to another, and at least half as high, is
# its crown, and the width that of a circle of the same area. The crown's base is where layers of half a
# metre that hold a hundredth of its returns begin without a break to the top (Holmgren & Persson 2004,
# Remote Sens. Environ. 90, 415). Leaf area is that of Beer's law for the light that reaches the ground
# below the crown, L = -2 cos(θ) ln(P), less the wood, over the clumping of the species' shoots.


ALLOMETRY = "pinus-sylvestris"  # whose heights and diameters go together
CELL = 0.5  # m
LOW = 0.5  # of a tree's height, above which the canopy near it is its crown
LAYER, RARE, SMOOTH = 0.5, 0.01, 9  # m; share of a crown's returns; layers of the median filter
HELD_BY_WOOD = 0.15  # of all that a crown holds back: assumed
DARKEST = 0.01  # share of light that is told from none
TRIES = 2000  # places in a crown that tell how much of it lies on the plot
BARE = 1.0  # m over the ground, below which a return is the ground's
MOST_BASE = 0.9  # of the height


def trees_of(
    dense: CloudReturns,
    upright: CloudReturns,
    zenith: float,
    species: str,
    low: np.ndarray,
    floor: np.ndarray,
) -> np.ndarray:
    """(N, 7) x, y, DBH, height, width and base of the crown, m, and leaf area, m².

    dense : of the returns that heights and crowns are read from; floor : (P,) m of the ground below these.
    upright : of pulses that came down at ``zenith`` degrees in the mean, which tell leaf area. low : (2,)
    corner of the plot. Diameters are those that Scots pines of such heights have.
    """
    place = dense.place[:, :2] - low[:2]
    height = dense.place[:, 2] - floor
    top = tops_of(np.column_stack([place, height]), height)
    crown = _crowns(place, height, top)
    of_return = _at(crown, place)
    many = len(top)
    area = CELL**2 * np.bincount(crown[crown >= 0], minlength=many)
    area = area / _on_plot(top, area, np.ptp(place, axis=0))
    base = [_base(height[of_return == k]) for k in range(many)]
    beam = _at(crown, upright.place[:, :2] - low[:2])
    light = 1 / np.maximum(upright.count, 1)
    seen = beam >= 0
    ground = seen & (upright.heights() < BARE)
    passed = np.bincount(beam[ground], light[ground], many)
    passed = passed / np.maximum(np.bincount(beam[seen], light[seen], many), 1e-9)
    index = -2 * np.cos(np.deg2rad(zenith)) * np.log(np.clip(passed, DARKEST, 1))
    leaves = (1 - HELD_BY_WOOD) * index * area / clumping_of(species)
    law = read_allometry(ALLOMETRY, Path())
    dbh = np.linspace(0.05, 1.0, 400)
    return np.column_stack(
        [
            top[:, :2],
            np.interp(top[:, 2], np.exp(middle(law.height, dbh)), dbh),
            top[:, 2],
            2 * np.sqrt(area / np.pi),
            np.minimum(base, MOST_BASE * top[:, 2]),
            np.maximum(leaves, 0.1),
        ]
    )


def most_leaves(dbh: np.ndarray) -> np.ndarray:
    """(N,) m² of leaves that trees of these diameters (N,) may be asked for."""
    kind = read_allometry(ALLOMETRY, Path())
    return np.asarray(0.999 * MOST_TIMES * band(kind, dbh)[1, :, 3])


def clumping_of(species: str) -> float:
    """Mean shadow of a species' shoots over that of their needles apart; 1 of leaves."""
    found, _ = load_species(find_species(species, Path()))
    if found.needles is None:
        return 1.0
    return shoot_of(found.needles, found.leaf.length.mean).clumping


def _crowns(place: np.ndarray, height: np.ndarray, top: np.ndarray) -> np.ndarray:
    """Tree of each cell of half a metre, -1 where there is none."""
    cell = np.floor(place / CELL).astype(int)
    canopy = np.zeros(cell.max(axis=0) + 1)
    np.maximum.at(canopy, tuple(cell.T), height)
    middle_of = (np.argwhere(canopy >= 0) + 0.5) * CELL
    near = cKDTree(top[:, :2]).query(middle_of)[1]
    inside = canopy.ravel() > np.maximum(LOW * top[near, 2], 2.0)
    return np.where(inside, near, -1).reshape(canopy.shape)


def _at(crown: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(P,) tree whose crown is over places (P, 2), -1 where none is."""
    cell = np.floor(place / CELL).astype(int)
    inside = ((cell >= 0) & (cell < crown.shape)).all(axis=1)
    tree_at = np.full(len(place), -1)
    tree_at[inside] = crown[tuple(cell[inside].T)]
    return tree_at


def _on_plot(top: np.ndarray, area: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(N,) share of each crown, a disc about its summit, that lies on the plot of this size (2,)."""
    k = np.arange(TRIES) + 0.5
    out, turn = np.sqrt(k / TRIES), np.pi * (3 - np.sqrt(5)) * k
    disc = np.column_stack([out * np.cos(turn), out * np.sin(turn)])
    share = np.ones(len(top))
    for _ in range(6):
        radius = np.sqrt(area / share / np.pi)
        spot = top[:, None, :2] + radius[:, None, None] * disc
        share = np.maximum(((spot >= 0) & (spot <= size)).all(axis=2).mean(axis=1), 0.2)
    return share


def _base(height: np.ndarray) -> float:
    """Height of the lowest return of a crown above the highest gap between its layers, m."""
    some = height[height > BARE]
    if not len(some):
        return 0.0
    count = np.bincount((some / LAYER).astype(int))
    full = median_filter((count >= RARE * count.sum()).astype(int), SMOOTH)
    gaps = np.flatnonzero(full[: full.nonzero()[0].max(initial=0)] == 0)
    lowest = (gaps.max(initial=-1) + 1) * LAYER
    return float(some[some >= lowest].min())


# Flight lines of two real clouds over one plot of conifers, each flown again over a stand of ours.
#
# Trees stand where the drone's cloud has its summits, with heights, crowns and leaf area as the clouds
# tell them (``crowns``); around the plot the same stand goes on. Way, height and fan of each line are
# read from the cloud's own pulses (``surveys``), reflectances and the threshold of detection from its
# intensities (``light``). Leaves reflect as much, and are as many, as makes single echoes of ours as
# bright and passes as much light to the ground as the clouds show. Beams are assumed as typical of such
# instruments. Shares of returns are not looked at for any of that. A line is judged by the mean of four
# stands of other seeds.
#
# The drone's slanted lines hold plants alone: whoever made the file took the ground out of them. Of such
# a line pulses are compared whose first return is a plant's, in ours as in the real one.


SPECIES = "ponderosa-pine"
WOOD, SOIL = 0.4, 0.3  # reflectances; the ground's where intensities have no scale
NEAR = 0.05  # of a share, that counts as the same, of the mean of the stands
STANDS = 4  # of the same trees, that differ by their seeds
AROUND = 3  # copies of the plot to each side: beams at 68 degrees come from 62 m away
STEEP = 40.0  # degrees: lines nearer to the nadir tell reflectances
NO_GROUND = 0.001  # share of first returns on the ground, below which a line has none
MOST, FEW = (
    1500,
    2000,
)  # pulses of a line that are flown again, and to tell its light; of more, so many
RANGE = 1.3  # times the farthest return
ROUNDS, CLOSE = 8, 0.04  # of growing the stand until its light is as near to the cloud's
FIRST = 3.0  # leaf area over Beer's law's, that the stand begins with
SHADED = 1.5  # power of the leaf area that is missing: leaves that are added shade each other


@dataclass(frozen=True)
class FlightOfCloud:
    """Name and file of a cloud, the beam that is assumed of its instrument, and the scale of its intensities
    where the file tells it."""

    name: str
    file: str
    beam: Beam
    scale: IntensityScale | None = None


FLIGHTS = (
    FlightOfCloud(
        "drone",
        "spanner_UAS.laz",
        Beam(
            divergence_mrad=(0.5, 0.5),
            exit_diameter=0.0045,
            subrays=61,
            pulse_ns=3.0,
            max_returns=5,
        ),
        IntensityScale(-20.0, 0.0),  # steps of 0.01 of 20 dB
    ),
    FlightOfCloud(
        "aircraft",
        "spanner_ALS.laz",
        Beam(divergence_mrad=(0.25, 0.25), subrays=61, pulse_ns=4.0, max_returns=7),
    ),
)


@dataclass(frozen=True)
class ReadFlight:
    """A cloud as it was read: its returns, lines by number, ranges (N,) m (inf where they are not known),
    angles off nadir (N,) degrees, heights (N,) m over the ground."""

    flight: FlightOfCloud
    cloud: FlownCloud
    returns: CloudReturns
    lines: dict[int, FlightLine]
    far: np.ndarray
    angle: np.ndarray
    height: np.ndarray

    @property
    def steep(self) -> np.ndarray:
        """(N,) returns of lines near the nadir."""
        return self.angle < STEEP


def read_flight(flight: FlightOfCloud, folder: Path) -> ReadFlight:
    """A cloud of a folder, its lines, ranges and heights."""
    cloud, returns = read_flown(folder / flight.file), read_cloud(folder / flight.file)
    lines = lines_of(cloud.place, cloud.time, cloud.number, cloud.count, cloud.line)
    far, angle = np.full(len(cloud.time), np.inf), np.full(len(cloud.time), np.inf)
    for number, line in lines.items():
        rows = cloud.line == number
        away = line.at(cloud.time[rows]) - cloud.place[rows]
        far[rows] = np.linalg.norm(away, axis=1)
        angle[rows] = np.degrees(np.arccos(np.clip(away[:, 2] / far[rows], -1, 1)))
    return ReadFlight(flight, cloud, returns, lines, far, angle, returns.heights())


def compare_flights(clouds: Path, seed: int, species: str = SPECIES) -> list[Comparison]:
    """Share of single returns, line by line, measured and flown again over ``STANDS`` stands."""
    drone, aircraft = (read_flight(flight, clouds) for flight in FLIGHTS)
    aircraft = scaled_like(aircraft, drone)
    again = [flown_again(drone, aircraft, species, seed + stand) for stand in range(STANDS)]
    return [
        row
        for read, of_stands in zip((drone, aircraft), zip(*again, strict=True), strict=True)
        for row in _rows(read, of_stands, seed)
    ]


def flown_again(
    dense: ReadFlight, upright: ReadFlight, species: str, seed: int
) -> list[tuple[Mobile, dict[int, np.ndarray]]]:
    """Fly both flights' scanners over a stand; the returns of the pulses that count (P,), by line."""
    caster, low, scanners = stand_and_scanners(dense, upright, species, seed)
    return [
        (plain, _lines_again(read, plain, caster, low, seed))
        for read, plain in zip((dense, upright), scanners, strict=True)
    ]


def scaled_like(read: ReadFlight, known: ReadFlight) -> ReadFlight:
    """A flight with the scale that makes the light of two of its returns sum to that of a known scale."""
    two, height = known.returns.take(known.steep), known.height[known.steep]
    span = known.flight.scale.high - known.flight.scale.low
    total = _sum_of(*_shared(two, height), singles(two, height), span)
    some = read.returns.take(read.steep)
    scale = scale_of(some, read.height[read.steep], SOIL, total)
    return replace(read, flight=replace(read.flight, scale=scale))


def stand_and_scanners(
    dense: ReadFlight, upright: ReadFlight, species: str, seed: int
) -> tuple[RayCaster, np.ndarray, list[Mobile]]:
    """The stand of a plot's trees, (3,) where its corner lies, and scanners of both flights.

    Beer's law knows shoots that are spread evenly; those of crowns stand together, which lets more light pass
    and leaves single echoes less than whole. Leaf area and reflectances follow until the line of ``upright``
    that is nearest to the nadir passes as much to the ground as its cloud shows, within ``CLOSE``.
    """
    more, scanners = FIRST, [scanner_of(dense), scanner_of(upright)]
    for _ in range(ROUNDS):
        scene, low = plot_like(dense, upright, species, seed, more)
        caster = make_caster(scene, Rays())
        scanners[0] = as_bright(dense, _upright(dense, scanners[0], caster, low, seed), scanners[0])
        ours = _upright(upright, scanners[1], caster, low, seed)
        scanners[1] = as_bright(upright, ours, scanners[1])
        short = leaves_missing(upright, ours)
        if abs(short - 1) <= CLOSE:
            break
        more *= short**SHADED
    return caster, low, scanners


def plot_like(
    dense: ReadFlight, upright: ReadFlight, species: str, seed: int, more: float = 1.0
) -> tuple[SceneGeometry, np.ndarray]:
    """The stand of a plot's trees, and (3,) where its corner lies in the clouds' numbers.

    dense, upright : clouds that tell the crowns, and what light passes them. more : leaf area over that.
    """
    real = dense.returns.place
    low = real.min(axis=0)
    floor = ground_below(real - low)
    zenith = float(np.mean(upright.angle[upright.steep]))
    trees = trees_of(dense.returns, upright.returns, zenith, species, low, floor + low[2])
    trees[:, 6] = np.minimum(more * trees[:, 6], most_leaves(trees[:, 2]))
    size = np.ptp(real[:, :2], axis=0)
    near = range(-AROUND, AROUND + 1)
    shifts = [np.array([i, j]) * size for i in near for j in near]
    site = site_of(trees, species, seed)
    whole = geometry_of(site, site.grow())
    return _repeated(whole, shifts), low + np.array([0.0, 0.0, float(np.median(floor))])


def _repeated(scene: SceneGeometry, shifts: list[np.ndarray]) -> SceneGeometry:
    """The scene with its trees at each shift (2,); one ground, made wide."""
    trees = np.flatnonzero(scene.tree >= 0)
    ground = np.flatnonzero(scene.tree < 0)
    rows = np.concatenate([*([trees] * len(shifts)), ground])
    transform = scene.transform[rows].copy()
    for number, shift in enumerate(shifts):
        transform[number * len(trees) : (number + 1) * len(trees), :2, 3] += shift
    transform[-len(ground) :, :2, :2] *= 50.0
    return SceneGeometry(
        meshes=scene.meshes,
        transform=transform,
        mesh_index=scene.mesh_index[rows],
        object_name=tuple(scene.object_name[scene.object_index[row]] for row in rows.tolist()),
        tree=scene.tree[rows],
        species=scene.species[rows],
    )


def scanner_of(read: ReadFlight) -> Mobile:
    """A scanner of a flight's beam that sees the reflectances that its own returns say."""
    some, height = read.returns.take(read.steep), read.height[read.steep]
    leaf, ground = reflectances(
        some, height, read.flight.scale, float(np.mean(read.angle[read.steep]))
    )
    surfaces = Surfaces(wood=WOOD, leaf=min(leaf, 1.0), ground=min(ground, 1.0))
    return Mobile(min_range=1.0, surfaces=surfaces, beam=read.flight.beam)


def _nearest_nadir(read: ReadFlight) -> int:
    """Number of the line that is nearest to the nadir."""
    line = read.cloud.line
    return min(read.lines, key=lambda k: float(np.median(read.angle[line == k])))


def _upright(
    read: ReadFlight, plain: Mobile, caster: RayCaster, low: np.ndarray, seed: int
) -> tuple[Cloud, np.ndarray]:
    """The line that is nearest to the nadir, flown again, and (N,) which returns lie on the plot."""
    ours = _flown(read, _nearest_nadir(read), plain, caster, low, seed, FEW)
    return ours, _inside(ours, read)


def leaves_missing(read: ReadFlight, flown: tuple[Cloud, np.ndarray]) -> float:
    """Leaf area that a stand needs over what it has to let as much light to the ground as a cloud shows.

    flown : the line that is nearest to the nadir, over the stand, and (N,) which of it lie on the plot.
    """
    cloud, (ours, inside) = read.cloud, flown
    real = cloud.line == _nearest_nadir(read)
    passed = [
        float(light[height < BARE].sum() / light.sum())
        for light, height in (
            (1 / cloud.count[real], read.height[real]),
            (1 / ours.count[inside], ours.position[inside, 2]),
        )
    ]
    return float(np.log(passed[0]) / np.log(passed[1]))


def as_bright(read: ReadFlight, flown: tuple[Cloud, np.ndarray], plain: Mobile) -> Mobile:
    """A scanner whose single echoes of crowns and of the ground are as bright in the median as a cloud's.

    flown : the line that is nearest to the nadir, seen by ``plain``, and (N,) which of it lie on the plot.
    """
    cloud, (ours, inside) = read.cloud, flown
    real = (cloud.line == _nearest_nadir(read)) & (cloud.count == 1)
    single = inside & (ours.count == 1)
    light = read.flight.scale.reflectance(read.returns.intensity)
    own = ours.intensity * ours.true_range**2
    z = ours.position[:, 2]
    leaf = np.median(light[real & (read.height > CROWN)]) / np.median(own[single & (z > CROWN)])
    ground = np.median(light[real & (read.height < GROUND)]) / np.median(own[single & (z < GROUND)])
    seen = plain.surfaces
    return plain.changed(
        surfaces=seen.changed(
            leaf=min(float(seen.leaf * leaf), 1.0), ground=min(float(seen.ground * ground), 1.0)
        )
    )


def _inside(ours: Cloud, read: ReadFlight) -> np.ndarray:
    """(N,) returns of ours on the plot."""
    place = ours.position[:, :2]
    size = np.ptp(read.cloud.place[:, :2], axis=0)
    return np.asarray(((place >= 0) & (place <= size)).all(axis=1))


def faintest_of(read: ReadFlight) -> float:
    """Light, 1/m², of the faintest echo that a flight's receiver tells."""
    return threshold(read.returns, read.cloud.line, read.far, read.flight.scale)


def _flown(
    read: ReadFlight,
    number: int,
    plain: Mobile,
    caster: RayCaster,
    low: np.ndarray,
    seed: int,
    most: int = MOST,
) -> Cloud:
    """A line flown again.

    Raises
    ------
    SpecError : too few sweeps tell how it was flown.
    """
    line = read.lines[number]
    rows = (read.cloud.line == number) & (read.cloud.number == 1)
    pattern = pattern_like(
        line, *(c[rows] for c in (read.cloud.place, read.cloud.time, read.cloud.angle))
    )
    farthest = RANGE * float(read.far[rows].max())
    faint = min(faintest_of(read) * farthest**2, 1.0)
    limited = plain.changed(max_range=farthest, faintest=faint)
    like = scanner_like(limited, line, pattern, low)
    fewer = like.changed(pulse_rate=like.pulse_rate / max(1.0, rows.sum() / most))
    return scan(fewer, caster, seed)


def _lines_again(
    read: ReadFlight, plain: Mobile, caster: RayCaster, low: np.ndarray, seed: int
) -> dict[int, np.ndarray]:
    """Returns of each pulse that counts (P,), of the lines that are long enough to tell their pattern."""
    returns_of = {}
    for number in read.lines:
        try:
            ours = _flown(read, number, plain, caster, low, seed)
        except SpecError:
            continue
        first = _inside(ours, read) & (ours.number == 1)
        if _has_no_ground(read, number):
            first &= ours.position[:, 2] >= BARE
        returns_of[number] = ours.count[first]
    return returns_of


def _has_no_ground(read: ReadFlight, number: int) -> bool:
    """Return whether the file holds nothing of the ground in a line."""
    rows = (read.cloud.line == number) & (read.cloud.number == 1)
    return bool((read.height[rows] < BARE).mean() < NO_GROUND)


def _rows(
    read: ReadFlight, of_stands: Sequence[tuple[Mobile, dict[int, np.ndarray]]], seed: int
) -> list[Comparison]:
    """Rows of the lines of a cloud that were flown again over several stands, each with its scanner."""
    cloud, halves = read.cloud, halves_apart(read.cloud, seed)
    flown = list(of_stands[0][1])
    found = [_row(read, k, [counts[k] for _, counts in of_stands], halves[k]) for k in flown]
    seen = [plain.surfaces for plain, _ in of_stands]
    leaf, ground = (100 * np.mean([getattr(s, part) for s in seen]) for part in ("leaf", "ground"))
    words = f" Leaves reflect {leaf:.0f} %, the ground {ground:.0f} %."
    unread = []
    for number in set(read.lines) - set(flown):
        alone = shares_of(cloud.count[(cloud.line == number) & (cloud.number == 1)])[0]
        unread.append(f"{number} ({100 * alone:.0f} % single)")
    if unread:
        words = f" Too few sweeps tell how line {', '.join(unread)} was flown: left out." + words
    if found:
        found[0] = replace(found[0], words=found[0].words + words)
    return found


def _row(read: ReadFlight, number: int, counts: list[np.ndarray], half: float) -> Comparison:
    """Single returns of a line beside those of ours, the mean and range of stands.

    counts : returns of pulses (P,) of each stand. half : how far apart the line's halves are, as a share.
    """
    cloud = read.cloud
    rows = (cloud.line == number) & (cloud.number == 1)
    bare = _has_no_ground(read, number)
    if bare:
        rows &= read.height >= BARE
    real, stands = shares_of(cloud.count[rows]), np.array([shares_of(some) for some in counts])
    mine, single = stands.mean(axis=0), 100 * stands[:, 0]
    far = float(np.median(read.far[rows]))
    only = " Pulses that meet a plant first: the file has no ground in this line." if bare else ""
    return Comparison(
        f"{read.flight.name}, single returns at {np.median(read.angle[rows]):.0f}° (line {number})",
        "%",
        Interval(100 * real[0], *(100 * (real[0] + np.array([-1, 1]) * half))),
        Interval(100 * mine[0], float(single.min()), float(single.max())),
        bool(abs(real[0] - mine[0]) <= NEAR),
        words=f"2, 3 and 4 returns: measured {_said(real)} %, ours {_said(mine)} %; {rows.sum():,} and "
        f"{sum(map(len, counts)):,} pulses; threshold {100 * faintest_of(read) * far**2:.1f} % at "
        f"{far:,.0f} m.{only}",
    )


def _said(shares: np.ndarray) -> str:
    return ", ".join(f"{100 * share:.1f}" for share in shares[1:])
