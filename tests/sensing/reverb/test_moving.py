"""Sources and receivers that move: pitch by the closed form, and what stands still as ever."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from forest_addon.results.reverb import wet_sound_of
from forest_addon.sensing.reverb.auralise import auralise
from forest_addon.sensing.reverb.ends import ends_of
from forest_addon.sensing.reverb.moving import heard_moving
from forest_addon.sensing.reverb.response import ImpulseResponse, channels_of, impulse_response
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb, SpecError

SPEED, RATE = 343.0, 8000.0
AIR = Air(sound_speed=SPEED)
NOTHING = Trunks(np.empty((0, 2)), np.empty(0), np.empty(0, np.int64))
FEW = Trunks(np.array([[9.0, 11.0], [3.0, 14.0]]), np.array([0.3, 0.2]), np.arange(2))


def walk(folder: Path, name: str, *rows: tuple[float, ...]) -> str:
    lines = ["time, x, y, z", *(", ".join(map(str, row)) for row in rows)]
    (folder / name).write_text("\n".join(lines))
    return name


def respond(folder: Path, trunks: Trunks = NOTHING, **settings: object) -> ImpulseResponse:
    reverb = Reverb(**{"duration": 0.2, "sample_rate": RATE, "ground": 0.0} | settings)
    return impulse_response(trunks, reverb, AIR, ends=ends_of(reverb, None, folder))


@pytest.mark.parametrize("who", ["source", "receiver", "both"])
def test_pitch_of_a_pass_by_is_the_closed_form(tmp_path: Path, who: str) -> None:
    """A tone from one end to the other, one of them or both on straight ways past each other, at 20 m/s."""
    tone, fast, aside = 500.0, 20.0, 5.0
    settings = {"source": (0.0, 0.0, 2.0), "receiver": (0.0, aside, 2.0)}
    if who != "receiver":
        settings["source_path"] = walk(tmp_path, "s.csv", (0, -20, 0, 2), (2, 20, 0, 2))
    if who != "source":
        settings["receiver_path"] = walk(tmp_path, "r.csv", (0, 20, aside, 2), (2, -20, aside, 2))
    found = respond(tmp_path, path_step=0.25, **settings)
    time = np.arange(int(2 * RATE)) / RATE
    heard = heard_moving(found, np.sin(2 * math.pi * tone * time), SPEED)[:, 0]
    v_s = np.array([fast, 0.0]) if who != "receiver" else np.zeros(2)
    v_r = np.array([-fast, 0.0]) if who != "source" else np.zeros(2)
    s0 = np.array([-20.0, 0.0]) if who != "receiver" else np.zeros(2)
    r0 = np.array([20.0, aside]) if who != "source" else np.array([0.0, aside])
    for middle in (0.4, 0.9, 1.0, 1.1, 1.6):
        some = slice(int((middle - 0.01) * RATE), int((middle + 0.01) * RATE))
        when = np.arange(len(heard))[some] / RATE
        # t' of t by the quadratic |r(t) - s(t')|² = c²(t - t')²
        gap = r0 + v_r * when[:, None] - s0
        a = SPEED**2 - v_s @ v_s
        b = SPEED**2 * when - gap @ v_s
        sent = (b - np.sqrt(b**2 - a * (SPEED**2 * when**2 - (gap**2).sum(1)))) / a
        far = SPEED * (when - sent)
        wanted = np.sin(2 * math.pi * tone * sent) / far
        loss = heard[some] @ wanted / (wanted @ wanted)
        assert 0.985 < loss <= 1.0005  # what the air takes of 500 Hz, by moments
        np.testing.assert_allclose(heard[some], loss * wanted, atol=2e-3 / far.min())
        turns = np.gradient(sent, when)[1:-1]
        n = (gap - v_s * sent[:, None]) / far[:, None]
        ratio = (1 - n @ v_r / SPEED) / (1 - n @ v_s / SPEED)
        np.testing.assert_allclose(turns, ratio[1:-1], rtol=1e-5)


@pytest.mark.medium
def test_what_waits_sounds_as_what_stands(tmp_path: Path) -> None:
    """A path that goes nowhere is the impulse response itself, trees and ground too."""
    path = walk(tmp_path, "wait.csv", (0, 5, 10, 1.5), (1, 5, 10, 1.5))
    dry = np.random.default_rng(0).standard_normal(6000)
    still = respond(tmp_path, FEW, ground=0.6, duration=0.3)
    wanted = auralise(channels_of(still), dry, RATE, RATE)[:, 0]
    for key in ("source_path", "receiver_path"):
        place = (
            path
            if key == "source_path"
            else walk(tmp_path, "r.csv", (0, 15, 10, 1.5), (1, 15, 10, 1.5))
        )
        found = respond(tmp_path, FEW, ground=0.6, duration=0.3, path_step=0.2, **{key: place})
        heard = heard_moving(found, dry, SPEED)[: len(wanted), 0]
        inner = slice(100, 6000)
        size = np.linalg.norm(wanted[inner])
        assert (
            np.linalg.norm(heard[inner] - wanted[inner]) < 3e-3 * size
        )  # the band's end, interpolated


def test_moments_places_and_words(tmp_path: Path) -> None:
    (tmp_path / "mics.csv").write_text("x,y,z\n0,0,0\n0,1,0\n")
    path = walk(tmp_path, "p.csv", (1, 0, 0, 1), (2, 4, 0, 1))
    reverb = Reverb(receiver_path=path, path_step=0.5, array_file="mics.csv")
    ends = ends_of(reverb, None, tmp_path)
    assert ends.times == (1.0, 1.5, 2.0)
    assert ends.channels[3] == "source to receiver.2 at 1.5 s"
    np.testing.assert_allclose(ends.pairs[3][1], (2.0, 1.0, 1.0))
    assert len(ends.on_ground) == 7
    bad = {
        "one row": "time,x,y,z\n0,0,0,1\n",
        "falls": "time,x,y,z\n1,0,0,1\n0,1,1,1\n",
        "below": "time,x,y,z\n0,0,0,1\n1,1,1,-1\n",
        "no z": "time,x,y\n0,0,0\n1,1,1\n",
        "words": "time,x,y,z\n0,0,0,1\n1,here,1,1\n",
    }
    for name, text in bad.items():
        (tmp_path / "bad.csv").write_text(text)
        with pytest.raises(SpecError, match=r"bad\.csv"):
            ends_of(Reverb(source_path="bad.csv"), None, tmp_path)
            pytest.fail(name)
    with pytest.raises(SpecError, match="no such file"):
        ends_of(Reverb(array_file="none.csv"), None, tmp_path)
    with pytest.raises(SpecError, match="path_step"):
        ends_of(replace_step(path), None, tmp_path)


def replace_step(path: str) -> Reverb:
    return Reverb(source_path=path, path_step=1e-4)


def test_background_noise_has_the_levels_asked_for(tmp_path: Path) -> None:
    """By octave, within four standard errors of a mean square over 8 s."""
    levels = (-40.0, -20.0, -30.0, -10.0)
    dry = np.zeros(int(8 * RATE))
    dry[:] = np.random.default_rng(1).standard_normal(len(dry))
    still = respond(tmp_path)
    reverb = Reverb(sample_rate=RATE, noise_db=levels)
    noisy, _ = wet_sound_of(reverb, still, dry, RATE)
    clean, _ = wet_sound_of(reverb.changed(noise_db=()), still, dry, RATE)
    noise = (noisy - clean)[:, 0]
    power = np.abs(np.fft.rfft(noise)) ** 2 / len(noise) ** 2 * 2
    frequency = np.fft.rfftfreq(len(noise), 1 / RATE)
    for number, level in enumerate(levels):
        middle = 63.0 * 2**number
        inside = (frequency >= middle / math.sqrt(2)) & (frequency < middle * math.sqrt(2))
        error = 4.0 / math.sqrt(inside.sum())
        found = power[inside].sum() / np.mean(dry**2) / 10 ** (level / 10)
        assert abs(found - 1) < error
    assert power[frequency > 63 * 2**3.5 + 1].sum() < 1e-20
