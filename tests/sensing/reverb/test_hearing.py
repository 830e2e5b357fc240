"""Directions of arrival: ambisonics by their definition, a head read back from a SOFA file and heard."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from forest_addon.formats.sofa import read_head
from forest_addon.sensing.reverb.hearing import SECTORS, Ambisonics, hearing_of
from forest_addon.sensing.reverb.response import ImpulseResponse, impulse_response
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Reverb, SpecError

AIR = Air(sound_speed=343.0)
RATE = 8000.0


def listen(trunks: Trunks, folder: Path = Path(), **settings: object) -> ImpulseResponse:
    reverb = Reverb(**{"duration": 0.3, "sample_rate": RATE, "head_azimuth_deg": 0.0} | settings)
    return impulse_response(
        trunks,
        reverb,
        AIR,
        hearing=hearing_of(reverb, folder),
        field=((-80.0, -80.0), (160.0, 160.0)),
    )


def one(x: float, y: float, radius: float = 0.2) -> Trunks:
    return Trunks(np.array([[x, y]]), np.array([radius]), np.arange(1))


@pytest.mark.parametrize("facing", [0.0, 40.0])
def test_ambisonics_are_the_first_harmonics_of_each_part(facing: float) -> None:
    """ACN order, SN3D: every part's direction is read back from W, Y, Z, X; W is one microphone's."""
    trunks = one(8.0, -5.0)
    given = {"source": (10.0, 3.0, 3.0), "receiver": (0.0, 0.0, 1.0), "ground": 0.5}
    found = listen(trunks, heard_as="ambisonics", head_azimuth_deg=facing, **given)
    plain = listen(trunks, **given)
    w, y, z, x = found.channels
    assert [c.channel[-1] for c in found.channels] == list("WYZX")
    np.testing.assert_array_equal(w.samples, plain.samples)
    turn = math.radians(facing)
    ways = {
        "direct": np.array([10.0, 3.0, 2.0]),
        "ground": np.array([10.0, 3.0, -4.0]),
        "trees": np.array([8.0, -5.0, 0.0]),
    }
    for name, way in ways.items():
        unit = way / np.linalg.norm(way)
        ahead = unit[0] * math.cos(turn) + unit[1] * math.sin(turn)
        left = unit[1] * math.cos(turn) - unit[0] * math.sin(turn)
        size = np.abs(getattr(w, name)).max()
        for channel, share in ((x, ahead), (y, left), (z, unit[2])):
            apart = getattr(channel, name) - share * getattr(w, name)
            assert np.abs(apart).max() < 1e-9 * size
    for channel, share in zip(
        Ambisonics(turn).taps(ways["direct"])[:, 0], (w, y, z, x), strict=True
    ):
        assert share.direct @ w.direct == pytest.approx(channel * (w.direct @ w.direct), abs=1e-12)


@pytest.mark.medium
def test_many_trunks_and_noise_keep_the_energy_of_directions() -> None:
    """X² + Y² + Z² = W² for each trunk; in diffuse noise in the mean, by octaves of time, within 1 dB."""
    rng = np.random.default_rng(3)
    place = rng.uniform(-80, 80, (1600, 2))
    place = place[np.hypot(*(place - [5, 0]).T) > 12]
    trunks = Trunks(place, np.full(len(place), 0.15), np.arange(len(place)))
    settings = {"model": "forest", "duration": 0.6, "surface": "grass", "continue_to": 0.0}
    given = {"source": (10.0, 0.0, 1.5), "receiver": (0.0, 0.0, 1.5)}
    found = listen(trunks, heard_as="ambisonics", branch_area_density=0.2, **settings, **given)
    w, y, z, x = (channel.trees for channel in found.channels)
    for first, last in ((0.06, 0.12), (0.12, 0.25), (0.25, 0.5)):
        part = slice(int(first * RATE), int(last * RATE))
        sides = sum(float((c[part] ** 2).sum()) for c in (x, y, z))
        assert abs(10 * math.log10(sides / float((w[part] ** 2).sum()))) < 1.0


def test_a_head_is_heard_as_its_file_says(tmp_path: Path) -> None:
    """Ears that are delays and gains by direction: each part has those of where it comes from."""
    sofar = pytest.importorskip("sofar")
    file = sofar.Sofa("SimpleFreeFieldHRIR")
    azimuth = np.arange(0, 360, 10.0)
    late = np.round(5 + 4 * np.sin(np.radians(azimuth))).astype(
        int
    )  # the left ear hears the left first
    responses = np.zeros((36, 2, 32))
    for row, shift in enumerate(late):
        responses[row, 0, 10 - shift] = 1.0 + row
        responses[row, 1, shift] = 100.0 + row
    file.Data_IR, file.Data_SamplingRate = responses, RATE
    file.SourcePosition = np.column_stack([azimuth, np.zeros(36), np.full(36, 1.5)])
    sofar.write_sofa(str(tmp_path / "head.sofa"), file)
    trunks = one(0.0, 8.0)
    given = {"source": (-10.0, 0.0, 1.0), "receiver": (0.0, 0.0, 1.0), "ground": 0.0}
    settings = {"heard_as": "binaural", "head_file": "head.sofa", "head_azimuth_deg": 180.0}
    found, plain = listen(trunks, tmp_path, **settings, **given), listen(trunks, **given)
    for part, row in (("direct", 0), ("trees", 27)):  # ahead; to the right of who faces -x
        for ear, channel in enumerate(found.channels):
            taps = responses[row, ear]
            wanted = np.convolve(getattr(plain, part), taps)[: len(plain.samples)]
            heard = getattr(channel, part)
            np.testing.assert_allclose(heard, wanted, atol=1e-9 * np.abs(wanted).max())
    np.testing.assert_array_equal(found.microphones[0].samples, plain.samples)
    assert SECTORS % 4 == 0
    with pytest.raises(SpecError, match="head_file"):
        Reverb(heard_as="binaural")
    file = sofar.Sofa("SingleRoomSRIR")
    file.Data_IR, file.Data_Delay = np.ones((1, 1, 8)), np.zeros((1, 1))
    file.delete("ReceiverDescriptions")
    file.delete("EmitterDescriptions")
    sofar.write_sofa(str(tmp_path / "room.sofa"), file)
    for name, words in (("room.sofa", "SimpleFreeFieldHRIR"), ("none.sofa", "no such file")):
        with pytest.raises(SpecError, match=words):
            listen(trunks, tmp_path, **settings | {"head_file": name})
    (tmp_path / "broken.sofa").write_bytes(b"CDF\x01" + bytes(50))
    with pytest.raises(SpecError, match=r"broken\.sofa"):
        listen(trunks, tmp_path, **settings | {"head_file": "broken.sofa"})


def test_responses_as_sofa_are_read_back(tmp_path: Path) -> None:
    """Measurements are sources, receivers microphones; places and samples are those of the response."""
    sofar = pytest.importorskip("sofar")
    from forest_addon.results.coordinates import Offset
    from forest_addon.results.reverb import REVERB
    from forest_addon.spec import Place

    reverb = Reverb(
        sample_rate=RATE, duration=0.1, array=3, sources=(Place(position=(1.0, 2.0, 3.0)),)
    )
    found = impulse_response(one(9.0, 12.0), reverb, AIR)
    assert REVERB.save is not None
    REVERB.save(tmp_path / "r.sofa", reverb, found, Offset((0.0, 0.0, 0.0)), None)
    back = sofar.read_sofa(str(tmp_path / "r.sofa"), verify=True, verbose=False)
    assert back.Data_IR.shape == (2, 3, len(found.samples))
    np.testing.assert_array_equal(back.Data_IR[1, 2], found.channels[5].samples)
    np.testing.assert_allclose(back.SourcePosition[1], (1, 2, 3))
    places = back.ListenerPosition[0] + np.asarray(back.ReceiverPosition)[2].T[0]
    np.testing.assert_allclose(places, found.channels[5].receiver)


def test_a_head_is_the_same_however_its_file_stores_it(tmp_path: Path) -> None:
    """Right ear first, turned about, lying, cartesian: levels and times of left over right are the file's."""
    sofar = pytest.importorskip("sofar")
    azimuth = np.radians(np.arange(0, 360, 30.0))
    ways = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(12)])
    taps = np.zeros((12, 2, 16))
    for row, side in enumerate(np.sin(azimuth)):  # the nearer ear is louder, and hears first
        taps[row, 0, 8 - round(4 * side)], taps[row, 1, 8 + round(4 * side)] = 2 + side, 2 - side
    turn = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])  # columns: ahead, left, up

    def stored(name: str, **values: object) -> Path:
        file = sofar.Sofa("SimpleFreeFieldHRIR")
        file.Data_IR, file.Data_SamplingRate = taps, RATE
        file.SourcePosition, file.SourcePosition_Type = ways, "cartesian"
        file.SourcePosition_Units = "metre"
        for key, value in values.items():
            setattr(file, key, value)
        sofar.write_sofa(str(tmp_path / name), file)
        return tmp_path / name

    plain = read_head(stored("a.sofa"))
    assert 20 * np.log10(np.linalg.norm(plain.responses[3], axis=1) @ [1, 0]) == pytest.approx(
        9.54, abs=0.01
    )
    assert np.argmax(plain.responses[3], axis=1).tolist() == [4, 12]
    places = np.array([[0, -0.09, 0], [0, 0.09, 0]])
    round_the_head = np.column_stack([np.degrees(azimuth), np.zeros(12), np.full(12, 1.5)])
    others = {
        "swapped": {"Data_IR": taps[:, ::-1], "ReceiverPosition": places},
        "swapped, spherical": {
            "Data_IR": taps[:, ::-1],
            "ReceiverPosition": np.array([[270.0, 0, 0.09], [90, 0, 0.09]]),
            "ReceiverPosition_Type": "spherical",
            "ReceiverPosition_Units": "degree, degree, metre",
        },
        "sources by angles": {
            "SourcePosition": round_the_head,
            "SourcePosition_Type": "spherical",
            "SourcePosition_Units": "degree, degree, metre",
        },
        "a head that looks up": {
            "SourcePosition": ways @ turn.T + [1, 2, 3],
            "ListenerPosition": np.array([[1.0, 2, 3]]),
            "ListenerView": turn.T[:1],
            "ListenerUp": turn.T[2:],
        },
    }
    for name, values in others.items():
        found = read_head(stored(f"{name}.sofa", **values))
        np.testing.assert_allclose(found.directions, plain.directions, atol=1e-12)
        np.testing.assert_array_equal(found.responses, plain.responses)
    for values, words in (
        ({"ReceiverPosition": np.zeros((2, 3))}, "both ears on one side"),
        ({"ListenerUp": np.array([[1.0, 0, 0]])}, "not at right angles"),
    ):
        with pytest.raises(SpecError, match=words):
            read_head(stored("bad.sofa", **values))
