"""Error against seconds, one picture: ours by setting, beside what others publish or was measured of them.

Three tasks, each on its own work but with the axes shared: a million pulses at ten trees of 200,000 triangles
(first range, median error as a share of the median range), one ping at 100,000 leaves (spectrum, L2), the
sound of 100,000 trunks on 1 km² (L2). Ours are measured here, CPU seconds of one core; theirs are figures
measured on another machine or printed by their authors, and hollow. Where nobody knows an error, the mark
stands at the upper rim.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forest_addon.api import Air, Echo, Sonar

from ..inside import (
    INK,
    LEAF_GREEN,
    RED,
    LeafDiscs,
    Say,
    blank_figure,
    make_caster,
    ping,
    scan,
    stream,
)
from ..tables import table
from . import reverb
from .lidar import BEAM, FROM_OUTSIDE, ONE_THREAD, forest
from .rows import BenchRow, Rows, Told

TITLE = "frontier: all simulators, error against seconds"
ASSUMPTIONS = """\
Filled: measured by this run, CPU seconds of one core. Hollow: not by this run; crosses have no known error.
HELIOS++, BLAINDER, the codes of Tanveer et al. 2020a (under Octave, 50,000 leaves in 19.5 s, taken twice)
and of Kaneko & Gamper, and the direct sum ran on a shared two-core machine, other than this run's or at
another time; SIMLIDAR's 284 beams/s is the mean of its authors' minutes, on theirs. Trees, leaves and
trunks are as many, not the same ones: HELIOS++ scanned ten trees of 200,000 triangles, BLAINDER one tree
with its rays as pulses, SIMLIDAR its own orchard. Errors of others follow from their rounding, not from a
comparison: HELIOS++ rounds echoes to 7.49 cm, a quarter of it is the median; Kaneko & Gamper's bins of 1°
and 10 m are 2 to 6 % off. That of direct sums is rounding, about 1e-13, which is not measured either.
"""
WORDS = ASSUMPTIONS
PULSES = 1e6
SUBRAYS, MANY = (1, 7, 19, 61), 397
LEAVES, FEW, TRUNKS = 100_000, 5_000, 100_000
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
DIRECT = 1e-13  # of a direct sum, its rounding, about
STEP = 0.0749  # m, that HELIOS++ rounds echoes to


@dataclass(frozen=True)
class Mark:
    """A simulator at a setting; error is None where nobody knows it, a pair where it lies between."""

    name: str
    seconds: float
    error: float | tuple[float, float] | None
    ours: bool = False

    @property
    def height(self) -> float | None:
        """The error, of a pair its geometric mean."""
        if isinstance(self.error, tuple):
            return float(np.sqrt(self.error[0] * self.error[1]))
        return self.error


def _first_range(subrays: int) -> BenchRow:
    caster = make_caster(forest(10, 200_000), ONE_THREAD)

    def first(count: int = subrays) -> np.ndarray:
        beam = replace(BEAM, subrays=count, max_returns=15)
        cloud = scan(FROM_OUTSIDE.changed(angle_step_deg=1.5, beam=beam), caster)
        ranges = np.full(cloud.pulses, np.nan)
        leading = cloud.number == 1
        ranges[cloud.pulse[leading]] = cloud.true_range[leading]
        return ranges

    def error(found: np.ndarray) -> str:
        true = first(MANY)
        middle = np.nanmedian(true)
        return f"{np.nanmedian(np.abs(found - true)) / middle:.1e} of {middle:.2f} m"

    return BenchRow(first, error, len(first()))


def _ping(tolerance: float, leaves: int = LEAVES) -> BenchRow:
    rng = stream(4, "bench", "frontier")
    normal = rng.normal(size=(LEAVES, 3))
    every = LeafDiscs(
        centre=rng.uniform([2, -3, -3], [9, 3, 3], (LEAVES, 3)),
        normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        radius=np.full(LEAVES, 0.025),
        instance=np.zeros(LEAVES, np.int64),
        leaf=np.arange(LEAVES),
        tree=np.full(LEAVES, -1),
    )
    discs = replace(every, **{name: value[:leaves] for name, value in vars(every).items()})
    sonar = Sonar(
        position=(0, 0, 0), beam_width_deg=(90, 90), shading="none", leaf_model="paper", cull=0.0
    )

    def work(at: float = tolerance) -> Echo:
        return ping(discs, sonar.changed(tolerance=at), Air())

    def error(echo: Echo) -> str:
        exact = work(0.0).spectra
        off = np.linalg.norm(echo.spectra - exact) / np.linalg.norm(exact)
        return f"{max(off, DIRECT):.1e}"

    return BenchRow(work, error, leaves)


RAYED: Rows = {f"{n} ray{'s' * (n > 1)} a pulse": partial(_first_range, n) for n in SUBRAYS}
PINGED: Rows = {f"ping, {t:.0e}": partial(_ping, t) for t in TOLERANCES}
PINGED["ping, direct sum"] = partial(_ping, 0.0, FEW)
HEARD: Rows = {
    f"response, {t:.0e}": partial(reverb.summed, TRUNKS, reverb.RADIUS, t) for t in TOLERANCES
}
ROWS: Rows = RAYED | PINGED | HEARD


def run(say: Say, told: dict[str, Told]) -> Figure:
    """Print the marks of others, and draw all."""
    helios = STEP / 4 / float(told[next(iter(RAYED))]["error"].split()[2])
    theirs = {
        "a million pulses, ten trees": [
            Mark("HELIOS++, 1 ray", PULSES / 60e3, helios),
            Mark("HELIOS++, 19 rays", PULSES / 9e3, helios),
            Mark("BLAINDER, one tree", PULSES / 64e3, None),
            Mark("SIMLIDAR, 284 beams/s", PULSES / 284, None),
        ],
        "one ping, 100,000 leaves": [Mark("Tanveer et al. 2020a, Octave", 2 * 19.5, None)],
        "one response, 100,000 trunks": [
            Mark("direct sum in float64", 144.0, DIRECT),
            Mark("Kaneko & Gamper's code, bins of 1° and 10 m", 1.45, (0.02, 0.06)),
        ],
    }
    rows = [
        [task, mark.name, f"{mark.seconds:.3g}", _words(mark.error)]
        for task, marks in theirs.items()
        for mark in marks
    ]
    say("")
    table(say, ["task", "simulator of others", "s", "relative error"], rows)
    ours = [_marks(told, *task) for task in ((RAYED, PULSES), (PINGED, LEAVES), (HEARD, 1.0))]
    return _draw({task: [*mine, *theirs[task]] for task, mine in zip(theirs, ours, strict=True)})


def _marks(told: dict[str, Told], rows: Rows, many: float) -> list[Mark]:
    """Marks of ours, of so many things each."""
    return [
        Mark(
            f"ours, {name.rpartition(', ')[2]}",
            told[name]["next"] * many / told[name]["many"],
            float(told[name]["error"].split(";")[0].split()[0]),
            ours=True,
        )
        for name in rows
    ]


def _words(error: float | tuple[float, float] | None) -> str:
    if error is None:
        return "not known"
    return f"{error[0]:g} to {error[1]:g}" if isinstance(error, tuple) else f"{error:.1e}"


def _draw(tasks: dict[str, list[Mark]]) -> Figure:
    """A panel a task, the axes shared; names beside the marks, ours joined."""

    figure = blank_figure((13.5, 5.2))
    panels = figure.subplots(1, len(tasks), sharex=True, sharey=True)
    for panel, (task, marks) in zip(panels, tasks.items(), strict=True):
        _panel(panel, marks)
        panel.set(xscale="log", yscale="log", xlabel="seconds", title=task)
    panels[0].set_ylabel("relative error")
    panels[0].set_xlim(1e-2, 1e5)
    panels[0].set_ylim(1e-14, 3.0)
    return figure


def _panel(axes: Axes, marks: list[Mark]) -> None:

    ours = [mark for mark in marks if mark.ours]
    axes.plot([m.seconds for m in ours], [m.height for m in ours], "-", color=LEAF_GREEN, lw=1)
    unknown = 0
    for mark in marks:
        height, colour = mark.height, LEAF_GREEN if mark.ours else RED
        if height is None:
            height = 1.0 / 4**unknown
            unknown += 1
        shape = "x" if mark.height is None else "o"
        face = colour if mark.ours else "none"
        axes.plot(mark.seconds, height, shape, color=colour, mfc=face, ms=6)
        if isinstance(mark.error, tuple):
            axes.plot([mark.seconds] * 2, mark.error, color=colour, lw=1)
        words = mark.name + (" (error not known)" if mark.height is None else "")
        left = mark.seconds > 1000 or mark.height == DIRECT
        axes.annotate(
            words.removeprefix("ours, ") if mark.ours else words,
            (mark.seconds, height),
            xytext=(-7 if left else 7, 0 if mark.ours or left else 7 if mark.seconds < 50 else -7),
            textcoords="offset points",
            fontsize=7,
            color=INK,
            ha="right" if left else "left",
            va="center",
        )
