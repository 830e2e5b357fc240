"""Workers that make scenes of a dataset or tiles of a field: threads of this process, or of a Dask cluster.

A worker holds a process that has Blender loaded and does one job after the other, as a pipe brings them; the
worker never loads Blender itself. It watches its process: a job that runs past its time or needs more
memory than it may is ended with it; one that can be cut is done in smaller parts, and what cannot be made is
set aside. The process is renewed after a while, and ends with whoever started it, however that comes.

A scheduler only hands out jobs. What is done stands on the disk before a result is given; so whatever a
scheduler loses (workers that end by walltime, tasks that it gives up after some such ends) is handed out
again, as long as it goes on finishing some.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import gc
import importlib
import logging
import multiprocessing
import os
import queue
import shlex
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field, replace
from importlib.machinery import PathFinder
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import module_from_spec
from multiprocessing.connection import Connection
from pathlib import Path
from types import ModuleType
from typing import Any

from forest_addon.base.places import environment_of_child
from forest_addon.spec import SpecError

from ..command import fault_of, is_told
from ..progress import held_memory, peak_memory_mb
from . import disk
from .plan import Recipe
from .settings import Running

LOOK = 0.1  # s between two looks at its memory
STARTS_IN = 300.0  # s, at most
TOLD = 300  # characters of its last words
TRIES = 2  # the second in a fresh process
TRIMS = "MALLOC_TRIM_THRESHOLD_"  # that Dask sets for its workers: scenes took a fifth longer
# What no further scene would survive either; without a number: a writer that left no file.
DISK = (
    *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.EIO),
    *(errno.EFBIG, None),
)


class WorkerJob:
    """Work of one process, and how much it may take: bytes of memory, threads that cast rays.

    number : of the job; the lowest are done first. name : of what it makes, in messages.
    """

    running: Running
    memory: float
    threads: int
    number: int
    name: str

    def is_done(self) -> bool:
        """Return whether another worker has finished it meanwhile; False: that is not known."""
        return False

    def make(self, session: Any) -> dict[str, float]:
        """Do it, in a process with Blender; returns CPU seconds of each stage."""
        raise NotImplementedError

    def note(self, outcome: SceneOutcome) -> None:
        """Write down how it went, where what is made does not say so itself."""

    def smaller(self) -> WorkerJob | None:
        """Return the same work in parts that need less memory; None: it cannot be cut."""


@dataclass(frozen=True)
class SceneJob(WorkerJob):
    """A scene of the dataset in the folder ``root``, as a ``WorkerJob``."""

    root: Path
    recipe: Recipe
    running: Running
    memory: float
    threads: int

    @property
    def number(self) -> int:
        """See ``WorkerJob``."""
        return self.recipe.number

    @property
    def name(self) -> str:
        """See ``WorkerJob``."""
        return f"scene {self.recipe.name}"

    def is_done(self) -> bool:
        """See ``WorkerJob``."""
        there = disk.read_scene(self.root / disk.SCENES / self.recipe.name)
        return there is not None and there.record.get("settings") == self.recipe.digest

    def make(self, session: Any) -> dict[str, float]:
        """See ``WorkerJob``."""
        from .scene import make

        partial = disk.begin(self.root, self.recipe.number)
        try:
            return make(self.recipe, partial, self.root, session, self.threads)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
            session.clear()

    def note(self, outcome: SceneOutcome) -> None:
        """See ``WorkerJob``."""
        done = outcome.kind == "done"
        status = {
            "status": "done" if done else "failed",
            "settings": self.recipe.digest,
            **({} if done else {"kind": outcome.kind, "why": outcome.why}),
            "seconds": outcome.wall,
            "cpu": outcome.seconds,
            "memory": outcome.memory,
        }
        disk.write_status(self.root, self.recipe.number, status)


@dataclass(frozen=True)
class SceneOutcome:
    """Outcome of a job: ``kind`` is done, or why it was not: settings, fault, disk, memory, timeout, crash,
    stopped.

    seconds : CPU time of each stage. wall : seconds. memory, peak : bytes that the process held afterwards,
    and at most. scene : number of the job.
    """

    kind: str
    why: str = ""
    seconds: dict[str, float] = field(default_factory=dict)
    wall: float = 0.0
    memory: float = 0.0
    peak: float = 0.0
    scene: int = -1


# The process of a worker: what runs within it.


def _serve(pipe: Connection, words: Path) -> None:
    """Load Blender, say so, and do jobs as they come; all that is printed goes to a file of last words."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the command, which ends us
    said = os.open(words, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    for stream in (1, 2):
        os.dup2(said, stream)
    threading.Thread(target=_end_with_starter, daemon=True).start()
    # From where it is installed: with a starter that has loaded it come its own modules, an inner ``bpy``.
    with contextlib.suppress(PackageNotFoundError):  # it came otherwise, and is imported as usual
        spec = PathFinder.find_spec("bpy", [str(distribution("bpy").locate_file(""))])
        if spec is not None and spec.loader is not None:
            sys.modules["bpy"] = module_from_spec(spec)
            spec.loader.exec_module(sys.modules["bpy"])
    from .scene import Session

    session = Session()
    pipe.send(SceneOutcome("done"))
    with contextlib.suppress(EOFError):  # the worker is gone
        while True:
            pipe.send(_outcome(pipe.recv(), session))
    os._exit(0)  # Blender may hang when its interpreter ends


def _end_with_starter() -> None:
    starter = multiprocessing.parent_process()
    if starter is not None:
        starter.join()
        os._exit(0)


def _outcome(job: WorkerJob, session: Any) -> SceneOutcome:
    """Do a job, or say why not."""
    with contextlib.suppress(
        OSError
    ):  # the largest memory is counted anew, where the system does so
        Path("/proc/self/clear_refs").write_text("5")
    try:
        outcome = SceneOutcome("done", seconds=job.make(session))
    except BaseException as problem:
        outcome = _failure(problem)
    gc.collect()
    if not session.served:  # modules and what they keep: no later scene need look through them
        gc.freeze()
    session.served += 1
    if (
        sys.platform == "linux"
    ):  # what scenes left in pieces goes back; another C library has no such call
        with contextlib.suppress(OSError, AttributeError):
            ctypes.CDLL(None).malloc_trim(0)
    return replace(outcome, memory=held_memory(), peak=(peak_memory_mb() or 0.0) * 2**20)


def _failure(problem: BaseException) -> SceneOutcome:
    """The outcome of a scene that ended so; ``disk`` where no other can be written either."""
    if isinstance(problem, MemoryError):
        return SceneOutcome("memory", "needs more memory than there is")
    if isinstance(problem, OSError):
        return SceneOutcome("disk" if problem.errno in DISK else "fault", str(problem))
    if isinstance(problem, ValueError) and is_told(problem):
        return SceneOutcome("settings", str(problem))
    return SceneOutcome("fault", fault_of(problem))


# The worker, which starts that process and watches it.

_starting = threading.Lock()  # of processes of several workers: the environment is everybody's


class Worker:
    """A process that has Blender loaded, started when it is first needed, and what it has been through."""

    def __init__(self) -> None:
        self.scenes = 0  # that its process has made
        self.first_memory = 0.0  # of its process, after the first
        self._stopped = False
        self._process: Any = None
        self._pipe: Any = None  # to it
        self._folder: Any = None  # of its last words

    def make(self, job: WorkerJob) -> SceneOutcome:
        """Do a job, twice if need be, in smaller parts where it needs too much memory, and note how it
        went."""
        if job.is_done():
            return SceneOutcome("done", scene=job.number)
        cut, left = "", TRIES
        while left:
            left -= 1
            outcome = self.once(job)
            if outcome.kind in ("done", "disk") or self._stopped:
                break
            self.end()
            smaller = job.smaller() if outcome.kind == "memory" else None
            if smaller is not None:
                job, cut, left = smaller, f"{job.name} {outcome.why}: it is cut", TRIES
        done = outcome.kind == "done"
        if self._stopped and not done:
            return replace(outcome, kind="stopped")
        if outcome.kind != "disk":
            try:
                job.note(outcome)
            except OSError as problem:
                outcome = replace(outcome, kind="disk", why=str(problem))
        if outcome.kind == "disk":
            return replace(outcome, why=f"{job.name}: {outcome.why}")
        grown = outcome.memory - self.first_memory > job.running.renew_grown_gb * 1e9
        if done and (grown or self.scenes >= job.running.renew_after):
            self.end()
        return replace(outcome, why=cut) if done else outcome

    def once(self, job: WorkerJob) -> SceneOutcome:
        """Have the process try a job."""
        problem = ""
        if self._process is None or not self._process.is_alive():
            problem = self.start()
        if problem:
            return SceneOutcome("crash", problem, scene=job.number)
        started = time.monotonic()
        outcome = self._answer(started + job.running.timeout, job.memory, job)
        outcome = replace(outcome, wall=time.monotonic() - started, scene=job.number)
        if self._process is not None:
            self.scenes += 1
            self.first_memory = self.first_memory or outcome.memory
        return outcome

    def start(self) -> str:
        """Start the process; returns what went wrong, empty if it is ready."""
        self.end()
        self._folder = tempfile.TemporaryDirectory()
        spawn = multiprocessing.get_context("spawn")
        self._pipe, theirs = spawn.Pipe()
        given = theirs, Path(self._folder.name) / "words"
        process = spawn.Process(target=_serve, args=given, daemon=True)
        self.scenes, self.first_memory = 0, 0.0
        with _starting, _environment():
            process.start()
        self._process = process
        theirs.close()  # so that ours ends with the process
        return self._answer(time.monotonic() + STARTS_IN, float("inf")).why

    def _answer(self, deadline: float, most: float, job: WorkerJob | None = None) -> SceneOutcome:
        """Answer of the process to a job, or at its start, or what became of it instead; then it is dead."""
        try:
            if job is not None:
                self._pipe.send(job)
            while not self._pipe.poll(LOOK):
                if time.monotonic() > deadline:
                    self.end()
                    return SceneOutcome("timeout", "ran past its time")
                if held_memory(self._process.pid) > most:
                    self.end()
                    why = f"needs more memory than it may have ({most / 1e9:.1f} GB)"
                    return SceneOutcome("memory", why)
            outcome: SceneOutcome = self._pipe.recv()
            return outcome
        except (EOFError, OSError):
            return self._crashed()

    def _crashed(self) -> SceneOutcome:
        """Sentence on how the process ended, with its last words."""
        self._process.join()
        code = self._process.exitcode
        said: list[str] = []
        with contextlib.suppress(OSError):  # it ended before its first word
            text = (Path(self._folder.name) / "words").read_bytes()[-4 * TOLD :]
            said = text.decode("utf-8", "replace").strip().splitlines()
        self.end()
        killed = code is not None and code < 0
        how = f"was ended by signal {-code}" if killed else f"ended with {code}"
        last = f": {said[-1][-TOLD:]}" if said else ""
        return SceneOutcome("crash", f"Blender's process {how}{last}")

    def stop(self) -> None:
        """Have the thread that is in ``make`` come back soon; the scene that it is at is lost."""
        self._stopped, process = True, self._process
        if process is not None:  # its thread finds it crashed
            process.kill()

    def end(self) -> None:
        """Kill the process; a scene that it was making is lost."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
            self._folder.cleanup()
        self._process = None


@contextlib.contextmanager
def _environment() -> Iterator[None]:
    """Within, processes start with the variables of ours; one thread for small matrices, which gives the same
    sums everywhere. The script of whoever asked is not run again in them, as spawning would.
    """
    before, asking = dict(os.environ), sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    os.environ.update(environment_of_child(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1"))
    os.environ.pop(TRIMS, None)
    try:
        yield
    finally:
        sys.modules["__main__"] = asking
        for name in set(os.environ) - set(before):
            del os.environ[name]
        os.environ.update(before)


_own = threading.local()


def work(job: WorkerJob) -> SceneOutcome:
    """``Worker.make`` by the one worker of this thread; what a scheduler calls."""
    if not hasattr(_own, "worker"):
        multiprocessing.current_process().daemon = False  # as Dask's are, which may start none
        _own.worker = Worker()
    worker: Worker = _own.worker
    return worker.make(job)


Report = Callable[[SceneOutcome], None]
POLL = 1.0  # s
STOPS_IN = 0.1  # s, before a worker is told once more
FRUITLESS = 5  # times that a cluster loses all that it holds, with nothing finished between
AHEAD, LEAST_AHEAD = (
    3,
    64,
)  # jobs that a scheduler holds for each thread of its workers, and at least
CAN_START_IN = 60  # s
OF_MEMORY = 0.9  # share of the machine's that all workers may need together


@dataclass(frozen=True)
class Cluster:
    """Place where jobs are done: ``workers`` here; a scheduler's address; or keys and values of a batch
    system. ``make`` is what each of its workers does with a job."""

    workers: int = 0
    scheduler: str = ""
    slurm: str | None = None
    make: Callable[[Any], SceneOutcome] = work

    @property
    def is_elsewhere(self) -> bool:
        """Return whether the workers are not of this process."""
        return bool(self.scheduler) or self.slurm is not None

    def shares(self, jobs: int, running: Running) -> tuple[float, int]:
        """Bytes of memory and threads that each of the workers may take that so many jobs need."""
        workers = 1 if self.is_elsewhere else min(self.local_workers(), max(jobs, 1))
        memory = running.memory_gb * 1e9 or machine_memory() * OF_MEMORY / workers
        return memory, max(1, (os.cpu_count() or 1) // workers)

    def local_workers(self) -> int:
        """Number of them on this machine."""
        return self.workers or os.cpu_count() or 1


def machine_memory() -> float:
    """Bytes of this machine's memory; infinity where the system does not tell."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, ValueError, OSError):  # Windows
        return float("inf")


def make_all(jobs: Sequence[WorkerJob], cluster: Cluster, report: Report) -> None:
    """Have every job done; ``report`` is told of each, in any order.

    Raises
    ------
    SpecError : the cluster cannot be used.
    OSError : the disk is full or cannot be written to, or the scheduler went away; what is done stays.
    """
    if not jobs:
        return
    if not cluster.is_elsewhere:
        _make_here(jobs, min(cluster.local_workers(), len(jobs)), report)
        return
    with _client(cluster) as client:
        _hand_out(jobs, client, cluster, report)


def _make_here(jobs: Sequence[WorkerJob], workers: int, report: Report) -> None:
    """Have jobs done by workers of this process, a thread each, which wait for their children."""
    idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
    every = [Worker() for _ in range(workers)]
    for worker in every:
        idle.put(worker)

    def make(job: WorkerJob) -> SceneOutcome:
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
    except BaseException:  # also Ctrl-C: no job is waited for
        pool.shutdown(wait=False, cancel_futures=True)
        while not all(result.done() for result in results):
            for worker in every:
                worker.stop()
            time.sleep(STOPS_IN)
        raise
    finally:
        pool.shutdown()
        for worker in every:
            worker.end()


def _take(outcome: SceneOutcome, report: Report) -> None:
    if outcome.kind == "disk":
        raise OSError(f"{outcome.why}; what is finished is kept")
    report(outcome)


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
    gc.collect()  # a client that never got through would wait for itself if it went as another starts
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
            "--slurm" if extra == "slurm" else "--scheduler",
            f"{name} is not installed, which hands work to the workers of a cluster; install "
            f"forest-sensing[{extra}], or leave the cluster out",
        ) from None


def _gone(address: str, problem: object) -> OSError:
    return OSError(
        f"the scheduler at {address} cannot be reached ({problem}); what is finished is kept, the same "
        "command goes on"
    )


def _hand_out(jobs: Sequence[WorkerJob], client: Any, cluster: Cluster, report: Report) -> None:
    """Submit jobs until each has a result; a lost one is submitted again.

    The scheduler holds a few jobs for each thread of its workers, not the whole plan, and each result is
    taken as it arrives; so a job costs the same in a plan of ten and of a hundred thousand.
    """
    address = client.scheduler.address if client.scheduler else "?"
    left = deque(jobs)
    out: dict[Any, WorkerJob] = {}
    ended: queue.SimpleQueue[Any] = queue.SimpleQueue()
    most, looked, fruitless = LEAST_AHEAD, 0.0, 0
    while left or out:
        if time.monotonic() - looked > POLL:
            most, looked = _ahead(client, address), time.monotonic()
        while left and len(out) < most:
            job = left.popleft()
            future = client.submit(cluster.make, job, pure=False, retries=0, priority=-job.number)
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
                    f"the cluster finished none of {len(left) + len(out)} jobs; what is finished is kept"
                )
        future.release()


def _ahead(client: Any, address: str) -> int:
    """Number of jobs that the scheduler is to hold.

    Raises
    ------
    OSError : it has gone away.
    """
    gone = _gone(address, "it has gone away")
    stream = getattr(client, "scheduler_comm", None)
    if client.status != "running" or stream is None or stream.comm.closed():
        raise gone
    try:
        return max(LEAST_AHEAD, AHEAD * sum(client.nthreads().values()))
    except (OSError, TimeoutError, CancelledError):
        raise gone from None
