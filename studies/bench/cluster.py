"""A dataset of 10,000 scenes by a Dask cluster whose workers only wait: cost of handing out, loss of workers.

A simulated scene waits as long as its seed says, a few for ten times as long, and leaves a small file in the
folder of the dataset as a real one does. Its workers are processes with many threads, on this machine; a
quarter of them is killed when a third of the scenes is done, and the command that hands out is ended and
given again at two thirds. Plan, engine, folders and manifest are those of ``headless dataset``.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..inside import (
    PLANS,
    Cluster,
    Plan,
    Recipe,
    Say,
    SceneJob,
    SceneOutcome,
    disk,
    environment_of_child,
    make_scenes,
    read_plan,
    recipes,
    stream,
)
from ..tables import table

TITLE = "cluster: handing out 10,000 scenes, and loss of a quarter of the workers"
TRIALS = ((1_000, False), (10_000, True))  # scenes, and whether something is lost
PROCESSES, THREADS, MEAN = 8, 8, 1.2  # s of a scene
WAIT = "FOREST_SIMULATED_WAIT"  # s, mean of a simulated scene; workers read it when they start
STRAGGLERS, SLOWER, SPREAD = 0.01, 10.0, 0.5  # share, times as long; of the logarithm of the others
MADE, LINE = "made.txt", 10  # a line of so many bytes for each time that a scene was finished
LONGEST = 3600.0  # s


@dataclass(frozen=True)
class ClusterTrial:
    """Outcome of a trial: ``waited`` seconds of all scenes, ``wall`` from the first to the last of them, CPU
    seconds of ``command`` and ``scheduler``, scenes that were finished ``twice``, the manifest's rows.
    """

    waited: float
    wall: float
    command: float
    scheduler: float
    twice: int
    rows: list[dict[str, Any]]


class CommandEndedError(Exception):
    """End of the command in the middle of the dataset."""


def run(say: Say, _: object) -> None:
    """Print the overhead a scene, without losses and with them."""
    head = ["scenes", "workers", "mean scene, s", "lost", "done", "made twice"]
    cost = ["plan, ms a scene", "command, ms", "scheduler, ms", "overhead"]
    kept = ["wall, s", "of the workers' time in scenes"]
    rows = []
    for scenes, loss in TRIALS:
        began = time.process_time()
        planned = read_plan(PLANS / "tiny.toml", [f"count={scenes}"])
        wanted = recipes(planned)
        each = {"plan": time.process_time() - began}
        with tempfile.TemporaryDirectory() as folder:
            found = trial(Path(folder), (planned, wanted), (PROCESSES, THREADS), MEAN, loss)
        each |= {"command": found.command, "scheduler": found.scheduler}
        done = sum(row["status"] == "done" for row in found.rows)
        row = [f"{scenes:,}", f"{PROCESSES} x {THREADS}", f"{found.waited / scenes:.2f}"]
        row += ["a quarter at 1/3, the command at 2/3" if loss else "none", f"{done:,}"]
        row += [f"{found.twice:,}", *(f"{took / scenes * 1e3:.1f}" for took in each.values())]
        row += [f"{sum(each.values()) / found.waited:.1%}", f"{found.wall:.0f}"]
        rows.append([*row, f"{found.waited / (found.wall * PROCESSES * THREADS):.0%}"])
    table(say, [*head, *cost, *kept], rows)
    say("")
    say(
        "Overhead: CPU seconds of plan, command and scheduler over the seconds that scenes take; one of "
        "`lidar-plots` as shipped takes a hundred times as long. Of the workers' time: killed ones "
        "count to the end; workers, command and scheduler share the cores of this machine."
    )


def trial(
    folder: Path,
    planned: tuple[Plan, Sequence[Recipe]],
    workers: tuple[int, int],
    mean: float,
    loss: bool,
) -> ClusterTrial:
    """Make a dataset of simulated scenes.

    folder : an empty one. planned : a plan and its recipes. workers : processes and threads of each.
    mean : seconds of a scene. loss : whether a quarter of the processes is killed at a third of the scenes,
    and the command ended and given again at two thirds.
    """
    plan, wanted = planned
    out, scenes = folder / "data", len(wanted)
    with simulated_cluster(folder, workers, mean) as (address, processes, scheduler):
        cluster = Cluster(scheduler=address, make=simulate)
        began, cpu = time.monotonic(), time.process_time()
        if loss:
            lost = processes[: -(-len(processes) // 4)]
            watch = threading.Thread(target=_lose, args=(out, scenes, lost))
            watch.start()
            with contextlib.suppress(CommandEndedError), _ends_at(signal.SIGUSR1):
                make_scenes(plan, wanted, wanted, out, cluster, quiet=True)
            watch.join()
        there = {one.number for one in disk.scenes_done(out)}
        missing = [recipe for recipe in wanted if recipe.number not in there]
        rows = make_scenes(plan, wanted, missing, out, cluster, quiet=True)
        wall, command = time.monotonic() - began, time.process_time() - cpu
        waited = sum(seconds_of(recipe.seed, mean) for recipe in wanted)
        return ClusterTrial(
            waited, wall, command, _cpu_of(scheduler), _finished(out) - scenes, rows
        )


def _lose(out: Path, scenes: int, workers: Sequence[subprocess.Popen[bytes]]) -> None:
    """Kill some workers at a third of the scenes, end the command by a signal at two thirds."""
    _wait_for(lambda: _finished(out) >= scenes // 3)
    for worker in workers:
        worker.kill()
    _wait_for(lambda: _finished(out) >= 2 * scenes // 3)
    os.kill(os.getpid(), signal.SIGUSR1)


@contextlib.contextmanager
def _ends_at(number: signal.Signals) -> Iterator[None]:
    """A signal ends what the main thread does within; Ctrl-C stays the user's."""

    def end(*_: object) -> None:
        raise CommandEndedError

    before = signal.signal(number, end)
    try:
        yield
    finally:
        signal.signal(number, before)


def _wait_for(happened: Callable[[], bool]) -> None:
    deadline = time.monotonic() + LONGEST
    while not happened():
        if time.monotonic() > deadline:
            raise TimeoutError("the simulated cluster stands still")
        time.sleep(0.05)


def _finished(out: Path) -> int:
    """Number of times that a scene was finished; one that two workers made counts twice."""
    made = out / MADE
    return made.stat().st_size // LINE if made.is_file() else 0


def _cpu_of(process: subprocess.Popen[bytes]) -> float:
    times = importlib.import_module("psutil").Process(process.pid).cpu_times()  # comes with Dask
    return float(times.user + times.system)


@contextlib.contextmanager
def simulated_cluster(
    folder: Path, wanted: tuple[int, int], mean: float
) -> Iterator[tuple[str, list[subprocess.Popen[bytes]], subprocess.Popen[bytes]]]:
    """Scheduler and workers as processes of their own, as ``dask scheduler`` and ``dask worker`` start them.

    wanted : workers and threads of each. Gives the address, the workers and the scheduler; all end with the
    context.
    """
    file = folder / "scheduler.json"
    environment = environment_of_child(**{WAIT: str(mean)})

    def start(kind: str, *words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *words, "--no-dashboard"]
        command += ["--scheduler-file", str(file)]
        none = subprocess.DEVNULL
        return subprocess.Popen(command, env=environment, cwd=folder, stdout=none, stderr=none)

    with contextlib.ExitStack() as stack:

        def until_the_end(process: subprocess.Popen[bytes]) -> subprocess.Popen[bytes]:
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        scheduler = until_the_end(start("scheduler", "--host", "127.0.0.1", "--port", "0"))
        _wait_for(lambda: file.is_file() and file.read_text().rstrip().endswith("}"))
        once = ("--no-nanny", "--nthreads", str(wanted[1]), "--memory-limit", "0")
        workers = [until_the_end(start("worker", *once)) for _ in range(wanted[0])]
        address = json.loads(file.read_text())["address"]
        with importlib.import_module("distributed").Client(address) as client:
            client.wait_for_workers(wanted[0])
        yield address, workers, scheduler


def seconds_of(seed: int, mean: float) -> float:
    """Seconds that a simulated scene takes: log-normal about a mean, one of a hundred ten times as long."""
    rng = stream(seed, "simulated")
    usual = mean / (1 + STRAGGLERS * (SLOWER - 1))
    drawn = usual * rng.lognormal(-0.5 * SPREAD**2, SPREAD)
    return float(drawn * (SLOWER if rng.random() < STRAGGLERS else 1.0))


def simulate(job: SceneJob) -> SceneOutcome:
    """Make a simulated scene: wait, then leave a folder with its record, as a worker does."""
    recipe, root, number = job.recipe, job.root, job.recipe.number
    seconds = seconds_of(recipe.seed, float(os.environ[WAIT]))
    if disk.read_scene(root / disk.SCENES / recipe.name) is not None:
        return SceneOutcome("done", scene=number)
    partial = disk.begin(root, number)
    time.sleep(seconds)
    (partial / "waited.txt").write_text(f"{seconds:.6f}\n")
    facts = {"split": recipe.split, "seed": recipe.seed, "trees": 0, "points": {}}
    facts |= {"scene": number, "base": recipe.base, "settings": recipe.digest}
    disk.finish(partial, root, facts)
    with open(root / MADE, "ab", buffering=0) as made:
        made.write(f"{number:{LINE - 1}d}\n".encode())
    return SceneOutcome("done", scene=number)
