"""Error against seconds, one picture: ours by setting, beside what others publish or was measured of them.

Three tasks, each on its own work but with the axes shared: a million pulses at ten trees of 200,000 triangles
(first range, median error as a share of the median range), one ping at 100,000 leaves (spectrum, L2), the
sound of 100,000 trunks on 1 km² (L2). Ours are measured here, CPU seconds of one core; theirs are figures
measured on another machine or printed by their authors, and hollow. Where nobody knows an error, the mark
stands at the upper rim.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from forest_addon.api import Air, Sonar, Terrestrial

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
from ..tables import median_seconds, table
from . import reverb as reverb
from .lidar import BEAM, ONE_THREAD, forest

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
PULSES = 1e6
SUBRAYS, MANY = (1, 7, 19, 61), 397
LEAVES, TRUNKS, RATE = 100_000, 100_000, 24e3
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


def run(say: Say) -> Figure:
    """Print all marks and draw them; about a minute."""
    tasks = {
        "a million pulses, ten trees": _lidar(),
        "one ping, 100,000 leaves": _sonar(),
        "one response, 100,000 trunks": _reverb(),
    }
    rows = [
        [
            task,
            mark.name,
            f"{mark.seconds:.3g}",
            _words(mark.error),
            "here" if mark.ours else "theirs",
        ]
        for task, marks in tasks.items()
        for mark in marks
    ]
    say(ASSUMPTIONS)
    table(say, ["task", "simulator", "s", "relative error", "measured"], rows)
    return _draw(tasks)


def _lidar() -> list[Mark]:
    caster = make_caster(forest(10, 200_000), ONE_THREAD)
    scanner = Terrestrial(
        position=(-5.0, -5.0, 1.6),
        azimuth_deg=(20.0, 70.0),
        elevation_deg=(0.0, 40.0),
        angle_step_deg=1.5,
    )

    def first(subrays: int) -> np.ndarray:
        cloud = scan(replace(scanner, beam=replace(BEAM, subrays=subrays, max_returns=15)), caster)
        ranges = np.full(cloud.pulses, np.nan)
        leading = cloud.number == 1
        ranges[cloud.pulse[leading]] = cloud.true_range[leading]
        return ranges

    true = first(MANY)
    middle = float(np.nanmedian(true))
    marks = []
    for subrays in SUBRAYS:
        error = float(np.nanmedian(np.abs(first(subrays) - true))) / middle
        seconds = median_seconds(lambda n=subrays: first(n), runs=1) * PULSES / len(true)
        marks.append(
            Mark(f"ours, {subrays} ray{'s' * (subrays > 1)} a pulse", seconds, error, ours=True)
        )
    return [
        *marks,
        Mark("HELIOS++, 1 ray", PULSES / 60e3, STEP / 4 / middle),
        Mark("HELIOS++, 19 rays", PULSES / 9e3, STEP / 4 / middle),
        Mark("BLAINDER, one tree", PULSES / 64e3, None),
        Mark("SIMLIDAR, 284 beams/s", PULSES / 284, None),
    ]


def _sonar() -> list[Mark]:
    rng = stream(4, "bench", "frontier")
    normal = rng.normal(size=(LEAVES, 3))
    discs = LeafDiscs(
        centre=rng.uniform([2, -3, -3], [9, 3, 3], (LEAVES, 3)),
        normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
        radius=np.full(LEAVES, 0.025),
        instance=np.zeros(LEAVES, np.int64),
        leaf=np.arange(LEAVES),
        tree=np.full(LEAVES, -1),
    )
    sonar = Sonar(
        position=(0, 0, 0), beam_width_deg=(90, 90), shading="none", leaf_model="paper", cull=0.0
    )
    some = replace(discs, **{name: value[:5000] for name, value in vars(discs).items()})
    few = median_seconds(lambda: ping(some, sonar.changed(tolerance=0.0), Air()), runs=1)
    exact = ping(discs, sonar.changed(tolerance=0.0), Air())
    marks = []
    for tolerance in TOLERANCES:
        at = sonar.changed(tolerance=tolerance)
        apart = np.linalg.norm(ping(discs, at, Air()).spectra - exact.spectra)
        error = float(apart / np.linalg.norm(exact.spectra))
        seconds = median_seconds(lambda s=at: ping(discs, s, Air()), runs=2)
        marks.append(Mark(f"ours, {tolerance:.0e}", seconds, error, ours=True))
    return [
        *marks,
        Mark("ours, direct sum", few * LEAVES / 5000, DIRECT, ours=True),
        Mark("Tanveer et al. 2020a, Octave", 2 * 19.5, None),
    ]


def _reverb() -> list[Mark]:
    paths = reverb._forest(TRUNKS, 10.0)
    exact = reverb._Exact(paths, RATE, 16)
    rows = [reverb._row(paths, RATE, exact, tolerance) for tolerance in TOLERANCES]
    ours = [
        Mark(f"ours, {t}", float(ms) / 1e3, float(error), ours=True) for t, ms, error, _ in rows
    ]
    return [
        *ours,
        Mark("direct sum in float64", 144.0, DIRECT),
        Mark("Kaneko & Gamper's code, bins of 1° and 10 m", 1.45, (0.02, 0.06)),
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
