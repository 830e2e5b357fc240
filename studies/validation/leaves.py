"""Inclination of leaves: presets against leaves of the same species, photographed level (Chianucci et al.
2018).

Both are samples of angles θ between leaf and horizontal. They are compared by the Kolmogorov-Smirnov
distance, by mean and deviation, by the ellipsoidal parameter χ of the mean (Campbell 1990:
θ̄ = 9.65 (3 + χ)^-1.65), and by mean |cos θ|, the share of its area that foliage shows to the zenith.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import stats

from ..inside import (
    BARK,
    FAINT,
    INK,
    LEAF_GREEN,
    blank_figure,
    find_species,
    grow,
    load_species,
    save_figure,
    stream,
    table_of,
)
from .run import Comparison, Interval, Picture

TITLE = "Leaves: how they incline"
SUMMARY = """\
Measured: leaf inclinations of 138 species from levelled photographs (Chianucci, Pisek, Raabe et al. 2018,
*A dataset of leaf inclination angles for temperate and boreal broadleaf woody species*, Ann. For. Sci.
75:50; MIT). *Simpler model*: presets of the papers, which say how leaves stand on twigs but not how they
incline; they stay as they are. *Simulated* are presets of the same wood under the species' name, whose
`[inclination]` is a beta distribution of measured mean and deviation, or, where that is refused (birch),
the measured shares of 5° classes. 1,000 leaves of three trees each; intervals are 95 % for the mean of
leaves drawn independently. A KS distance agrees if it is not refused at 5 %: a right one is refused once in
twenty.
"""
TERMS = """\
The measured variants are fitted to these very leaves, so their agreement says that the mechanism works, not
that it predicts. How far one tree stands for a species: the words of each row give means by sector of the
crown, which differ by more than these intervals. A canopy's leaves also turn with the season and with
height; a preset's do not.
"""
FILE = "leaf_angles.csv"
LEAVES, TREES = 1000, 3
LEVEL = 0.05


@dataclass(frozen=True)
class LeafKind:
    """A measured species, the paper's preset of its kind, and that of measured inclination."""

    measured: str
    before: str
    after: str


KINDS = (
    LeafKind("Acer platanoides", "maple", "acer-platanoides"),
    LeafKind("Corylus avellana", "hazelnut", "corylus-avellana"),
    LeafKind("Malus domestica", "apple", "malus-domestica"),
    LeafKind("Betula pendula", "honda-birch", "betula-pendula"),
)


def validate(data: Path, out: Path, arguments: argparse.Namespace) -> list[Comparison]:
    """Four species: a row for each measure, and one picture."""
    angles = read_angles(data / FILE)
    found, drawn = [], []
    for kind in KINDS:
        sectors = angles[kind.measured]
        measured = np.concatenate(list(sectors.values()))
        before, after = (inclinations(name, arguments.seed) for name in (kind.before, kind.after))
        drawn.append((kind, measured, before, after))
        found += _rows(kind, sectors, measured, before, after)
    picture = Picture(
        _draw(drawn, out / "leaves.png"),
        "Shares of leaves by inclination: measured (bars), the paper's preset (brown), the measured "
        "variant (green), and the beta distribution of measured mean and deviation (dotted).",
    )
    return [*found[:-1], replace(found[-1], pictures=(picture,))]


def read_angles(path: Path) -> dict[str, dict[str, np.ndarray]]:
    """Degrees by species and sector of the crown."""
    angles_of: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for row in table_of(path):
        name = f"{row['Genus']} {row['Species']}"
        angles_of[name][row["Canopy_sector"]].append(float(row["Angle_degree"]))
    return {
        name: {sector: np.array(values) for sector, values in sectors.items()}
        for name, sectors in angles_of.items()
    }


def inclinations(name: str, seed: int) -> np.ndarray:
    """Degrees of 1,000 leaves of three trees of a preset, drawn without return."""
    species, template = load_species(find_species(name, Path()))
    trees = [grow(species, template, stream(seed, "validate", name, k)) for k in range(TREES)]
    up = np.concatenate([np.abs(tree.leaves.normal[:, 2]) for tree in trees])
    chosen = stream(seed, "validate leaves", name).permutation(len(up))[:LEAVES]
    return np.rad2deg(np.arccos(np.clip(up[chosen], 0.0, 1.0)))


def ellipsoidal(mean_deg: float) -> float:
    """Campbell's χ of a mean inclination: 1 is a sphere, larger lies flatter."""
    return float((np.deg2rad(mean_deg) / 9.65) ** (-1 / 1.65) - 3)


def beta_of(degrees: np.ndarray) -> tuple[float, float]:
    """The parameters of the beta distribution of θ/90° with the sample's mean and variance."""
    share = degrees / 90
    both = share.mean() * (1 - share.mean()) / share.var() - 1
    return float(share.mean() * both), float((1 - share.mean()) * both)


def _rows(
    kind: LeafKind,
    sectors: dict[str, np.ndarray],
    measured: np.ndarray,
    before: np.ndarray,
    after: np.ndarray,
) -> list[Comparison]:
    name = kind.measured
    samples = (measured, after, before)
    means = [Interval.mean(sample) for sample in samples]
    chi = [
        Interval(*(ellipsoidal(v) for v in (m.value, m.high, m.low)))
        for m in means
        if m.low and m.high
    ]
    shown = [Interval.mean(np.cos(np.deg2rad(sample))) for sample in samples]
    parameters = [beta_of(sample) for sample in samples]
    spread = ", ".join(f"{s} {v.mean():.0f}° of {len(v)}" for s, v in sectors.items())
    beta = "; ".join(
        f"{what} {a:.2f}, {b:.2f}"
        for what, (a, b) in zip(("measured", kind.after, kind.before), parameters, strict=True)
    )
    limit = float(np.sqrt(-np.log(LEVEL / 2) / 2 * (1 / len(measured) + 1 / LEAVES)))
    tests = [stats.ks_2samp(measured, sample) for sample in (after, before)]
    return [
        Comparison(
            *(f"{name}, mean", "°", means[0], means[1], means[0].meets(means[1])),
            words=f"{len(measured):,} leaves measured ({spread}).",
            before=means[2],
        ),
        Comparison(
            *(f"{name}, ellipsoidal χ", "", chi[0], chi[1], chi[0].meets(chi[1])), before=chi[2]
        ),
        Comparison(
            *(f"{name}, share shown to the zenith", "", shown[0], shown[1]),
            shown[0].meets(shown[1]),
            before=shown[2],
        ),
        Comparison(
            f"{name}, KS distance",
            "",
            Interval(0.0, 0.0, limit),
            Interval(float(tests[0].statistic)),
            bool(tests[0].pvalue >= LEVEL),
            words=f"p = {tests[0].pvalue:.2g}, before {tests[1].pvalue:.2g}. Beta parameters: {beta}.",
            before=Interval(float(tests[1].statistic)),
        ),
    ]


def _draw(drawn: list[tuple[LeafKind, np.ndarray, np.ndarray, np.ndarray]], path: Path) -> Path:
    figure = blank_figure((11, 3.0))
    edges = np.linspace(0, 90, 19)
    middle = (edges[1:] + edges[:-1]) / 2
    fine = np.linspace(0.5, 89.5, 179)
    for number, (kind, measured, before, after) in enumerate(drawn):
        axes = figure.add_subplot(1, len(drawn), number + 1)
        shares = [np.histogram(v, edges)[0] / len(v) for v in (measured, before, after)]
        axes.bar(middle, 100 * shares[0], width=5, color=FAINT, label="measured")
        axes.plot(middle, 100 * shares[1], color=BARK, label=kind.before)
        axes.plot(middle, 100 * shares[2], color=LEAF_GREEN, lw=2, label=kind.after)
        curve = stats.beta(*beta_of(measured), scale=90).pdf(fine) * 500
        axes.plot(fine, curve, ":", color=INK, lw=1, label="beta")
        axes.set(title=kind.measured, xlabel="inclination, °", xlim=(0, 90), xticks=[0, 30, 60, 90])
        axes.set_ylim(0, 1.45 * axes.get_ylim()[1])  # room for the legend
        axes.legend(fontsize=7, loc="upper right" if measured.mean() < 45 else "upper left")
        if number == 0:
            axes.set_ylabel("leaves, % a 5°")
    return save_figure(figure, path)
