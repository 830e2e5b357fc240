"""When work may begin, where it goes on, and that nothing of it piles up."""

import ast
import importlib
import importlib.util
import inspect
import re
import subprocess
import sys
import textwrap
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

from ui.pressing import SENSORS, add_cube, counts, excluded, facts, press, settings_of, trees

from forest_addon import spec, ui
from forest_addon.blender.jobs import Job
from forest_addon.blender.scene import forest as forest_room
from forest_addon.blender.sensors import objects as sensors
from forest_addon.ui.forest import build
from forest_addon.ui.sensors.run import FOREST_OT_run
from forest_addon.ui.settings import exchange
from forest_addon.ui.shell import running


@pytest.mark.medium
def test_a_job_whose_scene_is_removed_says_so(built):
    scene, said = bpy.data.scenes.new("Second"), []
    modal = SimpleNamespace(
        _job=Job("Build", (None for _ in ())), _begun_in=(scene, scene.view_layers[0].name),
        _leave=lambda _: None, report=lambda _, words: said.append(words),
    )  # fmt: skip
    bpy.data.scenes.remove(scene)
    tick = SimpleNamespace(type="TIMER", value="NOTHING")
    assert running.Working.modal(modal, bpy.context, tick) == {"CANCELLED"}
    assert said == ["The scene was removed or undone meanwhile; run it again"]


@pytest.mark.slow
def test_everything_twice_nothing_piles_up(small):
    def everything():
        assert press("build") == {"FINISHED"}
        assert press("run") == {"FINISHED"}

    everything()
    before = counts()
    everything()
    assert counts() == before
    assert sorted(result.name for result in small.results) == sorted(["forest", *SENSORS])


# ------------------------------------------------------------------------------ cancelled and redone


class Pressed:
    """A button that was pressed in a window: what ``modal`` needs of its operator."""

    def __init__(self, kind, **settings):
        self.__dict__.update(settings)
        self.said, self._shown = [], ""
        self._begun_in = bpy.context.scene, bpy.context.view_layer.name
        self._kind = kind
        self._job = Job("Run Sensor", kind.work(self, bpy.context))

    def __getattr__(self, name):
        return partial(getattr(self._kind, name), self)

    def _leave(self, _context):
        pass

    def report(self, _kind, words):
        self.said.append(words)

    def until(self, over):
        """Tick until a condition holds; the answer to Blender then."""
        answer = {"RUNNING_MODAL"}
        while answer == {"RUNNING_MODAL"} and not over():
            tick = SimpleNamespace(type="TIMER", value="NOTHING", ctrl=False, oskey=False)
            answer = running.Working.modal(self, bpy.context, tick)
        return answer

    def escape(self):
        key = SimpleNamespace(type="ESC", value="PRESS", ctrl=False, oskey=False)
        return running.Working.modal(self, bpy.context, key)


@pytest.mark.slow
def test_a_job_stays_in_the_scene_that_it_was_begun_in(built):
    """Whatever the window shows meanwhile: points, figures and forest belong where the button was pressed."""
    first, second = bpy.context.scene, bpy.data.scenes.new("Second")

    def looks_elsewhere():
        bpy.context.window.scene = second

    for kind, expected in (
        (build.FOREST_OT_build, ["forest"]),
        (FOREST_OT_run, ["cloud", "forest"]),
    ):
        button = Pressed(kind, sensor="cloud", frames="THIS", keep=False, again=False, area=None)
        assert button.until(looks_elsewhere) == {"FINISHED"}
        assert sorted(first.forest_sensing.results.keys()) == expected
        assert len(second.forest_sensing.results) == len(second.objects) == 0
        bpy.context.window.scene = first


@pytest.mark.slow
@pytest.mark.parametrize(
    ("until", "answer", "said", "found"),
    [
        ("cloud, 1 of 4", "CANCELLED", "nothing was changed", set()),
        ("reverb, 3 of 4", "FINISHED", "what was done stays: cloud, echo", {"cloud", "echo"}),
    ],
)
def test_escape_says_what_stays_and_leaves_a_step_to_undo(built, until, answer, said, found):
    """Sensors that had finished are kept: Blender is told of a change, the user of which."""
    button = Pressed(FOREST_OT_run, sensor="", frames="THIS", keep=False, again=False)
    button.until(lambda: button._job.label == until)
    assert button.escape() == {answer}
    assert button.said == [f"Run Sensor was cancelled; {said}"]
    assert set(built.results.keys()) == {"forest"} | found


@pytest.mark.slow
def test_what_was_found_before_an_error_can_be_undone_too(built):
    button = Pressed(FOREST_OT_run, sensor="", frames="THIS", keep=False, again=False)
    button.until(lambda: "cloud" in built.results)
    bpy.data.objects.remove(sensors.receiver_of(bpy.data.objects["reverb"]))
    assert button.until(lambda: False) == {"FINISHED"}
    assert "receiver is gone" in button.said[-1]


def test_a_first_build_that_is_cancelled_leaves_an_empty_scene(props, monkeypatch):
    before = counts()
    button = Pressed(build.FOREST_OT_build, area=None)
    button.until(lambda: button._job.label == "growing trees")
    assert button.escape() == {"CANCELLED"}
    assert counts() == before
    assert exchange.untouched(props)


def starts_a_job(cls):
    """Whether an operator computes in the background, or calls one that does."""
    if issubclass(cls, running.Working):
        return True
    trees = [
        ast.parse(textwrap.dedent(inspect.getsource(each)))
        for each in vars(cls).values()
        if inspect.isfunction(each)
    ]
    nodes = (node for tree in trees for node in ast.walk(tree))
    named = {ast.unparse(node) for node in nodes if isinstance(node, ast.Attribute)}
    jobs = {f"bpy.ops.{c.bl_idname}" for c in of_ours() if issubclass(c, running.Working)}
    return bool(named & {*jobs, "bpy.ops.wm.read_homefile"})


def of_ours():
    return [cls for cls in ui._classes() if issubclass(cls, bpy.types.Operator)]


def test_operators_that_start_jobs_are_not_redone(registered):
    """The redo panel and *Repeat Last* run an operator to its end at once: the window would stand still."""
    made = (
        "forest_addon.ui.settings.drawing",
        "forest_addon.ui.settings.presets",
    )  # without a source
    plain = [cls for cls in of_ours() if cls.__module__ not in made]
    starting = {cls.__name__ for cls in plain if starts_a_job(cls)}
    assert {"FOREST_OT_run", "FOREST_OT_build", "FOREST_OT_import_tree"} <= starting
    for cls in plain:
        options = getattr(cls, "bl_options", {"REGISTER"})  # Blender's own, where none are given
        assert cls.__name__ not in starting or "REGISTER" not in options, cls.__name__


def test_an_import_that_another_thread_is_in_the_way_of_is_tried_again(monkeypatch):
    blocked = importlib._bootstrap._DeadlockError("two threads")
    outcomes, asked = [blocked, blocked, None], []

    def import_room(name):
        asked.append(name)
        if outcome := outcomes.pop(0):
            raise outcome

    monkeypatch.setattr(importlib, "import_module", import_room)
    running.getting_ready("site").run(None)
    assert asked == 3 * ["forest_addon.site"]
    outcomes[:] = [RuntimeError("another")]
    with pytest.raises(RuntimeError, match="another"):
        running.getting_ready("site").run(None)


# -------------------------------------------------------------------------------------- registration
# All or nothing: what the add-on registers, and that nothing of it stays.

ROOT = Path(__file__).resolve().parents[2]


def ours():
    """What Blender knows of us."""
    found = {
        cls.__name__
        for base in (bpy.types.PropertyGroup, bpy.types.Operator, bpy.types.Panel, bpy.types.UIList)
        for cls in base.__subclasses__()
        if cls.__name__.startswith("FOREST_") and getattr(cls, "is_registered", False)
    }
    found |= {name for name in dir(bpy.types) if name.startswith("FOREST_")}
    if hasattr(bpy.types.Scene, "forest_sensing"):
        found.add("Scene.forest_sensing")
    return found


@pytest.mark.parametrize("scenario", sorted((ROOT / "tests" / "gui").glob("*.py")), ids=str)
def test_scenarios_of_the_window_name_what_is_there(scenario):
    """Most of them are played by hand alone."""
    for room, name in re.findall(r'ours\("([^"]+)"\)\.(\w+)', scenario.read_text("utf-8")):
        assert hasattr(importlib.import_module(f"forest_addon.{room}"), name), (room, name)


@pytest.fixture
def unregistered(registered):
    """The add-on taken back for one test, and registered again after it."""
    ui.unregister()
    yield
    ui.register()


def test_unregistering_leaves_nothing(unregistered):
    assert ours() == set()
    for _ in range(2):
        ui.register()
        assert {"Scene.forest_sensing", "FOREST_PT_forest", "FOREST_PG_scene"} <= ours()
        assert hasattr(bpy.context.scene, "forest_sensing")
        ui.unregister()
        assert ours() == set()
        assert not hasattr(bpy.context.scene, "forest_sensing")


def test_registering_twice_is_refused_and_changes_nothing(registered):
    before = ours()
    with pytest.raises(ValueError, match="already registered"):
        ui.register()
    assert ours() == before


@pytest.mark.parametrize("position", [0, 9, -1])
def test_a_class_that_fails_takes_back_those_before_it(unregistered, monkeypatch, position):
    class Broken(bpy.types.Panel):
        """No space type: Blender refuses it."""

    classes = list(ui._classes())
    classes.insert(position, Broken)
    monkeypatch.setattr(ui, "_classes", lambda: tuple(classes))
    with pytest.raises((RuntimeError, ValueError, AttributeError)):
        ui.register()
    assert ours() == set()
    monkeypatch.undo()


IMPORTED = """
import atexit, sys
import bpy
before = set(sys.modules)
import forest_addon
atexit.register(forest_addon.unregister)
forest_addon.register()
new = {name.split(".")[0] for name in set(sys.modules) - before}
heavy = new & {"scipy", "laspy", "lazrs", "cattrs", "matplotlib", "tqdm"}
rooms = {n for n in sys.modules if n.startswith("forest_addon.")}
rooms = {r for r in rooms if r.split(".")[1] not in ("base", "ui", "spec", "blender")}
records = {"kind", "kinds", "look", "looks", "cost", "audit", "lines"}  # of sensors: light
records |= {"emptiness", "sensing", "lidar", "sonar", "reverb", "rays", "boxes"}
records |= {"geometry", "caster", "table", "exact"}
records |= {"formats", "atomic", "crs", "foreign", "ownership", "toml_file", "wav"}  # of the standard library
records |= {"results", "coordinates"}
print(sorted(heavy), sorted(r for r in rooms if not set(r.split(".")[1:]) <= records))
"""


@pytest.mark.slow
def test_enabling_imports_nothing_heavy():
    assert said_by(IMPORTED).splitlines()[-1] == "[] []"


def said_by(code):
    """What a Python of its own says that runs this."""
    run = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300
    )
    assert run.returncode == 0, run.stderr
    return run.stdout.strip()


WITHOUT_SCIPY = """
import atexit, importlib.util
import bpy

find = importlib.util.find_spec
importlib.util.find_spec = lambda name: None if name == "scipy" else find(name)
import forest_addon
atexit.register(forest_addon.unregister)
forest_addon.register()
from forest_addon.ui.shell import running
print(running.missing())
try:
    bpy.ops.forest.build()
except RuntimeError as problem:
    print(problem)
"""


@pytest.mark.slow
def test_enables_without_scipy_and_says_what_is_missing():
    said = said_by(WITHOUT_SCIPY)
    assert "('scipy',)" in said
    assert "scipy is missing in this Blender" in said


@pytest.mark.parametrize("file", sorted((ROOT / "forest_addon" / "ui").rglob("*.py")), ids=str)
def test_what_work_imports_first_is_there(file):
    """It is named by text."""
    for call in re.findall(r"getting_ready\(([^)]*)\)", file.read_text("utf-8")):
        for room in re.findall(r'"([\w.]+)"', call):
            assert importlib.util.find_spec(f"forest_addon.{room}"), room


# ----------------------------------------------------------------------------------------- refusals
# Refusals of the panel: each in words, after which nothing is changed.


def as_it_is(_at):
    pass


def settle(path, **values):
    """Change settings: those on the object of a sensor, or a group or the item of a list of the scene's."""

    def change(at):
        group = settings_of(path) if path in bpy.data.objects else at.props.path_resolve(path)
        for key, value in values.items():
            setattr(group, key, value)

    return change


def scanner(**settings):
    return lambda _: exchange.add_sensor(bpy.context.scene, spec.Mobile(**settings))


def scene_file(text):
    return lambda at: (at.folder / "bad.toml").write_text(text)


def without_scipy(at):
    at.patch.setattr(running, "missing", lambda: ("scipy",))


def full_memory(at):
    def full(*_):
        raise MemoryError

    at.patch.setattr(forest_room, "ground_mesh", full)


def editing(_):
    bpy.context.view_layer.objects.active = add_cube()
    bpy.ops.object.mode_set(mode="EDIT")


def chosen(name):
    def choose(_):
        bpy.ops.object.select_all(action="DESELECT")
        bpy.context.view_layer.objects.active = bpy.data.objects[name]

    return choose


def names_alike(at):
    at.props.output = str(at.folder)
    bpy.data.objects["cloud"].name, bpy.data.objects["echo"].name = "echo.1", "echo-1"


def below_a_file(at):
    (at.folder / "file").write_text("x")
    at.props.output = str(at.folder / "file" / "results")


def three_frames(_):
    bpy.context.scene.frame_end = 3


def points_gone(at):
    bpy.data.objects.remove(bpy.data.objects[at.props.results["cloud"].shown])


def dry_file_gone(at):
    at.props.dry, at.props.dry_file = "FILE", str(at.folder / "none.wav")


ANY = {"sensor": "cloud"}
BAD = {"filepath": "{}/bad.toml"}
REFUSED = [
    ("build", {}, settle("forest", size=(0, 6)), r"forest\.size\[0\].*larger than 0"),
    ("build", {}, settle("plantings[0]", species="baobab"), "baobab.*hazelnut"),
    ("build", {}, settle("plantings[0]", species="no.toml"), "no.toml.*no such file"),
    ("build", {}, settle("plantings[0]", use_expected=False), "expected.*give a number"),
    ("build", {}, settle("plantings[0]", scale=(2, 1)), "smallest, largest"),
    ("build", {}, full_memory, "not enough memory"),
    ("build", {}, editing, "Object Mode"),
    ("build", {}, without_scipy, "scipy is missing"),
    ("run", {}, editing, "Object Mode"),
    ("run", {}, without_scipy, "scipy is missing"),
    ("run", {}, names_alike, '"echo-1" is taken'),
    ("run", {"again": True}, as_it_is, "no result is from before"),
    ("run", ANY, excluded, "nothing to sense"),
    ("run", ANY, settle("cloud", azimuth_deg=(90, 10)), "from < to"),
    ("run", {"sensor": "scan"}, settle("scan", top=0.5), r"scan\.top.*above the scanner"),
    ("run", {"sensor": "echo"}, settle("echo", band=(1e5, 3e5)), r"echo\.band.*sample_rate"),
    ("run", {"sensor": "track"}, scanner(), "give poses, or the object to follow"),
    ("run", {"sensor": "track"}, scanner(follow="Nothing"), 'no object "Nothing"'),
    ("run", ANY, below_a_file, r"Save To.*cannot be made"),
    (
        "run",
        {**ANY, "frames": "RANGE"},
        three_frames,
        r"Save To.*choose a folder, or Keep.*3 frames",
    ),
    ("run_frames", ANY, three_frames, "choose a folder"),
    ("lock_trees", {}, chosen("cloud"), "Select trees of the forest"),
    ("paint", {}, settle("forest.terrain", object="nowhere"), 'no object "nowhere"'),
    ("paint", {}, lambda at: at.props.plantings.clear(), "no planting yet"),
    ("grow_again", {}, chosen("cloud"), "no tree of Add"),
    ("new", {"preset": "baobab"}, as_it_is, r"There is no scene .baobab."),
    ("fly", {"policy": "gap"}, as_it_is, "no flyer yet; add one"),
    ("edit_species", {}, settle("plantings[0]", species="gone.toml"), "there is no such file"),
    ("save_species", {"filepath": "x.toml"}, as_it_is, "Press Edit first"),
    ("add_source", {}, chosen("cloud"), "Choose a reverb"),
    ("apply_preset", {"kind": "wind", "values": '{"speed": 400}'}, as_it_is, "speed"),
    ("export_result", {"result": "cloud", "filepath": "{}/a.doc"}, as_it_is, r"use \.laz"),
    (
        "export_result",
        {"result": "cloud", "filepath": "{}/a.laz"},
        points_gone,
        "Run its sensor again",
    ),
    ("play", {"sensor": "reverb"}, dry_file_gone, r"none\.wav: there is no such file"),
    ("show_result", {"result": "forest"}, as_it_is, "no points"),
    ("look_through", {}, chosen("reverb"), "no eyes"),
    ("load_scene", BAD, as_it_is, "no such file"),
    ("load_scene", BAD, scene_file("["), "not TOML"),
    ("load_scene", BAD, scene_file("seed = -1"), "seed"),
    ("load_scene", BAD, scene_file("forrest = 1"), "did you mean"),
    ("load_scene", BAD, scene_file("seed = 9999999999"), "too large for the panel"),
]


def state(props):
    """Return numbers of blocks, places of trees, settings, results and the mode."""
    places = {tree.name: tree.matrix_world.copy() for tree in trees()}
    found = {result.name: facts(props, result.name) for result in props.results}
    settings = [said(group) for group in (props, props.forest, props.wind, *props.plantings)]
    return counts(), places, found, settings, bpy.context.mode


def said(group):
    """The settings of a group, but for groups within it."""
    plain = [p for p in group.bl_rna.properties if p.type not in ("POINTER", "COLLECTION")]
    values = {known.identifier: getattr(group, known.identifier) for known in plain}
    return {k: tuple(v) if type(v).__name__ == "bpy_prop_array" else v for k, v in values.items()}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "given", "situation", "words"), REFUSED, ids=[f"{row[0]}: {row[3]}" for row in REFUSED]
)
def test_what_cannot_be_done_is_said_and_changes_nothing(
    ran, tmp_path, monkeypatch, name, given, situation, words
):
    situation(SimpleNamespace(props=ran, folder=tmp_path, patch=monkeypatch))
    bpy.context.view_layer.update()
    given = {k: v.format(tmp_path) if k == "filepath" else v for k, v in given.items()}
    before, files = state(ran), sorted(tmp_path.rglob("*"))
    with pytest.raises(RuntimeError, match=words):
        press(name, **given)
    assert state(ran) == before
    assert sorted(tmp_path.rglob("*")) == files
