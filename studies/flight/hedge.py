"""Gap or no gap in a hedge, told from one echo.

Hedges of leaves at random, half of them with a gap straight ahead, are pinged once each from a place and
direction that vary a little; no two pings hear the same leaves. Three ways to tell: the echo's energy (less
of it: a gap), the times at which each band of the cochleagram first crosses a threshold, and the whole
cochleagram held against templates. The last two are linear discriminants fitted to half of the echoes, the
height of the threshold among them; what is told is of the other half. Intervals are of echoes drawn anew
(Efron 1979). One thing at a time is then changed at one hedge, with the same leaves, places and directions
else. Beside them the areas under the ROC curve that Wang & Müller (2021, Bioinspir.
Biomim., doi 10.1088/1748-3190/ac2aff) publish for a sonar head before an artificial hedge: 0.69 to 0.75 by
energy, 0.90 to 0.95 by first threshold crossings, 0.94 to 0.97 by a neural network on spectrograms.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib import rc_context

from forest_addon.api import Air, Sonar, SonarPose

from ..inside import (
    FAINT,
    LINES,
    STYLE,
    Equipment,
    LeafDiscs,
    band_power,
    cochleagram,
    frame_of,
    new_figure,
    ping,
    save_figure,
    stream,
    write_csv,
)
from .theory import area_under_curve, discriminant

SIZE = (3.0, 1.6, 0.4)  # metres across, up, deep
DENSITY = 400.0  # leaves/m³
LEAF = (0.025, 0.006)  # metres, radius and its spread
DISTANCES, GAPS = (0.8, 1.4), (0.25, 0.5)  # metres
ECHOES = 2000  # of a distance and gap; of each change a quarter as many
SHIFT = (0.005, 0.03, 0.03)  # metres, spreads of where it pings: ahead, across, up
TURN = 2.0  # degrees, of its direction
# Of the median hedge's largest envelope in a band; which one is told from the echoes that are fitted.
THRESHOLDS = (0.02, 0.05, 0.1, 0.2, 0.3, 0.5)
DRAWS, HELD = 400, (5.0, 95.0)  # samples drawn anew, and percentiles that hold 90 %
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


@dataclass(frozen=True)
class HedgeSetup:
    """A hedge and how it is pinged. distance, gap : metres. density : leaves/m³. beam : degrees, full width.

    unsteady : times ``SHIFT`` and ``TURN``. noise : standard deviation over the largest sample of the
    median echo. levels : of the threshold, to choose from.
    """

    distance: float
    gap: float
    density: float = DENSITY
    beam: float = SONAR.beam_width_deg[0]
    unsteady: float = 1.0
    noise: float = 0.0
    levels: tuple[float, ...] = THRESHOLDS

    @property
    def words(self) -> str:
        """Return where the hedge is and how wide its gap, in words."""
        return f"hedge at {self.distance:g} m, gap of {100 * self.gap:.0f} cm"


@dataclass(frozen=True)
class HedgeAreas:
    """Areas under the ROC curve by way, each with its ends of 90 %, and the level of the threshold."""

    area: Mapping[str, tuple[float, float, float]]
    level: float

    @property
    def words(self) -> str:
        """Return the areas in words."""
        found = (f"{k} {v[0]:.2f} ({v[1]:.2f} to {v[2]:.2f})" for k, v in self.area.items())
        return ", ".join(found) + f", threshold {self.level:g}"


CHANGED_AT = HedgeSetup(1.4, 0.5)
CHANGES = {
    "as above": CHANGED_AT,
    "threshold at 0.3 of the largest": replace(CHANGED_AT, levels=(0.3,)),
    "beam of 25°": replace(CHANGED_AT, beam=25.0),
    "gap of 75 cm": replace(CHANGED_AT, gap=0.75),
    "100 leaves/m³": replace(CHANGED_AT, density=100.0),
    "same place and direction": replace(CHANGED_AT, unsteady=0.0),
    "noise of 0.03 of the largest": replace(CHANGED_AT, noise=0.03),
}


def run(out: Path, size: float = 1.0, seed: int = 1, say: Callable[[str], None] = print) -> dict:
    """Ping, tell, write ``hedge.csv``, ``hedge-changes.csv`` and ``hedge.png``."""
    out.mkdir(parents=True, exist_ok=True)
    setups = {
        one.words: one
        for one in (HedgeSetup(distance, gap) for distance in DISTANCES for gap in GAPS)
    }
    found, pictures = {}, {}
    for name, setup in setups.items():
        heard = echoes(setup, _even(ECHOES * size), seed)
        pictures[setup] = heard[1], heard[3]
        found[name] = told(*heard, setup.levels, seed)
        say(f"{name}: {found[name].words}")
    _write(out / "hedge.csv", setups, found)
    changed = {}
    heard = echoes(CHANGED_AT, _even(ECHOES * size / 4), seed)
    for name, setup in CHANGES.items():
        if replace(setup, levels=THRESHOLDS) != CHANGED_AT:
            heard = echoes(setup, _even(ECHOES * size / 4), seed)
        changed[name] = told(*heard, setup.levels, seed)
        say(f"{CHANGED_AT.words}, {name}: {changed[name].words}")
    _write(out / "hedge-changes.csv", CHANGES, changed)
    draw(out / "hedge.png", list(setups.values()), list(found.values()), *pictures[CHANGED_AT])
    say(f"Written to {out}: hedge.csv, hedge-changes.csv, hedge.png")
    return found


def _even(count: float) -> int:
    return max(8, 4 * round(count / 4))


def _write(path: Path, setups: Mapping[str, HedgeSetup], found: Mapping[str, HedgeAreas]) -> None:
    table: dict[str, list] = {
        "setup": list(found),
        "distance_m": [setups[name].distance for name in found],
        "gap_m": [setups[name].gap for name in found],
        "threshold": [one.level for one in found.values()],
    }
    for way in PUBLISHED:
        for number, end in enumerate(("", "_low", "_high")):
            values = [round(one.area[way][number], 4) for one in found.values()]
            table[f"auc_{way.replace(' ', '_')}{end}"] = values
    write_csv(path, table)


def echoes(
    setup: HedgeSetup, count: int, seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Echoes of ``count`` pings at new hedges: energy (M,), cochleagram (M, B, T), the bands' envelopes
    (M, B, S) and whether there was a gap (M,). Every other one has it.
    """
    sonar = SONAR.changed(beam_width_deg=(setup.beam, setup.beam))
    air, equipment = Air(), Equipment.of(sonar)
    energy, picture, envelope = np.empty(count), [], []
    is_gap = np.arange(count) % 2 == 1
    keys = "hedge", round(1000 * setup.distance)
    sounds = []
    for number in range(count):
        rng = stream(seed, *keys, number)
        leaves = hedge(rng, setup, is_gap[number])
        off = rng.normal(0.0, SHIFT, 3) * setup.unsteady
        turn = np.deg2rad(rng.normal(0.0, TURN, 2)) * setup.unsteady
        pose = SonarPose(off, frame_of(float(turn[0]), float(turn[1])), np.zeros(3))
        sounds.append(ping(leaves, sonar, air, pose=pose, equipment=equipment).waveforms)
    loud = float(np.median([np.abs(sound).max() for sound in sounds]))
    for number, sound in enumerate(sounds):
        rng = stream(seed, *keys, "noise", number)
        heard = sound + rng.normal(0.0, setup.noise * loud, sound.shape) if setup.noise else sound
        energy[number] = float((heard**2).sum())
        picture.append(cochleagram(heard, sonar)[0])
        envelope.append(np.sqrt(band_power(heard, sonar)[0]).astype(np.float32))
    return energy, np.array(picture), np.array(envelope), is_gap


def hedge(rng: np.random.Generator, setup: HedgeSetup, is_gap: bool) -> LeafDiscs:
    """Leaves of a hedge ahead along X, without those in a gap straight ahead."""
    count = rng.poisson(setup.density * np.prod(SIZE))
    across, up, deep = SIZE
    centre = rng.uniform((0, -across / 2, -up / 2), (deep, across / 2, up / 2), (count, 3))
    centre[:, 0] += setup.distance
    normal = rng.standard_normal((count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    radius = np.clip(rng.normal(*LEAF, count), 0.008, 0.05)
    kept = np.flatnonzero(np.abs(centre[:, 1]) > (setup.gap / 2 if is_gap else 0.0))
    nothing = np.zeros(len(kept), dtype=np.int64)
    return LeafDiscs(centre[kept], normal[kept], radius[kept], nothing, kept, nothing - 1)


def told(
    energy: np.ndarray,
    picture: np.ndarray,
    envelope: np.ndarray,
    is_gap: np.ndarray,
    levels: tuple[float, ...] = THRESHOLDS,
    seed: int = 1,
) -> HedgeAreas:
    """Areas under the ROC curve of the three ways; fitted to every other pair of echoes, told of the rest.

    The threshold is the one of ``levels`` by which a half of the fitted echoes tells the other half best.
    """
    pair = np.arange(len(energy)) // 2
    fitted, rest = pair % 2 == 0, pair % 2 == 1
    largest = np.median(envelope[fitted & ~is_gap].max(axis=2), axis=0)  # (B,)
    first = {level: crossings(envelope, level * largest) for level in levels}
    some, others = pair % 4 == 0, pair % 4 == 2

    def worth(level: float) -> float:
        return area_under_curve(_scores(first[level], is_gap, some)[others], is_gap[others])

    level = max(levels, key=worth) if len(levels) > 1 else levels[0]
    score = {
        "energy": -energy,
        "first crossing": _scores(first[level], is_gap, fitted),
        "template": _scores(picture.reshape(len(picture), -1), is_gap, fitted),
    }
    return HedgeAreas(
        {k: area_with_ends(v[rest], is_gap[rest], seed) for k, v in score.items()}, level
    )


def _scores(features: np.ndarray, is_gap: np.ndarray, fitted: np.ndarray) -> np.ndarray:
    """(M,) scores by the discriminant of the echoes ``fitted`` (M,) bool."""
    weights = discriminant(features[fitted], is_gap[fitted])
    return np.asarray(features @ weights[:-1] + weights[-1])


def area_with_ends(score: np.ndarray, is_it: np.ndarray, seed: int) -> tuple[float, float, float]:
    """Area under the ROC curve, and between which ends it lies with 90 %: of echoes (M,) drawn anew of
    each kind.
    """
    rng = stream(seed, "hedge", "ends")
    kinds = [np.flatnonzero(is_it), np.flatnonzero(~is_it)]
    drawn = (np.concatenate([rng.choice(kind, len(kind)) for kind in kinds]) for _ in range(DRAWS))
    areas = [area_under_curve(score[rows], is_it[rows]) for rows in drawn]
    low, high = np.percentile(areas, HELD)
    return area_under_curve(score, is_it), float(low), float(high)


def crossings(envelope: np.ndarray, level: np.ndarray) -> np.ndarray:
    """(M, B) milliseconds after which each band's envelope (M, B, S) is above its level (B,) first; the
    end of the record where it never is.
    """
    above = envelope > level[:, None]
    first = above.argmax(axis=2).astype(float)
    first[~above.any(axis=2)] = envelope.shape[2]
    return first * 1e3 / SONAR.sample_rate


def draw(
    path: Path,
    setups: list[HedgeSetup],
    found: list[HedgeAreas],
    picture: np.ndarray,
    is_gap: np.ndarray,
) -> Path:
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
            spread = np.linspace(-0.2, 0.2, len(found))
            for x, setup, areas in zip(spread, setups, found, strict=True):
                value, low, high = areas.area[name]
                ends = [[value - low], [high - value]]
                colour = LINES[DISTANCES.index(setup.distance)]
                marker = "o" if setup.gap == GAPS[0] else "s"
                label = (
                    f"{setup.distance:g} m, gap {100 * setup.gap:.0f} cm" if place == 0 else None
                )
                ax.errorbar(place + x, value, ends, fmt=marker, color=colour, ms=5, label=label)
        ax.fill_between([], [], [], color=FAINT, label="Wang & Müller (2021)")
        ax.axhline(0.5, color=FAINT, lw=0.8)
        ax.set_xticks(range(3), ["energy", "first crossing", "template\n(theirs: CNN)"])
        ax.set(
            ylabel="area under the ROC curve", ylim=(0.45, 1.02), title="Gap or not, from one echo"
        )
        ax.legend(fontsize=7, loc="lower right", ncols=2)
    return save_figure(figure, path)
