"""Running long work from a button: progress in status bar and panels, Esc or Cancel stops it.

An operator that computes is a ``_Working`` with a ``work`` generator (``blender/jobs``). From a window it
runs modally: the window lives on, one job at a time, and nothing is left half done when it is stopped: what a
work has finished by then it notes in ``kept`` of its job. From a script it runs to its end at once.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import ClassVar

import bpy

from ...base.progress import Progress
from ...blender.jobs import Job, Task, Work
from ...spec import SpecError
from . import pace, requirements
from .progress import how_far, show_job, show_no_job
from .words import keep, say, title_of_operator

TICK = 0.02  # s between two looks at a running job
ATTEMPTS = 20  # at an import that another thread is in the way of
PROBLEMS = (SpecError, ValueError, OSError, ImportError, MemoryError, ReferenceError)
UNDO_KEYS = {"Z", "Y"}
LINKED = keep("This scene is linked from another file and cannot be changed")

_current: Job | None = None


def current() -> Job | None:
    """The job that runs now, None if none does; one that was cancelled counts until it has stopped."""
    global _current
    if _current is not None and _current.over and not _current.busy:
        _current = None
    return _current


def stop() -> None:
    """Cancel the job that runs, if one does: when the user asks, and when Blender undoes or loads."""
    job = current()
    if job is not None:
        job.cancel()


class InOwnScene:
    """An operator that changes a scene, which must not be linked from another file."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not context.scene.is_editable:
            cls.poll_message_set(say(LINKED))
        return bool(context.scene.is_editable)


class WhenReady:
    """An operator that can be used when nothing is in its way, and says what is."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reason = obstacle(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason


class Working(WhenReady):
    """Base of every operator that computes: when it can run, how, and how it says what is wrong."""

    # No REGISTER: from the redo panel, or repeated, it would run to its end in a window that stands still.
    bl_options: ClassVar[set[str]] = {"UNDO"}

    def work(self, context: bpy.types.Context) -> Work:
        """The work; returns a sentence with the key figures."""
        raise NotImplementedError

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        global _current
        if bpy.app.background:
            return self.execute(context)
        context.view_layer.update()
        manager = context.window_manager
        self._job = _current = Job(title_of_operator(self), self.work(context))
        self._begun_in = context.scene, context.view_layer.name
        self._shown = ""
        self._timer = manager.event_timer_add(TICK, window=context.window)
        manager.modal_handler_add(self)
        pace.rough_edges()
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        job = self._job
        if event.type == "ESC" and event.value == "PRESS":
            job.cancel()
        if job.over:
            self._leave(context)
            self.report({"INFO"}, _how_it_ended(job))
            return _outcome(job)
        if event.type in UNDO_KEYS and (event.ctrl or event.oskey):
            self.report(
                {"INFO"}, say("Undo waits for {job}; press Esc to cancel it", job=job.title)
            )
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            with _in_scene(context, *self._begun_in):
                done = job.step()
        except Exception as problem:
            job.cancel()
            self._leave(context)
            if not isinstance(problem, PROBLEMS):
                raise  # a fault of ours; it must not keep other jobs from running
            self.report({"ERROR"}, in_words(problem))
            return _outcome(job)
        if done:
            self._leave(context)
            self.report({"INFO"}, job.result)
            return {"FINISHED"}
        text = how_far(job)
        if text != self._shown:  # drawing costs the task time
            self._shown = text
            show_job(context, job)
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender itself ends the operator: another file is loaded, or Blender quits."""
        self._job.cancel()
        self._leave(context)

    def execute(self, context: bpy.types.Context) -> set[str]:
        context.view_layer.update()
        job = self._job = Job(title_of_operator(self), self.work(context))
        try:
            with _pointer(context) as tell:
                job.finish(tell)
        except PROBLEMS as problem:
            self.report({"ERROR"}, in_words(problem))
            return _outcome(job)
        self.report({"INFO"}, job.result)
        return {"FINISHED"}

    def _leave(self, context: bpy.types.Context) -> None:
        context.window_manager.event_timer_remove(self._timer)
        pace.usual_edges()
        show_no_job(context)


class FOREST_OT_cancel(bpy.types.Operator):
    """Stop what is running; what was there before stays as it was"""

    bl_idname = "forest.cancel"
    bl_label = "Cancel"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if current() is None:
            cls.poll_message_set(say("Nothing is running"))
            return False
        return True

    def execute(self, _context: bpy.types.Context) -> set[str]:
        stop()
        return {"FINISHED"}


CLASSES = (FOREST_OT_cancel,)


def getting_ready(import_rooms: Callable[[Progress], object]) -> Task:
    """The first piece of work: importing what it needs, scipy with it, takes a while the first time."""

    def patiently(tell: Progress) -> object:
        for _ in range(ATTEMPTS):
            try:
                return import_rooms(tell)
            except RuntimeError as problem:
                # two threads that import the same package each from another end: Python ends one of them
                if type(problem).__name__ != "_DeadlockError":
                    raise
                time.sleep(TICK)
        return import_rooms(tell)

    return Task(say("getting ready"), patiently, whole=True)


def obstacle(context: bpy.types.Context) -> str:
    """Return why nothing can be computed now; empty where it can."""
    if requirements.missing():
        missing = requirements.in_words(requirements.missing())
        return say("{missing}. The panel says what to do", missing=missing)
    job = current()
    if job is not None:
        if job.over:
            return say("{job} is stopping; only one job runs at a time", job=job.title)
        return say("{job} is running; only one job runs at a time", job=job.title)
    if context.mode != "OBJECT":
        return say("Leave this mode first: forests are grown and sensed in Object Mode")
    if not context.scene.is_editable:
        return say(LINKED)
    return ""


def in_words(problem: BaseException) -> str:
    """One sentence for what went wrong, with what to do."""
    if isinstance(problem, ModuleNotFoundError) and problem.name:
        return f"{requirements.in_words((problem.name,))}. {requirements.what_to_do()}"
    if isinstance(problem, ImportError):
        return f"{problem}. {requirements.what_to_do()}"
    if isinstance(problem, MemoryError):
        return say("There is not enough memory for this; take fewer trees or coarser steps")
    if isinstance(problem, ReferenceError):
        return say(_what_is_gone(problem))
    if isinstance(problem, OSError) and problem.strerror:
        return f"{problem.filename or say('A file cannot be written')}: {problem.strerror}"
    return str(problem)


def _what_is_gone(problem: ReferenceError) -> str:
    """Return which thing was removed while a job used it."""
    if "type Object" in str(problem):
        return keep("An object was removed or undone meanwhile, perhaps the sensor; run it again")
    if "type Scene" in str(problem):
        return keep("The scene was removed or undone meanwhile; run it again")
    return keep("Something of the scene was removed or undone meanwhile; run it again")


def unregister() -> None:
    """Stop what runs."""
    if current() is not None:
        show_no_job(bpy.context)
    stop()


@bpy.app.handlers.persistent
def _stop_before(*_: object) -> None:
    """Undo and loading a file replace Blender's data: a job must not go on over it."""
    stop()
    if _current is not None:
        _current.kept.clear()  # undone or gone with the file


HANDLERS = tuple((name, _stop_before) for name in ("undo_pre", "redo_pre", "load_pre"))


def _outcome(job: Job) -> set[str]:
    """Of a job that did not come to its end: whether Blender is to make a step to undo of it."""
    return {"FINISHED"} if job.kept else {"CANCELLED"}


def _how_it_ended(job: Job) -> str:
    if not job.kept:
        return say("{job} was cancelled; nothing was changed", job=job.title)
    kept = ", ".join(dict.fromkeys(job.kept))
    return say("{job} was cancelled; what was done stays: {kept}", job=job.title, kept=kept)


@contextmanager
def _in_scene(context: bpy.types.Context, scene: bpy.types.Scene, layer: str) -> Iterator[None]:
    """The scene and view layer in which a job was begun; the window may show others by now.

    Raises
    ------
    ReferenceError : the scene was removed.
    """
    layers = scene.view_layers
    with context.temp_override(scene=scene, view_layer=layers.get(layer) or layers[0]):
        yield


@contextmanager
def _pointer(context: bpy.types.Context) -> Iterator[Progress]:
    """Show how far a piece of work is, at the mouse pointer."""
    manager = context.window_manager
    manager.progress_begin(0, 100)
    try:
        yield lambda done, total: manager.progress_update(100 * done / max(total, 1))
    finally:
        manager.progress_end()
