"""Plots read from clouds: scales of intensities, reflectances, crowns, leaf area."""

from pathlib import Path

import numpy as np
import pytest
from references.measured import FOUND, needs_measurements

from forest_addon.base.rng import stream
from forest_addon.growth.library import read_allometry
from forest_addon.growth.measured.allometry import Wanted, refuse_contradictions
from forest_addon.spec import SpecError
from studies.validation.flights import (
    FLIGHTS,
    IntensityScale,
    clumping_of,
    most_leaves,
    read_flight,
    reflectances,
    scale_of,
    singles,
    trees_of,
)
from studies.validation.flights import HELD_BY_WOOD as WOOD
from studies.validation.own_cloud import CloudReturns


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


def drawn_plot(gap=0.3, side=40.0, pulses=120_000):
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
