"""Running sensors: one or all, in the scene as it is or frame by frame; what it costs; where results go."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import bpy
import numpy as np

from ...blender.jobs import Task, Work
from ...blender.scene.instances import may_be_met, planted_names
from ...blender.sensors import objects as sensors
from ...formats.ownership import Keeper, keeping
from ...results.coordinates import Offset
from ...sensing.kind import Cost, note_pace
from ...sensing.kinds import audited, cost_of, kind_of
from ...spec import Sensor, SpecError
from ..forest.wind import swaying
from ..results.keep import begin_frames
from ..settings.drawing import split
from ..settings.exchange import to_spec
from ..settings.preferences import expansions, rays_of
from ..shell.running import (
    PROBLEMS,
    WhenReady,
    Working,
    asked,
    button,
    duration,
    getting_ready,
    in_words,
    made,
    menu,
    press,
)
from ..shell.words import keep, label, say
from .panels import is_unrendered

if TYPE_CHECKING:
    from ...blender.sensors.observe import Observer
    from ...results.kind import Finding

LONG = 60.0  # s; what takes longer is asked about
LARGE = 2e9  # bytes; the same
KEPT = 1 / 3  # of a run's memory: 100 bytes a point, which is what Blender keeps of it
PICTURE = 1e6  # bytes of a picture that is kept, as measured


def costs(context: bpy.types.Context, things: Iterable[bpy.types.Object]) -> list[Cost]:
    """The cost of running each of these sensors once; tooltips ask for it, so nothing is written.

    Raises
    ------
    SpecError, ValueError : settings that cannot be used.
    """
    from ...blender.read.depsgraph import ready
    from ...blender.sensors.moving import Forecast

    home = Path(bpy.path.abspath(context.scene.forest_sensing.folder))
    costs_of_sensors = []
    trees = sum(planting.standing for planting in context.scene.forest_sensing.plantings)
    known = ready()
    triangles = 0 if known else triangles_in(context.scene)
    for obj in things:
        settings = to_spec(context.scene, [obj])
        (sensor,) = settings.sensors
        engine = "bvhtree" if settings.rays.engine == "bvhtree" else "embree"
        way = kind_of(sensor).trajectory(sensor, home, Forecast(context.scene))
        again = sensor.kind in known
        costs_of_sensors.append(cost_of(sensor, way, engine, settings, trees, triangles, again))
        triangles = 0  # the first one sets them up
    return costs_of_sensors


def triangles_in(scene: bpy.types.Scene) -> int:
    """Number of triangles of a scene's meshes, each once, before modifiers."""
    meshes = {obj.data for obj in scene.objects if obj.type == "MESH"}
    return sum(len(mesh.loops) - 2 * len(mesh.polygons) for mesh in meshes)


def chosen_things(scene: bpy.types.Scene, name: str, again: bool = False) -> list[bpy.types.Object]:
    """The sensor of this name, all where it is empty. again : only those whose result is of the forest that
    stood before."""
    stale = {result.name for result in scene.forest_sensing.results if result.stale}
    chosen = [obj for obj in sensors.sensors_of(scene) if name in ("", obj.name)]
    return [obj for obj in chosen if obj.name in stale] if again else chosen


def estimate(context: bpy.types.Context, name: str, again: bool = False) -> list[Cost]:
    """The cost of running the sensor of this name, or all; none where settings cannot be used, which running
    says."""
    try:
        return costs(context, chosen_things(context.scene, name, again))
    except PROBLEMS:
        return []


def is_large(found: list[Cost], frames: int = 1, keep: bool = False) -> bool:
    """Return whether one should be asked before this runs. keep : what all frames find stays in the file."""
    seconds = frames * sum(cost.seconds for cost in found)
    return seconds > LONG or memory_of(found, frames if keep else 1) > LARGE


def memory_of(found: list[Cost], kept: int = 1) -> float:
    """Bytes of a run whose points and pictures stay for so many frames."""
    return sum(cost.memory + (kept - 1) * (KEPT * cost.memory + PICTURE) for cost in found)


def cost_in_words(found: list[Cost], frames: int = 1, keep: bool = False) -> str:
    """22.5 M pulses, about 5 min, 1.8 GB."""
    parts = []
    for what in ("pulses", "pings", "channels", "runs"):
        number = frames * sum(cost.count for cost in found if cost.what == what)
        if any(cost.what == what for cost in found):
            count = short(number)
            many = {
                "pulses": label("{count} pulses", count=count),
                "pings": label("{count} pings", count=count),
                "channels": label("{count} channels", count=count),
                "runs": label("{count} runs", count=count),
            }
            one = {"pings": label("1 ping"), "channels": label("1 channel"), "runs": label("1 run")}
            parts.append(one.get(what, many[what]) if number == 1 else many[what])
    parts.append(label("about {time}", time=duration(frames * sum(c.seconds for c in found))))
    memory = memory_of(found, frames if keep else 1)
    if memory >= 5e7:
        parts.append(label("{size:.1f} GB", size=memory / 1e9))
    return ", ".join(parts)


def short(count: int) -> str:
    """A number with three digits that count: 22.5 M."""
    for unit, word in ((1e9, " G"), (1e6, " M"), (1e4, "k")):
        if count >= unit:
            return f"{count / (1e3 if word == 'k' else unit):.3g}{word}"
    return f"{count:,}"


def time_in_words(seconds: float) -> str:
    """A time that was taken or estimated: exact to a tenth of a second where that says something."""
    return f"{seconds:.1f} s" if seconds < 9.95 else duration(seconds)


class Ahead:
    """All runs of a job, one after the other: which one comes, and which share of the whole it is."""

    def __init__(self, of_sensors: list[Cost], frames: int) -> None:
        self._of_sensors, self._frames, self._done, self._ran = of_sensors, frames, 0, 0
        self._times: dict[str, tuple[float, float]] = {}  # s taken and estimated, by sensor
        ends = np.cumsum([0.0, *frames * [max(cost.seconds, 1e-3) for cost in of_sensors]])
        self._ends = (ends / ends[-1]).tolist()

    def next(self, name: str) -> tuple[str, tuple[float, float], Cost]:
        """Name of the next run, from which share of the job to which it leads, what it
        costs."""
        frame, number = divmod(self._done, len(self._of_sensors))
        span, words = (self._ends[self._done], self._ends[self._done + 1]), name
        self._done += 1
        if len(self._of_sensors) > 1:
            words = say(
                "{sensor}, {number} of {count}",
                sensor=words,
                number=number + 1,
                count=len(self._of_sensors),
            )
        if self._frames > 1:
            words = say(
                "{sensor}, frame {number} of {count}",
                sensor=words,
                number=frame + 1,
                count=self._frames,
            )
        return words, span, self._of_sensors[number]

    def note(self, name: str, took: float, estimated: float) -> None:
        """Note what a run took; those of a frame range add up."""
        self._ran += 1
        before = self._times.get(name, (0.0, 0.0))
        self._times[name] = before[0] + took, before[1] + estimated

    def told(self, sentence: str) -> str:
        """Sentence at the end: of one run its own, of several the times of all."""

        def both(times: tuple[float, float]) -> str:
            took, estimated = map(time_in_words, times)
            return say("{took} ({estimated} estimated)", took=took, estimated=estimated)

        runs = list(self._times.items())
        if self._ran == 1:
            estimated = time_in_words(runs[0][1][1])
            return say("{found} ({estimated} estimated)", found=sentence, estimated=estimated)
        whole = sum(times[0] for _, times in runs), sum(times[1] for _, times in runs)
        each = ", ".join(f"{name} {both(times)}" for name, times in runs)
        return say("{count} runs in {time}: {each}", count=self._ran, time=both(whole), each=each)


FEW = 3  # names of objects in a sentence
SHOWN = 40  # letters of a name


class FOREST_OT_run(Working, bpy.types.Operator):
    """Run sensors in the scene as it is evaluated now, or on every frame of the frame range"""

    bl_label = "Run Sensor"
    needs = (
        (
            lambda context: sensors.sensors_of(context.scene),
            keep("There is no sensor yet. Add one to the list"),
        ),
        (
            lambda context: any(map(may_be_met, context.view_layer.objects)),
            keep("There is nothing to sense in this scene. Grow a forest first"),
        ),
    )

    sensor: bpy.props.StringProperty(
        name="Sensor",
        description="Name of its object; empty: all of them",
        options={"SKIP_SAVE"},
    )
    frames: bpy.props.EnumProperty(
        name="Frames",
        items=[
            ("THIS", "This Frame", "The scene as it is now"),
            ("RANGE", "Frame Range", "Each frame of the scene's range; files are numbered"),
        ],
        options={"SKIP_SAVE"},
    )

    sure: bpy.props.BoolProperty(options={"HIDDEN", "SKIP_SAVE"})
    again: bpy.props.BoolProperty(
        name="Again",
        description="Only sensors whose result is from before the last change",
        options={"SKIP_SAVE"},
    )
    keep: bpy.props.BoolProperty(
        name="Keep in File",
        description="Points and pictures of all frames stay in this file; the timeline shows them",
        options={"SKIP_SAVE"},
    )

    @classmethod
    def description(cls, context: bpy.types.Context, given: bpy.types.OperatorProperties) -> str:
        """Sentence on what it would do, with what that costs where the settings say."""
        words, cost = say(cls.__doc__ or ""), estimate(context, given.sensor, given.again)
        return f"{words}.\n{cost_in_words(cost)}" if cost else words

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if not (self.sure or bpy.app.background):
            frames = len(frames_of(context.scene)) if self.frames == "RANGE" else 1
            if is_large(estimate(context, self.sensor, self.again), frames, self.keep):
                return set(
                    bpy.ops.forest.run_large(
                        "INVOKE_DEFAULT",
                        sensor=self.sensor,
                        frames=self.frames,
                        keep=self.keep,
                        again=self.again,
                    )
                )
        return super().invoke(context, event)

    def work(self, context: bpy.types.Context) -> Work:
        scene = context.scene
        yield getting_ready("blender.sensors.observe", "ui.results.finding")
        chosen = chosen_things(scene, self.sensor, self.again)
        if not chosen and self.again:
            problem = say("no result is from before the last change; press Run")
            raise SpecError(say("Run Again"), problem)
        if not chosen:
            problem = say("{name} is no sensor of this scene; add it again", name=self.sensor)
            raise SpecError("sensor", problem)
        to_spec(scene, [])
        folder = _folder(scene.forest_sensing.output)
        self._broken: dict[str, str] = {}  # what is wrong with sensors, by name
        able: list[tuple[bpy.types.Object, Cost]] = []
        for obj in chosen:
            with self._apart(obj.name):
                able.append((obj, costs(context, [obj])[0]))
        if not able:
            raise ValueError(self._problems())
        chosen = [obj for obj, _ in able]
        frames = frames_of(scene)
        ahead = Ahead([cost for _, cost in able], 1 if self.frames == "THIS" else len(frames))
        if self.frames == "THIS":
            sentence = yield from self._look(context, chosen, folder, None, ahead)
            return self._told(ahead, sentence)
        now, part_of_frame, sentence = scene.frame_current, scene.frame_subframe, ""
        if folder is None and not self.keep and len(frames) > 1:
            problem = say(
                "choose a folder, or Keep in File: of {count} frames the panel keeps one",
                count=len(frames),
            )
            raise SpecError(say("Save To"), problem)
        try:
            for frame in frames:
                scene.frame_set(frame)
                sentence = yield from self._look(context, chosen, folder, frame, ahead)
        finally:
            scene.frame_set(now, subframe=part_of_frame)
        return self._told(ahead, sentence)

    @contextmanager
    def _apart(self, name: str, frame: int | None = None) -> Iterator[None]:
        """Note what is wrong with a sensor in this block, so that others run."""
        try:
            yield
        except PROBLEMS as problem:
            said = in_words(problem)
            short = name if len(name) <= SHOWN else f"{name[:SHOWN]}…"
            said = said if name in said else f"{short}: {said}"
            if frame is not None:
                said = say("frame {frame}: {said}", frame=frame, said=said)
            self._broken.setdefault(name, said)

    def _problems(self) -> str:
        """Sentences on what is wrong with the first sensors that do not run, and how many more there are."""
        problems = list(self._broken.values())
        more = len(problems) - FEW
        others = [say("({count} more)", count=more)] if more > 0 else []
        return " ".join(problems[:FEW] + others)

    def _told(self, ahead: Ahead, sentence: str) -> str:
        """Sentence at the end, with what did not run and why.

        Raises
        ------
        ValueError : nothing ran.
        """
        broken = self._problems()
        if not self._job.kept:
            raise ValueError(broken)
        for problem in self._broken.values():
            self.report({"WARNING"}, problem)
        said = ahead.told(sentence)
        return said if not broken else say("{said}. NOT RUN: {broken}", said=said, broken=broken)

    def _look(
        self,
        context: bpy.types.Context,
        things: Iterable[bpy.types.Object],
        folder: Path | None,
        frame: int | None,
        ahead: Ahead,
    ) -> Work:
        """Run these sensors in the scene of one frame, None: as it is, of which nothing is numbered."""
        from ...blender.sensors.moving import seconds_of
        from ...blender.sensors.observe import Observer

        rays = rays_of(to_spec(context.scene, []).rays)
        missing: list[str] = []
        sway = yield from swaying(context, missing)
        observer = Observer.of(context.evaluated_depsgraph_get(), rays, expansions())
        observer.blow(sway, seconds_of(context.scene))
        warnings = (*missing, observer.warning, names_unrendered(context.view_layer))
        for sentence in filter(None, warnings):
            self.report({"WARNING"}, sentence)
        sentence = ""
        for obj in things:
            with self._apart(obj.name, frame):
                sentence = yield from self._sense(context, obj, observer, folder, frame, ahead)
        return sentence

    def _sense(
        self,
        context: bpy.types.Context,
        obj: bpy.types.Object,
        observer: Observer,
        folder: Path | None,
        frame: int | None,
        ahead: Ahead,
    ) -> Work:
        """Run one sensor."""
        from ...stand.plan import labels
        from ..results.finding import keep_finding, note_audit, note_figures

        started = time.perf_counter()
        step, span, cost = ahead.next(obj.name)
        home = Path(bpy.path.abspath(context.scene.forest_sensing.folder))
        number = "" if frame is None else f"-{frame:04d}"
        settings = to_spec(context.scene, [obj])
        (sensor,) = settings.sensors
        job = observer.job(sensor, settings, home)  # here: it goes from frame to frame
        found = yield Task(step, partial(kind_of(sensor).run, job), span=span)
        took = time.perf_counter() - started
        note_pace(sensor, cost, took)
        observer.ran.add(sensor.kind)
        ahead.note(obj.name, took, cost.seconds)
        planted = planted_names(context.scene, labels(settings.plantings))
        if self.keep and obj.name not in self._job.kept:
            begin_frames(context.scene, obj.name)
        sentence = keep_finding(
            context,
            obj,
            sensor,
            found,
            took,
            Offset.of(settings),
            (observer.names, planted),
            frame if self.keep else None,
            observer.geometry,
        )
        estimate = keep(
            "{took:.1f} s, {estimated:.1f} s estimated", took=took, estimated=cost.seconds
        )
        note_figures(context, obj.name, {"Time": estimate})
        empty = kind_of(sensor).empty(job, found)
        if empty:
            sentence = f"{obj.name}: {empty}"
            self.report({"WARNING"}, sentence)
        self._job.kept.append(obj.name)
        if folder is not None:
            numbered = replace(sensor, name=sensor.name + number)
            sentence += self._save(folder, obj.name, numbered, found, Offset.of(settings))
        at_end = (span[1], span[1])
        audit = yield Task(step, lambda _tell: audited(job, found, took), span=at_end)
        if audit is not None:
            note_audit(context, obj.name, audit)
            if not audit.kept:
                self.report({"WARNING"}, f"{obj.name}: {audit}")
        return sentence

    def _save(self, folder: Path, name: str, sensor: Sensor, found: Finding, offset: Offset) -> str:
        """Save a result where nothing of the user's is replaced; returns the end of the sentence on it."""
        from ...results.kinds import write_finding

        advice = say("choose another folder, or move it away")
        try:
            with keeping(Keeper(folder, "panel", advice=advice)) as keeper:
                keeper.reads(bpy.data.filepath)
                path = write_finding(folder, sensor, found, offset)[0]
        except (OSError, ImportError, SpecError) as problem:
            reason = in_words(problem)
            self.report(
                {"WARNING"}, say("{sensor}: not saved: {reason}", sensor=name, reason=reason)
            )
            return ""
        bpy.context.scene.forest_sensing.results[name].file = str(path)
        return say(", saved as {path}", path=path)


FOUND = ("build", "new_seed", "run", "run_frames", "look_through", "load_scene", "save_scene")


@menu("Forest")
def forest(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """Menu through which a search by F3 finds what grows and runs: it looks through those of the view."""
    for name in FOUND:
        menu.layout.operator(f"forest.{name}")


def draw_menu(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    """The entry in the view's menu *Object*."""
    menu.layout.menu(forest.__name__, icon="OUTLINER_OB_CURVES")


MENUS = (("VIEW3D_MT_object", draw_menu),)


def _draw_large(pressed: bpy.types.Operator, context: bpy.types.Context) -> None:
    frames = len(frames_of(context.scene)) if pressed.frames == "RANGE" else 1
    cost = estimate(context, pressed.sensor, pressed.again)
    pressed.layout.label(text=cost_in_words(cost, frames, pressed.keep), icon="INFO")
    pressed.layout.label(text="Esc stops it; what was found until then stays.")


@made(
    bpy.types.Operator,
    "OT",
    "execute",
    "Run All the Same",
    bl_options={"INTERNAL"},
    invoke=asked(keep("This is a large run"), keep("Run"), 340),
    draw=_draw_large,
    sensor=bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"}),
    frames=bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"}),
    keep=bpy.props.BoolProperty(options={"HIDDEN", "SKIP_SAVE"}),
    again=bpy.props.BoolProperty(options={"HIDDEN", "SKIP_SAVE"}),
)
def run_large(pressed: bpy.types.Operator, _context: bpy.types.Context) -> set[str]:
    """Ask before what takes long or much memory"""
    given = {name: getattr(pressed, name) for name in ("sensor", "frames", "keep", "again")}
    return set(bpy.ops.forest.run("INVOKE_DEFAULT", sure=True, **given))


def _draw_frames(pressed: bpy.types.Operator, context: bpy.types.Context) -> None:
    layout, scene = pressed.layout, context.scene
    column = split(layout)
    column.row().prop(pressed, "which", expand=True)
    frames = column.column(align=True)
    for name in ("frame_start", "frame_end", "frame_step"):
        frames.prop(scene, name)
    column.prop(scene.forest_sensing, "output")
    column.prop(pressed, "keep")
    layout.label(text=_how_many(pressed, scene), icon="INFO")


def _how_many(pressed: bpy.types.Operator, scene: bpy.types.Scene) -> str:
    one = pressed.which == "ONE" and pressed.sensor
    number, frames = 1 if one else len(sensors.sensors_of(scene)), len(frames_of(scene))
    if not (scene.forest_sensing.output or pressed.keep) and frames > 1:
        return label("Choose a folder in Save To, or Keep in File")
    runs = label(
        "{sensors} × {frames} frames: {runs:,} runs",
        sensors=pressed.sensor if one else number,
        frames=frames,
        runs=number * frames,
    )
    cost = estimate(bpy.context, pressed.sensor if one else "")
    return f"{runs}, {cost_in_words(cost, frames, pressed.keep)}" if cost else runs


@button(
    "Run Frame Range",
    WhenReady,
    needs=FOREST_OT_run.needs,
    bl_options=set(),
    invoke=asked(keep("Run Frame Range"), keep("Run"), 320),
    draw=_draw_frames,
    which=bpy.props.EnumProperty(
        name="Run",
        description="Which sensors run on every frame",
        items=[
            ("ONE", "This Sensor", "The one that is chosen in the list"),
            ("ALL", "All Sensors", "One after the other, frame by frame"),
        ],
        options={"SKIP_SAVE"},
    ),
    sensor=bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"}),
    keep=bpy.props.BoolProperty(
        name="Keep in File",
        description="Points and pictures of all frames stay in this file; the timeline shows them",
    ),
)
def run_frames(pressed: bpy.types.Operator, _context: bpy.types.Context) -> str:
    """Run sensors on every frame of the frame range; asks first how many, and where results go"""
    one = pressed.sensor if pressed.which == "ONE" else ""
    press(bpy.ops.forest.run, sensor=one, frames="RANGE", keep=pressed.keep, sure=True)
    return ""


def frames_of(scene: bpy.types.Scene) -> range:
    """The frames of a scene's range."""
    return range(scene.frame_start, scene.frame_end + 1, scene.frame_step)


def names_unrendered(layer: bpy.types.ViewLayer) -> str:
    """Say which objects sensors meet although renders do not show them; empty where there are none."""
    names = sorted(obj.name for obj in layer.objects if is_unrendered(obj))
    if not names:
        return ""
    more = say(" and {count:,} more", count=len(names) - FEW) if len(names) > FEW else ""
    return say(
        "Hidden in renders, and sensed all the same: {names}{more}",
        names=", ".join(names[:FEW]),
        more=more,
    )


def _folder(output: str) -> Path | None:
    """Folder in which results are saved, made where it is missing; None where they are not.

    Raises
    ------
    SpecError : there can be no such folder.
    """
    if not output:
        return None
    if output.startswith("//") and not bpy.data.filepath:
        problem = say("// means beside the .blend file; save that first")
        raise SpecError(say("Save To"), problem)
    folder = Path(bpy.path.abspath(output))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        said = say("{folder} cannot be made: {reason}", folder=folder, reason=problem.strerror)
        raise SpecError(say("Save To"), said) from None
    return folder
