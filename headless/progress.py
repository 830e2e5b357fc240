"""Stages of a run: a line and a time each, a bar for what takes longer than a second, memory."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from forest_addon.base.progress import Progress

from .command import DoubtfulError

if TYPE_CHECKING:
    from forest_addon.sensing.audit import Audit

WIDTH = 28
MEANT = "did you mean"
BAR: dict[str, Any] = {  # shown after a second
    "total": 1,
    "delay": 1.0,
    "leave": False,
    "bar_format": "{desc:<36}{bar:20} {percentage:3.0f}%  {elapsed}, {remaining} left",
}


CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def plain(text: str) -> str:
    """A text without characters that command a terminal: they are shown escaped, as \\x1b."""
    return CONTROL.sub(lambda found: ascii(found[0])[1:-1], text)


class PlainStream:
    """A stream to which texts are written ``plain``."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write a text; returns how many of its characters were."""
        self._stream.write(plain(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class Stages:
    """Names and times the stages of a run; ``seconds`` keeps what each took, ``warnings`` what was said.

    ``found``, set within a stage, stands behind its time. verbose : say what an audit looked at as well.
    strict : a warning is an error, at the end. clock : seconds of it are told; those of a name add up.
    """

    def __init__(
        self,
        quiet: bool,
        verbose: bool = False,
        strict: bool = False,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.quiet, self.verbose, self.strict, self._clock = quiet, verbose, strict, clock
        self._doubts: list[str] = []
        self.found = ""
        self.warnings: list[str] = []
        self.seconds: dict[str, float] = {}
        self._bar: Any = None  # of the stage that runs

    @contextmanager
    def stage(self, name: str) -> Iterator[Progress]:
        """Time a stage; the block gets a function ``progress(done, total)``."""
        start, self.found = self._clock(), ""
        if self.quiet or not sys.stderr.isatty():
            yield lambda done, total: None
        else:
            from tqdm import tqdm  # here: many a series of scenes is quiet

            with tqdm(desc=f"  {plain(name)}", file=sys.stderr, **BAR) as self._bar:
                yield partial(_show, self._bar)
        took = self._clock() - start
        self.seconds[name] = self.seconds.get(name, 0.0) + took
        self.say(f"  {name:<{WIDTH}}{took:7.2f} s   {self.found}".rstrip())

    def say(self, text: str) -> None:
        """Print a line, unless quiet."""
        if not self.quiet:
            self._print(text)

    def say_audit(self, name: str, audit: Audit) -> None:
        """Say an audit; what it doubts is an error at the end."""
        if self.verbose:
            self.say(f"  {audit}")
        self._doubts += [] if audit.kept else [f"{name}: {audit}"]

    def end(self, out: Path) -> None:
        """End a run whose results are all in a folder.

        Raises
        ------
        DoubtfulError : an audit found an error beyond what was allowed, or ``strict`` and a warning.
        """
        doubtful = [*self._doubts, *(self.warnings if self.strict else ())]
        if doubtful:
            raise DoubtfulError(f"{'; '.join(doubtful)}; the results are kept in {out}")

    def tell(self, lines: Sequence[str]) -> None:
        """Print lines on what was read; one that asks for what was meant is a warning."""
        for line in lines:
            if MEANT in line:
                self.warn(line)
            else:
                self.say(f"  {line}")

    def warn(self, warning: str) -> None:
        """Print what a user would hardly want, also when quiet; each once."""
        if warning not in self.warnings:
            self.warnings.append(warning)
            self._print(f"  Warning: {warning}")

    def _print(self, text: str) -> None:
        if self._bar is not None and self._bar.last_print_t > self._bar.start_t:  # it is shown
            self._bar.clear()
        print(plain(text), file=sys.stderr, flush=True)


def _show(bar: Any, done: int, total: int) -> None:
    bar.total = total
    bar.update(done - bar.n)


@contextmanager
def hushed(*, errors: bool = False) -> Iterator[None]:
    """Keep Blender's own chatter off standard output; it is written below Python, so there.

    errors : standard error too, where an operator prints the traceback that it also raises.
    """
    sys.stdout.flush()
    streams = (1, 2) if errors else (1,)
    kept = [os.dup(stream) for stream in streams]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in streams:
        os.dup2(nowhere, stream)
    os.close(nowhere)
    try:
        yield
    finally:
        sys.stdout.flush()
        for stream, original in zip(streams, kept, strict=True):
            os.dup2(original, stream)
            os.close(original)


def peak_memory_mb() -> float | None:
    """Megabytes (2^20 bytes) of resident memory at its highest; None where the system does not tell.

    Linux hands ``ru_maxrss`` of a process on to those that it starts; the high-water mark of /proc is its
    own.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 1024
    try:
        import resource
    except ImportError:  # Windows
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1024**2 if sys.platform == "darwin" else 1024)


def held_memory(pid: int | str = "self") -> float:
    """Bytes of memory that a process holds; 0 where the system does not tell."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
        return float(pages * os.sysconf("SC_PAGE_SIZE"))
    except (OSError, ValueError, IndexError):
        return 0.0
