"""A handle on the process that has Blender loaded: start it, have it make a scene, end it.

Whoever holds the handle never loads Blender. The child is watched while it works: it is killed when a scene
runs past its time or needs more memory than it may, and what came of a scene is told in one ``SceneOutcome``.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from forest_addon.base.places import environment_of_child

LOOK = 0.1  # s between two looks at its memory
STARTS_IN = 300.0  # s, at most
TOLD = 300  # characters of its last words
TRIMS = "MALLOC_TRIM_THRESHOLD_"  # that Dask sets for its workers: scenes took a fifth longer


@dataclass(frozen=True)
class SceneOutcome:
    """Outcome of a scene: ``kind`` is done, or why it was not: settings, fault, disk, memory, timeout, crash.

    seconds : CPU time of each stage. wall : seconds. memory, peak : bytes that the process held afterwards,
    and at most.
    """

    kind: str
    why: str = ""
    seconds: dict[str, float] = field(default_factory=dict)
    wall: float = 0.0
    memory: float = 0.0
    peak: float = 0.0


class Child:
    """The process, started when it is first needed."""

    def __init__(self, threads: int = 1) -> None:
        self.threads = threads
        self.scenes = 0  # that it has made
        self.first_memory = 0.0  # after the first
        self._process: subprocess.Popen[str] | None = None
        self._answers: queue.Queue[str | None] = queue.Queue()
        self._words: IO[bytes] | None = None

    def make(self, root: Path, recipe: dict[str, Any], timeout: float, most: float) -> SceneOutcome:
        """Have a scene made; ``most`` bytes of memory, ``timeout`` seconds."""
        if self._process is None or self._process.poll() is not None:
            problem = self._start()
            if problem:
                return SceneOutcome("crash", problem)
        started = time.monotonic()
        try:
            self._send({"root": str(root), "recipe": recipe})
        except OSError:
            return self._crashed()
        answer = self._wait(started + timeout, most)
        wall = time.monotonic() - started
        if isinstance(answer, SceneOutcome):
            return answer
        memory, peak = float(answer.get("memory", 0.0)), float(answer.get("peak", 0.0))
        self.scenes += 1
        self.first_memory = self.first_memory or memory
        if "done" in answer:
            return SceneOutcome("done", "", answer["seconds"], wall, memory, peak)
        return SceneOutcome(str(answer["failed"]), str(answer["why"]), {}, wall, memory)

    def _start(self) -> str:
        """Start it; returns what went wrong, empty if it is ready."""
        self.end()
        one = "1"  # small matrices; and the same sums everywhere
        environment = environment_of_child(OPENBLAS_NUM_THREADS=one, OMP_NUM_THREADS=one)
        environment.pop(TRIMS, None)
        self._words = tempfile.TemporaryFile()  # noqa: SIM115 - it lives as long as the process
        self._process = subprocess.Popen(
            [sys.executable, "-m", f"{__package__}.maker", str(self.threads)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._words,
            text=True,
            encoding="utf-8",
            env=environment,
            start_new_session=os.name != "nt",  # Ctrl-C is for the command, which ends us
        )
        self._answers, self.scenes, self.first_memory = queue.Queue(), 0, 0.0
        threading.Thread(
            target=_read, args=(self._process.stdout, self._answers), daemon=True
        ).start()
        ready = self._wait(time.monotonic() + STARTS_IN, float("inf"))
        return ready.why if isinstance(ready, SceneOutcome) else ""

    def _send(self, what: dict[str, Any]) -> None:
        assert self._process is not None
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(what) + "\n")
        self._process.stdin.flush()

    def _wait(self, deadline: float, most: float) -> dict[str, Any] | SceneOutcome:
        """Its next answer, or what became of it instead; then it is dead."""
        while True:
            try:
                line = self._answers.get(timeout=LOOK)
            except queue.Empty:
                if time.monotonic() > deadline:
                    self.end()
                    return SceneOutcome("timeout", "ran past its time")
                held = self.memory()
                if held > most:
                    self.end()
                    return SceneOutcome(
                        "memory", f"needs more memory than it may have ({most / 1e9:.1f} GB)"
                    )
                continue
            return self._crashed() if line is None else json.loads(line)

    def _crashed(self) -> SceneOutcome:
        assert self._process is not None
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5.0)
        code, said = self._process.returncode, self._last_words()
        self.end()
        how = (
            f"was ended by signal {-code}"
            if code is not None and code < 0
            else f"ended with {code}"
        )
        return SceneOutcome("crash", f"Blender's process {how}" + (f": {said}" if said else ""))

    def _last_words(self) -> str:
        if self._words is None:
            return ""
        self._words.seek(0, os.SEEK_END)
        self._words.seek(max(0, self._words.tell() - 4 * TOLD))
        lines = self._words.read().decode("utf-8", "replace").strip().splitlines()
        return lines[-1][-TOLD:] if lines else ""

    def memory(self) -> float:
        """Bytes that it holds; 0 where the system does not tell."""
        if self._process is None:
            return 0.0
        try:
            pages = int(Path(f"/proc/{self._process.pid}/statm").read_text().split()[1])
            return float(pages * os.sysconf("SC_PAGE_SIZE"))
        except (OSError, ValueError, IndexError):
            return 0.0

    @property
    def pid(self) -> int | None:
        """Of the process, None where there is none."""
        return None if self._process is None else self._process.pid

    def kill(self) -> None:
        """Kill the process while another thread waits for its answer, which then finds it crashed."""
        process = self._process
        if process is not None:
            process.kill()

    def end(self) -> None:
        """Kill it; a scene that it was making is lost."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                with contextlib.suppress(OSError):
                    if stream is not None:
                        stream.close()
        if self._words is not None:
            self._words.close()
            self._words = None


def _read(stream: IO[str] | None, answers: queue.Queue[str | None]) -> None:
    try:
        for line in stream or ():
            answers.put(line)
    except (OSError, ValueError):  # closed under us
        pass
    answers.put(None)
