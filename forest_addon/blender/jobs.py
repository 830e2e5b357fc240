"""Long work without a frozen window: arrays in a thread, Blender's data on the main thread.

A piece of work is a generator. What it yields is a ``Task``, which touches arrays and no ``bpy``; the
task runs in a thread and its result comes back out of the ``yield``. Whatever stands between two yields
runs on the main thread, the only one that may touch Blender, and should be short:

    forest = yield Task("growing trees", lambda tell: grow_forest(settings, species, tell))
    build(scene, settings, forest)
    return "20 trees"

``Job`` drives such a generator, either step by step while a window lives (``step``) or to its end at
once, without a thread (``finish``). A task says by its ``tell`` how far it is. When the job is cancelled,
``CancelledError`` comes out of whatever line of Python the task is at, as Ctrl-C comes in a terminal.
"""

from __future__ import annotations

import ctypes
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from ..base.progress import Progress

SOON, LITTLE = 2.0, 0.02  # s, and share, before which nothing is said of the time that is left
TURN = 5e-4  # s that a task keeps Python's lock while the window waits for it


@dataclass(frozen=True)
class Task:
    """Work on arrays: ``run(tell)`` calls ``tell(done, total)`` now and then.

    whole : it is short and never left half done, as imports must not be.
    span : from which share of the job to which it leads, where the job knows all that is to come.
    """

    label: str
    run: Callable[[Progress], Any]
    whole: bool = False
    span: tuple[float, float] | None = None


Work = Generator[Task, Any, str]


class CancelledError(BaseException):
    """Raised within a task when its job was cancelled; no ``except Exception`` on the way keeps it."""


class Job:
    """One piece of work on its way.

    label : what it is doing now.
    share : how much of that is done, 0 to 1; of the whole job, where it knows what is to come.
    result : what the work returned, once ``step`` or ``finish`` said it is done.
    over : whether it is done, has failed or was cancelled.
    """

    def __init__(self, title: str, work: Work) -> None:
        self.title = title
        self.label = title
        self.share = 0.0
        self.result = ""
        self.over = False
        self.kept: list[str] = []  # what the work has brought to its end, in words
        self._begun = self._since = time.monotonic()
        self._span: tuple[float, float] | None = None
        self._work = work
        self._thread: threading.Thread | None = None
        self._outcome: Any = None
        self._problem: BaseException | None = None
        self._stopped = threading.Event()
        self._at_work: int | None = None  # the thread that may be interrupted
        self._lock = threading.Lock()

    @property
    def left(self) -> float | None:
        """Seconds until the end, as it went until now; of what it does now, where the job does not know what
        is to come. None where that cannot be said."""
        took = time.monotonic() - (self._begun if self._span else self._since)
        if took < SOON or self.share < LITTLE:
            return None
        return took * (1.0 - self.share) / self.share

    @property
    def busy(self) -> bool:
        """Return whether a task is still running, also one that was cancelled and has not noticed yet."""
        if self._stopped.is_set():
            self._interrupt()
        return self._thread is not None and self._thread.is_alive()

    def step(self) -> bool:
        """Go on if the running task is done; True when all the work is.

        Raises whatever the work raises; call it on the main thread only.
        """
        if self.busy:
            return False
        try:
            task = self._resume()
        except StopIteration as end:
            self.result, self.over = end.value, True
            return True
        self._begin(task)
        self._thread = threading.Thread(target=self._run_beside, args=(task,), daemon=True)
        self._thread.start()
        return False

    def finish(self, tell: Progress | None = None) -> None:
        """Do all the work here and now; ``tell`` also hears how far each task is."""
        while True:
            try:
                task = self._resume()
            except StopIteration as end:
                self.result, self.over = end.value, True
                return
            self._begin(task)
            self._run(task, tell)

    def cancel(self) -> None:
        """Give the work up: nothing more of it runs on the main thread, its task stops soon."""
        self.over = True
        self._stopped.set()
        self._interrupt()
        self._work.close()

    def _interrupt(self) -> None:
        """Raise in the task's thread, as soon as that runs Python: steps between two ``tell`` are long, and
        what they keep for later they store whole or not at all. An import would leave half a module: it
        goes on, and who asks whether the job is busy asks for this again."""
        with self._lock:
            if self._at_work is None or _imports(self._at_work):
                return
            raise_in = ctypes.pythonapi.PyThreadState_SetAsyncExc
            raise_in(ctypes.c_ulong(self._at_work), ctypes.py_object(CancelledError))
            self._at_work = None

    def _resume(self) -> Task:
        problem, outcome = self._problem, self._outcome
        self._problem = self._outcome = None
        return self._work.throw(problem) if problem is not None else self._work.send(outcome)

    def _begin(self, task: Task) -> None:
        self._span, self._since = task.span, time.monotonic()
        self.label, self.share = task.label, task.span[0] if task.span else 0.0

    def _run_beside(self, task: Task) -> None:
        """Run a task in this thread, which can be interrupted and leaves the window its turns."""
        try:
            with _short_turns():
                with self._lock:
                    if self._stopped.is_set():
                        return
                    self._at_work = None if task.whole else threading.get_ident()
                try:
                    self._run(task)
                finally:
                    with self._lock:
                        self._at_work = None
        except CancelledError:
            pass  # it came when the task was done already

    def _run(self, task: Task, listener: Progress | None = None) -> None:
        def tell(done: int, total: int) -> None:
            if self._stopped.is_set():
                raise CancelledError
            low, high = task.span or (0.0, 1.0)
            self.share = low + (high - low) * done / max(total, 1)
            if listener:
                listener(done, total)

        try:
            self._outcome = task.run(tell)
        except BaseException as problem:
            self._problem = problem


def _imports(thread: int) -> bool:
    """Return whether a thread is importing a module."""
    frame = sys._current_frames().get(thread)
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            return True
        frame = frame.f_back
    return False


@contextmanager
def _short_turns() -> Iterator[None]:
    """Threads change more often in this block.

    A window that draws asks Python hundreds of things, and each waits until a task lets go of Python's
    lock: with Python's own 5 ms that is seconds.
    """
    usual = sys.getswitchinterval()
    sys.setswitchinterval(TURN)
    try:
        yield
    finally:
        sys.setswitchinterval(usual)
