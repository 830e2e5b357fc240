"""Workers that make the scenes: threads of this process, or those of a Dask cluster.

A worker holds a child that has Blender loaded and never loads it itself, so workers of one machine need
no scheduler and no processes besides these children. The child is watched: it is killed when a scene
runs past its time or needs more memory than it may, renewed after a while, and a scene that it cannot
make is set aside.

A job is a plain table, so that it can be sent to another machine. A scheduler only hands out jobs. What
is done stands on the disk before a result is given; so whatever a scheduler loses (workers that end by
walltime, tasks that it gives up after some such ends) is handed out again, as long as it goes on
finishing some.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import json
import logging
import os
import queue
import shlex
import subprocess
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import IO, Any

from forest_addon.base.places import environment_of_child
from forest_addon.spec import SpecError

from ..progress import held_memory
from . import disk
from .plan import Recipe
from .settings import Running

LOOK = 0.1  # s between two looks at its memory
STARTS_IN = 300.0  # s, at most
TOLD = 300  # characters of its last words
TRIES = 2  # the second in a fresh process
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


class Worker:
    """A child that has Blender loaded, started when it is first needed, and what it has been through."""

    def __init__(self, threads: int = 1) -> None:
        self.threads = threads
        self.scenes = 0  # that its child has made
        self.first_memory = 0.0  # of its child, after the first
        self._stopped = False
        self._process: subprocess.Popen[str] | None = None
        self._answers: queue.Queue[str | None] = queue.Queue()
        self._words: IO[bytes] | None = None

    def make(self, job: dict[str, Any]) -> dict[str, Any]:
        """Make the scene of a job. ``result`` is done, failed, disk or stopped; ``why`` says what was
        wrong."""
        root, recipe, running = Path(job["root"]), job["recipe"], Running(**job["running"])
        number = int(recipe["number"])
        if int(job["threads"]) != self.threads:
            self.end()
            self.threads = int(job["threads"])
        there = disk.read_scene(root / disk.SCENES / disk.scene_name(number))
        if there is not None and there.record.get("settings") == recipe["digest"]:
            return {"result": "done", "scene": number}
        for _ in range(TRIES):
            outcome = self.scene(root, recipe, running.timeout, float(job["memory"]))
            if outcome.kind in ("done", "disk") or self._stopped:
                break
            self.end()
        done = outcome.kind == "done"
        told = {"result": outcome.kind, "scene": number, "why": outcome.why}
        if outcome.kind == "disk":
            return told
        if self._stopped and not done:
            return told | {"result": "stopped"}
        status = {"status": "done" if done else "failed", "settings": recipe["digest"]}
        status |= {} if done else {"kind": outcome.kind, "why": outcome.why}
        status |= {"seconds": outcome.wall, "cpu": outcome.seconds, "memory": outcome.memory}
        try:
            disk.write_status(root, number, status)
        except OSError as problem:
            return {"result": "disk", "scene": number, "why": str(problem)}
        grown = outcome.memory - self.first_memory > running.renew_grown_gb * 1e9
        if done and (grown or self.scenes >= running.renew_after):
            self.end()
        told |= {"result": status["status"], "seconds": outcome.wall}
        return told | {"cpu": sum(outcome.seconds.values())}

    def scene(
        self, root: Path, recipe: dict[str, Any], timeout: float, most: float
    ) -> SceneOutcome:
        """Have the child try a scene; ``most`` bytes of memory, ``timeout`` seconds."""
        if self._process is None or self._process.poll() is not None:
            problem = self.start()
            if problem:
                return SceneOutcome("crash", problem)
        assert self._process is not None
        assert self._process.stdin is not None
        started = time.monotonic()
        try:
            self._process.stdin.write(json.dumps({"root": str(root), "recipe": recipe}) + "\n")
            self._process.stdin.flush()
        except OSError:
            return self._crashed()
        answer = self._wait(started + timeout, most)
        if isinstance(answer, SceneOutcome):
            return answer
        outcome = SceneOutcome(**answer, wall=time.monotonic() - started)
        self.scenes += 1
        self.first_memory = self.first_memory or outcome.memory
        return outcome

    def start(self) -> str:
        """Start the child; returns what went wrong, empty if it is ready."""
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

    def _wait(self, deadline: float, most: float) -> dict[str, Any] | SceneOutcome:
        """Return the child's next answer, or what became of it instead; then it is dead."""
        while True:
            try:
                line = self._answers.get(timeout=LOOK)
            except queue.Empty:
                assert self._process is not None
                if time.monotonic() > deadline:
                    self.end()
                    return SceneOutcome("timeout", "ran past its time")
                if held_memory(self._process.pid) > most:
                    self.end()
                    why = f"needs more memory than it may have ({most / 1e9:.1f} GB)"
                    return SceneOutcome("memory", why)
                continue
            return self._crashed() if line is None else json.loads(line)

    def _crashed(self) -> SceneOutcome:
        """Return how the child ended, with its last words."""
        assert self._process is not None
        assert self._words is not None
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5.0)
        code = self._process.returncode
        self._words.seek(max(0, self._words.seek(0, os.SEEK_END) - 4 * TOLD))
        said = self._words.read().decode("utf-8", "replace").strip().splitlines()
        self.end()
        how = (
            f"was ended by signal {-code}"
            if code is not None and code < 0
            else f"ended with {code}"
        )
        last = f": {said[-1][-TOLD:]}" if said else ""
        return SceneOutcome("crash", f"Blender's process {how}{last}")

    def stop(self) -> None:
        """Have the thread that is in ``make`` come back soon; the scene that it is at is lost."""
        self._stopped, process = True, self._process
        if process is not None:  # its thread finds it crashed
            process.kill()

    def end(self) -> None:
        """Kill the child; a scene that it was making is lost."""
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


def _read(stream: IO[str], answers: queue.Queue[str | None]) -> None:
    with contextlib.suppress(OSError, ValueError):  # closed under us
        for line in stream:
            answers.put(line)
    answers.put(None)


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


Report = Callable[[dict[str, Any]], None]
POLL = 1.0  # s
STOPS_IN = 0.1  # s, before a worker is told once more
FRUITLESS = 5  # times that a cluster loses all that it holds, with nothing finished between
AHEAD, LEAST_AHEAD = (
    3,
    64,
)  # jobs that a scheduler holds for each thread of its workers, and at least
CAN_START_IN = 60  # s


@dataclass(frozen=True)
class Cluster:
    """Place where scenes are made: ``workers`` here; a scheduler's address; or keys and values of a batch
    system. ``make`` is what each of its workers does with a job."""

    workers: int = 0
    scheduler: str = ""
    slurm: str | None = None
    make: Callable[[dict[str, Any]], dict[str, Any]] = work

    def local_workers(self) -> int:
        """Return how many there are on this machine."""
        return self.workers or os.cpu_count() or 1


def make_all(jobs: Sequence[dict[str, Any]], cluster: Cluster, report: Report) -> None:
    """Have every job done; ``report`` is told of each, in any order.

    Raises
    ------
    SpecError : the cluster cannot be used.
    OSError : the disk is full or cannot be written to, or the scheduler went away; what is done stays.
    """
    if not jobs:
        return
    if not cluster.scheduler and cluster.slurm is None:
        _make_here(jobs, min(cluster.local_workers(), len(jobs)), report)
        return
    with _client(cluster) as client:
        _hand_out(jobs, client, cluster, report)


def _make_here(jobs: Sequence[dict[str, Any]], workers: int, report: Report) -> None:
    """Have jobs done by workers of this process, a thread each, which wait for their children."""
    idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
    every = [Worker() for _ in range(workers)]
    for worker in every:
        idle.put(worker)

    def make(job: dict[str, Any]) -> dict[str, Any]:
        worker = idle.get()
        try:
            return worker.make(job)
        finally:
            idle.put(worker)

    pool = ThreadPoolExecutor(workers)
    results = [pool.submit(make, job) for job in jobs]
    try:
        for result in as_completed(results):
            _take(result.result(), report)
    except BaseException:  # also Ctrl-C: no scene is waited for
        pool.shutdown(wait=False, cancel_futures=True)
        while not all(result.done() for result in results):
            for worker in every:
                worker.stop()
            time.sleep(STOPS_IN)
        for root in {job["root"] for job in jobs}:
            disk.clean(Path(root))  # of scenes that were being made
        raise
    finally:
        pool.shutdown()
        for worker in every:
            worker.end()


def _take(result: dict[str, Any], report: Report) -> None:
    if result["result"] == "disk":
        raise OSError(f"scene {result['scene']:06d}: {result['why']}; finished scenes are kept")
    report(result)


@contextlib.contextmanager
def _client(cluster: Cluster) -> Iterator[Any]:
    distributed = _import("distributed", "dataset")
    import dask

    # No scene is lost to the rule that a task is bad on which some workers ended: it is handed out again.
    calm = {
        "distributed.scheduler.allowed-failures": 1000,
        "distributed.comm.timeouts.connect": f"{CAN_START_IN}s",
        "distributed.admin.system-monitor.gil.enabled": False,
    }
    for name in [n for n in logging.root.manager.loggerDict if n.split(".")[0] == "distributed"]:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)  # what matters is said in a sentence
    with dask.config.set(calm), contextlib.ExitStack() as stack:
        if cluster.scheduler:
            try:
                yield stack.enter_context(
                    distributed.Client(cluster.scheduler, timeout=CAN_START_IN)
                )
            except (OSError, TimeoutError) as problem:
                raise _gone(cluster.scheduler, problem) from None
            except TypeError as problem:  # of Dask, where its settings name no certificate
                if not cluster.scheduler.startswith("tls://"):
                    raise
                why = "needs a certificate; name one in Dask's settings, distributed.comm.tls"
                raise SpecError(f"--scheduler {cluster.scheduler}", why) from problem
            return
        ours, jobs = slurm_cluster(cluster.slurm or "")
        # kept at that number: a job that ends by its walltime is followed by another
        stack.enter_context(ours).adapt(minimum_jobs=jobs, maximum_jobs=jobs)
        yield stack.enter_context(distributed.Client(ours))


def slurm_cluster(said: str) -> tuple[Any, int]:
    """A cluster of Slurm jobs from KEY=VALUE,... and how many to start, as ``jobs`` says; all else is
    dask-jobqueue's.
    """
    jobqueue = _import("dask_jobqueue", "slurm")
    keys: dict[str, Any] = {"cores": 1, "processes": 1, "memory": "8GB"}
    for pair in said.split(","):
        key, equals, value = pair.partition("=")
        if not equals:
            raise SpecError("--slurm", f'"{pair}" must be KEY=VALUE, such as partition=cpu,jobs=40')
        keys[{"partition": "queue"}.get(key.strip(), key.strip())] = value.strip()
    jobs = str(keys.pop("jobs", "1"))
    if not jobs.isdigit() or not int(jobs):
        raise SpecError("--slurm", f'jobs is "{jobs}"; give how many jobs to start')
    for key in ("cores", "processes"):
        keys[key] = int(keys[key])
    safe = environment_of_child()
    said_first = [
        f"export {key}={shlex.quote(safe[key])}" for key in ("PYTHONPATH", "PYTHONSAFEPATH")
    ]
    keys.setdefault("job_script_prologue", said_first)
    return jobqueue.SLURMCluster(**keys), int(jobs)


def _import(name: str, extra: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise SpecError(
            "dataset",
            f"{name} is not installed, which hands scenes to the workers of a cluster; install "
            f"forest-sensing[{extra}], or leave the cluster out",
        ) from None


def _gone(address: str, problem: object) -> OSError:
    return OSError(
        f"the scheduler at {address} cannot be reached ({problem}); finished scenes are kept, the same "
        "command "
        "goes on"
    )


def _hand_out(
    jobs: Sequence[dict[str, Any]], client: Any, cluster: Cluster, report: Report
) -> None:
    """Submit jobs until each has a result; a lost one is submitted again.

    The scheduler holds a few jobs for each thread of its workers, not the whole plan, and each result is
    taken as it arrives; so a scene costs the same in a plan of ten and of a hundred thousand.
    """
    address = client.scheduler.address if client.scheduler else "?"
    left = deque(jobs)
    out: dict[Any, dict[str, Any]] = {}
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    most, looked, fruitless = LEAST_AHEAD, 0.0, 0
    while left or out:
        if time.monotonic() - looked > POLL:
            most, looked = _ahead(client, address), time.monotonic()
        while left and len(out) < most:
            job = left.popleft()
            rank = -int(job["recipe"]["number"])
            future = client.submit(cluster.make, job, pure=False, retries=0, priority=rank)
            out[future] = job
            future.add_done_callback(ended.put)
        try:
            future = ended.get(timeout=POLL)
        except queue.Empty:
            continue
        job = out.pop(future)
        if future.status == "finished":
            fruitless = 0
            _take(future.result(), report)
        else:
            left.append(job)
            fruitless += 1
            if fruitless >= FRUITLESS * most:
                raise OSError(
                    f"the cluster finished none of {len(left) + len(out)} scenes; finished scenes are kept"
                )
        future.release()


def _ahead(client: Any, address: str) -> int:
    """Return how many jobs the scheduler is to hold.

    Raises
    ------
    OSError : it has gone away.
    """
    gone = _gone(address, "it has gone away")
    if client.status != "running" or not _answers(client):
        raise gone
    try:
        return max(LEAST_AHEAD, AHEAD * sum(client.nthreads().values()))
    except (OSError, TimeoutError, CancelledError):
        raise gone from None


def _answers(client: Any) -> bool:
    """Return whether the scheduler is still there."""
    stream = getattr(client, "scheduler_comm", None)
    return stream is not None and not stream.comm.closed()
