"""Timings and tables of the studies: the median CPU time of some work, rows as Markdown."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence

from forest_addon.base.progress import Say


def median_seconds(work: Callable[[], object], runs: int = 3) -> float:
    """Median CPU seconds of this thread over several runs."""
    taken = []
    for _ in range(runs):
        start = time.thread_time()
        work()
        taken.append(time.thread_time() - start)
    return statistics.median(taken)


def table(say: Say, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a Markdown table."""
    say("| " + " | ".join(head) + " |")
    say("|" + "---|" * len(head))
    for row in rows:
        say("| " + " | ".join(row) + " |")
