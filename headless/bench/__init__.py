"""``python -m headless bench``: time and error side by side, printed as tables.

Each section is a module with ``TITLE`` and ``run(say)``, which may give back a picture; it measures CPU
time of one core (the median of several runs) against an exact reference, and says both in one row.
Nothing is asserted here.
"""

from __future__ import annotations

import importlib
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path

SECTIONS = ("growth", "stand", "lidar", "sonar", "reverb", "flight")

Say = Callable[[str], None]


def run(names: Sequence[str], folder: Path) -> None:
    """Run sections in order, print their tables, draw their pictures into a folder."""
    from ..report.pictures import save_figure

    for name in names or SECTIONS:
        section = importlib.import_module(f".{name}", __name__)
        print(f"\n## {section.TITLE}\n", flush=True)
        figure = section.run(lambda text: print(text, flush=True))
        if figure is not None:
            folder.mkdir(parents=True, exist_ok=True)
            print(f"\nDrawn in {save_figure(figure, folder / f'{name}.png')}", flush=True)


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
