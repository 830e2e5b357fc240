"""A forest in tiles: its scans and echoes are those of the whole to the bit, whatever the tiles."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

bpy = pytest.importorskip("bpy")

from forest_addon import api as forest
from forest_addon.blender.files.export import empty_file
from forest_addon.tiles import TABLES, TiledForest
from headless.dataset.factory import make_dataset
from headless.dataset.plan import read_plan

FIELD = forest.Forest(size=(64.0, 10.0), margin=4.0, undergrowth="none")
SCENE = forest.Scene(
    seed=4,
    forest=FIELD,
    offset=(500000.0, 4e6, 0.0),
    plantings=(
        forest.Planting(species="hazelnut", variants=2, expected=14, scale=(0.6, 1.2)),
        forest.Planting(species="abop-ternary-a", variants=1, expected=14),
    ),
)
SCANNERS = (
    forest.Terrestrial(name="tls", position=(30.2, 5.1, 1.5), angle_step_deg=2.5),
    forest.Airborne(
        name="als",
        position=(0.0, 5.0, 40.0),
        track=64.0,
        speed=20.0,
        pulse_rate=2000.0,
        line_rate=40.0,
        field_deg=(-8.0, 8.0),
        beam=forest.Beam(subrays=7, divergence_mrad=(2.0, 2.0)),
    ),
)
BAT = forest.Sonar(name="bat", position=(3.0, 3.0, 1.2), max_range=4.0, azimuth_deg=45.0)


def as_one(scene, folder):
    """The world of the whole forest, its scans in a folder."""
    empty_file()
    world = forest.build(scene)
    for scanner in SCANNERS:
        world.scan_to(folder / f"{scanner.name}.ply", scanner)
    return world


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The scene, and the scans, the trees and the echo of the forest as one."""
    folder = tmp_path_factory.mktemp("whole")
    world = as_one(SCENE, folder)
    return SCENE, folder, world.trees, world.ping(BAT).pings[0].spectra


def tiled(scene, **tiles):
    empty_file()
    return forest.Tiling.of(scene.changed(tiles=forest.Tiles(**tiles)))


@pytest.mark.slow
@settings(max_examples=2)
@given(size=st.floats(11.0, 70.0), buffer=st.floats(0.0, 8.0))
def test_scans_over_edges_are_those_of_the_whole_to_the_bit(whole, tmp_path, size, buffer):
    scene, folder, _, _ = whole
    same_scans(tiled(scene, size=size, buffer=buffer), folder, tmp_path)


@pytest.mark.slow
def test_scans_of_trees_that_are_points_are_those_of_the_whole(tmp_path):
    scene = SCENE.changed(forest=FIELD.changed(instancing="points"))
    as_one(scene, tmp_path)
    same_scans(tiled(scene, size=21.3, buffer=3.0), tmp_path, tmp_path)


def same_scans(tiling, folder, tmp_path):
    for scanner in SCANNERS:
        tiling.scan_to(tmp_path / "t.ply", scanner)
        alone = (folder / f"{scanner.name}.ply").read_bytes()
        assert (tmp_path / "t.ply").read_bytes() == alone
    assert not list(tmp_path.glob("*.parts"))


@pytest.mark.slow
def test_trees_are_of_one_tile_each_and_the_whole_s_own(whole):
    scene, _, trees, echo = whole
    tiling = tiled(scene, size=20.0, buffer=3.0)
    assert tiling.forest.in_tile.sum() == len(trees["tree"])
    own = tiling.grid.tile_of(tiling.forest.stand().position[:, :2])
    found = tiling.build(1).trees
    rows = np.searchsorted(trees["tree"], found["tree"])
    for name in ("x_m", "height_m", "dbh_m", "leaf_area_m2", "rotation_rad"):
        assert np.array_equal(found[name], trees[name][rows])
    assert set(np.flatnonzero(own == 1)) <= set(found["tree"].tolist())
    assert len(tiling.reachable(BAT)) < len(trees["tree"])
    assert np.abs(echo).max() > 0
    assert np.array_equal(tiling.look(BAT).pings[0].spectra, echo)


@pytest.mark.slow
def test_a_scan_that_was_ended_goes_on_and_a_pulse_is_followed_or_missed(whole, tmp_path):
    scene, folder, _, _ = whole
    tiling = tiled(scene, size=20.0, buffer=2.0)
    scanner = SCANNERS[0]

    def stop(done, total):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        tiling.scan_to(tmp_path / "t.ply", scanner, progress=stop)
    work = forest.TiledScan(tiling, scanner, tmp_path / "t.ply.parts")
    assert len(work.todo(True)) == len(work.pulses.pieces) - 2
    assert "beyond the buffer of 2 m" in work.followed
    tiling.scan_to(tmp_path / "t.ply", scanner, resume=True)
    alone = (folder / "tls.ply").read_bytes()
    assert (tmp_path / "t.ply").read_bytes() == alone
    # Were pulses that leave the buffer not followed, it would show.
    tile = np.full_like(work.pulses.piece, 0)
    work.pulses = dataclasses.replace(work.pulses, piece=tile)
    for piece in work.todo(False):
        work.make(piece)
    work.join(tmp_path / "short.ply")
    assert (tmp_path / "short.ply").read_bytes() != alone


@pytest.mark.slow
def test_a_tile_is_audited_and_what_was_changed_is_seen(tmp_path):
    tiling = tiled(SCENE.changed(plantings=SCENE.plantings[1:]), size=20.0, buffer=2.0)
    scanner = SCANNERS[1].changed(beam=forest.Beam(), pulse_rate=400.0)
    work = forest.TiledScan(tiling, scanner, tmp_path)
    piece = int(work.todo(False)[1])
    work.make(piece)
    audit = work.audit(piece)
    assert audit.kept
    rows = bytearray(work.path(piece).read_bytes())
    rows[-3] ^= 1
    work.path(piece).write_bytes(rows)
    wrong = work.audit(piece)
    assert not wrong.kept
    assert "records" in wrong.worst.what


@pytest.mark.slow
def test_what_another_process_found_of_a_forest_is_taken_and_no_other(tmp_path, monkeypatch):
    scene = SCENE.changed(plantings=SCENE.plantings[1:], tiles=forest.Tiles(size=20.0, buffer=3.0))
    tiling = forest.Tiling.of(scene).forest
    tiling.keep(tmp_path / "plan.npz")
    monkeypatch.setattr(TiledForest, "_measure", lambda self: pytest.fail("measured anew"))
    again = forest.Tiling.of(scene, kept=tmp_path / "plan.npz").forest
    for name in TABLES:
        assert np.array_equal(getattr(again, name), getattr(tiling, name)), name
    for column in ("position", "scale", "sink", "variant"):
        assert np.array_equal(getattr(again.stand(), column), getattr(tiling.stand(), column))
    for change in ({"seed": 5}, {"tiles": forest.Tiles(size=10.0, buffer=3.0)}):
        with pytest.raises(pytest.fail.Exception, match="anew"):
            forest.Tiling.of(scene.changed(**change), kept=tmp_path / "plan.npz")


@pytest.mark.slow
def test_files_of_tiles_hold_the_points_over_them(whole, tmp_path):
    scene, _, _, _ = whole
    tiling = tiled(scene, size=16.0, buffer=4.0, files="both")
    got = tiling.scan_to(tmp_path / "t.npz", SCANNERS[0])
    points = 0
    for file in (tmp_path / "t").iterdir():
        x, y = (np.load(file)[axis] for axis in "xy")
        tile = tiling.grid.tile_of(np.column_stack([x - 500000.0, y - 4e6]))
        assert {tiling.grid.name(t) for t in tile} == {file.stem.removeprefix("t-")}
        points += len(x)
    assert points == got.points > 0


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({}, "tiles.size"),
        ({"accuracy": forest.Accuracy(detail="auto")}, "detail"),
        ({"wind": forest.Wind(speed=3.0)}, "wind"),
        ({"stems": (forest.Stems(count=3),)}, "stems"),
    ],
)
def test_what_cannot_be_cut_is_said(change, word):
    tiles = forest.Tiles(size=10.0 if change else 0.0)
    with pytest.raises(forest.SpecError, match=word):
        forest.Tiling.of(SCENE.changed(tiles=tiles, **change))


def test_sensors_that_hear_all_are_refused(tmp_path):
    tiling = tiled(SCENE.changed(plantings=()), size=10.0)
    with pytest.raises(forest.SpecError, match="without tiles"):
        tiling.look(forest.Reverb(source=(0, 0, 1), receiver=(9, 0, 1)))
    with pytest.raises(forest.SpecError, match="scan_to"):
        tiling.look(SCANNERS[0])
    receiver = SCANNERS[1].receiver
    for word, change in {
        "motion": {"motion": True},
        "bounces": {"bounces": True},
        "folded": {"receiver": receiver.changed(beyond="folded")},
        "waveforms": {"receiver": receiver.changed(sample_ns=1.0), "faintest": 0.01},
    }.items():
        with pytest.raises(forest.SpecError, match=f"{word}.*tiles|tiles.*{word}"):
            tiling.scan_to(tmp_path / "t.laz", SCANNERS[1].changed(**change))
    with pytest.raises(forest.SpecError, match="tile"):
        tiling.build(99)


def test_a_plan_of_many_scenes_takes_no_tiles(tmp_path):
    file = tmp_path / "p.toml"
    file.write_text("[scene.tiles]\nsize = 10.0\n[scene.forest]\nsize = [5.0, 5.0]\n")
    with pytest.raises(forest.SpecError, match="tiles"):
        make_dataset(read_plan(file, ["count=2"]), tmp_path / "out", quiet=True)
    assert not (tmp_path / "out").exists()
