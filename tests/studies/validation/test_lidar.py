"""Stems, twigs and returns of pulses: what the comparisons with measured clouds are made of."""

import argparse
from pathlib import Path

import laspy
import numpy as np
import pytest
from references.measured import FOUND, needs_measurements

from forest_addon.base.rng import stream
from forest_addon.formats.las import read_las
from forest_addon.spec import SpecError
from studies.validation import lidar, own_cloud
from studies.validation.own_cloud import CloudReturns, compare_own, read_cloud
from studies.validation.stems import (
    DIAMETERS,
    NONE,
    REAL,
    find_stems,
    ratios,
    read_plots,
    taubin,
    thicker,
)
from studies.validation.twin import detected


def test_a_circle_through_an_arc_is_found_again():
    angle = np.linspace(0.3, 1.8, 30)
    points = [7.0, -3.0] + 0.15 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    centre, radius = taubin(points)
    assert np.allclose(centre, [7.0, -3.0], atol=1e-9)
    assert radius == pytest.approx(0.15)


def test_stems_are_told_from_bushes():
    """Three arcs as a scanner sees them, a cloud of leaves, and a stem too high above the ground."""
    rng = stream(1, "stems")
    angle = rng.uniform(np.pi / 2, 3 * np.pi / 2, (3, 200))
    where = np.array([[5.0, 0.0], [9.0, 4.0], [12.0, -6.0]])
    size = np.array([0.1, 0.2, 0.15])
    stems = where[:, None] + size[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    points = np.concatenate([*stems, [3.0, 3.0] + 0.4 * rng.normal(size=(400, 2))])
    points += 0.002 * rng.normal(size=points.shape)
    height = np.append(rng.uniform(1.2, 1.4, 400), np.full(200, 4.0))
    height = np.append(height, rng.uniform(1.2, 1.4, 400))
    centre, radius = find_stems(np.column_stack([points, height]), rng)
    assert np.allclose(np.sort(centre[:, 0]), [5.0, 9.0], atol=0.01)
    assert np.allclose(np.sort(radius), [0.1, 0.2], atol=0.005)


@pytest.mark.slow
def test_beam_and_noise_make_twigs_thicker_and_thick_branches_hardly():
    assert np.allclose(thicker(*NONE, 1), 1, atol=0.02)
    real = thicker(*REAL, 1)
    assert (np.diff(real) < 0).all()
    assert real[0] > 1.3
    assert real[-1] == pytest.approx(1, abs=0.02)
    assert len(real) == len(DIAMETERS)


def test_a_cloud_of_ones_own_needs_a_scene(tmp_path):
    with pytest.raises(SpecError, match="--scene: is needed beside a cloud"):
        compare_own(tmp_path / "a.laz", None)
    with pytest.raises(SpecError, match=r"a\.laz: is not there"):
        read_las(tmp_path / "a.laz")
    (tmp_path / "a.laz").write_bytes(b"no cloud")
    with pytest.raises(SpecError, match="cannot be read as LAS or LAZ"):
        lidar.validate(
            Path(), tmp_path, argparse.Namespace(file=tmp_path / "a.laz", scene=tmp_path, seed=1)
        )


@needs_measurements
def test_measured_clouds_and_plots_are_as_their_readme_says():
    shares, _ = read_cloud(FOUND / "clouds" / "spanner_ALS.laz").shares()
    assert np.allclose(100 * shares, [41.7, 32.5, 18.9, 5.9], atol=0.05)
    plots = [read_plots(FOUND / "rioja" / f"tree_{name}.csv") for name in ("field", "tls")]
    assert len(plots[0]) == 16
    stems = [np.concatenate([rows[:, 2:4] for rows in p.values()]) for p in plots]
    assert ratios(*stems)[0][-1] == pytest.approx(0.82, abs=0.01)


@pytest.mark.slow
def test_a_cloud_of_ones_own_is_held_to_a_scene(tmp_path):
    """The cloud of the very scene agrees with it, however many returns its pulses have."""
    pytest.importorskip("bpy")
    from forest_addon import api

    scene = tmp_path / "own.toml"
    scene.write_text(OWN, encoding="utf-8")
    settings = api.read(scene)
    api.build(settings).scan(settings.sensors[0]).save(tmp_path / "own.laz")
    found = compare_own(tmp_path / "own.laz", scene)
    assert [c.agrees for c in found] == [True] * 6
    assert found[0].measured.value == pytest.approx(found[0].simulated.value)


def las(path, place, number, count):
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = [1e-4] * 3
    cloud = laspy.LasData(header)
    cloud.xyz = place
    cloud.return_number, cloud.number_of_returns = number, count
    cloud.write(path)


def test_a_cloud_without_numbers_of_returns_is_refused(tmp_path):
    las(tmp_path / "a.laz", np.zeros((9, 3)), np.zeros(9, np.uint8), np.zeros(9, np.uint8))
    with pytest.raises(SpecError, match="does not say which return"):
        read_cloud(tmp_path / "a.laz")


def test_shares_agree_relatively_and_only_what_was_measured_is_judged():
    def pulses(shares, size=20_000):
        count = np.repeat(np.arange(1, 5), (np.array(shares) * size).astype(int))
        return CloudReturns(np.zeros((len(count), 3)), np.ones(len(count)), count, count == 9)

    theirs = pulses((0.8, 0.145, 0.049, 0.006))
    apart = own_cloud._compared("als", theirs, pulses((0.8, 0.151, 0.006, 0.043)), "")
    assert [row.agrees for row in apart[:4]] == [True, True, False, False]
    alike = own_cloud._compared("als", theirs, pulses((0.8, 0.143, 0.051, 0.006)), "")
    assert all(row.agrees for row in alike[:4])
    single = own_cloud._compared("als", pulses((1.0, 0, 0, 0)), theirs, "")
    assert [row.agrees for row in single[:4]] == [None] * 4


def test_heights_are_over_ground_that_slopes():
    rng = np.random.default_rng(0)
    place = rng.uniform(0, 40, (20_000, 3))
    slope, tall = (
        0.4 * place[:, 0],
        np.where(rng.random(20_000) < 0.3, 0.0, rng.uniform(0, 20, 20_000)),
    )
    place[:, 2] = slope + tall
    for ground in (tall == 0, np.zeros(20_000, bool)):
        found = CloudReturns(place, np.ones(20_000), np.ones(20_000), ground).heights()
        assert np.abs(found - tall).mean() < 0.5


OWN = """
name = "own"
seed = 1
forest = { size = [10.0, 10.0] }
plantings = [{ species = "hazelnut", variants = 1, expected = 3 }]

[[sensors]]
kind = "airborne"
position = [5.0, -5.0, 60.0]
track = 20.0
speed = 20.0
pulse_rate = 4000.0
line_rate = 60.0
field_deg = [-6.0, 6.0]
beam = { subrays = 7, max_returns = 5, divergence_mrad = [20.0, 20.0], pulse_ns = 1.0 }
"""


def test_summits_of_cones_are_their_trees_and_a_bush_is_none():
    trees = np.array([[5.0, 5.0, 20.0], [14.0, 6.0, 15.0], [8.0, 15.0, 24.0], [30.0, 30.0, 18.0]])
    cones = np.vstack([trees[:3], [[20.0, 18.0, 9.0]]])
    place = np.stack(np.meshgrid(*[np.arange(0, 24, 0.25)] * 2), axis=-1).reshape(-1, 2)
    away = np.linalg.norm(place[:, None] - cones[:, :2], axis=2)
    found, false = detected(place, (cones[:, 2] - 3 * away).max(axis=1).clip(0), trees)
    assert found == pytest.approx(3 / 4)  # one tree has no returns
    assert false == pytest.approx(1 / 4)
