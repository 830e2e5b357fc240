"""Timings and tables of the studies: CPU time of some work, rows as Markdown."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

from .inside import Say, write_csv


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


def write_rows(path: Path, rows: Iterable[Any]) -> None:
    """Write rows, of the same names or of one dataclass, as CSV."""
    kept = [asdict(row) if is_dataclass(row) else row for row in rows]
    write_csv(path, {name: [row[name] for row in kept] for name in kept[0]})
