"""Rows of the benchmarks: a job each, timed cold and warm, by the library of kernels and by numpy.

Each job runs in a process of its own with one thread, where nothing is kept that another made: the first
call is cold, imports that it needs within. Later calls alternate between library and numpy; times are the
medians of their CPU time. What is long is called twice, by the library alone. Beside the times stands how
far off the result of either way is, by a reference that uses neither. Peak memory is the process's.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from statistics import median
from typing import Any

from ..inside import (
    KERNELS_SWITCH,
    Say,
    environment_of_child,
    kernel_engine,
    peak_memory_mb,
)
from ..tables import say_row, table, timed

RUNS, LONG = 3, 3.0  # calls by each way; CPU seconds of a call from which on it is not repeated
HEAD = ("job", "how many", "first, ms", "next, ms", "on the clock, ms", "a second", "by numpy, ms")
ERRORS = ("error", "error by numpy", "peak, MB")


def _nothing(_: Any) -> str:
    return ""


@dataclass(frozen=True)
class BenchRow:
    """A job that is prepared: its work, the error of what it gives, and of how many things it is."""

    work: Callable[[], Any]
    error: Callable[[Any], str] = _nothing
    many: int = 1


Rows = dict[str, Callable[[], BenchRow]]  # by name; each is prepared in its own process


Told = dict[str, Any]  # of a row: CPU seconds, errors in words, MB


def say_rows(say: Say, section: str, names: Iterable[str]) -> dict[str, Told]:
    """Print the table of some rows of a section, one by one; what each took by its name."""
    if kernel_engine() != "C":
        say(f"Both ways are computed by {kernel_engine()}\n")
    table(say, [*HEAD, *ERRORS], [])
    every = {}
    for name in names:
        told = every[name] = measured(section, name)
        took = (told["first"], told["next"], told["clock"], told["numpy"])
        first, again, clock, numpy = (_figure(1e3 * s) if s else "-" for s in took)
        speed = _figure(told["many"] / told["next"]) if told["next"] else "-"
        errors = [told["error"] or "-", told["numpy_error"] or "-"]
        errors[1] = "the same" if errors[1] == errors[0] != "-" else errors[1]
        many = f"{told['many']:,}"
        say_row(
            say, [name, many, first, again, clock, speed, numpy, *errors, f"{told['peak']:.0f}"]
        )
    return every


def _figure(value: float) -> str:
    return f"{value:,.0f}" if value >= 100 else f"{value:.3g}"


def measured(section: str, name: str) -> Told:
    """Measure one row in a process of its own.

    Raises
    ------
    OSError : it ended without a figure; its words stand above.
    """
    environment = environment_of_child(OMP_NUM_THREADS="1")
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # compiled once, as where it is installed
    command = [sys.executable, "-m", __name__, section, name]
    ended = subprocess.run(command, stdout=subprocess.PIPE, text=True, env=environment)
    if ended.returncode:
        raise OSError(f'bench {section}, "{name}" ended with {ended.returncode}; why stands above')
    return json.loads(ended.stdout.splitlines()[-1])


def _measure(section: str, name: str) -> Told:
    """Measure one row in this process."""
    row = import_module(f"{__package__}.{section}").ROWS[name]()
    _, first = timed(row.work)
    peak = peak_memory_mb() or 0.0
    found: dict[bool, Any] = {}
    found[True], again = timed(row.work)
    taken, clocks = {True: [again], False: list[float]()}, []
    for by_library in (False, True) * (0 if again > LONG else RUNS):
        with _kernels(by_library):
            begin = time.perf_counter()
            found[by_library], seconds = timed(row.work)
            taken[by_library].append(seconds)
            clocks.append(time.perf_counter() - begin if by_library else float("inf"))
    errors = {by_library: row.error(result) for by_library, result in found.items()}
    return {
        "many": row.many,
        "first": first,
        "next": median(taken[True]),
        "clock": min(clocks, default=None),
        "numpy": median(taken[False]) if taken[False] else None,
        "error": errors[True],
        "numpy_error": errors.get(False, ""),
        "peak": peak,
    }


@contextmanager
def _kernels(on: bool) -> Iterator[None]:
    """Have the library compute, or numpy."""
    before = os.environ.pop(KERNELS_SWITCH, None)
    if not on:
        os.environ[KERNELS_SWITCH] = "off"
    try:
        yield
    finally:
        os.environ.pop(KERNELS_SWITCH, None)
        if before is not None:
            os.environ[KERNELS_SWITCH] = before


if __name__ == "__main__":
    print(json.dumps(_measure(*sys.argv[1:])))
