"""Gap or no gap in a hedge, told from one echo.

Hedges of leaves at random, half of them with a gap straight ahead, are pinged once each from a place and
direction that vary a little; no two pings hear the same leaves. Three ways to tell: the echo's energy (less
of it: a gap), the times at which each band of the cochleagram first crosses a threshold, and the whole
cochleagram held against templates. The last two are linear discriminants fitted to half of the echoes; what
is told is of the other half. Beside them the areas under the ROC curve that Wang & Müller (2021, Bioinspir.
Biomim., doi 10.1088/1748-3190/ac2aff) publish for a sonar head before an artificial hedge: 0.69 to 0.75 by
energy, 0.90 to 0.95 by first threshold crossings, 0.94 to 0.97 by a neural network on spectrograms.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib import rc_context

from forest_addon.base.rng import stream
from forest_addon.flight.senses import band_power, cochleagram
from forest_addon.flight.statistics import area_under_curve, discriminant
from forest_addon.formats.table import write_csv
from forest_addon.sensing.sonar.ping import LeafDiscs, ping
from forest_addon.sensing.sonar.poses import SonarPose
from forest_addon.sensing.sonar.station import Equipment
from forest_addon.sensing.trajectory import frame_of
from forest_addon.spec import Air, Sonar

from ...report.flights import LINES, new_figure
from ...report.pictures import FAINT, STYLE, save_figure

SIZE = (3.0, 1.6, 0.4)  # metres across, up, deep
DENSITY = 400.0  # leaves/m³
LEAF = (0.025, 0.006)  # metres, radius and its spread
DISTANCES, GAPS = (0.8, 1.4), (0.25, 0.5)  # metres
ECHOES = 120  # of a distance and gap
SHIFT = (0.005, 0.03, 0.03)  # metres, spreads of where it pings: ahead, across, up
TURN = 2.0  # degrees, of its direction
THRESHOLD = 0.3  # of the median hedge's largest envelope in a band
PUBLISHED = {"energy": (0.69, 0.75), "first crossing": (0.90, 0.95), "template": (0.94, 0.97)}
SONAR = Sonar(
    band=(30e3, 80e3),
    sample_rate=200e3,
    call="fm",
    call_duration=0.002,
    beam_width_deg=(50.0, 50.0),
    wood=False,
    facets=False,
    shading="none",
    leaf_model="piston",
    max_range=3.0,
    record=0.0165,
    cull=0.02,
    tolerance=1e-4,
)


def run(out: Path, size: float = 1.0, seed: int = 1, say: Callable[[str], None] = print) -> dict:
    """Ping, tell, write ``hedge.csv`` and ``hedge.png``."""
    out.mkdir(parents=True, exist_ok=True)
    count = max(16, 2 * round(ECHOES * size / 2))
    rows, found, shown = [], {name: [] for name in PUBLISHED}, None
    for distance in DISTANCES:
        for gap in GAPS:
            energy, picture, power, is_gap = echoes(distance, gap, count, seed)
            areas = told(energy, picture, power, is_gap)
            for name, area in areas.items():
                found[name].append(area)
            rows.append((distance, gap, *areas.values()))
            words = ", ".join(f"{name} {area:.2f}" for name, area in areas.items())
            say(f"hedge at {distance:g} m, gap of {100 * gap:.0f} cm: {words}")
            if shown is None or (distance, gap) == (1.4, 0.5):
                shown = picture, is_gap
    names = ("distance_m", "gap_m", *(f"auc_{name.replace(' ', '_')}" for name in PUBLISHED))
    columns = zip(*rows, strict=True)
    write_csv(
        out / "hedge.csv",
        {n: [round(v, 4) for v in c] for n, c in zip(names, columns, strict=True)},
    )
    assert shown is not None
    draw(out / "hedge.png", rows, found, *shown)
    say(f"Written to {out}: hedge.csv, hedge.png")
    return found


def echoes(
    distance: float, gap: float, count: int, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of so many pings at new hedges energy (M,), cochleagram (M, B, T), the bands' envelopes (M, B, S) and
    whether there was a gap (M,).
    """
    air, equipment = Air(), Equipment.of(SONAR)
    energy, picture, envelope = np.empty(count), [], []
    is_gap = np.arange(count) % 2 == 1
    for number in range(count):
        rng = stream(seed, "hedge", round(1000 * distance), round(1000 * gap), number)
        leaves = hedge(rng, distance, gap if is_gap[number] else 0.0)
        off = rng.normal(0.0, SHIFT, 3)
        turn = np.deg2rad(rng.normal(0.0, TURN, 2))
        pose = SonarPose(off, frame_of(float(turn[0]), float(turn[1])), np.zeros(3))
        sound = ping(leaves, SONAR, air, pose=pose, equipment=equipment).waveforms
        energy[number] = float((sound**2).sum())
        picture.append(cochleagram(sound, SONAR)[0])
        envelope.append(np.sqrt(band_power(sound, SONAR)[0]).astype(np.float32))
    return energy, np.array(picture), np.array(envelope), is_gap


def hedge(rng: np.random.Generator, distance: float, gap: float) -> LeafDiscs:
    """Leaves of a hedge ahead along X, without those in a gap of some width straight ahead."""
    count = rng.poisson(DENSITY * np.prod(SIZE))
    across, up, deep = SIZE
    centre = rng.uniform((0, -across / 2, -up / 2), (deep, across / 2, up / 2), (count, 3))
    centre[:, 0] += distance
    normal = rng.standard_normal((count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    radius = np.clip(rng.normal(*LEAF, count), 0.008, 0.05)
    kept = np.flatnonzero(np.abs(centre[:, 1]) > gap / 2)
    nothing = np.zeros(len(kept), dtype=np.int64)
    return LeafDiscs(centre[kept], normal[kept], radius[kept], nothing, kept, nothing - 1)


def told(
    energy: np.ndarray, picture: np.ndarray, envelope: np.ndarray, is_gap: np.ndarray
) -> dict[str, float]:
    """Areas under the ROC curve of the three ways; fitted to every other pair of echoes, told of the rest."""
    fitted = (np.arange(len(energy)) // 2) % 2 == 0
    rest = ~fitted
    areas = {"energy": area_under_curve(-energy[rest], is_gap[rest])}
    level = THRESHOLD * np.median(envelope[fitted & ~is_gap].max(axis=2), axis=0)  # (B,)
    first = crossings(envelope, level)
    whole = picture.reshape(len(picture), -1)
    for name, features in (("first crossing", first), ("template", whole)):
        weights = discriminant(features[fitted], is_gap[fitted])
        score = features[rest] @ weights[:-1] + weights[-1]
        areas[name] = area_under_curve(score, is_gap[rest])
    return areas


def crossings(envelope: np.ndarray, level: np.ndarray) -> np.ndarray:
    """(M, B) milliseconds after which each band's envelope (M, B, S) is above its level (B,) first; the
    end of the record where it never is.
    """
    above = envelope > level[:, None]
    first = above.argmax(axis=2).astype(float)
    first[~above.any(axis=2)] = envelope.shape[2]
    return first * 1e3 / SONAR.sample_rate


def draw(path: Path, rows: list, found: dict, picture: np.ndarray, is_gap: np.ndarray) -> Path:
    """Mean cochleagrams of hedge and gap, and the areas beside the published ones."""
    with rc_context(STYLE):
        figure, axes = new_figure(3, (12, 3.9), width_ratios=(1, 1, 1.5))
        length = SONAR.record * Air().speed() / 2
        low, high = (f / 1e3 for f in SONAR.band)
        for ax, which, name in ((axes[0], ~is_gap, "hedge"), (axes[1], is_gap, "gap of 50 cm")):
            ax.imshow(
                picture[which].mean(axis=0),
                origin="lower",
                aspect="auto",
                extent=(0, length, low, high),
                vmin=0,
                vmax=0.8,
                cmap="magma",
            )
            ax.set(xlabel="distance, m", ylabel="band, kHz", title=f"Mean echo at 1.4 m: {name}")
        ax = axes[2]
        for place, (name, published) in enumerate(PUBLISHED.items()):
            ax.fill_between([place - 0.35, place + 0.35], *published, color=FAINT, alpha=0.8, lw=0)
            values = found[name]
            spread = np.linspace(-0.2, 0.2, len(values))
            for number, (x, value) in enumerate(zip(spread, values, strict=True)):
                distance, gap = rows[number][:2]
                colour = LINES[DISTANCES.index(distance)]
                marker = "o" if gap == GAPS[0] else "s"
                first = place == 0
                label = f"{distance:g} m, gap {100 * gap:.0f} cm" if first else None
                ax.plot(place + x, value, marker, color=colour, ms=5, label=label)
        ax.fill_between([], [], [], color=FAINT, label="Wang & Müller (2021)")
        ax.axhline(0.5, color=FAINT, lw=0.8)
        ax.set_xticks(range(3), ["energy", "first crossing", "template\n(theirs: CNN)"])
        ax.set(
            ylabel="area under the ROC curve", ylim=(0.45, 1.02), title="Gap or not, from one echo"
        )
        ax.legend(fontsize=7, loc="lower right", ncols=2)
    return save_figure(figure, path)
