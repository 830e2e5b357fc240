"""Workers that make the scenes: threads of this process, or those of a Dask cluster.

A thread waits for a child that has Blender loaded; so workers of one machine need no scheduler and no
processes besides these children.

A scheduler only hands out jobs. What is done stands on the disk; so whatever a scheduler loses (workers that
end by walltime, tasks that it gives up after some such ends) is handed out again, as long as it goes on
finishing some. Dask's processes hold a handle on a child that has Blender loaded, never Blender itself.
"""

from __future__ import annotations

import contextlib
import importlib
import logging
import os
import queue
import shlex
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from forest_addon.base.places import environment_of_child
from forest_addon.spec import SpecError

from . import disk
from .worker import Worker, work

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
    left = deque(jobs)
    ended: queue.SimpleQueue[dict[str, Any] | Exception] = queue.SimpleQueue()
    every = [Worker() for _ in range(workers)]
    threads = [
        threading.Thread(target=_work_off, args=(worker, left, ended), daemon=True)
        for worker in every
    ]
    try:
        for thread in threads:
            thread.start()
        for _ in jobs:
            result = ended.get()
            if isinstance(result, Exception):
                raise result
            _take(result, report)
    except BaseException:  # also Ctrl-C: no scene is waited for
        left.clear()
        while any(thread.is_alive() for thread in threads):
            for worker, thread in zip(every, threads, strict=True):
                worker.stop()
                thread.join(STOPS_IN)
        for root in {job["root"] for job in jobs}:
            disk.clean(Path(root))  # of scenes that were being made
        raise
    finally:
        for worker in every:
            worker.end()


def _work_off(
    worker: Worker,
    left: deque[dict[str, Any]],
    ended: queue.SimpleQueue[dict[str, Any] | Exception],
) -> None:
    """Have a worker do jobs until none are left."""
    try:
        while True:
            try:
                job = left.popleft()
            except IndexError:
                return
            ended.put(worker.make(job))
    except Exception as problem:  # raised where it is waited for
        ended.put(problem)


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
