"""The Python API: the README's lines as written, truth by name, and what cannot be done in one sentence."""

import base64
import copy
import doctest
import inspect
import io
import pickle
import runpy
import sys
import threading
import time
import typing
from collections.abc import Iterator

import laspy
import numpy as np
import pytest
from scipy.io import wavfile
from scipy.spatial.transform import Rotation

from forest_addon import api as forest, spec

bpy = pytest.importorskip("bpy")

from forest_addon.api import (
    given as scanners_module,
    results as results_module,
    world as world_module,
)
from forest_addon.blender.sensors.observe import Observer
from forest_addon.formats.toml_file import structure

BUSH = forest.Planting(species="hazelnut", variants=1, expected=2, exact=True)
SCENE = forest.Scene(
    seed=4,
    offset=(500000.0, 4e6, 100.0),
    forest=forest.Forest(size=(6.0, 6.0), margin=5.0),
    plantings=(BUSH,),
)
TRIPOD = forest.Terrestrial(position=(-2.0, 3.0, 1.5), angle_step_deg=2.0)
BAT = forest.Sonar(position=(-2.0, 3.0, 1.5), beam_width_deg=(60.0, 60.0), cull=0.01)
CLAP = forest.Reverb(source=(-3, 3, 0.2), receiver=(9, 3, 0.2), sample_rate=8000, duration=0.1)
ROW = forest.Tractor(position=(-3, 0, 1), track=2, step=0.5, angle_step_deg=5, reach=8, top=4)
FEW, COARSE = (TRIPOD.changed(angle_step_deg=step) for step in (5.0, 20.0))
TREES = {"tree": [7, 3], "x_m": [50.0, 0.0], "y_m": [0.0, 2.0], "z_m": [1.0, 0.0]}
TREES = {name: np.array(values) for name, values in {**TREES, "dbh_m": [0.3, 0.3]}.items()}
QUICK = forest.Sonar(position=(-2.0, 3.0, 1.5), wood=False, band=(60e3, 70e3), max_range=5.0)


@pytest.fixture(scope="module")
def world():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return forest.build(SCENE)


@pytest.fixture(scope="module")
def results(world):
    return [world.scan(TRIPOD), world.scan(ROW), world.ping(BAT), world.impulse_response(CLAP)]


@pytest.mark.slow
def test_the_same_as_the_sensors_find(world):
    observer = Observer(bpy.context.evaluated_depsgraph_get())
    cloud, echo, sound = world.scan(TRIPOD), world.ping(BAT), world.impulse_response(CLAP)
    assert np.array_equal(cloud.points, observer.observe(TRIPOD, SCENE).position)
    assert np.array_equal(echo.pings[0].spectra, observer.observe(BAT, SCENE).spectra)
    assert np.array_equal(sound.found.trees, observer.observe(CLAP, SCENE).trees)
    assert set(np.unique(cloud.labels["tree"])) <= {-1, 0, 1}
    assert cloud.audit.kept
    assert echo.audit.kept
    assert sound.audit.kept
    assert cloud.audit.checked > 0
    world.scene = SCENE.changed(accuracy=forest.Accuracy(audit=0))
    assert world.scan(TRIPOD).audit is None
    world.scene = SCENE


@pytest.mark.medium
def test_what_is_left_to_auto_is_chosen_and_said(world):
    echo = world.ping(BAT.changed(tolerance="auto", cull="auto"))
    assert [choice.key for choice in echo.chosen] == ["tolerance", "cull"]
    assert echo.sensor.tolerance > 0
    assert echo.audit.kept
    assert echo.audit.allowed < 1e-3


@pytest.mark.medium
def test_what_grew_is_held_against_its_truth(world):
    assert list(world.audit) == ["leaves"]
    assert world.audit["leaves"].kept


def test_truth_by_name(world):
    assert len(world.trees["height_m"]) == 2
    leaves = world.leaves
    assert leaves["centre"].shape == leaves["normal"].shape == (len(leaves["radius"]), 3)
    wood = world.skeleton(1)
    assert np.allclose(wood["start"][0, :2], [world.trees["x_m"][1], world.trees["y_m"][1]])
    assert wood["radius"].shape == (len(wood["start"]), 2)


def test_threads_read_the_scene_one_after_the_other(world, monkeypatch):
    from forest_addon.blender.sensors import observe

    read, inside, most = world.observer.of, [], []  # evaluated: threads at once would end Blender

    def slowly(*scene):
        inside.append(1)
        most.append(len(inside))
        time.sleep(0.05)
        inside.pop()
        return read(*scene)

    monkeypatch.setattr(observe.Observer, "of", slowly)
    threads = [threading.Thread(target=lambda: world.observer) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == [1, 1, 1]


@pytest.mark.medium
def test_what_is_moved_is_scanned_where_it_is(world):
    before = world.scan(TRIPOD)
    tree = next(o for o in bpy.context.scene.objects if o.name.startswith("hazelnut 0000"))
    tree.location.x += 0.5
    try:
        assert len(world.scan(TRIPOD)) != len(before)
    finally:
        tree.location.x -= 0.5
    again = world.scan(TRIPOD)
    assert np.allclose(again.points, before.points, atol=1e-4)


@pytest.mark.medium
@pytest.mark.parametrize("ending", [".laz", ".las", ".ply", ".npz", ".csv"])
def test_a_cloud_as_a_file(results, tmp_path, ending):
    cloud, east = results[0], results[0].points[:, 0] + SCENE.offset[0]
    path = cloud.save(tmp_path / f"cloud{ending}")
    if ending in (".laz", ".las"):
        with laspy.open(path) as file:
            assert file.header.point_count == len(cloud)
    elif ending == ".npz":
        assert np.array_equal(np.load(path)["x"], east)
    elif ending == ".csv":
        assert np.allclose(np.loadtxt(path, delimiter=",", skiprows=1, usecols=0), east)
    else:
        assert f"element vertex {len(cloud)}".encode() in path.read_bytes()[:2000]
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.slow
def test_notebooks_show_pictures_and_play_sounds(world, results):
    for result in results:
        shown = result._repr_html_()
        assert "<img" in shown
        coded = shown.partition("data:audio/wav;base64,")[2].partition('"')[0]
        assert bool(coded) == isinstance(result, forest.Echoes | forest.Response)
        if coded:
            rate, samples = wavfile.read(io.BytesIO(base64.b64decode(coded)))
            assert rate == (BAT.sample_rate / BAT.time_expansion if rate > 8000 else 8000)
            assert np.abs(samples).max() > 0
    assert "hazelnut" in world._repr_html_()


@pytest.mark.medium
def test_a_sensor_inside_of_a_trunk_is_said(world):
    wood = world.skeleton(0)
    row = int(np.argmax(wood["radius"].min(axis=1)))
    inside = tuple(0.5 * (wood["start"][row] + wood["end"][row]))
    for sensor in (
        COARSE.changed(position=inside),
        BAT.changed(position=inside, max_range=2.0),
        CLAP.changed(source=inside),
        forest.Mobile(poses=(forest.Pose(position=inside), forest.Pose(time=0.01)), line_rate=200),
    ):
        assert "stands inside tree 0" in world.look(sensor).warnings[0]
    assert world.scan(COARSE).warnings == ()


def test_an_instrument_is_the_sensor_of_a_scene_file_that_names_it():
    sensor = forest.instrument("velodyne-vlp-16", "mobile", speed=3.0)
    table = {"kind": "mobile", "scanner": "velodyne-vlp-16", "speed": 3.0}
    assert sensor == structure(table, forest.Sensor)
    assert sensor.channels == 16


# --------------------------------------------------------------------------------------------- given
# Wrong arguments of a script end in one sentence, never in what breaks further in.


def other(species):
    return SCENE.changed(plantings=(BUSH.changed(species=species),))


@pytest.mark.medium
@pytest.mark.parametrize(
    ("do", "words"),
    [
        (
            lambda w: w.scan(BAT),
            "scan: takes a Tractor or Terrestrial or Mobile or Airborne, not a Sonar",
        ),
        (lambda w: w.ping(TRIPOD), "ping: takes a Sonar"),
        (lambda w: w.look(np.zeros((4, 2))), "not a ndarray of shape (4, 2)"),
        (lambda w: w.look(None), "takes a sensor"),
        (lambda w: TRIPOD.changed(position=np.zeros(2)), "position: has 2 values; give 3"),
        (
            lambda w: TRIPOD.changed(position=np.zeros((3, 3))),
            "position[0]: [0.0, 0.0, 0.0] is not a number",
        ),
        (lambda w: TRIPOD.changed(position=1.0), "position: 1.0 is not a list of 3 numbers"),
        (lambda w: TRIPOD.changed(position=(0, 0, np.nan)), "position[2]: nan m is out of range"),
        (lambda w: w.skeleton(99), "99 is no tree of this world"),
        (lambda w: w.scan(TRIPOD).save("cloud.txt"), "end its name in .laz"),
        (lambda w: w.scan(forest.Mobile(follow="nothing")), 'there is no object "nothing"'),
        (
            lambda w: SCENE.changed(sed=3),
            'sed: is not known; did you mean "seed"? Allowed: name, seed',
        ),
        (lambda w: SCENE.changed(seed=-1), "seed: -1 is out of range"),
        (lambda w: forest.read("nowhere.toml"), "there is no such file"),
        (
            lambda w: forest.build(
                SCENE.changed(plantings=(forest.Planting(species="oak", expected=1),))
            ),
            '"oak"',
        ),
        (lambda w: forest.instrument("riegl-vq-780i", "terrestrial"), "is no terrestrial scanner"),
        (lambda w: forest.instrument("riegl-vz-400i", "sonar"), '"sonar" is not known'),
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
        (lambda w: forest.trajectory([0, 0], np.zeros((2, 3))), "time: does not rise"),
        (lambda w: forest.trajectory([0], np.zeros((2, 3))), "time: has 1 values; give 2"),
        (lambda w: forest.trajectory([0, 1], np.zeros((2, 3)), [1, 2, 3]), "arrays of one length"),
        (lambda w: forest.trajectory([0, np.nan], np.zeros((2, 3))), "not finite"),
        (lambda w: forest.trajectory("ab", np.zeros((2, 3))), "arrays of one length"),
        (lambda w: w.scan(FEW, along=3), "along: takes what forest.trajectory makes"),
        *(
            (lambda w, way=way: w.scan(FEW, along=way), "(arrays, and a Rotation), not a Traj")
            for way in (
                forest.Trajectory([0, 1], np.zeros((2, 3)), Rotation.identity(2)),
                forest.Trajectory(np.arange(2.0), np.zeros((2, 3)), np.eye(2, 4)),
            )
        ),
        (
            lambda w: w.scan(FEW, along=forest.trajectory([0], [(0, 0, 0)])),
            "along: is for a Mobile scanner or a Sonar, not a Terrestrial",
        ),
        (lambda w: w.scan_to("x.laz", ROW), "scan_to: takes a scanner, not a Tractor"),
        (lambda w: w.scan_to("x.doc", FEW), "end its name in .laz"),
        (lambda w: w.scan_to("/no/such/x.laz", FEW), "the folder /no/such is not there"),
        *(
            (lambda w, few=few: forest.crowns(np.zeros((1, 3)), [1], few), "trees: takes columns")
            for few in (None, [1], {"tree": [1]}, {**TREES, "dbh_m": [0.1]})
        ),
        (lambda w: pickle.dumps(w), "cannot be copied or sent"),
        (lambda w: copy.deepcopy(w), "cannot be copied or sent"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_sentence(do, words, world):
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

    monkeypatch.setattr(Observer, "job", huge)
    with pytest.raises(forest.SpecError, match=r"needs more memory than there is \(Unable to all"):
        world.scan(COARSE)


def test_what_memory_will_not_hold_is_refused_before_it_begins(world, monkeypatch):
    poses = forest.trajectory([0.0, 1e5], [(0.0, 0.0, 30.0), (9.0, 0.0, 30.0)])  # milliseconds
    with pytest.raises(
        forest.SpecError, match=r"needs about \S+ GB of memory, and \S+ GB are free"
    ):
        world.scan(forest.Mobile(), along=poses)
    monkeypatch.setattr(scanners_module, "free_memory", lambda: 1e5)
    with pytest.raises(forest.SpecError, match="plantings: their 1 different trees need about"):
        forest.build(SCENE)


AWAY = (4000.0, 0.0, 2.0)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        (COARSE.changed(position=AWAY), "0 points: the nearest thing is 3,989 m away and it reaches 120 m"),
        (COARSE.changed(elevation_deg=(60.0, 80.0)), "0 points: nothing that sends enough back"),
        (forest.Airborne(position=(0, -2, 90.0), track=5.0, max_range=40.0, pulse_rate=99.0), "reaches 40 m"),
        (forest.Tractor(position=AWAY, track=1.0, step=0.5, angle_step_deg=9.0), "no beam met anything: the"),
        (forest.Sonar(position=AWAY), "silence: the nearest thing is 3,989 m away and it reaches 15 m"),
        (CLAP.changed(min_radius=2.0), "no trunk is heard"),
    ],
)  # fmt: skip
def test_a_result_that_is_empty_says_why(world, sensor, words):
    result = world.look(sensor)
    assert [warning for warning in result.warnings if words in warning], result.warnings
    assert [note for note in result.notes if words in note]


def test_a_result_that_is_not_empty_says_nothing(results):
    assert [result.warnings for result in results[:3]] == [()] * 3


# ------------------------------------------------------------------------------------------ analysis
# For analysts: tables with units, names for numbers, ways from arrays, scans of any size into a file.


@pytest.mark.slow
def test_a_cloud_as_a_table_has_the_columns_of_its_file_and_their_units(world, tmp_path):
    pandas = pytest.importorskip("pandas")
    cloud = world.scan(FEW)
    table = cloud.to_pandas()
    read = pandas.read_csv(cloud.save(tmp_path / "cloud.csv"))
    assert len(table) == len(cloud) == len(read) > 50
    assert np.allclose(table["x"] + SCENE.offset[0], read.iloc[:, 0], atol=1e-6)
    assert table.attrs["units"]["range"] == "m"
    assert table.attrs["offset_m"] == list(SCENE.offset)
    mean = table.groupby("organ")["range"].mean()  # a usual question
    organs = cloud.labels["organ"]
    assert np.isclose(mean[3], cloud.found.returns.distance[organs == 3].mean())


@pytest.mark.medium
def test_every_result_as_a_dataset(world):
    xarray = pytest.importorskip("xarray")
    for result, name, shape in (
        (cloud := world.scan(FEW), "range", (len(cloud),)),
        (row := world.scan(ROW), "distance", row.matrix.shape),
        (echo := world.ping(QUICK), "waveform", echo.waveforms.shape),
        (clap := world.impulse_response(CLAP), "sample", (len(clap.samples), 1)),
    ):
        made = result.to_xarray()
        assert isinstance(made, xarray.Dataset)
        assert made[name].shape == shape
        assert made[name].attrs["units"]
        assert made.attrs["sensor"] == result.sensor.name
        assert len(result.to_pandas()) == np.prod(shape)
        assert result.to_pandas().attrs["units"][name] == made[name].attrs["units"]
        if result is not cloud:
            pytest.importorskip("zarr")
            place = f"memory://results/{name}.zarr"
            made.to_zarr(place)
            assert xarray.open_zarr(place).load().identical(made)
    assert np.array_equal(echo.to_xarray()["waveform"].values, echo.waveforms)


@pytest.mark.medium
def test_every_property_of_every_result_can_be_read(world):
    receiver = forest.SonarReceiver(source_level_db=100, self_noise_db=30)
    heard = world.ping(QUICK.changed(receiver=receiver))
    for result in (world.scan(FEW), world.scan(ROW), heard, world.impulse_response(CLAP)):
        names = [n for n, _ in inspect.getmembers(type(result), lambda m: isinstance(m, property))]
        for name in names:
            assert getattr(result, name) is not None, name
    echo = heard.pings[0]
    np.testing.assert_allclose(heard.received["recorded"][0], echo.received.recorded, rtol=1e-12)
    assert world.ping(QUICK).received == {}


@pytest.mark.medium
def test_numbers_have_names(world):
    labels = world.scan(FEW).labels
    met = {world.objects[number] for number in np.unique(labels["object"]) if number >= 0}
    assert any(name.startswith("hazelnut") for name in met)
    assert set(met) <= set(bpy.data.objects.keys())
    species = np.unique(labels["species"][labels["species"] >= 0])
    assert [world.species[number] for number in species] == ["hazelnut"]


@pytest.mark.parametrize("ending", ["laz", "npz"])
def test_a_scan_into_a_file_is_the_scan(world, tmp_path, ending):
    cloud = world.scan(FEW)
    done = world.scan_to(tmp_path / f"a.{ending}", FEW)
    other = cloud.save(tmp_path / f"b.{ending}")
    assert done.points == len(cloud)
    if ending == "laz":
        one, two = laspy.read(done.path), laspy.read(other)
        assert all(np.array_equal(one[n], two[n]) for n in ("X", "Y", "Z", "intensity"))
    else:
        one, two = np.load(done.path), np.load(other)
        assert all(np.array_equal(one[n], two[n], equal_nan=True) for n in ("x", "time", "range"))


def test_a_scan_that_was_cut_off_goes_on_to_the_same_bytes(world, tmp_path, monkeypatch):
    from forest_addon.sensing.lidar import scan as scan_module

    monkeypatch.setattr(scan_module, "RAYS_AT_ONCE", 500)
    fine = FEW.changed(angle_step_deg=3.0)

    def cut(done, total):
        if done > total / 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        world.scan_to(tmp_path / "cut.npz", fine, progress=cut)
    done = world.scan_to(tmp_path / "cut.npz", fine, resume=True)
    whole = world.scan_to(tmp_path / "whole.npz", fine)
    assert 0 < done.resumed_at < done.pulses
    assert done.path.read_bytes() == whole.path.read_bytes()


def test_moving_sensors_follow_arrays(world):
    """As the same poses of settings do, to the bit."""
    poses = (
        forest.Pose(time=0.0, position=(0, -5, 8), heading_deg=90.0),
        forest.Pose(time=1.0, position=(1, 5, 8), heading_deg=80.0, pitch_deg=5.0, roll_deg=2.0),
    )
    drone = forest.Mobile(pulse_rate=2000.0, poses=poses)
    way = forest.trajectory(
        [p.time for p in poses],
        [p.position for p in poses],
        [p.heading_deg for p in poses],
        [p.pitch_deg for p in poses],
        [p.roll_deg for p in poses],
    )
    given = forest.Mobile(pulse_rate=2000.0, poses=poses[:1])
    assert np.array_equal(world.scan(given, along=way).points, world.scan(drone).points)
    echoes = world.ping(QUICK, along=forest.trajectory([0, 1], [(-2, 3, 1.5), (-1, 3, 1.5)]))
    assert len(echoes.pings) == 2
    assert np.array_equal(echoes.pings[0].spectra, world.ping(QUICK).pings[0].spectra)


def test_short_words_for_what_one_looks_at(world):
    cloud = world.scan(FEW)
    assert len(repr(cloud)) < 100
    assert f"{len(cloud):,}" in repr(cloud)
    assert repr(FEW) == "Terrestrial(position=(-2.0, 3.0, 1.5), angle_step_deg=5.0)"
    assert "tolerance='auto'" in repr(forest.Sonar(tolerance="auto"))


def test_a_scene_that_is_printed_can_be_pasted_into_a_script(tmp_path):
    script = tmp_path / "pasted.py"
    script.write_text(f"from forest_addon.api import *\n\nscene = {SCENE!r}\n", encoding="utf-8")
    assert runpy.run_path(str(script))["scene"] == SCENE


def named_types(obj):
    """The classes of ours that the signatures of a function, or of a class's public ones, name."""
    calls = [obj]
    if inspect.isclass(obj):
        public = [call for name, call in vars(obj).items() if not name.startswith("_")]
        calls = [getattr(call, "fget", call) for call in public] + [getattr(obj, "__init__", None)]
    for call in filter(inspect.isfunction, calls):
        known = dict.fromkeys(INNER, object) | call.__globals__
        known |= {name: getattr(forest, name) for name in forest.__all__}
        known |= {"Corners": spec.Corners, "Iterator": Iterator, "Observer": object}
        for hint in typing.get_type_hints(call, known).values():  # else a NameError
            for kind in [hint, *typing.get_args(hint)]:
                if inspect.isclass(kind) and kind.__module__.startswith("forest_addon"):
                    yield kind.__name__


# What Site, Echo, Tree, its mesh and Tiling keep for our own code; so does World with its Observer.
INNER = {"Inputs", "ForestPlan", "SearchGroup", "Relief", "Wanted", "Edges"}
INNER |= {"TileGrid", "TiledForest", "SceneGeometry", "TrunkStand"}


def test_every_type_is_exported_and_worlds_stay(world):
    exported = set(forest.__all__)
    lacking = {
        (name, kind)
        for name in exported
        for kind in named_types(getattr(forest, name))
        if kind not in exported | INNER
    }
    assert lacking == set()
    site = forest.Site.of(SCENE)
    with pytest.raises(forest.SpecError, match="cannot be copied or sent"):
        pickle.dumps(site)


# --------------------------------------------------------------------------------------------- other
# Other scenes than that of the fixture, which end it.


@pytest.mark.medium
def test_a_world_that_was_replaced_says_so():
    """It would scan another forest, and call that its own."""
    world = forest.build(SCENE)
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
    assert len(world.trees["tree"]) == 2  # what grew is known all the same


def test_any_scene_of_blender():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.mesh.primitive_cube_add(location=(5, 0, 0))
    found = forest.current().scan(forest.Terrestrial(position=(0, 0, 0), angle_step_deg=3))
    assert np.isclose(found.points[:, 0].min(), 4.0)
    with pytest.raises(forest.SpecError, match="not grown here"):
        forest.current().trees  # noqa: B018


@pytest.mark.medium
def test_blenders_own_cube_is_not_in_the_forest():
    bpy.ops.wm.read_factory_settings()
    forest.build(SCENE)
    assert not {"Cube", "Camera", "Light"} & {obj.name for obj in bpy.data.objects}


@pytest.mark.medium
def test_a_closed_file():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    world = forest.build(SCENE)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with pytest.raises(forest.SpecError, match=r"world: .*build it again|another scene"):
        world.scan(TRIPOD)


def test_still_holds_the_scene_as_it_is():
    """Objects added to Blender's scene within the block are seen after it and not before."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bare = forest.current()
    down = forest.Terrestrial(position=(0, 0, 3), elevation_deg=(-90, -80), angle_step_deg=5)
    with bare.still():
        bpy.ops.mesh.primitive_plane_add(size=4)
        assert len(bare.scan(down)) == 0
    assert len(bare.scan(down)) > 0


@pytest.mark.medium
def test_step_by_step_is_the_same_as_at_once():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = forest.Scene(seed=4, plantings=(BUSH,), sensors=(CLAP,))
    at_once = forest.build(scene).trees
    site = forest.Site.of(scene)
    grown = site.grow()
    world = site.build(grown, as_assets=False, seconds=2.0)
    assert world.trees.keys() == at_once.keys()
    assert all(np.array_equal(world.trees[name], at_once[name]) for name in at_once)
    assert world.seconds > 2.0  # growing, and building
    assert world.audit["leaves"].seconds == world.seconds


def test_without_blender(monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", None)
    with pytest.raises(forest.SpecError, match="pip install bpy"):
        forest.build(SCENE)
    assert forest.Terrestrial().kind == "terrestrial"  # settings need no Blender


@pytest.mark.medium
def test_the_examples_run():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    modules = (world_module, scanners_module, results_module)
    found = [doctest.testmod(module) for module in modules]
    assert sum(each.attempted for each in found) >= 12
    assert not any(each.failed for each in found)


def test_nothing_in_the_scene_is_said():
    empty = forest.build(forest.Scene(forest=forest.Forest(margin=0.0)))
    for obj in list(bpy.data.objects):
        bpy.data.objects.remove(obj)
    assert empty.scan(COARSE).warnings == ("cloud: 0 points: there is nothing in the scene",)


def test_a_forest_without_trees_is_said():
    bare = forest.build(SCENE.changed(plantings=(BUSH.changed(expected=0.0),)))
    assert bare.forest.notes == ("no tree stands: expect more, or a larger field",)


def test_a_stand_that_cannot_be_drawn_is_said_as_any_other_setting():
    far = forest.Gaussian(centre=(900.0, 900.0), width=(1.0, 1.0))
    nowhere = forest.Planting(species="hazelnut", expected=2.0, gaussians=(far,))
    with pytest.raises(forest.SpecError, match=r"^hazelnut: the gaussians put nothing on the fi"):
        forest.build(forest.Scene(plantings=(nowhere,)))


# -------------------------------------------------------------------------------------------- crowns
# Crowns in labelled points, beside shapes whose measures are known.


def turned(rng, angle, long, short, low, high, many=20_000):
    """Points on a stem and in a crown that is an ellipse of these diameters between two heights."""
    place = rng.uniform(-1, 1, (many, 2))
    place = place[np.hypot(*place.T) < 1] * [long / 2, short / 2]
    cos, sin = np.cos(angle), np.sin(angle)
    crown = np.column_stack([place @ [[cos, sin], [-sin, cos]], rng.uniform(low, high, len(place))])
    stem = np.column_stack([rng.uniform(-0.1, 0.1, (3000, 2)), rng.uniform(0, low, 3000)])
    herbs = np.column_stack([rng.uniform(-2, 2, (300, 2)), rng.uniform(0, 0.9, 300)])
    return np.concatenate([stem, crown, herbs])


@pytest.fixture(scope="module")
def found():
    rng = np.random.default_rng(5)
    one = turned(rng, 0.7, 8.0, 5.0, 6.0, 15.0) + np.array([50, 0, 1])
    two = turned(rng, 2.9, 4.0, 4.0, 3.0, 9.0)
    two = np.concatenate([two, [[0, 0, 30.0]]]) + np.array([0, 2, 0])
    points = np.concatenate([one, two])
    label = np.repeat([7, 3], [len(one), len(two)])
    mixed = rng.permutation(len(points))
    return forest.crowns(points[mixed], label[mixed], TREES)


def test_an_ellipse_s_height_base_and_mean_diameter_are_found(found):
    assert found["tree"].tolist() == [7, 3]
    assert np.allclose(found["height_m"], [15, 9], atol=0.01)  # a lone point far above is no tip
    assert np.allclose(found["crown_base_m"], [6.05, 3.05], atol=0.101)
    assert np.allclose(found["crown_diameter_m"], [6.5, 4.0], atol=0.05)


def test_a_tree_that_nobody_saw_is_nan_and_labels_have_to_fit():
    points = np.zeros((5, 3))
    none = forest.crowns(points, np.full(5, -1), TREES)
    assert np.isnan(none["height_m"]).all()
    assert none["points"].tolist() == [0, 0]
    line = forest.crowns(np.arange(15.0).reshape(5, 3), np.full(5, 3), TREES)
    assert np.isnan(line["crown_diameter_m"]).all()
    with pytest.raises(forest.SpecError, match="a label for each of 5 points"):
        forest.crowns(points, np.zeros(4), TREES)
