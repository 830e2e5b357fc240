"""Recognition of plants: which of two, told from echoes of both ears and several pings.

After Kuc (2020, J. Acoust. Soc. Am. 148:3270): a sonar with audible clicks, two ears and five emissions at
aspects 18° apart heard a Ficus benjamina and a Schefflera arboricola, whose leaf areas differ by a factor of
four; a linear classifier of spectrograms, ten-fold cross-validated, was wrong in fewer than 1 %. With the
envelopes alone, and three emissions, the error was 22 % (2020, J. Acoust. Soc. Am. 147:2357).

Each echo's picture is reduced to its first principal components, which know nothing of the kinds; then comes
a linear discriminant. Here a plant is a ball of leaves at random, of the same leaf area, turned before the
sonar. His plants' sizes, distances and clicks are not in the abstracts; they are guesses here, and said as
such. Errors are given as he has them (other aspects of the same two plants) and for plants that were never
heard before.
"""

from __future__ import annotations

from collections.abc import Callable
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
    cochleagram,
    discriminant,
    frame_of,
    new_figure,
    ping,
    save_figure,
    stream,
)
from ..tables import write_rows

AREA = 0.6  # m² of leaves of a plant, one side; ours
BALL = 0.3  # metres, radius of a plant; ours
AWAY = 1.0  # metres to its middle; ours
RADIUS = {"ficus": 0.018, "schefflera": 0.036}  # metres: leaf areas that differ by a factor of four
SPREAD = 0.15  # of the radii, relative; ours
ASPECTS = 140  # of a plant, as many as give 5,600 binaural echoes of ten plants with two ears
PLANTS = 10  # of each kind
STEP_DEG = 18.0
EMISSIONS = (1, 3, 5)
FOLDS = 10
COMPONENTS = 24  # of a picture
PUBLISHED = {("envelope", 3): 0.22, ("spectrogram", 5): 0.01}
SONAR = Sonar(
    band=(4e3, 16e3),
    sample_rate=48e3,
    call="fm",
    call_duration=0.001,
    beam_width_deg=(60.0, 60.0),
    ears=2,
    ear_spacing=0.15,
    ear_turn_deg=20.0,
    wood=False,
    facets=False,
    shading="none",
    leaf_model="piston",
    max_range=2.0,
    record=0.012,
    cull=0.02,
    tolerance=1e-4,
)


def run(out: Path, size: float = 1.0, seed: int = 1, say: Callable[[str], None] = print) -> dict:
    """Ping, tell, write ``plants.csv`` and ``plants.png``. size : of the number of aspects."""
    out.mkdir(parents=True, exist_ok=True)
    turns = max(20, 20 * round(ASPECTS * size / 20))  # so that 18° are whole steps
    pictures = np.array(
        [
            [picture_of(kind, number, turns, seed) for number in range(PLANTS)]
            for kind in range(len(RADIUS))
        ]
    )  # (kinds, plants, turns, ears, bands, bins)
    rows = []
    for what, seen in (("envelope", pictures.mean(axis=4)), ("spectrogram", pictures)):
        heard = reduced(seen.reshape(*seen.shape[:4], -1))
        for ears in (1, 2):
            for emissions in EMISSIONS:
                same, new = errors(heard[:, :, :, :ears], emissions, seed)
                known = {"heard": what, "ears": ears, "emissions": emissions}
                rows.append(known | {"error_same_plants": same, "error_new_plants": new})
                say(
                    f"{what}, {ears} ear{'s' if ears > 1 else ''}, {emissions} emissions: "
                    f"{100 * same:.1f} % wrong, of plants never heard {100 * new:.1f} %"
                )
    write_rows(out / "plants.csv", rows)
    draw(out / "plants.png", rows)
    say(f"Written to {out}: plants.csv, plants.png")
    return {tuple(row.values())[:3]: tuple(row.values())[3:] for row in rows}


def plant(kind: int, number: int, seed: int) -> LeafDiscs:
    """Leaves of a plant of a kind, about the origin; the area of all is that of every other plant."""
    rng = stream(seed, "plant", kind, number)
    middle = list(RADIUS.values())[kind]
    count = round(AREA / (np.pi * middle**2 * (1 + SPREAD**2)))
    radius = middle * np.clip(rng.normal(1.0, SPREAD, count), 0.5, 1.5)
    way = rng.standard_normal((count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    centre = way * BALL * rng.random((count, 1)) ** (1 / 3)
    normal = rng.standard_normal((count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    nothing = np.zeros(count, dtype=np.int64)
    return LeafDiscs(centre, normal, radius, nothing, np.arange(count), nothing - 1)


def picture_of(kind: int, number: int, turns: int, seed: int) -> np.ndarray:
    """(turns, ears, bands, bins) cochleagrams of a plant from all around it."""
    leaves, air, equipment = plant(kind, number, seed), Air(), Equipment.of(SONAR)
    sounds = []
    for turn in 2 * np.pi * np.arange(turns) / turns:
        ahead = np.array([np.cos(turn), np.sin(turn), 0.0])
        pose = SonarPose(-AWAY * ahead, frame_of(float(turn), 0.0), np.zeros(3))
        sound = ping(leaves, SONAR, air, pose=pose, equipment=equipment).waveforms
        sounds.append(cochleagram(sound, SONAR).astype(np.float32))
    return np.array(sounds)


def reduced(heard: np.ndarray) -> np.ndarray:
    """(..., ``COMPONENTS`` at most) first principal components of pictures (..., F)."""
    rows = heard.reshape(-1, heard.shape[-1]).astype(np.float64)
    rows -= rows.mean(axis=0)
    _, axes = np.linalg.eigh(rows.T @ rows)
    components = rows @ axes[:, : -COMPONENTS - 1 : -1]
    return components.reshape(*heard.shape[:-1], -1)


def errors(heard: np.ndarray, emissions: int, seed: int) -> tuple[float, float]:
    """Shares of wrong answers: of other aspects of the plants that were learned from (ten-fold), and of
    plants that were left out.

    heard : (kinds, plants, turns, ears, features). A row is the emissions from one aspect on, 18° apart.
    """
    turns = heard.shape[2]
    step = round(STEP_DEG / 360 * turns)
    start = np.arange(turns)
    views = [heard[:, :, (start + k * step) % turns] for k in range(emissions)]
    rows = np.concatenate([view.reshape(*view.shape[:3], -1) for view in views], axis=3)
    same = []
    for number in range(heard.shape[1]):  # his two plants are one of these pairs
        pair = rows[:, number].reshape(2 * turns, -1)
        truth = np.repeat([False, True], turns)
        fold = stream(seed, "folds", number).permutation(2 * turns) % FOLDS
        for out in range(FOLDS):
            same.append(
                _wrong(pair[fold != out], truth[fold != out], pair[fold == out], truth[fold == out])
            )
    new = []
    for number in range(heard.shape[1]):
        rest = np.arange(heard.shape[1]) != number
        known = rows[:, rest].reshape(-1, rows.shape[3])
        truth = np.repeat([False, True], len(known) // 2)
        other = rows[:, number].reshape(2 * turns, -1)
        new.append(_wrong(known, truth, other, np.repeat([False, True], turns)))
    return float(np.mean(same)), float(np.mean(new))


def _wrong(known: np.ndarray, truth: np.ndarray, rows: np.ndarray, is_it: np.ndarray) -> float:
    weights = discriminant(known, truth)
    return float(np.mean((rows @ weights[:-1] + weights[-1] > 0) != is_it))


def draw(path: Path, rows: list) -> Path:
    """Errors by the number of emissions, beside the published ones."""
    with rc_context(STYLE):
        figure, axes = new_figure(2, (9, 3.6))
        titles = {
            "error_same_plants": "other aspects of the same plants",
            "error_new_plants": "plants never heard",
        }
        for ax, (column, title) in zip(axes, titles.items(), strict=True):
            kinds = dict.fromkeys((row["heard"], row["ears"]) for row in rows)
            for number, (what, ears) in enumerate(kinds):
                mine = [row for row in rows if (row["heard"], row["ears"]) == (what, ears)]
                floor = [max(row[column], 5e-4) for row in mine]
                label = f"{what}, {ears} ear{'s' if ears > 1 else ''}"
                line = "o-" if ears == 2 else "o:"
                ax.plot(EMISSIONS, floor, line, color=LINES[number // 2], label=label)
            for (what, emissions), error in PUBLISHED.items():
                ax.plot(emissions, error, "*", color=FAINT, ms=12, mec="k", mew=0.5)
                ax.annotate(f"Kuc, {what}", (emissions, error), fontsize=6, ha="right", va="bottom")
            ax.set(yscale="log", ylim=(4e-4, 0.6), xlabel="emissions", title=title)
            ax.set_ylabel("share of wrong answers")
        axes[0].legend(fontsize=7)
    return save_figure(figure, path)
