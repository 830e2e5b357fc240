"""The report of Méndez et al.'s experiment: Table 3 and the regressions, Méndez et al.'s numbers beside
ours, and their picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from forest_addon.sensing.lidar.wood_indices import OriginLine, line_through_origin
from headless.report.pictures import BARK, FAINT, INK, LEAF_GREEN, RED, blank_figure, save_figure

from ..tables import table
from .simlidar_rows import OrchardFinding

# S, Table 3: iterations, trees, branches, beams, minutes.
TABLE_3 = (
    (4, 1, 360, 558_930, 2),
    (5, 1, 1_497, 561_935, 4),
    (6, 1, 5_564, 504_840, 11),
    (7, 1, 15_168, 579_965, 26),
    (4, 4, 2_064, 1_634_720, 15),
    (5, 4, 4_991, 2_482_130, 32),
    (6, 4, 20_020, 2_404_000, 135),
    (7, 4, 44_658, 2_467_105, 210),
)
# S, its fits through the origin: slope and R².
THEIRS = {"projected_m2": ("A_PR", 3.6166, 0.7002), "area_m2": ("A_L", 10.812, 0.7756)}
BEAMS = {
    "impacted_m2": "one ray",
    "impacted_solid_m2": "solid beam, P = 2",
    "impacted_eq14_m2": "solid beam, θ from the vertical (eq. 14)",
}

DISCUSSION = """\
Where and why they differ:
- Méndez et al.'s A_IM is smaller than ours for the same wood. Its thick beam is not the reason: a
  solid beam is hit as
  soon as anything is in its sector, here about 2 by 6.5 mm and so as large as the twigs (5 to 7 mm), which
  makes A_IM larger and slopes smaller than one ray does. One ray sees the wood as thick as it is.
- θ from the vertical, as Méndez et al.'s eq. 14 can be read, may be a part of it: then level beams
  count for nothing,
  slopes grow towards Méndez et al.'s and R² falls a little. How much depends on how far off the trees stand.
- That distance, h0, and which 42 of 96 orchards S built are not given (see headless/orchards.py for ours),
  nor whether leaves stood in the way. Ours have none.
- Méndez et al.'s two slopes have the ratio 2.99 and unequal R²; Σπdh and Σdh over the same
  internodes have the ratio
  π and equal R², as ours. So Méndez et al.'s A_PR and A_L cannot both be these sums.
- Our R² are higher; it may help that our orchards share trees, which differ in diameter and pruning only.
- A_PR and A_L count all wood, A_IM what is in sight; the more branches, the more they hide each other. So
  slopes grow with the iterations, which no one line follows."""


def print_report(found: Sequence[OrchardFinding], out: Path) -> None:
    """Print both tables and what is to be said of them."""
    first = found[0]
    print(
        f"SIMLIDAR's experiment: {len(found)} orchards, seed {first.seed}, h0 = {first.internode_m:g} m,"
        f" rays by {', '.join(sorted({row.engine for row in found}))}"
        + (f", every {first.gap + 1}th scan" if first.gap else "")
    )
    print(
        "\nTable 3, d_m = 6 mm; CPU seconds of growing, building, reading and scanning (one ray):\n"
    )
    table(
        print,
        [
            *("iterations", "trees", "branches", "S", "beams", "S"),
            *("triangles", "CPU s", "S, minutes", "beams/CPU s", "P = 2, scan: CPU s"),
        ],
        list(_table_3(found)),
    )
    print("\nRegressions through the origin, A_IM of the whole orchard:\n")
    table(print, ["fit", "beam", "slope", "S", "R²", "S"], list(_regressions(found)))
    print(f"\nThe solid beam's A_IM is {_growth(found):.2f} times that of one ray (median).\n")
    print(DISCUSSION)
    print(f"\nAll orchards: {out / 'orchards.csv'}; their trees: {out / 'trees.csv'}")


def _table_3(found: Sequence[OrchardFinding]) -> list[list[str]]:
    rows = []
    for iterations, trees, branches, beams, minutes in TABLE_3:
        for row in found:
            orchard = row.orchard
            if not orchard.in_table_3 or (row.iterations, row.trees) != (iterations, trees):
                continue
            if row.smallest_m != 0.006:
                continue
            seconds = row.build_s + row.scan_s
            rows.append(
                [
                    *(f"{iterations}", f"{trees}", f"{row.branches:,}", f"{branches:,}"),
                    *(f"{row.beams:,}", f"{beams:,}", f"{row.triangles:,}"),
                    *(f"{seconds:.2f}", f"{minutes}", f"{row.beams / row.scan_s:,.0f}"),
                    f"{row.scan_solid_s:.2f}",
                ]
            )
    return rows


def fits(found: Sequence[OrchardFinding]) -> dict[tuple[str, str], OriginLine]:
    """The lines by (what, beam): A_PR and A_L on A_IM of either beam."""
    return {
        (what, beam): line_through_origin(_column(found, beam), _column(found, what))
        for what in THEIRS
        for beam in BEAMS
    }


def _regressions(found: Sequence[OrchardFinding]) -> list[list[str]]:
    rows = []
    for (what, beam), line in fits(found).items():
        name, slope, r2 = THEIRS[what]
        rows.append(
            [
                *(f"{name} = k·A_IM", BEAMS[beam]),
                *(f"{line.slope:.4f}", f"{slope:g}", f"{line.r2:.4f}", f"{r2:.4f}"),
            ]
        )
    return rows


def draw(found: Sequence[OrchardFinding], path: Path) -> Path:
    """A_PR and A_L against A_IM: points, our lines and Méndez et al.'s."""
    figure = blank_figure((10, 4.4))
    for axes, (what, (name, theirs, _)) in zip(figure.subplots(1, 2), THEIRS.items(), strict=True):
        y = _column(found, what)
        most = max(_column(found, beam).max() for beam in BEAMS)
        ends = np.array([0.0, 1.05 * most])
        for (beam, label), colour in zip(BEAMS.items(), (BARK, RED, LEAF_GREEN), strict=True):
            x = _column(found, beam)
            line = line_through_origin(x, y)
            four = np.array([row.trees == 4 for row in found])
            axes.scatter(x[~four], y[~four], s=16, c=colour, linewidths=0)
            axes.scatter(x[four], y[four], s=22, c=colour, marker="s", linewidths=0)
            axes.plot(
                ends,
                line.slope * ends,
                c=colour,
                linewidth=1.2,
                label=f"{label}: k = {line.slope:.3g}, R² = {line.r2:.2f}",
            )
        axes.plot(ends, theirs * ends, c=FAINT, linewidth=1.6, label=f"S: k = {theirs:g}")
        axes.set_title(f"{name} against A_IM")
        axes.set_xlabel("impacted area A_IM, m²")
        axes.set_ylabel(f"{name}, m²")
        axes.set_xlim(0, ends[1])
        axes.set_ylim(0, 1.35 * y.max())  # room for the legend
        axes.legend(loc="upper left", fontsize=8, frameon=True, framealpha=1.0, edgecolor="none")
    figure.text(0.995, 0.005, "squares: four trees", ha="right", va="bottom", fontsize=7, color=INK)
    return save_figure(figure, path)


def _growth(found: Sequence[OrchardFinding]) -> float:
    return float(np.median(_column(found, "impacted_solid_m2") / _column(found, "impacted_m2")))


def _column(found: Sequence[OrchardFinding], name: str) -> np.ndarray:
    return np.array([getattr(row, name) for row in found])
