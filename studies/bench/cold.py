"""The first small call of a fresh process: what imports take, the call with nothing kept, and the next one.

Each job prepares itself without the code that it measures, and is called twice. Its error is against what
is exact: the expected number of points, the spacing asked for, the sum over all leaves at all frequencies,
the cones of a skeleton.
"""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..inside import Say
from ..tables import fresh, table

Job = tuple[
    Callable[[], object], Callable[[object], str]
]  # the call, and the error of what it gave


def say_cold(say: Say, section: str) -> None:
    """Print the table of a section's small jobs."""
    say(
        "\nA small call, cold: a fresh process with nothing kept; CPU time, imports counted apart\n"
    )
    rows = []
    for name in JOBS[section]:
        rows.append([name, *fresh(__name__, section, name).split(";")])
    table(say, ["job", "imports, s", "first call, ms", "next, ms", "error"], rows)


def measure(section: str, name: str) -> None:
    """Print one row; to be called in a process that has imported nothing yet."""
    call, error = JOBS[section][name]()
    start = time.process_time()
    returned = call()
    first = time.process_time()
    call()
    last = time.process_time()
    print(f"{start:.2f};{1e3 * (first - start):.1f};{1e3 * (last - first):.1f};{error(returned)}")


def _points() -> Job:
    from ..inside import Process, sample, stream
    from .intensities import KINDS, SIDE

    process = Process(KINDS["wide hills, thinned"](), np.zeros(2), np.full(2, SIDE))
    process = process.scaled(1000 / process.expected)

    def error(points: Any) -> str:
        return f"{(len(points) - 1000) / np.sqrt(1000):+.1f} σ of the count"

    return lambda: sample(process, stream(2, "bench", "cold")), error


def _spaced() -> Job:
    from scipy.spatial import cKDTree

    from ..inside import Spacing, greedy, stream

    rng = stream(4, "bench", "cold")
    points, mark, distance = rng.uniform(0, 100, (1000, 2)), rng.random(1000), 2.0

    def error(keep: Any) -> str:
        nearest = cKDTree(points[keep]).query(points[keep], 2)[0][:, 1]
        return f"{max(0.0, distance - float(nearest.min())):.0e} m too near"

    spacing = Spacing(np.array([[distance]]), np.zeros(1000, dtype=int), np.zeros(1000))
    return lambda: greedy(points, mark, spacing), error


def _tree(species: str) -> Callable[[], Job]:
    def job() -> Job:
        from ..inside import find_species, grow, load_species, stream

        found = load_species(find_species(species, Path()))

        def call() -> object:
            return grow(*found, stream(5, "bench", "cold"))

        def error(tree: Any) -> str:
            from ..inside import wood_of_mesh, wood_of_skeleton

            if tree.grafted:
                return "-"
            off = wood_of_mesh(tree.mesh).area / wood_of_skeleton(tree.skeleton).area - 1
            return f"{100 * off:+.2f} % of the wood's surface"

        return call, error

    return job


def _echo(model: str, count: int) -> Callable[[], Job]:
    def job() -> Job:
        kernel = importlib.import_module(".sonar_sum", __package__)
        leaves = kernel._Leaves.random(model, count, "spread")
        start, spacing, bins = kernel.START, kernel.SPACING, kernel.BINS

        def error(found: Any) -> str:
            exact = leaves.sum(0.0, start, spacing, bins)
            gap = np.abs(found.spectrum - exact.spectrum).max()
            return f"{gap / exact.size:.0e} of Σ|A|"

        return lambda: leaves.sum(1e-5, start, spacing, bins), error

    return job


JOBS: dict[str, dict[str, Callable[[], Job]]] = {
    "growth": {"a tree by its grammar": _tree("ginkgo"), "a maple from templates": _tree("maple")},
    "stand": {"1,000 points on hills": _points, "spacing of 1,000 points": _spaced},
    "sonar": {
        "echo of 100 leaves, paper's model": _echo("paper", 100),
        "echo of 100 leaves, exact disc": _echo("exact", 100),
    },
}

if __name__ == "__main__":
    measure(*sys.argv[1:])
