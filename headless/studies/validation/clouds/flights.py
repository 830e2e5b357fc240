"""FlightOfCloud lines of two real clouds over one plot of conifers, each flown again over a stand of ours.

Trees stand where the drone's cloud has its summits, as high as these, with the diameters that pines of these
heights have; around the plot the same stand goes on. Way, height and fan of each line are read from the
cloud's own pulses (``surveys``). The instruments are assumed as typical of their kind. The threshold is read
from each cloud: the light of the faintest twentieth of what came back in pulses of several returns, its
intensities taken for reflectances from -20 to 0 dB; the median of the lines. Nothing else follows the clouds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.blender.rays.casters import make_caster
from forest_addon.growth.library.allometry_file import read_allometry
from forest_addon.growth.measured.allometry import middle
from forest_addon.sensing.lidar.scan import scan
from forest_addon.sensing.lidar.surveys.flown import lines_of
from forest_addon.sensing.lidar.surveys.like import pattern_like, scanner_like
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.spec import Beam, Mobile, Rays, SpecError, Surfaces

from ....commands.work.like import FlownCloud, read_flown
from ..comparison import Comparison, Interval
from ..living import geometry_of, site_of, tops_of
from ..own_cloud import CloudReturns, read_cloud
from .yardstick import ground_below

SPECIES = "ponderosa-pine"
SURFACES = Surfaces(wood=0.4, leaf=0.35, ground=0.3)
NEAR = 0.05  # of a share, that counts as the same
FAINTEST = 0.05  # share of the echoes that are taken for the threshold
AROUND = 1  # copies of the plot to each side
SCALE = (
    -20.0,
    0.0,
)  # dB of reflectance at the ends of the intensities: the drone's step by 0.01 of 20 dB
BLOCK, HALVES = 5.0, 40  # metres, and halvings of a line's blocks
RANGE = 1.3  # times the farthest return


@dataclass(frozen=True)
class FlightOfCloud:
    """Name and file of a cloud, and the beam that is assumed of its instrument."""

    name: str
    file: str
    beam: Beam


FLIGHTS = (
    FlightOfCloud(
        "drone",
        "spanner_UAS.laz",
        Beam(
            divergence_mrad=(0.5, 0.5),
            exit_diameter=0.0045,
            subrays=19,
            pulse_ns=3.0,
            max_returns=5,
        ),
    ),
    FlightOfCloud(
        "aircraft",
        "spanner_ALS.laz",
        Beam(divergence_mrad=(0.25, 0.25), subrays=19, pulse_ns=4.0, max_returns=7),
    ),
)


def compare_flights(clouds: Path, seed: int, species: str = SPECIES) -> list[Comparison]:
    """Share of single returns, line by line, measured and flown again."""
    scene, low = plot_like(clouds / FLIGHTS[0].file, species, seed)
    found = []
    for flight in FLIGHTS:
        found += _lines(flight, clouds / flight.file, scene, low, seed)
    return found


def plot_like(file: Path, species: str, seed: int) -> tuple[SceneGeometry, np.ndarray]:
    """The stand in the places of a cloud's summits, and (3,) where its corner lies in the cloud's numbers."""
    real = read_cloud(file).place
    low = real.min(axis=0)
    place = real - low
    floor = ground_below(place)
    tops = tops_of(place, place[:, 2] - floor)
    law = read_allometry("pinus-sylvestris", Path())
    dbh = np.linspace(0.05, 1.0, 400)
    stems = np.column_stack(
        [tops[:, :2], np.interp(tops[:, 2], np.exp(middle(law.height, dbh)), dbh), tops[:, 2]]
    )
    size = np.ptp(place[:, :2], axis=0)
    near = range(-AROUND, AROUND + 1)
    shifts = [np.array([i, j]) * size for i in near for j in near]
    site = site_of(stems, species, seed)
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


def threshold(
    returns: CloudReturns, line: np.ndarray, far: np.ndarray, scale: tuple[float, float]
) -> float:
    """Light, 1/m², of the faintest twentieth of the echoes of several of a pulse: the median of the lines.

    line, far : (N,) number of its line and range, m; inf where it is not known. scale : dB of reflectance
        that an intensity of 0 and one of 65535 stand for; what lies at its lower end is not counted.
    """
    span = scale[1] - scale[0]
    light = 10 ** ((scale[0] + span * returns.intensity / 65535) / 10) / far**2
    several = (returns.count > 1) & (returns.intensity > 0)
    seen = [
        float(np.quantile(light[several & (line == number)], FAINTEST))
        for number in np.unique(line).tolist()
        if np.isfinite(far[line == number]).all()
    ]
    return float(np.median(seen))


def _lines(
    flight: FlightOfCloud, file: Path, scene: SceneGeometry, low: np.ndarray, seed: int
) -> list[Comparison]:
    """Rows of the lines of a cloud that are long enough to tell their pattern."""
    cloud, returns = read_flown(file), read_cloud(file)
    lines = lines_of(cloud.place, cloud.time, cloud.number, cloud.count, cloud.line)
    far = np.full(len(cloud.time), np.inf)
    for number, line in lines.items():
        rows = cloud.line == number
        far[rows] = np.linalg.norm(cloud.place[rows] - line.at(cloud.time[rows]), axis=1)
    faint = threshold(returns, cloud.line, far, SCALE)
    caster, found = make_caster(scene, Rays()), []
    unread: list[str] = []  # lines with too few sweeps to tell how they were flown
    size = np.ptp(cloud.place[:, :2], axis=0)
    halves = halves_apart(cloud, seed)
    for number, line in lines.items():
        rows = (cloud.line == number) & (cloud.number == 1)
        try:
            pattern = pattern_like(line, cloud.place[rows], cloud.time[rows])
        except SpecError:
            unread.append(f"{number} ({100 * shares_of(cloud.count[rows])[0]:.0f} % single)")
            continue
        farthest = RANGE * float(far[rows].max())
        plain = Mobile(
            min_range=1.0,
            max_range=farthest,
            faintest=min(faint * farthest**2, 1.0),
            surfaces=SURFACES,
            beam=flight.beam,
        )
        ours = scan(scanner_like(plain, line, pattern, low, line.time[0]), caster, seed)
        place = ours.position[:, :2]
        first = ((place >= 0) & (place <= size)).all(axis=1) & (ours.number == 1)
        away = line.at(cloud.time[rows]) - cloud.place[rows]
        angle = float(np.degrees(np.median(np.arccos(away[:, 2] / far[rows]))))
        real, mine = (shares_of(count) for count in (cloud.count[rows], ours.count[first]))
        limit = 100 * faint * float(np.median(far[rows])) ** 2
        found.append(
            Comparison(
                f"{flight.name}, single returns at {angle:.0f}° (line {number})",
                "%",
                Interval(100 * real[0], *(100 * (real[0] + np.array([-1, 1]) * halves[number]))),
                Interval(100 * mine[0]),
                bool(abs(real[0] - mine[0]) <= NEAR),
                words=f"2, 3 and 4 returns: measured {_said(real)} %, ours {_said(mine)} %; {rows.sum():,} "
                f"and {first.sum():,} pulses; threshold {limit:.1f} % at {np.median(far[rows]):,.0f} m.",
            )
        )
    if unread and found:
        words = f" Too few sweeps tell how line {', '.join(unread)} was flown: left out."
        found[0] = replace(found[0], words=found[0].words + words)
    return found


def shares_of(count: np.ndarray) -> np.ndarray:
    """(4,) shares of pulses (P,) with 1, 2, 3 and 4 returns."""
    shares: np.ndarray = np.bincount(np.minimum(count, 5), minlength=6)[1:5] / max(len(count), 1)
    return shares


def halves_apart(cloud: FlownCloud, seed: int) -> dict[int, float]:
    """Of each line, how far apart the shares of single returns of random halves of its blocks are: the 95th
    percentile, as a share."""
    rng, found = stream(seed, "validate", "halves of lines"), {}
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
        found[number] = float(np.quantile(apart or [0.0], 0.95))
    return found


def _said(shares: np.ndarray) -> str:
    return ", ".join(f"{100 * share:.1f}" for share in shares[1:])
