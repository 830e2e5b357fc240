"""Flight lines from clouds: found again from the beams of a scanner whose way is known."""

import numpy as np

from forest_addon.base.rng import stream
from forest_addon.sensing.lidar.surveys.like import gaps_of, lines_of, pulses_of, split_lines


def beams(way, time, rng, wrong=0.0):
    """Pulses of three returns from places (P, 3) to a plot 30 m wide and high, to a centimetre."""
    foot = np.column_stack([rng.uniform(-15, 15, (len(time), 2)), np.zeros(len(time))])
    up = np.sort(rng.uniform(0, 0.25, (len(time), 3)), axis=1)[:, ::-1]
    place = foot[:, None] + up[:, :, None] * (way - foot)[:, None]
    bad = rng.random(len(time)) < wrong
    place[bad] += rng.uniform(-3, 3, (bad.sum(), 3, 3))
    count = np.full(len(time) * 3, 3)
    return place.round(2).reshape(-1, 3), np.repeat(time, 3), np.tile([1, 2, 3], len(time)), count


def test_lines_are_found_from_their_beams_with_every_fifth_pulse_wrong():
    rng, found, truth = stream(1, "beams"), [], {}
    for number, (x, v) in enumerate([(-40.0, [1.0, 9.0, 0.2]), (150.0, [0.0, -8.0, 0.0])]):
        time = np.sort(rng.uniform(0, 4, 3000)) + 1000.0 * number + 2.8e8
        way = np.array([x, -16.0, 100.0]) + (time - time[0])[:, None] * np.array(v)
        truth[number] = (time, way, v)
        found.append((*beams(way, time, rng, wrong=0.2), np.full(9000, 7)))
    place, time, number, count, source = (
        np.concatenate(values) for values in zip(*found, strict=True)
    )
    line = split_lines(time, source)
    lines = lines_of(place, time, number, count, line)
    assert sorted(lines) == [0, 1]
    for name, (when, way, velocity) in truth.items():
        assert np.abs(lines[name].at(when) - way).max() < 0.3
        assert np.allclose(lines[name].velocity, velocity, atol=0.1)
        assert lines[name].miss < 0.02


def test_a_bent_way_is_followed_by_a_polyline():
    rng = stream(2, "beams")
    time = np.sort(rng.uniform(0, 60, 6000))
    way = np.column_stack([20 * np.sin(time / 15), 2 * time - 60, np.full(len(time), 80.0)])
    place, when, number, count = beams(way, time, rng)
    lines = lines_of(place, when, number, count, np.zeros(len(place), int))
    away = np.linalg.norm(lines[0].at(time) - way, axis=1)
    assert np.sqrt((away**2).mean()) < 1.0  # the polyline itself is within 20·(10/15)²/8 = 1.1 m
    assert len(lines[0].time) == 7


def test_too_few_pulses_are_no_line():
    rng = stream(3, "beams")
    time = np.arange(10.0)
    place, when, number, count = beams(np.tile([0.0, 0.0, 50.0], (10, 1)), time, rng)
    assert lines_of(place, when, number, count, np.zeros(30, int)) == {}


def test_pulses_are_told_apart_though_the_clock_is_coarse():
    time = np.array([0, 0, 0, 0, 0, 1, 1, 2.0])
    number = np.array([1, 2, 1, 2, 1, 1, 1, 2], dtype=np.uint8)
    count = np.array([2, 2, 2, 2, 1, 3, 3, 3], dtype=np.uint8)
    pulse = pulses_of(time, number, count)
    assert pulse.tolist() == [0, 0, 1, 1, 2, 3, 4, 5]
    place = np.column_stack([np.zeros((8, 2)), [5.0, 3, 9, 8, 0, 0, 0, 0]])
    gap, row = gaps_of(place, pulse)
    assert gap.tolist() == [2.0, 1.0]
    assert row.tolist() == [1, 3]
