"""Wrong arguments of a script end in one sentence, never in what breaks further in."""

import copy
import pickle

import laspy
import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from forest_addon import api as forest
from forest_addon.blender.sensors.observe import Observer

BUSH = forest.Planting(species="hazelnut", variants=1, expected=1, exact=True)
SCENE = forest.Scene(forest=forest.Forest(size=(4.0, 4.0), margin=2.0), plantings=(BUSH,))
COARSE = forest.Terrestrial(position=(-2.0, 3.0, 1.5), angle_step_deg=20.0)
CLAP = forest.Reverb(source=(-3, 3, 0.2), receiver=(9, 3, 0.2), sample_rate=8000, duration=0.05)


@pytest.fixture(scope="module")
def world():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return forest.build(SCENE)


@pytest.fixture(scope="module")
def results(world):
    row = forest.Tractor(track=1.0, step=0.5, angle_step_deg=5.0, reach=3.0)
    bat = forest.Sonar(position=(-2.0, 3.0, 1.5), cull=0.01)
    return [world.scan(COARSE), world.scan(row), world.ping(bat), world.impulse_response(CLAP)]


def other(species):
    return SCENE.changed(plantings=(BUSH.changed(species=species),))


@pytest.mark.medium
@pytest.mark.parametrize(
    ("do", "words"),
    [
        (
            lambda w: forest.current("x.blend"),
            "takes a Scene, not a str; read a scene file by read",
        ),
        (lambda w: forest.build("x.toml"), "build: takes a Scene, not a str; read a scene file"),
        (lambda w: forest.build(None), "takes a Scene, not None"),
        (lambda w: forest.build(SCENE, folder=3), "folder: takes the path"),
        (lambda w: forest.build(SCENE, progress=3), "progress: takes a function"),
        (lambda w: forest.read(3), "read: takes the path"),
        (lambda w: forest.read("a\0.toml"), "read: takes the path"),
        (lambda w: forest.instrument(None), "instrument: None is not a text"),
        (lambda w: forest.instrument("riegl-vz400i"), 'did you mean "riegl-vz-400i"?'),
        (lambda w: forest.instrument("../scanners/leica-blk360"), "is not known"),
        (lambda w: forest.instrument("leica-blk360", "terestrial"), 'did you mean "terrestrial"?'),
        (lambda w: forest.build(other("hazlenut")), 'did you mean "hazelnut"?'),
        (lambda w: forest.build(other("a/b")), "use one of abop"),
        (lambda w: forest.build(other("../species/maple")), "use one of abop"),
        (lambda w: forest.Sonar(call="fmm"), 'did you mean "fm"?'),
        (lambda w: w.scan(COARSE, progress=3), "progress: takes a function"),
        (lambda w: w.hemisphere(np.zeros(2)), "array (3,) of metres, not one of shape (2,)"),
        (lambda w: w.hemisphere(np.zeros((3, 3))), "array (3,) of metres"),
        (lambda w: w.hemisphere("here"), "not a str"),
        (lambda w: w.hemisphere((0, 0, np.nan)), "not finite"),
        (lambda w: w.hemisphere((0, 0, 1), pixels=10**7), "from 1 to 8192"),
        (lambda w: w.hemisphere((0, 0, 1), pixels=1.5), "not a whole number"),
        (lambda w: w.canopy(np.zeros((0, 3))), "array (N, 3)"),
        (lambda w: w.canopy(None), "array (N, 3)"),
        (lambda w: pickle.dumps(w), "cannot be copied or sent"),
        (lambda w: copy.deepcopy(w), "cannot be copied or sent"),
    ],
)
def test_one_sentence(do, words, world):
    with pytest.raises(forest.SpecError) as said:
        do(world)
    assert words in str(said.value)
    assert "\n" not in str(said.value)


@pytest.mark.medium
def test_results_go_where_a_file_can_be(results, tmp_path):
    """Every kind of result in every format: a folder that is missing or no folder, a folder's own name."""
    (tmp_path / "file").write_text("x")
    for result in results:
        for ending in result.endings:
            (tmp_path / f"folder{ending}").mkdir(exist_ok=True)
            for place, words in (
                (tmp_path / "none" / f"x{ending}", "make it first"),
                (tmp_path / "file" / f"x{ending}", "is no folder"),
                (tmp_path / f"folder{ending}", "is a folder"),
                (tmp_path / ("x" * 300 + ending), "shorten it"),
                (f"{tmp_path}/x\0{ending}", "takes the path"),
                (3, "takes the path"),
            ):
                with pytest.raises(forest.SpecError, match=words):
                    result.save(place)
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == {"file"}


@pytest.mark.medium
def test_what_is_called_copc_has_its_octree(results, tmp_path):
    for result in results[:2]:
        for name in ("a.copc.laz", "A.COPC.LAZ"):
            result.save(tmp_path / name)
            with laspy.CopcReader.open(tmp_path / name) as reader:
                assert len(reader.query()) == len(getattr(result, "cloud", result))


def test_results_travel_between_processes(results):
    for result in results:
        back = pickle.loads(pickle.dumps(result))
        assert back.sensor == result.sensor
        assert back.audit == result.audit


def test_too_little_memory_is_said(world, monkeypatch):
    def huge(*_):
        np.zeros(2**48)

    monkeypatch.setattr(Observer, "observe", huge)
    with pytest.raises(forest.SpecError, match=r"needs more memory than there is \(Unable to all"):
        world.scan(COARSE)


@pytest.mark.medium
def test_a_world_that_was_replaced_says_so(world):
    """It would scan another forest, and call that its own."""
    try:
        second = forest.build(SCENE.changed(seed=9))
        for look in (
            lambda: world.scan(COARSE),
            lambda: world.impulse_response(CLAP),
            lambda: world.hemisphere((0.0, 0.0, 1.0), pixels=8),
            lambda: world.audit,
        ):
            with pytest.raises(forest.SpecError, match="another forest was built in its place"):
                look()
        assert len(second.scan(COARSE)) > 0
        assert len(world.trees["tree"]) == 1  # what grew is known all the same
    finally:
        again = forest.build(SCENE)
        world.forest, world._place = again.forest, again._place


AWAY = (4000.0, 0.0, 2.0)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        (COARSE.changed(position=AWAY), "0 points: the nearest thing is 3,994 m away and it reaches 120 m"),
        (COARSE.changed(elevation_deg=(60.0, 80.0)), "0 points: nothing that sends enough back"),
        (forest.Airborne(position=(0, -2, 90.0), track=5.0, max_range=40.0, pulse_rate=99.0), "reaches 40 m"),
        (forest.Tractor(position=AWAY, track=1.0, step=0.5, angle_step_deg=9.0), "no beam met anything: the"),
        (forest.Sonar(position=AWAY), "silence: the nearest thing is 3,994 m away and it reaches 15 m"),
        (CLAP.changed(min_radius=2.0), "no trunk is heard"),
    ],
)  # fmt: skip
def test_a_result_that_is_empty_says_why(world, sensor, words):
    result = world.look(sensor)
    assert [warning for warning in result.warnings if words in warning], result.warnings
    assert [note for note in result.notes if words in note]


def test_a_result_that_is_not_empty_says_nothing(results):
    assert [result.warnings for result in results[:3]] == [()] * 3


def test_nothing_in_the_scene_is_said():
    empty = forest.build(forest.Scene(forest=forest.Forest(margin=0.0)))
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    assert empty.scan(COARSE).warnings == ("cloud: 0 points: there is nothing in the scene",)


def test_a_forest_without_trees_is_said():
    bare = forest.build(SCENE.changed(plantings=(BUSH.changed(expected=0.0),)))
    assert bare.forest.notes == ("no tree stands: expect more, or a larger field",)


def test_a_stand_that_cannot_be_drawn_is_said_as_any_other_setting():
    far = forest.Gaussian(centre=(900.0, 900.0), width=(1.0, 1.0))
    nowhere = forest.Planting(species="hazelnut", expected=2.0, gaussians=(far,))
    with pytest.raises(forest.SpecError, match=r"^hazelnut: the gaussians put nothing on the fi"):
        forest.build(forest.Scene(plantings=(nowhere,)))
