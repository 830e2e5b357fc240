"""Returns of a pulse and heights of returns: a measured plot of conifers, and ours like it.

Our stand has 400 stems/ha of the preset honda-conifer, 22 to 31 m high, on level ground 90 m wide; the
middle of it is looked at from above. *Before*, trees are the preset stretched to that height, leaves down
to the ground; then crowns begin at 0.56 of the height, as BAAD's evergreen conifers of its diameter have
them. Leaf area is varied by taking leaves away, which gives an interval; nothing is fitted to the clouds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.blender.rays.casters import make_caster
from forest_addon.formats.las import read_las
from forest_addon.sensing.lidar.cloud import Cloud
from forest_addon.sensing.lidar.scan import Scan, join
from forest_addon.spec import Airborne, Beam, Rays, Surfaces

from ...report.pictures import FAINT, INK, LEAF_GREEN, blank_figure, save_figure
from .comparison import Comparison, Interval, Picture
from .woods import grown, with_leaves, with_smaller_leaves, wood

STEMS_PER_HA, WIDE, PLOT = 400, 90.0, 15.0  # m: half the plot that is looked at
HEIGHTS = (22.0, 31.0)
CROWN_BASE = 0.56  # of the height
SHARES = (1.0, 0.3, 0.1)  # of the preset's leaves: leaf areas are said in the picture
MOST = 4  # returns that are told apart
NEAR = 0.05  # of a share that counts as the same
PULSES = 5000
SURFACES = Surfaces(wood=0.4, leaf=0.35, ground=0.3)


@dataclass(frozen=True)
class Instrument:
    """One of the measured clouds, and a scanner that is typical of its kind."""

    name: str
    file: str
    scanner: Airborne


INSTRUMENTS = (
    Instrument(
        "drone",
        "spanner_UAS.laz",
        Airborne(
            name="drone",
            position=(0.0, -20.0, 100.0),
            field_deg=(-30.0, 30.0),
            max_range=300.0,
            min_range=3.0,
            faintest=0.6,
            surfaces=SURFACES,
            beam=Beam(
                divergence_mrad=(0.5, 0.5),
                exit_diameter=0.0045,
                subrays=19,
                pulse_ns=3.0,
                max_returns=5,
            ),
        ),
    ),
    Instrument(
        "aircraft",
        "spanner_ALS.laz",
        Airborne(
            name="aircraft",
            position=(0.0, -20.0, 1200.0),
            field_deg=(-2.0, 2.0),
            max_range=2500.0,
            min_range=100.0,
            faintest=0.2,
            surfaces=SURFACES,
            beam=Beam(divergence_mrad=(0.25, 0.25), subrays=19, pulse_ns=4.0, max_returns=7),
        ),
    ),
)


def compare_plots(clouds: Path, out: Path, seed: int) -> list[Comparison]:
    """Shares of pulses with 1 to 4 returns and the heights of returns, for drone and aircraft."""
    meshes = [tree.mesh for tree in grown("honda-conifer", 2, seed)]
    tall = [float(mesh.vertices[:, 2].max()) for mesh in meshes]
    area = _leaf_area(seed, tall)
    found, drawn = [], []
    for instrument in INSTRUMENTS:
        measured = read_returns(clouds / instrument.file)
        tried = {
            share: look_at(_stand(meshes, tall, share, seed), instrument.scanner, seed)
            for share in SHARES
        }
        apart = {s: np.abs(counts(c) - counts(measured)).max() for s, c in tried.items()}
        best = min(apart, key=lambda share: apart[share])
        drawn.append((instrument, measured, tried, best))
        plain = look_at(_stand(meshes, tall, best, seed, 0.0), instrument.scanner, seed)
        found += _rows(instrument, measured, tried, best, area, plain)
        found.append(_sensitivity(instrument, meshes, tall, tried[best], best, seed))
    picture = Picture(
        _draw(drawn, out / "plots.png", area),
        "Left: pulses by their number of returns, measured and ours by leaf area (m² a m² of ground). Right: "
        "heights of all returns, as a share of the 99th percentile.",
    )
    return [*found[:-1], replace(found[-1], pictures=(picture,))]


@dataclass(frozen=True)
class Echoed:
    """Returns: number (N,) of its pulse's, how many that pulse had, height (N,) m, intensity (N,)."""

    number: np.ndarray
    count: np.ndarray
    height: np.ndarray
    intensity: np.ndarray


def read_returns(path: Path) -> Echoed:
    """Those of a LAS file; heights above its lowest thousandth, intensity as it stands.

    Raises
    ------
    SpecError : it is no LAS or LAZ file.
    """
    cloud = read_las(path)
    z = np.asarray(cloud.z, float)
    return Echoed(
        np.asarray(cloud.return_number),
        np.asarray(cloud.number_of_returns),
        z - np.quantile(z, 0.001),
        np.asarray(cloud.intensity, float),
    )


def counts(echoed: Echoed) -> np.ndarray:
    """(4,) shares of pulses with 1, 2, 3 and 4 returns, of those that had any."""
    first = echoed.count[echoed.number == 1]
    return np.bincount(np.minimum(first, 15), minlength=16)[1 : MOST + 1] / max(len(first), 1)


def faded(echoed: Echoed) -> float:
    """Mean intensity of first of several returns over that of single ones."""
    first = echoed.number == 1
    several, single = first & (echoed.count > 1), first & (echoed.count == 1)
    return float(echoed.intensity[several].mean() / echoed.intensity[single].mean())


def look_at(scene: object, scanner: Airborne, seed: int) -> Echoed:
    """Return what a scanner finds of the plot in the scene's middle."""
    half = np.deg2rad(scanner.field_deg[1])
    lines = int(np.sqrt(PULSES * scanner.position[2] * np.tan(half) / PLOT))
    track, speed = 40.0, 20.0
    rate = lines * speed / track
    scanner = scanner.changed(
        track=track, speed=speed, line_rate=rate, pulse_rate=rate * lines, heading_deg=90.0
    )
    scan = Scan(scanner, make_caster(scene, Rays()), seed)  # type: ignore[arg-type]
    return _within(join([piece for _, piece in scan.chunks()]))


def _stand(
    meshes: list, tall: list[float], share: float, seed: int, base: float = CROWN_BASE
) -> object:
    rng = stream(seed, "validate", "plot")
    count = int(STEMS_PER_HA * WIDE**2 / 1e4)
    foot = WIDE * (rng.random((count, 2)) - 0.5)
    height = rng.uniform(*HEIGHTS, count)
    up = (1 - base) * height / np.resize(tall, count)
    thinned = [with_leaves(mesh, share, rng) for mesh in meshes]
    return wood(thinned, foot, np.ones(count), up, seed, base * height if base else None)


def _leaf_area(seed: int, tall: list[float]) -> float:
    """Leaf area of all leaves, m² a m² of ground; a leaf is stretched with its tree."""
    trees = grown("honda-conifer", 2, seed)
    area = np.mean([np.pi * np.square(tree.leaves.radius).sum() for tree in trees])
    up = (1 - CROWN_BASE) * np.mean(HEIGHTS) / np.mean(tall)
    return float(area * np.sqrt((up**2 + 1) / 2) * STEMS_PER_HA / 1e4)


def _within(cloud: Cloud) -> Echoed:
    first = cloud.position[np.maximum(np.searchsorted(cloud.pulse, cloud.pulse), 0)]
    middle = (np.abs(first[:, :2]) < PLOT).all(axis=1)
    whole = _echoed(cloud)
    return Echoed(*(getattr(whole, name)[middle] for name in Echoed.__dataclass_fields__))


def _echoed(cloud: Cloud) -> Echoed:
    return Echoed(cloud.number, cloud.count, cloud.position[:, 2], cloud.intensity)


def _rows(
    instrument: Instrument,
    measured: Echoed,
    tried: dict[float, Echoed],
    best: float,
    area: float,
    plain: Echoed,
) -> list[Comparison]:
    name = instrument.name
    rows = []
    for number in range(MOST):
        mine = [float(counts(echoed)[number]) for echoed in tried.values()]
        row = _share(
            f"{name}, pulses with {number + 1} returns",
            float(counts(measured)[number]),
            mine,
            float(counts(tried[best])[number]),
            f"The value is at a leaf area of {best * area:.2g} m²/m², the interval from "
            f"{SHARES[-1] * area:.2g} to {area:.2g}; instruments are assumed. Shares agree within 5 points, "
            "which small ones do easily."
            if not number
            else "",
        )
        rows.append(replace(row, before=Interval(100 * float(counts(plain)[number]))))
    middle = _height(name, measured, list(tried.values()), tried[best])
    was = float(np.median(plain.height) / np.quantile(plain.height, 0.99))
    rows.append(replace(middle, before=Interval(was)))
    rows.append(
        Comparison(
            f"{name}, first of several returns over single ones, intensity",
            "",
            Interval(faded(measured)),
            _spanned(faded(tried[best]), [faded(echoed) for echoed in tried.values()]),
            None,
            words="Measured in an instrument's own numbers, so not judged."
            if name == "drone"
            else "",
        )
    )
    return rows


def _share(
    what: str, measured: float, mine: list[float], value: float, words: str = ""
) -> Comparison:
    agrees = abs(value - measured) <= NEAR
    return Comparison(
        *(what, "%", Interval(100 * measured), _spanned(100 * value, [100 * m for m in mine])),
        agrees,
        words=words,
    )


def _height(name: str, measured: Echoed, tried: list[Echoed], best: Echoed) -> Comparison:
    middle = [
        float(np.median(echoed.height) / np.quantile(echoed.height, 0.99))
        for echoed in (measured, best, *tried)
    ]
    return Comparison(
        f"{name}, median height of returns over the 99th percentile",
        "",
        Interval(middle[0]),
        _spanned(middle[1], middle[2:]),
        abs(middle[1] - middle[0]) <= 2 * NEAR,
        words="Within 0.1. The measured plot slopes and is not levelled, ours is level; where half the "
        "returns are of the ground, the median is there."
        if name == "drone"
        else "",
    )


def _spanned(value: float, values: list[float]) -> Interval:
    return Interval(value, min(value, *values), max(value, *values))


def _sensitivity(
    instrument: Instrument,
    meshes: list,
    tall: list[float],
    plain: Echoed,
    share: float,
    seed: int,
) -> Comparison:
    """Share of single returns with twice and half the footprint, and twice and half the pulse."""
    beam, scene = instrument.scanner.beam, _stand(meshes, tall, share, seed)
    changes = {
        "footprint x 2": replace(beam, divergence_mrad=tuple(2 * d for d in beam.divergence_mrad)),
        "footprint x 4": replace(beam, divergence_mrad=tuple(4 * d for d in beam.divergence_mrad)),
        "pulse / 2": replace(beam, pulse_ns=beam.pulse_ns / 2),
        "pulse x 2": replace(beam, pulse_ns=2 * beam.pulse_ns),
    }
    single = {
        name: 100 * float(counts(look_at(scene, instrument.scanner.changed(beam=b), seed))[0])
        for name, b in changes.items()
    }
    said = ", ".join(f"{name} {value:.0f} %" for name, value in single.items())
    now = 100 * float(counts(plain)[0])
    small = [with_smaller_leaves(mesh, 0.5) for mesh in meshes]
    same = [
        100 * float(counts(look_at(_stand(m, tall, s, seed), instrument.scanner, seed))[0])
        for m, s in ((meshes, 0.25), (small, 1.0))
    ]
    return Comparison(
        f"{instrument.name}, single returns by footprint and pulse",
        "%",
        None,
        _spanned(now, list(single.values())),
        None,
        words=f"As assumed {now:.0f} %; {said}. Of a quarter of the leaf area, with "
        f"leaves of 12 cm {same[0]:.0f} %, with four times as many of 6 cm {same[1]:.0f} %.",
    )


def _draw(
    drawn: list[tuple[Instrument, Echoed, dict[float, Echoed], float]], path: Path, area: float
) -> Path:
    figure = blank_figure((11, 5.6))
    for row, (instrument, measured, tried, best) in enumerate(drawn):
        bars, profile = (figure.add_subplot(2, 2, 2 * row + k) for k in (1, 2))
        place = np.arange(1, MOST + 1)
        bars.bar(place - 0.3, 100 * counts(measured), 0.2, color=INK, label="measured")
        edges = np.linspace(0, 1.1, 23)
        for number, (share, echoed) in enumerate({-1.0: measured, **tried}.items()):
            high = echoed.height / np.quantile(echoed.height, 0.99)
            heights = np.histogram(high, edges)[0] / len(high)
            colour = INK if number == 0 else LEAF_GREEN if share == best else FAINT
            style = ("-", "--", "-", ":")[number]
            profile.plot(100 * heights, (edges[1:] + edges[:-1]) / 2, style, color=colour)
            if number:
                label = f"ours, leaf area {share * area:.2g}"
                bars.bar(
                    place - 0.3 + 0.2 * number,
                    100 * counts(echoed),
                    0.2,
                    color=LEAF_GREEN,
                    alpha=1.1 - 0.3 * number,
                    label=label,
                )
        bars.set(title=f"{instrument.name}, pulses by returns, %", xticks=place)
        bars.legend(fontsize=7)
        profile.set(title="returns by height, %", ylabel="height")
    return save_figure(figure, path)
