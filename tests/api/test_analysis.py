"""For analysts: tables with units, names for numbers, ways from arrays, scans of any size into a file."""

import inspect
import pickle
import typing
from collections.abc import Iterator

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import laspy

from forest_addon import api as forest, spec

SCENE = forest.Scene(
    seed=4,
    offset=(500000.0, 4e6, 100.0),
    forest=forest.Forest(size=(6.0, 6.0), margin=5.0),
    plantings=(forest.Planting(species="hazelnut", variants=1, expected=2, exact=True),),
)
TRIPOD = forest.Terrestrial(position=(-2.0, 3.0, 1.5), angle_step_deg=5.0)
BAT = forest.Sonar(position=(-2.0, 3.0, 1.5), wood=False, band=(60e3, 70e3), max_range=5.0)
CLAP = forest.Reverb(source=(-3, 3, 0.2), receiver=(9, 3, 0.2), sample_rate=8000, duration=0.05)
ROW = forest.Tractor(position=(-3, 0, 1), track=2, step=0.5, angle_step_deg=5, reach=8, top=4)


@pytest.fixture(scope="module")
def world():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return forest.build(SCENE)


@pytest.mark.slow
def test_a_cloud_as_a_table_has_the_columns_of_its_file_and_their_units(world, tmp_path):
    pandas = pytest.importorskip("pandas")
    cloud = world.scan(TRIPOD)
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
        (cloud := world.scan(TRIPOD), "range", (len(cloud),)),
        (row := world.scan(ROW), "distance", row.matrix.shape),
        (echo := world.ping(BAT), "waveform", echo.waveforms.shape),
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
    heard = world.ping(BAT.changed(receiver=receiver))
    for result in (world.scan(TRIPOD), world.scan(ROW), heard, world.impulse_response(CLAP)):
        names = [n for n, _ in inspect.getmembers(type(result), lambda m: isinstance(m, property))]
        for name in names:
            assert getattr(result, name) is not None, name
    echo = heard.pings[0]
    np.testing.assert_allclose(heard.received["recorded"][0], echo.received.recorded, rtol=1e-12)
    assert world.ping(BAT).received == {}


@pytest.mark.medium
def test_numbers_have_names(world):
    labels = world.scan(TRIPOD).labels
    met = {world.objects[number] for number in np.unique(labels["object"]) if number >= 0}
    assert any(name.startswith("hazelnut") for name in met)
    assert set(met) <= set(bpy.data.objects.keys())
    species = np.unique(labels["species"][labels["species"] >= 0])
    assert [world.species[number] for number in species] == ["hazelnut"]


@pytest.mark.parametrize("ending", ["laz", "npz"])
def test_a_scan_into_a_file_is_the_scan(world, tmp_path, ending):
    cloud = world.scan(TRIPOD)
    done = world.scan_to(tmp_path / f"a.{ending}", TRIPOD)
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
    fine = TRIPOD.changed(angle_step_deg=3.0)

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
    echoes = world.ping(BAT, along=forest.trajectory([0, 1], [(-2, 3, 1.5), (-1, 3, 1.5)]))
    assert len(echoes.pings) == 2
    assert np.array_equal(echoes.pings[0].spectra, world.ping(BAT).pings[0].spectra)


@pytest.mark.parametrize(
    ("do", "words"),
    [
        (lambda w: forest.trajectory([0, 0], np.zeros((2, 3))), "time: does not rise"),
        (lambda w: forest.trajectory([0], np.zeros((2, 3))), "time: has 1 values; give 2"),
        (lambda w: forest.trajectory([0, 1], np.zeros((2, 3)), [1, 2, 3]), "arrays of one length"),
        (lambda w: forest.trajectory([0, np.nan], np.zeros((2, 3))), "not finite"),
        (lambda w: forest.trajectory("ab", np.zeros((2, 3))), "arrays of one length"),
        (lambda w: w.scan(TRIPOD, along=3), "along: takes a trajectory, not an int"),
        (
            lambda w: w.scan(TRIPOD, along=forest.trajectory([0], [(0, 0, 0)])),
            "along: is for a Mobile scanner or a Sonar, not a Terrestrial",
        ),
        (lambda w: w.scan_to("x.laz", ROW), "scan_to: takes a scanner, not a Tractor"),
        (lambda w: w.scan_to("x.doc", TRIPOD), "end its name in .laz"),
        (lambda w: w.scan_to("/no/such/x.laz", TRIPOD), "the folder /no/such is not there"),
    ],
)
def test_what_cannot_be_used_is_said(world, do, words):
    with pytest.raises(forest.SpecError) as problem:
        do(world)
    assert words in str(problem.value)


def test_short_words_for_what_one_looks_at(world):
    cloud = world.scan(TRIPOD)
    assert len(repr(cloud)) < 100
    assert f"{len(cloud):,}" in repr(cloud)
    assert repr(TRIPOD) == "Terrestrial(position=(-2.0, 3.0, 1.5), angle_step_deg=5.0)"
    assert eval(repr(SCENE), vars(forest)) == SCENE
    assert "tolerance='auto'" in repr(forest.Sonar(tolerance="auto"))


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
