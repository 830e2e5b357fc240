"""Stems, twigs and returns of pulses: what the comparisons with measured clouds are made of."""

import argparse
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest
from references.measured import FOUND, needs_measurements
from references.rays import BruteCaster, scene_with
from scipy.stats import hypergeom

from forest_addon.base.rng import stream
from forest_addon.formats.las import read_las
from forest_addon.growth.library import read_allometry
from forest_addon.growth.measured.allometry import Wanted, refuse_contradictions
from forest_addon.spec import Mobile, SpecError
from headless.surveys import FlownCloud
from studies.__main__ import main
from studies.scenes import level_ground
from studies.validation import cloud_pair as cloud_sums, flights, lidar, own_cloud
from studies.validation.cloud_pair import compare_clouds, hold_pair, lines_in, rarefied, stems_of
from studies.validation.flights import (
    BLOCK,
    FLIGHTS,
    HELD_BY_WOOD as WOOD,
    IntensityScale,
    clumping_of,
    halves_apart,
    most_leaves,
    read_flight,
    reflectances,
    scale_of,
    singles,
    threshold,
    trees_of,
)
from studies.validation.lidar import detected
from studies.validation.own_cloud import CloudReturns, compare_own, read_cloud
from studies.validation.plots import VOXEL, measure_plot
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
    with pytest.raises(
        SpecError, match=r"a\.laz: there is no such file|a\.laz there is no such file"
    ):
        read_las(tmp_path / "a.laz")
    (tmp_path / "a.laz").write_bytes(b"no cloud")
    with pytest.raises(SpecError, match="cannot be read as a LAS or LAZ file"):
        lidar.validate(
            Path(), tmp_path, argparse.Namespace(file=tmp_path / "a.laz", scene=tmp_path, seed=1)
        )


@needs_measurements
def test_measured_clouds_and_plots_are_as_their_readme_says():
    shares, _ = read_cloud(FOUND / "clouds" / "spanner_ALS.laz").shares()
    # Of all returns 41.7, 32.5, 18.9 and 5.9; without those that are withheld:
    assert np.allclose(100 * shares, [40.2, 33.4, 19.4, 6.0], atol=0.05)
    plots = [read_plots(FOUND / "rioja" / f"tree_{name}.csv") for name in ("field", "tls")]
    assert len(plots[0]) == 16
    stems = [np.concatenate([rows[:, 2:4] for rows in p.values()]) for p in plots]
    assert ratios(*stems)[0][-1] == pytest.approx(0.82, abs=0.01)


@pytest.mark.medium
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


def las(path, place, number, count, classes=0):
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = [1e-4] * 3
    cloud = laspy.LasData(header)
    cloud.xyz = place
    cloud.return_number, cloud.number_of_returns = number, count
    cloud.classification = np.broadcast_to(classes, len(place))
    cloud.write(path)
    return path


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


# -------------------------------------------------------------------------------------------- clouds
# Clouds held to clouds: closed forms, densities that differ, and media that differ.

ORIGIN = np.array([15.0, 15.0, 4000.0])
TALL, WIDE = 12.0, 30.0


def medium(path, pulses, density, seed, low=0.0):
    """A LAS file of single returns: a medium of this many contacts a metre from ``low`` to 12 m, by
    chance."""
    rng = stream(seed, "medium")
    foot = np.column_stack([rng.uniform(0, WIDE, (pulses, 2)), np.zeros(pulses)])
    way = (ORIGIN - foot) / np.linalg.norm(ORIGIN - foot, axis=1, keepdims=True)
    into = rng.exponential(1 / density, pulses)
    z = np.where(TALL - into * way[:, 2] > low, TALL - into * way[:, 2], 0.0)
    place = foot + (z / way[:, 2])[:, None] * way
    ones = np.ones(pulses, np.uint8)
    return las(path, place, ones, ones, np.where(z == 0, 2, 1))


def test_rarefied_occupancy_is_the_hypergeometric_chance():
    many, hits = np.array([10, 12, 40, 200, 30]), np.array([0, 3, 4, 150, 30])
    right = 1 - hypergeom.pmf(0, many, hits, 10)
    assert np.allclose(rarefied(many, hits, 10), right, atol=1e-10)


@pytest.mark.medium
@pytest.mark.parametrize("pulses", [30_000, 90_000])
def test_voxels_let_through_what_beers_law_says_at_every_density(tmp_path, pulses):
    density = 0.15
    whole = lines_in(medium(tmp_path / "a.las", pulses, density, 1), ORIGIN)[0].whole()
    layer = slice(2, int(TALL) - 1)
    passed = whole["passed"][layer].sum() / whole["voxels"][layer].sum()
    filled = whole["filled"][layer].sum() / whole["voxels"][layer].sum()
    assert passed == pytest.approx(np.exp(-density), abs=0.01)
    assert filled == pytest.approx(1 - np.exp(-density * 10), abs=0.01)
    gap = whole["gap"].sum() / whole["sent"].sum()
    assert gap == pytest.approx(np.exp(-density * (TALL - 0.5)), abs=0.03)


@pytest.mark.slow
def test_a_cloud_agrees_with_a_thinner_one_and_not_with_a_denser_medium(tmp_path):
    one = medium(tmp_path / "one.las", 45_000, 0.15, 1)
    thin = medium(tmp_path / "thin.las", 15_000, 0.15, 2)
    other = medium(tmp_path / "other.las", 45_000, 0.3, 3)
    verdicts = [
        {row.measure.name: row.verdict for row in compare_clouds(one, two, (ORIGIN, ORIGIN), 1)[0]}
        for two in (thin, other)
    ]
    for name in ("light that passes a voxel of 1 m", "voxels of 1 m that 10 beams meet"):
        assert [verdict[name] for verdict in verdicts] == ["agrees", "does not agree"]
    assert verdicts[0]["profile of light"] == "agrees"
    assert verdicts[0]["residual of stems' circles"].startswith("too little of it in one and thin")


@pytest.mark.medium
def test_stems_residuals_and_arcs_are_those_that_were_made():
    rng = stream(4, "stems")
    angle = rng.uniform(0, np.pi, (3, 4000))  # half of each stem is seen
    middle = np.array([[5.0, 0.0], [9.0, 4.0], [12.0, -6.0]])
    radius = np.array([0.1, 0.2, 0.15])[:, None] + 0.005 * rng.standard_normal(angle.shape)
    xy = middle[:, None] + radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=2)
    height = rng.uniform(0.5, 4, angle.size)
    bush = np.column_stack([rng.normal(0, 0.5, (2000, 2)), rng.uniform(0, 4, 2000)])
    place = np.concatenate([np.column_stack([xy.reshape(-1, 2), height]), bush])
    found = stems_of(place, place[:, 2])
    order = np.argsort(found[:, 0])
    assert np.allclose(found[order, :2], middle, atol=0.003)
    assert np.allclose(found[order, 2], [0.1, 0.2, 0.15], atol=0.002)
    assert np.allclose(found[:, 3], 0.5, atol=0.06)
    assert np.allclose(found[:, 4], 0.005, atol=0.0007)


@pytest.mark.slow
def test_the_command_writes_table_and_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cloud_sums, "MOST", 5000)
    files = [str(medium(tmp_path / f"{name}.las", 20_000, 0.2, 1)) for name in "ab"]
    out = tmp_path / "out"
    words = ["validate", "lidar", *files, "--origin", "15,15,4000", "--out", str(out)]
    assert not main(words)
    said = capsys.readouterr().out
    assert (out / "lidar" / "pair.md").read_text("utf-8") in said
    assert "| profile of light, m, median |" in said
    assert (out / "lidar" / "pair.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("subject", "origins", "said"),
    [("stand", [], "two files go with lidar"), ("lidar", ["0,0,0"] * 3, "is given 3 times")],
)
def test_what_cannot_be_a_pair_is_refused(tmp_path, subject, origins, said):
    chosen = argparse.Namespace(scene=None, stand=None, docs=None, out=tmp_path, seed=1)
    with pytest.raises(SpecError, match=said):
        hold_pair(subject, (tmp_path / "a.las", tmp_path / "b.las"), origins, chosen)


# ------------------------------------------------------------------------------------ plot of clouds
# Plots read from clouds: scales of intensities, reflectances, crowns, leaf area.


def split_light(span, high, pulses=4000):
    """Pulses that crown and ground share, and single ones of both, on a scale of ``span`` dB."""
    rng = stream(3, "split light")
    crown = np.concatenate([rng.uniform(0.05, 0.95, pulses), np.ones(pulses), np.zeros(pulses)])
    leaf, ground = 0.14, 0.3
    two = (crown > 0) & (crown < 1)
    each = np.column_stack([leaf * crown, ground * (1 - crown)])
    keep = np.column_stack([crown > 0, crown < 1])
    code = (10 * np.log10(np.maximum(each, 1e-9)) - (high - span)) / span * 65535
    number = np.where(keep, np.column_stack([np.ones(len(crown)), 1 + two]), 0).astype(int)
    count = np.repeat(1 + two, 2).reshape(-1, 2)
    height = np.broadcast_to([20.0, 0.0], keep.shape)
    time = np.repeat(np.arange(len(crown)), 2).reshape(-1, 2)
    rows = keep.ravel()
    n = int(rows.sum())
    returns = CloudReturns(
        np.zeros((n, 3)),
        number.ravel()[rows],
        count.ravel()[rows],
        np.zeros(n, bool),
        time.ravel()[rows].astype(float),
        None,
        code.ravel()[rows],
    )
    return returns, height.ravel()[rows]


@pytest.mark.parametrize("span", [12.0, 20.0, 35.0])
def test_the_scale_of_intensities_is_the_one_that_keeps_light(span):
    returns, height = split_light(span, 5.0)
    found = scale_of(returns, height, ground=0.3)
    assert found.high - found.low == pytest.approx(span, rel=1e-3)
    leaf, ground = reflectances(returns, height, found, zenith=0.0)
    assert ground == pytest.approx(0.3, rel=1e-3)
    assert leaf == pytest.approx(0.14 * 1.5, rel=1e-3)


def test_no_tree_of_a_plot_is_asked_for_more_leaves_than_can_be_grown():
    dbh = 0.121
    most = float(most_leaves(np.array([dbh]))[0])
    kind = read_allometry("pinus-sylvestris", Path())
    refuse_contradictions(Wanted(dbh, 12.1, 4.4, 1.0, most), kind, "plot")
    with pytest.raises(SpecError, match="leaf_area"):
        refuse_contradictions(Wanted(dbh, 12.1, 4.4, 1.0, 1.01 * most), kind, "plot")


@pytest.mark.slow
@needs_measurements
def test_the_drones_pulses_keep_their_light_on_the_scale_that_its_steps_have():
    drone = read_flight(FLIGHTS[0], FOUND / "clouds")
    some, height = drone.returns.take(drone.steep), drone.height[drone.steep]
    found = scale_of(some, height, ground=0.4)
    assert found.high - found.low == pytest.approx(20.0, abs=4.0)
    crown, ground = IntensityScale(-20.0, 0.0).reflectance(np.array(singles(some, height)))
    assert crown < ground


def drawn_plot(gap=0.3, side=30.0, pulses=68_000):
    """Beams from above on crowns that are upright cylinders of 3 m radius from 10 to 20 m, which a share of
    ``gap`` passes."""
    rng = stream(4, "drawn plot")
    axis = np.arange(5.0, side, 10.0)
    foot = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    xy = rng.uniform(0, side, (pulses, 2))
    apart = np.linalg.norm(xy[:, None] - foot, axis=2)
    over = apart.min(axis=1) < 3.0
    passed = ~over | (rng.random(pulses) < gap)
    dome = 20.0 - 0.8 * apart.min(axis=1)
    height = np.where(passed, 0.0, np.where(rng.random(pulses) < 0.5, dome, rng.uniform(10, dome)))
    ones = np.ones(pulses, int)
    place = np.column_stack([xy, height + 500.0])
    return CloudReturns(place, ones, ones, height == 0, None, None, 1000.0 * ones), foot


@pytest.mark.slow
def test_crowns_of_a_drawn_plot_are_as_they_were_drawn():
    cloud, foot = drawn_plot()
    low = np.array([0.0, 0.0, 500.0])
    floor = np.full(len(cloud.place), 500.0)
    found = trees_of(cloud, cloud, 0.0, "ponderosa-pine", low, floor)
    assert len(found) == len(foot)
    away = np.linalg.norm(found[:, None, :2] - foot, axis=2).min(axis=1)
    assert away.max() < 1.0
    assert np.allclose(found[:, 3], 20.0, atol=0.5)
    assert np.allclose(found[:, 4], 6.0, atol=0.8)  # cells of 0.5 m at its edge
    assert np.allclose(found[:, 5], 10.0, atol=0.6)
    expected = -2 * np.log(0.3) * np.pi * 9 * (1 - WOOD) / clumping_of("ponderosa-pine")
    assert found[:, 6].mean() == pytest.approx(expected, rel=0.15)


# ------------------------------------------------------------------------------------------- flights
# Flight lines of real clouds flown again: thresholds that are read, shares of returns, their nulls.


@needs_measurements
def test_a_line_flown_again_sees_level_ground_from_as_far_as_the_cloud():
    some = replace(FLIGHTS[1], scale=IntensityScale(-20.0, 0.0))
    read = read_flight(some, FOUND / "clouds")
    low = np.append(
        read.cloud.place[:, :2].min(axis=0), np.median(read.cloud.place[read.height < 1, 2])
    )
    number = flights._nearest_nadir(read)
    caster = BruteCaster(scene_with(level_ground(1000.0)))
    flown = flights._flown(
        read, number, Mobile(min_range=1.0, beam=read.flight.beam), caster, low, 1, most=60
    )
    inside = flights._inside(flown, read)
    far = read.far[(read.cloud.line == number) & (read.height < 1)]
    assert inside.sum() > 20
    assert np.median(flown.true_range[inside]) == pytest.approx(np.median(far), abs=5.0)


def cloud_of(light, far, count, line):
    """Returns whose intensities say their light on a scale from -20 to 0 dB."""
    level = 10 * np.log10(light * far**2)
    code = np.clip(np.round((level + 20) / 20 * 65535), 0, 65535)
    n = len(far)
    return CloudReturns(
        np.zeros((n, 3)), np.ones(n, int), count, np.zeros(n, bool), None, line, code
    )


def test_a_threshold_of_light_is_read_from_lines_of_any_range():
    rng = stream(1, "threshold")
    line = np.repeat([1, 2, 3], 20000)
    far = np.repeat([100.0, 190.0, 290.0], 20000)
    light = 1e-6 * rng.pareto(2.0, 60000) + 1e-6
    count = rng.integers(1, 4, 60000)
    found = threshold(cloud_of(light, far, count, line), line, far, IntensityScale(-20.0, 0.0))
    # P(light < q) = 1 - (1e-6/q)²: a twentieth lies below 1e-6/√0.95.
    assert found == pytest.approx(1e-6 / np.sqrt(0.95), rel=0.01)


def test_halves_of_a_line_are_as_far_apart_as_chance_makes_them():
    rng = stream(2, "halves")
    pulses = 40000
    place = np.column_stack([rng.uniform(0, 20 * BLOCK, (pulses, 2)), np.zeros(pulses)])
    count = np.where(rng.random(pulses) < 0.5, 1, 2)
    ones = np.ones(pulses, int)
    cloud = FlownCloud(place, np.zeros(pulses), ones, count, ones, np.zeros(pulses), "")
    # Two halves of 20,000 independent pulses: 1.96 times sqrt(0.25/20000 + 0.25/20000).
    assert halves_apart(cloud, 1)[1] == pytest.approx(0.0098, rel=0.35)


# ----------------------------------------------------------------------------------------- yardstick
# The yardstick of plots on a cloud whose stems and branches were put there.

STEMS = np.array([[2.0, 2.0, 0.10], [6.0, 2.5, 0.14], [4.0, 6.0, 0.07]])


@pytest.mark.slow
def test_stems_shrubs_and_gaps_are_told_apart():
    rng = stream(3, "yardstick")
    ground = np.column_stack([rng.uniform(0, 8, (10_000, 2)), rng.normal(0, 0.01, 10_000)])
    parts = [ground]
    for x, y, radius in STEMS:
        turn = rng.uniform(0, 2 * np.pi, 8_000)
        reach = radius + rng.normal(0, 0.003, turn.size)
        z = rng.uniform(0, 9, turn.size)
        parts.append(np.column_stack([x + reach * np.cos(turn), y + reach * np.sin(turn), z]))
    shrub = rng.uniform([1.0, 5.0, 0.5], [2.0, 6.0, 1.9], (400, 3))
    crown = rng.uniform([0.0, 0.0, 6.0], [8.0, 4.0, 8.0], (20_000, 3))  # over half of the field
    found = measure_plot(np.concatenate([*parts, shrub, crown]))
    order = np.argsort(found.stems[:, 0])
    assert found.stems[order, :3] == pytest.approx(STEMS[np.argsort(STEMS[:, 0])], abs=0.004)
    low = np.concatenate([*parts[1:], shrub])
    low = low[(low[:, 2] > 0.3) & (low[:, 2] < 4.0)]
    of_shrub = len(np.unique(np.floor(shrub / VOXEL), axis=0))
    share = of_shrub / len(np.unique(np.floor(low / VOXEL), axis=0))
    assert found.not_stem == pytest.approx(share, abs=0.02)
    assert found.empty == pytest.approx(0.5, abs=0.02)
    assert found.profile.sum() == pytest.approx(1)
    assert set(np.argsort(found.profile)[-2:]) == {6, 7}
