"""Running long work from a button: progress in status bar and panels, Esc or Cancel stops it.

An operator that computes is a ``Working`` with a ``work`` generator (``blender/jobs``). From a window it
runs modally: the window lives on, one job at a time, and nothing is left half done when it is stopped: what a
work has finished by then it notes in ``kept`` of its job. From a script it runs to its end at once. Packages
that Blender lacks are looked for before.
"""

from __future__ import annotations

import functools
import importlib
import importlib.util
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

import bpy
import gpu
from bpy_extras.io_utils import ImportHelper

from ...base.progress import Progress
from ...blender.jobs import Job, Task, Work
from ...spec import SpecError
from .views import redraw_panels
from .words import keep, label, say, title_of_operator

NEEDED = ("numpy", "scipy", "cattrs")
WHAT_TO_DO = (  # line by line, as wide as the sidebar
    keep("The extension brings it along:"),
    keep("install its zip again under"),
    keep("Preferences > Get Extensions"),
    keep("> Install from Disk."),
)


@functools.cache
def missing() -> tuple[str, ...]:
    """Packages that cannot be found; looked up once, none of them is imported."""
    return tuple(name for name in NEEDED if importlib.util.find_spec(name) is None)


def packages_in_words(names: tuple[str, ...]) -> str:
    """One sentence for packages that are missing."""
    if len(names) == 1:
        return say("{package} is missing in this Blender", package=names[0])
    return say("{packages} are missing in this Blender", packages=say(" and ").join(names))


def what_to_do() -> str:
    """The same lines as a sentence."""
    return " ".join(say(line) for line in WHAT_TO_DO)


WIDE = 18  # of the bar in the status bar, in units of Blender's layouts


def how_far(job: Job) -> str:
    """State of a job: its step, how much of it is done, and when it will be."""
    if job.over:
        return say("{job} is stopping", job=job.title)
    if job.left is None:
        return f"{job.label} {job.share:.0%}"
    left = duration(job.left)
    return say("{step} {share:.0%}, {time} left", step=job.label, share=job.share, time=left)


def duration(seconds: float) -> str:
    """A time as one says it."""
    if seconds < 1.5:
        return say("a second")
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return say("{minutes:.0f} min", minutes=seconds / 60)
    return say("{hours:.1f} h", hours=seconds / 3600)


def draw_job(row: bpy.types.UILayout, job: Job) -> None:
    """Draw how far a job is into a row, and the button that stops it."""
    row.progress(factor=job.share, text=how_far(job))
    row.operator("forest.cancel", text="", icon="CANCEL")


def show_job(context: bpy.types.Context, job: Job) -> None:
    """Have status bar and panels say how far a job is."""

    def draw(header: Any, _context: bpy.types.Context) -> None:
        row = header.layout.row(align=True)
        row.label(text=job.title)
        bar = row.row(align=True)
        bar.ui_units_x = WIDE
        draw_job(bar, job)
        row.label(text=label("Esc: cancel"))

    if context.workspace is not None:
        context.workspace.status_text_set(draw)
    redraw_panels()


def show_no_job(context: bpy.types.Context) -> None:
    """Have the status bar say what it says usually, and panels offer to start work again."""
    if context.workspace is not None:
        context.workspace.status_text_set(None)
    redraw_panels()


BY_PROCESSOR = (
    "llvmpipe",
    "softpipe",
    "swrast",
    "swiftshader",
    "software",
    "lavapipe",
    "gdi generic",
)
LITTLE = 240_000  # triangles that a processor draws in less than a tenth of a second


def drawable() -> int:
    """Number of triangles that all stand-ins of a forest may have: fewer without a graphics card."""
    from ...blender.scene.forest import DRAWABLE

    if bpy.app.background:
        return DRAWABLE
    drawn_by = gpu.platform.renderer_get().lower()
    return LITTLE if any(name in drawn_by for name in BY_PROCESSOR) else DRAWABLE


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


def obstacle(context: bpy.types.Context) -> str:
    """Reason why nothing can be computed now; empty where it can."""
    if missing():
        return say("{missing}. The panel says what to do", missing=packages_in_words(missing()))
    job = current()
    if job is not None:
        if job.over:
            return say("{job} is stopping; only one job runs at a time", job=job.title)
        return say("{job} is running; only one job runs at a time", job=job.title)
    if context.mode != "OBJECT":
        return say("Leave this mode first: forests are grown and sensed in Object Mode")
    return linked(context)


def linked(context: bpy.types.Context) -> str:
    """Return why a scene cannot be changed; empty where it can."""
    return "" if context.scene.is_editable else say(LINKED)


class Button:
    """Base of the panel's operators: why one cannot be pressed now, what it does, what is said of it.

    ready : says why none of its kind can be pressed now. needs : what must hold of the context for this one,
    each with what is said where it does not.
    """

    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}
    ready = staticmethod(linked)
    needs: ClassVar[Any] = ()

    @classmethod
    def obstacle(cls, context: bpy.types.Context) -> str:
        """Reason why it cannot be pressed now; empty where it can."""
        unmet = (say(words) for holds, words in cls.needs if not holds(context))
        return cls.ready(context) or next(unmet, "")

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        reason = cls.obstacle(context)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def act(self, context: bpy.types.Context) -> str | None:
        """Do it; returns what is reported, nothing where that is empty. None: nothing was done.

        Raises
        ------
        PROBLEMS : are reported, and nothing was done.
        """
        raise NotImplementedError

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            said = self.act(context)
        except PROBLEMS as problem:
            self.report({"ERROR"}, in_words(problem))
            return {"CANCELLED"}
        finally:
            redraw_panels()  # those in other windows too may show items of a list that are gone
        if said:
            self.report({"INFO"}, said)
        return {"CANCELLED"} if said is None else {"FINISHED"}


ASKED = type(bpy.props.BoolProperty())  # what Blender asks for: a property of a class


def made(
    kind: type, letters: str, does: str, title: str, /, *bases: type, **body: Any
) -> Callable[[Callable[..., Any]], type]:
    """Make a class of Blender's of the function below, which has its name, its help and what it ``does``.

    letters : of its kind, within its name. title : what people call it. bases : what all of its sort share.
    body : what else the class holds, settings that Blender asks for among it.
    """

    def make(function: Callable[..., Any], name: str = "") -> type:
        held = {key: value for key, value in body.items() if not isinstance(value, ASKED)}
        asked = {key: value for key, value in body.items() if key not in held}
        said = {"__doc__": function.__doc__, "bl_label": title, does: function}
        id_name = (name or function.__name__).lstrip("_")
        kept = said | held | {"__annotations__": asked}
        return type(f"FOREST_{letters}_{id_name}", (*bases, kind), kept)

    return make


button = functools.partial(made, bpy.types.Operator, "OT", "act")  # forest.NAME
long_button = functools.partial(made, bpy.types.Operator, "OT", "work")  # which starts a job
panel = functools.partial(made, bpy.types.Panel, "PT", "draw")
menu = functools.partial(made, bpy.types.Menu, "MT", "draw")


class Reading(Button):
    """An operator that changes nothing in the scene, which may be linked from another file."""

    bl_options: ClassVar[set[str]] = {"REGISTER"}
    ready = staticmethod(lambda _context: "")


class Taking(ImportHelper):
    """Asks for a file; of one that was dropped into a view, for the rest of its settings."""

    filepath: bpy.props.StringProperty(subtype="FILE_PATH", options={"SKIP_SAVE", "HIDDEN"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not self.filepath:
            return set(ImportHelper.invoke(self, context, event))
        title = Path(self.filepath).name
        return set(context.window_manager.invoke_props_dialog(self, title=title, translate=False))


def ask_for_file(
    pressed: bpy.types.Operator, context: bpy.types.Context, _event: bpy.types.Event
) -> set[str]:
    """Open the file browser; what is chosen there is done, as ``invoke`` of an operator."""
    context.window_manager.fileselect_add(pressed)
    return {"RUNNING_MODAL"}


def asked(
    title: str, confirm: str, width: int, needed: Callable[[Any], bool] = lambda context: True
) -> Callable[..., set[str]]:
    """The ``invoke`` of an operator that asks in a dialog first, if need be and a window is there."""

    def invoke(
        pressed: bpy.types.Operator, context: bpy.types.Context, _event: bpy.types.Event
    ) -> set[str]:
        if bpy.app.background or not needed(context):
            return set(pressed.execute(context))
        words = {"title": say(title), "confirm_text": say(confirm)}
        return set(context.window_manager.invoke_props_dialog(pressed, width=width, **words))

    return invoke


def dropped(ending: str, title: str, operator: str) -> type[bpy.types.FileHandler]:
    """The class that has files of an ending, dropped into a 3D view, taken by one of our operators."""

    def poll_drop(_cls: type, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type == "VIEW_3D"

    name = f"FOREST_FH_{operator.partition('.')[2]}"
    said = {"bl_idname": name, "bl_label": title, "bl_import_operator": operator}
    body = said | {"bl_file_extensions": ending, "poll_drop": classmethod(poll_drop)}
    return type(name, (bpy.types.FileHandler,), body)


def press(operator: Callable[..., set[str]], **settings: object) -> set[str]:
    """Press another button: as a window does, or in the background as a script does.

    Raises
    ------
    ValueError : it refuses; in its words.
    """
    how = "EXEC_DEFAULT" if bpy.app.background else "INVOKE_DEFAULT"
    try:
        return set(operator(how, **settings))
    except RuntimeError as refusal:
        raise ValueError(str(refusal).removeprefix("Error: ").strip()) from None


class WhenReady(Button):
    """An operator that can be used when no job runs, in Object Mode."""

    ready = staticmethod(obstacle)


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
            scene, name = self._begun_in  # the window may show others by now
            layer = scene.view_layers.get(name) or scene.view_layers[0]
            with context.temp_override(scene=scene, view_layer=layer):
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
        show_no_job(context)


@button("Cancel", Reading, needs=((lambda _: current() is not None, keep("Nothing is running")),))
def cancel(_button: Button, _context: bpy.types.Context) -> str:
    """Stop what is running; what was there before stays as it was"""
    stop()
    return ""


def getting_ready(*rooms: str) -> Task:
    """The first piece of work: importing what it needs, scipy with it, takes a while the first time.

    rooms : modules of ours by their names within ``forest_addon``.
    """
    within = (__package__ or "").removesuffix(".ui.shell")

    def patiently(_tell: Progress) -> None:
        for left in reversed(range(ATTEMPTS)):
            try:
                for room in rooms:
                    importlib.import_module(f"{within}.{room}")
                return
            except RuntimeError as problem:
                # two threads that import the same package each from another end: Python ends one of them
                if type(problem).__name__ != "_DeadlockError" or not left:
                    raise
                time.sleep(TICK)

    return Task(say("getting ready"), patiently, whole=True)


def in_words(problem: BaseException) -> str:
    """One sentence for what went wrong, with what to do."""
    if isinstance(problem, ModuleNotFoundError) and problem.name:
        return f"{packages_in_words((problem.name,))}. {what_to_do()}"
    if isinstance(problem, ImportError):
        return f"{problem}. {what_to_do()}"
    if isinstance(problem, MemoryError):
        return say("There is not enough memory for this; take fewer trees or coarser steps")
    if isinstance(problem, ReferenceError):
        return say(next(words for kind, words in GONE.items() if kind in str(problem)))
    if isinstance(problem, OSError) and problem.strerror:
        return f"{problem.filename or say('A file cannot be written')}: {problem.strerror}"
    return str(problem)


# What was removed while a job used it, by what Python says of it.
GONE = {
    "type Object": keep(
        "An object was removed or undone meanwhile, perhaps the sensor; run it again"
    ),
    "type Scene": keep("The scene was removed or undone meanwhile; run it again"),
    "": keep("Something of the scene was removed or undone meanwhile; run it again"),
}


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
    """Say to Blender whether a job that did not come to its end is a step to undo."""
    return {"FINISHED"} if job.kept else {"CANCELLED"}


def _how_it_ended(job: Job) -> str:
    if not job.kept:
        return say("{job} was cancelled; nothing was changed", job=job.title)
    kept = ", ".join(dict.fromkeys(job.kept))
    return say("{job} was cancelled; what was done stays: {kept}", job=job.title, kept=kept)


@contextmanager
def _pointer(context: bpy.types.Context) -> Iterator[Progress]:
    """Show how far a piece of work is, at the mouse pointer."""
    manager = context.window_manager
    manager.progress_begin(0, 100)
    try:
        yield lambda done, total: manager.progress_update(100 * done / max(total, 1))
    finally:
        manager.progress_end()
