"""Timings and tables of the studies: CPU time of some work, work in a fresh process, rows as Markdown."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from .inside import Say, environment_of_child


def median_seconds(work: Callable[[], object], runs: int = 3) -> float:
    """Median CPU seconds of this thread over several runs."""
    taken = []
    for _ in range(runs):
        start = time.thread_time()
        work()
        taken.append(time.thread_time() - start)
    return statistics.median(taken)


def timed(work: Callable[..., Any], *given: Any, **named: Any) -> tuple[Any, float]:
    """Result of work on its arguments, and the CPU seconds of all threads that it took."""
    start = time.process_time()
    found = work(*given, **named)
    return found, time.process_time() - start


def fresh(module: str, *words: str) -> str:
    """Return the last line that a module prints in a process of its own, with one thread."""
    command = [sys.executable, "-m", module, *words]
    one = environment_of_child(OMP_NUM_THREADS="1")
    ended = subprocess.run(command, capture_output=True, text=True, check=True, env=one)
    return ended.stdout.splitlines()[-1]


def table(say: Say, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a Markdown table."""
    say("| " + " | ".join(head) + " |")
    say("|" + "---|" * len(head))
    for row in rows:
        say("| " + " | ".join(row) + " |")
