"""Timings and tables of the studies: CPU time of some work, rows as Markdown."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from .inside import Say


def timed(work: Callable[..., Any], *given: Any, **named: Any) -> tuple[Any, float]:
    """Result of work on its arguments, and the CPU seconds of all threads that it took."""
    start = time.process_time()
    found = work(*given, **named)
    return found, time.process_time() - start


def table(say: Say, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a Markdown table."""
    say_row(say, head)
    say("|" + "---|" * len(head))
    for row in rows:
        say_row(say, row)


def say_row(say: Say, row: Sequence[str]) -> None:
    """Print one row of it."""
    say("| " + " | ".join(row) + " |")
