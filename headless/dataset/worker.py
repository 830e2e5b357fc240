"""Worker: holds a Blender, has it make scenes, renews it, and sets aside what cannot be made.

A job is a plain table, so that it can be sent to another machine; its result says in a word what came of it.
Everything that matters is on the disk before the result is given, so a lost result loses nothing.
"""

from __future__ import annotations

import atexit
import threading
from dataclasses import asdict
from pathlib import Path
from typing import Any

from . import disk
from .child import Child, SceneOutcome
from .plan import Recipe
from .settings import Running

TRIES = 2  # the second in a fresh process


class Worker:
    """One Blender and what it has been through."""

    def __init__(self) -> None:
        self.child = Child()
        self.renewed = 0
        self._stopped = False

    def make(self, job: dict[str, Any]) -> dict[str, Any]:
        """Make the scene of a job. ``result`` is done, failed, disk or stopped; ``why`` says what was
        wrong."""
        root, recipe, running = Path(job["root"]), job["recipe"], Running(**job["running"])
        number, threads = int(recipe["number"]), int(job["threads"])
        if threads != self.child.threads:
            self.end()
            self.child = Child(threads)
        there = disk.read_scene(root / disk.SCENES / disk.scene_name(number))
        if there is not None and there.record.get("settings") == recipe["digest"]:
            return {"result": "done", "scene": number}
        outcome = SceneOutcome("fault")
        for _ in range(TRIES):
            outcome = self.child.make(root, recipe, running.timeout, float(job["memory"]))
            if outcome.kind in ("done", "disk") or self._stopped:
                break
            self._renew()
        told = {"result": outcome.kind, "scene": number, "why": outcome.why}
        if outcome.kind == "disk":
            return told
        if self._stopped and outcome.kind != "done":
            return told | {"result": "stopped"}
        status = {
            "status": "done" if outcome.kind == "done" else "failed",
            "settings": recipe["digest"],
        }
        status |= {"kind": outcome.kind, "why": outcome.why} if outcome.kind != "done" else {}
        status |= {"seconds": outcome.wall, "cpu": outcome.seconds, "memory": outcome.memory}
        try:
            disk.write_status(root, number, status)
        except OSError as problem:
            return {"result": "disk", "scene": number, "why": str(problem)}
        grown = outcome.memory - self.child.first_memory > running.renew_grown_gb * 1e9
        if outcome.kind == "done" and (grown or self.child.scenes >= running.renew_after):
            self._renew()
        told["result"] = status["status"]
        return told | {"seconds": outcome.wall, "cpu": sum(outcome.seconds.values())}

    def stop(self) -> None:
        """Have the thread that is in ``make`` come back soon; the scene that it is at is lost."""
        self._stopped = True
        self.child.kill()

    def end(self) -> None:
        """End its Blender."""
        self.child.end()

    def _renew(self) -> None:
        self.end()
        self.renewed += 1


def job_of(
    recipe: Recipe, root: Path, running: Running, memory: float, threads: int
) -> dict[str, Any]:
    """The table that a worker is sent: a scene, where it goes, and how much it may take."""
    return {
        "root": str(root),
        "recipe": asdict(recipe),
        "running": asdict(running),
        "memory": memory,
        "threads": threads,
    }


_own = threading.local()


def work(job: dict[str, Any]) -> dict[str, Any]:
    """``Worker.make`` by the one worker of this thread; what a scheduler calls."""
    if not hasattr(_own, "worker"):
        _own.worker = Worker()
        atexit.register(_own.worker.end)
    made: dict[str, Any] = _own.worker.make(job)
    return made
