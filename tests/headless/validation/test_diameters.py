"""Stems of two lists matched, and diameters by tape, by circle and by quantiles."""

import numpy as np
import pytest
from references.measured import FOUND, needs_measurements

from forest_addon.base.rng import stream
from headless.studies.validation.tapes.diameters import matched_stems
from headless.studies.validation.tapes.girths import bole, by_circle, by_quantiles, by_tape, section
from headless.studies.validation.tapes.stem_lists import match_stems


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


def test_lists_of_different_plots_are_not():
    rng = stream(6, "lists")
    assert not match_stems(rng.uniform(-15, 15, (40, 2)), rng.uniform(-15, 15, (36, 2))).certain


def test_a_tape_spans_hollows_and_quantiles_leave_them_out():
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
    rng = stream(7, "furrows")
    rough = furrowed + 0.0005 * rng.standard_normal(furrowed.shape)
    assert by_quantiles(rough, 0.45, 0.99) == pytest.approx(0.3, abs=0.002)
    assert by_quantiles(rough, 0.05, 0.99) < 0.294


def test_a_tape_about_bark_reads_more_than_the_area_says():
    cut = section(bole(0.32, 3), 1.3001)
    order = np.argsort(np.arctan2(cut[:, 1], cut[:, 0]))
    x, y = cut[order].T
    area = 0.5 * abs((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    assert 2 * np.sqrt(area / np.pi) == pytest.approx(0.32, abs=0.001)
    assert 0.003 < by_tape(cut) - 0.32 < 0.02


@pytest.mark.slow
@needs_measurements
def test_riojas_lists_match_in_most_plots():
    stems, chance, left = matched_stems(FOUND / "rioja")
    assert len(stems) > 440
    assert chance < 130
    assert len(left) <= 3
    assert (stems[:, 2] - stems[:, 1]).mean() == pytest.approx(-2.1, abs=0.3)
