"""The study of the sonar: measures in closed form, a made-up pole that tells its recorder, leaves' areas."""

import math

import numpy as np
import pytest

from studies.validation.sonar import (
    ASPECTS,
    DISTANCES,
    RATE,
    RECORD,
    SPEED,
    beam_by_floor,
    calibrated,
    draw_plant,
    heard,
    leaves_of,
    measures,
    pole_mesh,
    second_echo,
    sounded,
)

TIME = np.arange(RECORD) / RATE


def tone(begin: float, lasts: float, level: float = 1.0, phase: float = 0.0) -> np.ndarray:
    inside = (begin <= TIME) & (begin + lasts > TIME)
    return level * np.where(inside, np.sin(2 * math.pi * 40e3 * (TIME - begin) + phase), 0.0)


def test_measures_are_those_of_tones():
    """Five tones of known energies that begin 1 ms after what is measured, and last 2 ms."""
    levels = np.array([1.0, 2.0, 3.0, 2.0, 1.0])
    begin = 2 * (0.5 - 0.25) / SPEED + 1e-3
    found = measures(np.array([tone(begin, 2e-3, level) for level in levels]), 0.5)
    power = levels**2
    assert found["energy"] == pytest.approx(10 * math.log10(power.mean() * 600), abs=0.05)
    assert found["spread"] == pytest.approx(power.std(ddof=1) / power.mean(), rel=1e-3)
    assert found["first"] == pytest.approx(1.2, abs=0.02)
    assert found["last"] == pytest.approx(2.8, abs=0.02)
    assert found["alike"] == pytest.approx(1.0, abs=1e-6)
    assert found["scintillation"] == pytest.approx(power.var(ddof=1) / power.mean() ** 2, rel=1e-2)


def pulse(time: np.ndarray) -> np.ndarray:
    return np.exp(-0.5 * (time / 0.1e-3) ** 2) * np.cos(2 * math.pi * 40e3 * time)


@pytest.mark.parametrize("width_deg", [40.0, 70.0])
@pytest.mark.parametrize("distance", DISTANCES)
def test_a_pole_and_its_image_tell_the_beam_and_the_height(width_deg, distance):
    """Images in an upright mirror and a hard floor 0.7 m below, a Gaussian beam."""
    radius, height = 0.03, 0.7
    straight = 2 * (distance - radius)
    path = math.hypot(straight, 2 * height)
    off = math.atan2(2 * height, straight)
    twice = 10 ** (-2 * 10 * math.log10(2) * (2 * off / math.radians(width_deg)) ** 2 / 20)

    echo = pulse(TIME - straight / SPEED - 0.3e-3) / straight
    echo += 2 * twice / path * pulse(TIME - path / SPEED - 0.3e-3)
    width, found = beam_by_floor(echo, radius, distance)
    assert found == pytest.approx(height, rel=0.02)
    assert math.degrees(width) == pytest.approx(width_deg, rel=0.03)


def test_the_recorder_gives_the_pole_back():
    """Echoes as recorded but for the window at its own distance, by physics at the other."""
    radius, poles = 0.03, {}
    for distance in DISTANCES:
        straight = 2 * (distance - radius)
        path = math.hypot(straight, 1.4)
        poles[distance] = pulse(TIME - straight / SPEED - 0.3e-3) / straight
        poles[distance] += 0.5 / path * pulse(TIME - path / SPEED - 0.3e-3)
        poles[distance] /= math.sqrt(distance)
    recorder = calibrated(poles, radius)
    for distance, most in zip(DISTANCES, (0.01, 0.05), strict=True):
        mesh = pole_mesh(radius, distance, recorder.height)
        _, transfer = heard([mesh], recorder.width, shading="none")
        again = sounded(recorder, transfer)
        peaks = [second_echo(each)[0] for each in (poles[distance], again)]
        assert peaks[1] == pytest.approx(peaks[0], abs=2 / RATE)
        air = math.exp(-0.15 * 2 * (distance - DISTANCES[0]))  # of 40 kHz, not in the images
        first = poles[distance][: round(RATE * (peaks[0] + 1e-3))]
        assert np.abs(again).max() == pytest.approx(air * np.abs(first).max(), rel=most)


def test_leaves_keep_their_area_flat_and_bent():
    plant = draw_plant(1, 3)
    area = math.pi * plant.length * plant.width
    flat, bent = (leaves_of(plant, curved) for curved in (False, True))
    size = np.linalg.norm(flat.area_vectors(), axis=1)
    assert np.bincount(flat.leaf, size) == pytest.approx(area, rel=1e-6)
    whole = np.linalg.norm(bent.area_vectors(), axis=1).reshape(len(area), -1).sum(axis=1)
    assert whole == pytest.approx(area, rel=0.03)
    assert (bent.leaf == -1).all()
    assert ASPECTS == 5
