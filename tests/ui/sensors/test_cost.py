"""What a run costs is said before, and what is large is asked about; then one bar leads through all of it."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from references.scenes import link
from ui.pressing import next_uid, press

from forest_addon import spec
from forest_addon.blender.read import depsgraph
from forest_addon.blender.read.depsgraph import read_scene
from forest_addon.blender.sensors import objects as sensors
from forest_addon.blender.sensors.observe import Observer
from forest_addon.sensing import kind as costs_of
from forest_addon.sensing.kinds import KINDS, kind_of
from forest_addon.sensing.lidar.tractor import TractorScan
from forest_addon.spec import Sonar
from forest_addon.ui.sensors import panels, run
from forest_addon.ui.sensors.run import Ahead
from forest_addon.ui.settings.exchange import to_spec


def things():
    return sensors.sensors_of(bpy.context.scene)


@pytest.mark.medium
def test_pulses_are_counted_as_they_are_sent(built):
    press("add_sensor", kind="drone")
    bpy.context.view_layer.objects.active.forest_sensor.mobile.pulse_rate = 500
    bpy.context.view_layer.update()
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    for obj in things():
        settings = to_spec(bpy.context.scene, [obj])
        found = observer.observe(settings.sensors[0], settings)
        said = run.costs(bpy.context, [obj])[0].count
        if isinstance(found, TractorScan):
            assert said == found.distance.size
        else:
            assert said == getattr(found, "pulses", 1)


def test_tooltips_write_nothing_and_know_the_way_of_what_is_followed(props):
    """Blender forbids to write while it draws: no block is made, and no frame is gone to."""
    scene = bpy.context.scene
    for kind in ("drone", "mobile", "sonar", "tractor"):
        press("add_sensor", kind=kind)
    sonar = bpy.context.view_layer.objects["Bat Sonar"]
    carrier = link("carrier")
    carrier.keyframe_insert("location", frame=1)
    sonar.forest_sensor.sonar.follow, sonar.forest_sensor.sonar.poses = "carrier", 7
    bpy.context.view_layer.update()
    exact = {}
    for obj in things():
        (sensor,) = to_spec(scene, [obj]).sensors
        exact[obj.name] = kind_of(sensor).cost(sensor, Observer.way(sensor), "embree").count
    gone_to = []
    note = gone_to.append
    bpy.app.handlers.frame_change_pre.append(note)
    before = next_uid()
    counts = {obj.name: run.costs(bpy.context, [obj])[0].count for obj in things()}
    for given in (SimpleNamespace(sensor=name, again=False) for name in ("", *counts)):
        assert run.FOREST_OT_run.description(bpy.context, given)
    bpy.app.handlers.frame_change_pre.remove(note)
    assert (next_uid(), gone_to) == (before + 1, [])
    assert counts == pytest.approx(exact, rel=1e-5)
    assert counts["Bat Sonar"] == 7


def test_a_reverb_is_guessed_to_take_longer_among_more_trees(built, monkeypatch):
    """By what each tree adds; a run's pace is of the whole guess then."""
    monkeypatch.setattr(costs_of, "_pace", {})
    plantings = bpy.context.scene.forest_sensing.plantings
    (obj,) = (one for one in things() if sensors.kind_of(one) == "reverb")
    few = run.costs(bpy.context, [obj])[0]
    plantings[0].standing += 1000
    many = run.costs(bpy.context, [obj])[0]
    settings = to_spec(bpy.context.scene, [obj])
    kind, standing = KINDS["reverb"], sum(planting.standing for planting in plantings)
    more = [
        sum(kind.seconds_among(settings.sensors[0], settings, n, 1))
        for n in (standing - 1000, standing)
    ]
    assert many.seconds - few.seconds == pytest.approx(more[1] - more[0])
    assert more[1] > more[0]
    costs_of.note_pace(to_spec(bpy.context.scene, [obj]).sensors[0], many, 30.0)
    assert run.costs(bpy.context, [obj])[0].seconds == pytest.approx(30.0)


def test_its_own_pace_counts_once_a_sensor_has_run(built, monkeypatch):
    monkeypatch.setattr(costs_of, "_pace", {})
    (obj,) = (obj for obj in things() if obj.name == "cloud")
    guess = run.costs(bpy.context, [obj])[0]
    assert guess.seconds == pytest.approx(guess.setup + guess.work * costs_of.RAY)
    assert guess.setup > costs_of.BEGIN
    sensor = to_spec(bpy.context.scene, [obj]).sensors[0]
    costs_of.note_pace(sensor, guess, 12.0)
    assert run.costs(bpy.context, [obj])[0].seconds == pytest.approx(12.0)
    twice = Sonar(ears=2)  # of which the seconds to begin are no less by half
    guessed = [kind_of(bat).cost(bat, None, "embree") for bat in (Sonar(ears=1), twice)]
    assert 0.5 < guessed[0].seconds / guessed[1].seconds < 1.0
    costs_of.note_pace(twice, guessed[1], 3.0)
    after = [kind_of(bat).cost(bat, None, "embree").seconds for bat in (Sonar(ears=1), twice)]
    assert after[1] == pytest.approx(3.0)
    assert 0.5 < after[0] / after[1] < 1.0


@pytest.mark.parametrize(
    ("count", "seconds", "memory", "words"),
    [
        (22_500_000, 300.0, 1.8e9, "22.5 M pulses, about 5 min, 1.8 GB"),
        (691_200, 1.0, 1e6, "691k pulses, about a second"),
        (900, 7000.0, 0, "900 pulses, about 1.9 h"),
    ],
)
def test_in_words(props, count, seconds, memory, words):
    one = costs_of.Cost("pulses", count, count, seconds, int(memory))
    assert run.cost_in_words([one]) == words
    assert run.is_large([one]) == (seconds > 60)


def test_what_all_frames_keep_counts_too(props):
    one = costs_of.Cost("pulses", 1000, 1000, 0.01, 30_000_000)
    assert not run.is_large([one], 250)
    assert run.is_large([one], 250, keep=True)
    assert run.cost_in_words([one], 250, keep=True).endswith("2.8 GB")  # 30 MB + 249 x (10 + 1) MB


def test_what_is_large_is_asked_about_before(built):
    for obj in things():
        if obj.name == "cloud":
            obj.forest_sensor.terrestrial.angle_step_deg = 0.01
    assert run.is_large(run.costs(bpy.context, things()))
    told = bpy.types.Operator.bl_rna_get_subclass_py("FOREST_OT_run").description

    class Given:
        sensor, again = "cloud", False

    assert "pulses" in told(bpy.context, Given)


def test_one_bar_leads_through_all_sensors_and_frames():
    found = [costs_of.Cost("pulses", 1, 1, seconds, 0) for seconds in (1.0, 3.0)]
    ahead = Ahead(found, frames=3)
    spans, words = [], []
    for _ in range(6):
        step, span, _ = ahead.next("cloud")
        spans.append(span)
        words.append(step)
    assert [low for low, _ in spans] == pytest.approx([0, 1 / 12, 4 / 12, 5 / 12, 8 / 12, 9 / 12])
    assert all(before[1] == pytest.approx(after[0]) for before, after in pairwise(spans))
    assert spans[-1][1] == pytest.approx(1.0)
    assert words[3] == "cloud, 2 of 2, frame 2 of 3"


def test_times_of_all_runs_are_told_beside_what_was_estimated():
    one, other = (costs_of.Cost("pulses", 1, 1, seconds, 0) for seconds in (1.0, 30.0))
    alone = Ahead([one], frames=1)
    alone.next("cloud")
    alone.note("cloud", 2.04, one.seconds)
    assert alone.told("300 points in 2.0 s") == "300 points in 2.0 s (1.0 s estimated)"
    frames = Ahead([one, other], frames=2)
    for name, took, cost_of in [("cloud", 2.0, one), ("echo", 20.0, other)] * 2:
        frames.next(name)
        frames.note(name, took, cost_of.seconds)
    assert frames.told("") == (
        "4 runs in 44 s (62 s estimated): cloud 4.0 s (2.0 s estimated), echo 40 s (60 s estimated)"
    )


def test_what_set_a_scene_up_is_not_estimated_again(built, monkeypatch):
    """Until something of it has changed; a run that is too short says nothing of others."""
    monkeypatch.setattr(costs_of, "_pace", {})
    depsgraph.close()
    (obj,) = (obj for obj in things() if obj.name == "cloud")

    def estimate():
        bpy.context.view_layer.update()
        return run.costs(bpy.context, [obj])[0]

    first = estimate()
    assert first.setup >= costs_of.BEGIN + costs_of.TRIANGLE * run.triangles_in(bpy.context.scene)
    assert press("run", sensor="cloud") == {"FINISHED"}
    again = estimate()
    assert again.setup == 0
    assert again.work == first.work
    obj.location.x += 0.1
    assert estimate().setup == 0
    next(one for one in bpy.data.objects if "forest_tree" in one).location.x += 0.1
    assert estimate().setup == pytest.approx(first.setup)
    assert press("run", sensor="cloud") == {"FINISHED"}
    others = [one for one in things() if sensors.kind_of(one) == "sonar"]
    assert run.costs(bpy.context, others)[0].setup > 1.0  # none of its kind has run yet


@pytest.mark.parametrize("part", ["setup", "work"])
def test_a_pace_is_of_the_part_that_it_was_seen_in(monkeypatch, part):
    """A slow set-up does not slow the rays of the next run down, nor the other way round."""
    monkeypatch.setattr(costs_of, "_pace", {})
    bat = Sonar()
    setup, work = (9.0, 1.0) if part == "setup" else (1.0, 9.0)
    cost = costs_of.Cost("pings", 1, 1, 10.0, 0, 10.0, setup)
    costs_of.note_pace(bat, cost, 19.0)
    later = costs_of.cost_with("sonar", cost, 0.0, 0.0)
    assert later.seconds == pytest.approx(19.0)
    other = costs_of.Cost("pings", 1, 1, 0.0, 0, work, 0.0)
    assert costs_of.cost_with("sonar", other, 0.0, 0.0).seconds == pytest.approx(
        work if part == "setup" else 18.0
    )
    costs_of.note_pace(bat, costs_of.Cost("pings", 1, 1, 0.01, 0, 0.01), 0.1)
    assert costs_of.cost_with("sonar", cost, 0.0, 0.0).seconds == pytest.approx(19.0)


# -------------------------------------------------------------------------------------------- things
# What an object is to sensors, from the panel to what they find.


@pytest.fixture
def wall(small):
    bpy.ops.mesh.primitive_cube_add(location=(3, 3, 1))
    return bpy.context.object


def found():
    return read_scene(bpy.context.evaluated_depsgraph_get())


def test_an_object_is_seen_until_it_is_not_to_be(wall):
    assert wall.forest_seen
    assert wall.name in found().object_name
    wall.forest_seen = False
    assert wall.name not in found().object_name
    assert wall["forest_ignored"]
    wall.forest_seen = True
    assert wall.name in found().object_name
    assert "forest_ignored" not in wall


WATER, MIRROR, RETRO = ({"forest_polish": kind} for kind in ("WATER", "MIRROR", "RETRO"))


@pytest.mark.parametrize(
    ("settings", "reflects", "optics"),
    [
        ({"forest_reflects": True}, spec.Surfaces().other, {}),
        ({"forest_reflects": True, "forest_reflected": 0.25}, 0.25, {}),
        ({"forest_reflects": True, "forest_reflected": 3.0}, 1.0, {}),  # a share
        (WATER, np.nan, {0: 2}),
        (WATER | {"forest_refraction": 1.4}, np.nan, {0: 2, 1: 1.4}),
        (MIRROR | {"forest_mirrored": 0.75}, np.nan, {0: 0, 2: 0.75}),
        (RETRO | {"forest_gained": 300.0}, np.nan, {0: 3, 3: 300}),
    ],
)
def test_an_object_has_a_reflectance_of_its_own_is_a_mirror_or_water(
    wall, settings, reflects, optics
):
    for key, value in settings.items():
        setattr(wall, key, value)
    scene = found()
    assert scene.reflectance.tolist() == pytest.approx([reflects], nan_ok=True)
    assert (scene.optics is None) == (not optics)
    for column, value in optics.items():
        assert scene.optics[0, column] == pytest.approx(value)
    wall.forest_reflects, wall.forest_polish = False, "NONE"
    assert np.isnan(found().reflectance).all()
    assert found().optics is None


def test_optics_have_usual_values_and_what_is_misspelt_is_refused(wall):
    assert (wall.forest_reflects, wall.forest_polish) == (False, "NONE")
    wall.forest_polish = "WATER"
    assert wall["forest_optics"] == "water"
    assert wall.forest_refraction == pytest.approx(1.33)
    wall.forest_polish = "RETRO"
    assert wall.forest_gained == 785.0
    wall["forest_optics"] = "mirorr"
    wall.update_tag()  # a scanner that follows bounces refuses it
    assert found().optics[0, 0] == -1


def test_what_a_script_has_set_is_shown(wall):
    wall["forest_ignored"], wall["forest_reflectance"] = 1, 0.75
    assert not wall.forest_seen
    assert wall.forest_reflects
    assert wall.forest_reflected == 0.75
    wall["forest_reflectance"] = "white"  # sensors do not count it either
    assert wall.forest_reflected == spec.Surfaces().other


def test_it_is_undone(wall):
    bpy.ops.ed.undo_push(message="before")
    wall.forest_seen = False
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert bpy.data.objects["Cube"].forest_seen


def test_the_panel_is_there_for_what_sensors_could_see(wall):
    assert panels.thing.poll(bpy.context)
    for other in ("reverb", "cloud"):
        bpy.context.view_layer.objects.active = bpy.data.objects[other]
        assert not panels.thing.poll(bpy.context)
    bpy.context.view_layer.objects.active = None
    assert panels.seen_thing(SimpleNamespace(object=None)) is None
    assert not panels.thing.poll(bpy.context)


def test_objects_keep_it_without_the_add_on(wall):
    wall.forest_seen = False
    for owner, name, _ in panels.PROPERTIES:
        delattr(owner, name)
    try:
        assert not hasattr(wall, "forest_seen")
        assert wall["forest_ignored"]
        assert wall.name not in found().object_name
    finally:
        for owner, name, prop in panels.PROPERTIES:
            setattr(owner, name, prop)
    assert not wall.forest_seen
