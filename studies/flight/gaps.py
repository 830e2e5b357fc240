"""A passage in a hedge or a pole among leaves, told from one echo, clean and in noise.

The tasks, and four ways to tell, are those of ``forest_addon.flight.listening``: half of the echoes fit them,
the other half is told. Each is fitted anew at every signal-to-noise ratio. Intervals are of echoes drawn anew
(Efron 1979). Beside them the areas under the ROC curve that Wang & Müller (2021, Bioinspir. Biomim., doi
10.1088/1748-3190/ac2aff) publish for a sonar head before an artificial hedge: 0.69 to 0.75 by energy, 0.90 to
0.95 by first threshold crossings, 0.94 to 0.97 by a neural network on spectrograms.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib import rc_context

from ..inside import (
    FAINT,
    LINES,
    LISTENERS,
    STYLE,
    EchoTask,
    Listener,
    area_under_curve,
    new_figure,
    noisy,
    save_figure,
    sensed,
    stream,
)
from ..tables import write_rows

TASKS = {
    "hedge at 1.4 m, gap of 50 cm": EchoTask("passage", 1.4, 0.5),
    "hedge at 1.4 m, gap of 25 cm": EchoTask("passage", 1.4, 0.25),
    "hedge at 0.8 m, gap of 50 cm": EchoTask("passage", 0.8, 0.5),
    "hedge at 0.8 m, gap of 25 cm": EchoTask("passage", 0.8, 0.25),
    "pole of 4 cm in leaves at 1.4 m": EchoTask("pole", 1.4, 0.04),
}
DRAWN = (0, 4)  # of the tasks, those whose curves are drawn
SNR_DB = (None, 30.0, 20.0, 10.0, 0.0, -10.0)  # dB; None: no noise
ECHOES = 1000  # of a task
DRAWS, HELD = 400, (5.0, 95.0)  # samples drawn anew, and percentiles that hold 90 %
PUBLISHED = {"energy": (0.69, 0.75), "first crossing": (0.90, 0.95), "network": (0.94, 0.97)}
Area = tuple[float, float, float]


def run(out: Path, size: float = 1.0, seed: int = 1, say: Callable[[str], None] = print) -> dict:
    """Ping, tell, write ``gaps.csv`` and ``gaps.png``; returns areas by task, noise and way."""
    out.mkdir(parents=True, exist_ok=True)
    count = max(8, 4 * round(ECHOES * size / 4))
    found: dict[tuple[str, float | None, str], Area] = {}
    rows = []
    for words, task in TASKS.items():
        is_there = np.arange(count) % 2 == 1
        sound = [task.heard(seed, n, bool(there)) for n, there in enumerate(is_there)]
        for snr in SNR_DB:
            heard = sound
            if snr is not None:
                loud = task.loudness()
                heard = [noisy(one, snr, loud, seed, n) for n, one in enumerate(sound)]
            areas = told(np.array([sensed(one) for one in heard]), is_there, seed)
            found |= {(words, snr, way): area for way, area in areas.items()}
            known = {"task": words, "snr_db": "" if snr is None else snr, "echoes": count // 2}
            for way, area in areas.items():
                auc, low, high = np.round(area, 4).tolist()
                rows.append(known | {"listener": way, "auc": auc, "auc_low": low, "auc_high": high})
            cells = (f"{v[0]:.2f} ({v[1]:.2f} to {v[2]:.2f})" for v in areas.values())
            level = "no noise" if snr is None else f"{snr:g} dB"
            say(f"| {words}, {level} | {count // 2} | {' | '.join(cells)} |")
    write_rows(out / "gaps.csv", rows)
    draw(out / "gaps.png", found)
    say(f"Written to {out}: gaps.csv, gaps.png")
    return found


def told(power: np.ndarray, is_there: np.ndarray, seed: int = 1) -> dict[str, Area]:
    """Areas under the ROC curve by way, each with its ends of 90 %; fitted to every other pair of echoes
    (M, B, S), told of the rest.
    """
    fitted = np.arange(len(power)) // 2 % 2 == 0
    known, other, truth = power[fitted], power[~fitted], is_there[~fitted]
    scores = {way: Listener(way).fit(known, is_there[fitted]).score(other) for way in LISTENERS}
    return {way: area_with_ends(score, truth, seed) for way, score in scores.items()}


def area_with_ends(score: np.ndarray, is_it: np.ndarray, seed: int) -> Area:
    """Area under the ROC curve, and between which ends it lies with 90 %: of echoes (M,) drawn anew of
    each kind.
    """
    rng = stream(seed, "hedge", "ends")
    kinds = [np.flatnonzero(is_it), np.flatnonzero(~is_it)]
    drawn = (np.concatenate([rng.choice(kind, len(kind)) for kind in kinds]) for _ in range(DRAWS))
    areas = [area_under_curve(score[rows], is_it[rows]) for rows in drawn]
    low, high = np.percentile(areas, HELD)
    return area_under_curve(score, is_it), float(low), float(high)


def draw(path: Path, found: dict[tuple[str, float | None, str], Area]) -> Path:
    """Areas against signal-to-noise, without noise on the right, beside the published ones."""
    with rc_context(STYLE):
        figure, axes = new_figure(2, (11, 4.0))
        place = np.array([40.0 if snr is None else snr for snr in SNR_DB])
        for ax, words in zip(axes, [list(TASKS)[n] for n in DRAWN], strict=True):
            for way, colour in zip(LISTENERS, LINES, strict=False):
                value, low, high = np.array([found[words, snr, way] for snr in SNR_DB]).T
                error = np.maximum([value - low, high - value], 0)
                ax.errorbar(place, value, error, color=colour, marker="o", ms=4, label=way)
                if way in PUBLISHED and "hedge" in words:
                    ax.fill_between([42, 46], *PUBLISHED[way], color=colour, alpha=0.4, lw=0)
            ax.axhline(0.5, color=FAINT, lw=0.8)
            ticks = [-10, 0, 10, 20, 30, 40]
            ax.set_xticks(ticks, [*map(str, ticks[:-1]), "no noise"])
            label = "peak over noise in the band, dB"
            ax.set(xlabel=label, ylabel="area under the ROC curve", ylim=(0.4, 1.02), title=words)
        axes[0].fill_between([], [], [], color=FAINT, label="Wang & Müller (2021)")
        axes[0].legend(fontsize=7)
    return save_figure(figure, path)
