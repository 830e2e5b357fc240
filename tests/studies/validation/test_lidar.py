"""Stems, twigs and returns of pulses: what the comparisons with measured clouds are made of."""

import argparse
from dataclasses import replace
from functools import cache
from pathlib import Path

import laspy
import numpy as np
import pytest
from references.measured import FOUND, needs_measurements
from references.rays import BruteCaster, scene_with
from scipy import stats
from scipy.stats import hypergeom

from forest_addon.base.rng import stream
from forest_addon.formats.las import read_las
from forest_addon.formats.tree_map import read_tree_map
from forest_addon.growth.library import read_allometry
from forest_addon.growth.measured.allometry import Wanted, refuse_contradictions
from forest_addon.spec import Mobile, SpecError
from forest_addon.stand.statistics.intensity import Window
from headless.surveys import FlownCloud
from studies.__main__ import main
from studies.scenes import level_ground
from studies.validation import (
    cloud_pair as cloud_sums,
    flights,
    leaves,
    lidar,
    own_cloud,
    tapes as residuals,
)
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
from studies.validation.leaves import KINDS
from studies.validation.lidar import detected
from studies.validation.own_cloud import CloudReturns, compare_own, read_cloud
from studies.validation.plots import VOXEL, measure_plot
from studies.validation.stand import MAPS, fit_covariates, judge
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
from studies.validation.tapes import (
    bole,
    breast_diameter,
    by_circle,
    by_tape,
    match_stems,
    matched_stems,
    scan_plot,
    section,
    sections_of,
    taper_of,
)
from studies.validation.trees import band_of, read_trees


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


# ---------------------------------------------------------------------------------------- diameters
# Stems of two lists matched, and diameters by tape, by circle and as FORTLS has them.


def two_lists(rng, turn_deg, shift, lost=8, stems=40):
    radius = 20 * np.sqrt(rng.random(stems))
    turn = rng.uniform(0, 2 * np.pi, stems)
    given = np.column_stack([radius * np.cos(turn), radius * np.sin(turn)])
    t = np.deg2rad(-turn_deg)
    matrix = np.array([[np.cos(t), -np.sin(t)], [np.sin(t), np.cos(t)]])
    order = rng.permutation(stems)[lost:]
    found = (given[order] - shift) @ matrix.T + 0.1 * rng.standard_normal((len(order), 2))
    return given, found, order


@pytest.mark.parametrize("turn_deg", [-9.0, 100.0])
def test_lists_that_are_turned_and_shifted_are_matched(turn_deg):
    given, found, order = two_lists(stream(5, "lists"), turn_deg, np.array([0.5, -1.0]))
    match = match_stems(given, found)
    assert match.certain
    assert np.degrees(match.turn) == pytest.approx(turn_deg, abs=0.5)
    assert match.shift == pytest.approx([0.5, -1.0], abs=0.15)
    assert (order[match.found] == match.given).mean() > 0.95
    assert len(match.given) >= 30


def test_a_tape_spans_hollows_and_a_circle_does_not():
    angle = 2 * np.pi * (np.arange(3600) + 0.5) / 3600
    round_one = 0.15 * np.column_stack([np.cos(angle), np.sin(angle)])
    assert by_tape(round_one) == pytest.approx(0.3, rel=1e-5)
    assert by_circle(round_one)[1] == pytest.approx(0.3, rel=1e-9)
    deep = np.where(np.arange(3600) % 20 < 8, 0.14, 0.15)[
        :, None
    ]  # furrows of 1 cm, 40 % of the way
    furrowed = deep / 0.15 * round_one
    assert by_tape(furrowed) == pytest.approx(0.3, rel=2e-3)
    assert by_circle(furrowed)[1] == pytest.approx(2 * (0.4 * 0.14 + 0.6 * 0.15), rel=1e-3)


def seen_half(diameter, away, step, noise=0.0, eye=1.5):
    """Points of a tapered stem's near side, as a scanner's steps find it: rays meet the cylinder of each
    height in closed form."""
    turn = np.arange(-0.3, 0.3, step)
    z = np.concatenate([h + np.arange(-0.06, 0.06, step * away) for h in (1.0, 1.3, 1.6)])
    azimuth, height = (v.ravel() for v in np.meshgrid(turn, z))
    radius = (diameter - 0.02 * (height - 1.3)) / 2
    met = np.abs(np.sin(azimuth)) < radius / away
    azimuth, height, radius = azimuth[met], height[met], radius[met]
    range_ = away * np.cos(azimuth) - np.sqrt(radius**2 - (away * np.sin(azimuth)) ** 2)
    range_ = range_ + noise * stream(3, "half").standard_normal(len(range_))
    return np.column_stack([range_ * np.cos(azimuth), range_ * np.sin(azimuth), height])


@pytest.mark.parametrize("turn_deg", [0.0, 90.0, 180.0])
def test_fortls_finds_the_diameter_and_taper_of_a_round_stem(turn_deg):
    t = np.deg2rad(turn_deg)  # 180 degrees is where azimuths leap
    points = seen_half(0.32, 8.0, 7.67e-4) @ np.array(
        [[np.cos(t), np.sin(t), 0], [-np.sin(t), np.cos(t), 0], [0, 0, 1]]
    )
    found = sections_of(points, 1.5, 7.67e-4)
    assert found[:, 0] == pytest.approx([1.0, 1.3, 1.6])
    assert found[:, 1] == pytest.approx(0.32 - 0.02 * (found[:, 0] - 1.3), abs=0.02)  # grid of 1 cm
    assert breast_diameter(found, -0.02) == pytest.approx(0.32, abs=0.01)
    assert taper_of([np.array([[1.0, 0.326], [1.3, 0.32], [1.6, 0.314]])]) == pytest.approx(-0.02)


@pytest.mark.medium
def test_a_stem_behind_another_is_hidden():
    stems = np.array([[5.0, 0.0, 0.4], [9.0, 0.0, 0.25], [0.0, 6.0, 0.3]])
    found = scan_plot(stems, 3, bark=False)
    assert np.isfinite(found.fortls).tolist() == [True, False, True]
    assert found.fortls[[0, 2]] == pytest.approx(found.tape[[0, 2]], abs=0.015)


@pytest.mark.slow
def test_bark_adds_to_residuals_of_circles(monkeypatch):
    few = np.array([[4.0, 3.0, 0.25, 17.0]])
    monkeypatch.setattr(residuals, "pine_stems", lambda seed: few)
    monkeypatch.setattr(residuals, "STEP", 0.25)
    rough, smooth = (
        np.median(residuals.stems_of_plot(4, bark, residuals.EXACT)[:, 4]) for bark in (True, False)
    )
    assert 0.002 < smooth < 0.0035  # the noise, 3 mm
    assert rough > 1.4 * smooth
    joined = residuals.stems_of_plot(4, False)[
        :, 4
    ]  # by about half of 12 mm, as the stations are five
    assert np.median(joined) > 1.4 * smooth


def test_a_tape_about_bark_reads_more_than_the_area_says():
    cut = section(bole(0.32, 3), 1.3001)
    order = np.argsort(np.arctan2(cut[:, 1], cut[:, 0]))
    x, y = cut[order].T
    area = 0.5 * abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    assert 2 * np.sqrt(area / np.pi) == pytest.approx(0.32, abs=0.001)
    assert 0.003 < by_tape(cut) - 0.32 < 0.02


@pytest.mark.medium
@needs_measurements
def test_riojas_lists_match_in_most_plots():
    stems, chance, left = matched_stems(FOUND / "rioja")
    assert len(stems) > 440
    assert chance < 130
    assert len(left) <= 3
    assert (stems[:, 2] - stems[:, 1]).mean() == pytest.approx(-2.1, abs=0.3)


# --------------------------------------------------------------------------------------------- trees
# Bands of measured trees, and what is taken from a grown one.


def test_a_band_holds_ninety_in_a_hundred_of_the_trees_near_it():
    rng = stream(1, "band")
    dbh = rng.uniform(0.1, 0.4, 5000)
    height = rng.normal(10, 2, 5000)
    height[:50] = np.nan
    band, count = band_of({"dbh_m": dbh, "height_m": height}, "height_m", 0.2)
    near = np.isfinite(height) & (dbh > 0.16) & (dbh < 0.25)
    assert count == near.sum()
    held = (height[near] >= band.low) & (height[near] <= band.high)
    assert held.mean() == pytest.approx(0.9, abs=0.01)
    assert band_of({"dbh_m": dbh, "height_m": height}, "height_m", 5.0) == (None, 0)


@needs_measurements
def test_measured_trees_are_read_by_type():
    trees = read_trees(FOUND / "baad_trees.csv")
    assert {kind: len(columns["dbh_m"]) for kind, columns in trees.items()}.keys() == {"DA", "EG"}
    band, count = band_of(trees["EG"], "height_m", 0.2)
    assert count > 100
    assert 5 < band.low < band.value < band.high < 30


# -------------------------------------------------------------------------------------------- leaves
# Leaf inclinations of presets against those measured of the same species.


@pytest.mark.slow
@needs_measurements
def test_measured_variants_are_not_refused_and_presets_of_papers_are(tmp_path, monkeypatch):
    """At 1e-3 instead of 5 %: four right samples are refused by chance once in 250 seeds; this one is not."""
    drawn = cache(leaves.inclinations)
    monkeypatch.setattr(leaves, "inclinations", drawn)
    angles = leaves.read_angles(FOUND / "leaf_angles.csv")
    for kind in KINDS:
        measured = np.concatenate(list(angles[kind.measured].values()))
        tests = [stats.ks_2samp(measured, drawn(name, 2)) for name in (kind.after, kind.before)]
        assert tests[0].pvalue > 1e-3 > tests[1].pvalue
    found = leaves.validate(FOUND, tmp_path, argparse.Namespace(seed=2))
    assert len(found) == 4 * len(KINDS)
    assert found[-1].pictures[0].file.stat().st_size < 150_000


# --------------------------------------------------------------------------------------------- stand
# The processes that mapped stands need, on the smallest map.


@needs_measurements
def test_young_pines_are_no_poisson_process_and_groups_serve_them():
    stand = next(s for s in MAPS if s.name == "finpines")
    points = read_tree_map(FOUND / "stands" / "finpines.csv").position
    laws = judge(stand, points, np.linspace(0.1, stand.reach, 25), None, 1)
    p_values = {law.name: law.excess.p_value for law in laws}
    assert p_values["Poisson"] < 0.05 < p_values["clusters"]


def test_coefficients_of_covariates_are_found_again():
    """Each within 4.5 of its standard errors: fails once in 50,000."""
    rows, columns = 40, 50
    window = Window.rectangle(np.zeros(2), np.array([100.0, 80.0]))
    z = np.stack(np.meshgrid(np.linspace(-1, 1, columns), np.linspace(100, 130, rows)))
    mean = np.exp(-16.0 + 1.5 * z[0] + 0.1 * z[1]) * window.area / (rows * columns) * 40
    rng = stream(1, "covariates")
    count = rng.poisson(mean)
    row, column = np.divmod(np.repeat(np.arange(rows * columns), count.ravel()), columns)
    points = (np.stack([column, row], axis=1) + rng.random((len(row), 2))) * [2.0, 2.0]
    fit = fit_covariates(points, z, window)
    assert (np.abs(fit.coefficient[1:] - [1.5, 0.1]) < 4.5 * fit.error[1:]).all()
    assert fit.pixels.sum() * 4.0 == pytest.approx(len(points))
    assert fit.at(points[:5]).min() > 0
    with pytest.raises(ValueError, match="drop one"):
        fit_covariates(points, np.stack([z[0], 2 * z[0] + 1]), window)
