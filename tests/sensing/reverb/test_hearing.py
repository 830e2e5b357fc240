"""Directions of arrival: ambisonics by their definition, a head read back from a SOFA file and heard."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import wavfile

from forest_addon.base.rng import stream
from forest_addon.formats.sofa import read_head
from forest_addon.formats.wav import read_wav, write_wav
from forest_addon.results.coordinates import Offset
from forest_addon.results.reverb import REVERB, wet_sound_of
from forest_addon.sensing.reverb.auralise import auralise, normalised, resample
from forest_addon.sensing.reverb.channels import ImpulseResponse, channels_of
from forest_addon.sensing.reverb.directivity import CARDIOID, OMNI, Directivity, read_directivity
from forest_addon.sensing.reverb.ends import ends_of
from forest_addon.sensing.reverb.hearing import SECTORS, Ambisonics, hearing_of
from forest_addon.sensing.reverb.moving import heard_moving
from forest_addon.sensing.reverb.response import impulse_response
from forest_addon.sensing.reverb.trunks import Trunks
from forest_addon.spec import Air, Place, Reverb, SpecError

AIR = Air(sound_speed=343.0)
RATE = 8000.0


def listen(
    trunks: Trunks, folder: Path = Path(), directivity: Directivity = OMNI, **settings: object
) -> ImpulseResponse:
    reverb = Reverb(**{"duration": 0.3, "sample_rate": RATE, "head_azimuth_deg": 0.0} | settings)
    return impulse_response(
        trunks,
        reverb,
        AIR,
        directivity=directivity,
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
    reverb = Reverb(
        sample_rate=RATE, duration=0.1, array=3, sources=(Place(position=(1.0, 2.0, 3.0)),)
    )
    found = impulse_response(one(9.0, 12.0), reverb, AIR)
    REVERB.saves[".sofa"](tmp_path / "r.sofa", reverb, found, Offset((0.0, 0.0, 0.0)))
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
        ({"Data_Delay": np.array([[-1.0, 0]])}, "Data_Delay beyond 0 to 100,000 samples"),
        ({"Data_Delay": np.array([[0.0, 1e6]])}, "Data_Delay beyond 0 to 100,000 samples"),
    ):
        with pytest.raises(SpecError, match=words):
            read_head(stored("bad.sofa", **values))


# --------------------------------------------------------------------------------------- directivity
# Directed sources: the products are the table, and every path has the gain of its departure angle.


def loudspeaker() -> Directivity:
    """A baffled piston of 10 cm: narrower towards high frequencies."""
    frequency = np.array([125.0, 500.0, 1000.0, 2000.0, 4000.0])
    angle = np.deg2rad(np.arange(0, 181, 10))
    x = 2 * np.pi * frequency / 343.0 * 0.1 * np.sin(np.minimum(angle, np.pi / 2))[:, None]
    return Directivity(angle, frequency, np.exp(-(x**2) / 8) + 0.01)


def test_omni_and_cardioid_are_one_product() -> None:
    cosine = np.cos(np.linspace(0, np.pi, 37))
    for pattern, expected in ((OMNI, np.ones(37)), (CARDIOID, (1 + cosine) / 2)):
        (term,) = pattern.terms(1e-9)
        assert term.flat
        np.testing.assert_allclose(term.gains(cosine) * term.of_frequency[0], expected, atol=1e-15)


def test_products_are_the_interpolated_table() -> None:
    speaker = loudspeaker()
    frequency = np.geomspace(50, 10_000, 80)  # also beyond the table
    for cosine in np.cos(np.linspace(0, np.pi, 23)):
        sums = sum(
            term.gains(np.array([cosine])) * term.spectrum(frequency)
            for term in speaker.terms(1e-12)
        )
        np.testing.assert_allclose(sums, speaker.at(cosine, frequency), atol=1e-12)
    assert len(speaker.terms(1e-2)) < len(speaker.terms(1e-12))
    row = 3
    angle, middle = speaker.angle[row], speaker.frequency
    np.testing.assert_allclose(speaker.at(math.cos(angle), middle), speaker.gain[row], rtol=1e-12)


def trunks(count: int) -> Trunks:
    rng = np.random.default_rng(3)
    return Trunks(rng.uniform(-12, 32, (count, 2)), np.full(count, 0.2), np.arange(count))


@pytest.mark.medium
def test_each_path_has_the_gain_of_its_departure() -> None:
    """One trunk at a time, and 12 at once by either sum: cardioid that points away from the receiver."""
    forest = trunks(12)
    away = forest.position - (5.0, 10.0)
    gain = 0.5 - 0.5 * away[:, 0] / np.hypot(*away.T)
    apart = [
        g * listen(forest.select(np.array([m])), tolerance=0.0).trees for m, g in enumerate(gain)
    ]
    expected = np.sum(apart, axis=0)
    free = listen(forest).ground
    for tolerance in (0.0, 1e-6):
        together = listen(
            forest, directivity=CARDIOID, facing_azimuth_deg=180.0, tolerance=tolerance
        )
        assert np.linalg.norm(together.trees - expected) < 2e-5 * np.linalg.norm(expected)
        assert np.abs(together.direct).max() < 1e-15
        # The bounce leaves downwards by atan(1.5/5) from the horizon: a little of it is heard.
        share = 0.5 - 0.5 * 5 / math.hypot(5, 1.5)
        np.testing.assert_allclose(together.ground, share * free, atol=1e-15)


def test_a_directivity_by_frequency_filters_direct_and_trees() -> None:
    speaker, one = loudspeaker(), trunks(1)
    facing = {"facing_azimuth_deg": 60.0, "duration": 2.0}
    directed, free = (
        listen(one, directivity=directivity, **facing) for directivity in (speaker, OMNI)
    )
    frequency = np.fft.rfftfreq(16_000, 1 / 8000.0)
    heard = (frequency > 200) & (frequency < 3000)
    away = one.position[0] - (5.0, 10.0)
    turn = math.atan2(away[1], away[0]) - math.pi / 3
    for part, cosine in (("direct", 0.5), ("trees", math.cos(turn))):
        ratio = np.fft.rfft(getattr(directed, part)) / np.fft.rfft(getattr(free, part))
        np.testing.assert_allclose(ratio[heard], speaker.at(cosine, frequency[heard]), atol=3e-3)


@pytest.mark.parametrize(
    "text",
    [
        "angle_deg, 500, 2000\n0, 0, 0\n90, -6.0206, -20\n180, -inf, -40\n",
        "angle_deg;500,0;2000\n0;0;0\n90;-6,0206;-20\n180;-inf;-40\n",
    ],
)
def test_a_file(tmp_path: Path, text: str) -> None:
    file = tmp_path / "speaker.csv"
    file.write_text(text)
    found = read_directivity(file)
    np.testing.assert_allclose(found.gain, [[1, 1], [0.5, 0.1], [0, 0.01]], atol=1e-5)
    np.testing.assert_allclose(found.frequency, [500, 2000])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("angle,500\n0,0\n", "two rows"),
        ("angle,500\n0,0\n90,0\n", "0 to 180"),
        ("angle,500\n0,0\n180,loud\n", '500 is "loud", not a finite number'),
        ("angle,500\n0,0\n180,nan\n", "row 3 has no 500"),
        ("angle,500\n0,0\n180,0,0\n", "row 3 has 3 values, its header 2"),
        ("angle,500,250\n0,0,0\n180,0,0\n", "must rise"),
        ("angle,500\n0,900\n180,0\n", "200 dB"),
    ],
)
def test_bad_files_are_refused_in_words(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(SpecError, match=said):
        read_directivity(file)
    with pytest.raises(SpecError, match="no such file"):
        read_directivity(tmp_path / "none.csv")


# ---------------------------------------------------------------------------------------------- ends
# Several sources and receivers: where they are, what they are called, that each is as if it were alone.


def test_names_and_places() -> None:
    reverb = Reverb(
        sources=(Place(position=(1.0, 2.0, 3.0)),),
        receivers=(Place(position=(4.0, 5.0, 6.0)),),
        receiver_objects="Ear, Camera ,",
    )
    ends = ends_of(reverb, {"Ear": (7.0, 8.0, 9.0), "Camera": (1.0, 1.0, 1.0)})
    assert ends.source_names == ("source", "source 2")
    assert ends.receiver_names == ("receiver", "receiver 2", "Ear", "Camera")
    assert ends.channels[4] == "source 2 to receiver"
    np.testing.assert_array_equal(ends.receivers[2], (7, 8, 9))


def test_a_pair_of_ears_and_a_slanted_row() -> None:
    ears = ends_of(Reverb(array=2, array_spacing=0.2)).receivers
    np.testing.assert_allclose(ears, [(15, 9.9, 1.5), (15, 10.1, 1.5)], atol=1e-12)
    row = ends_of(
        Reverb(array=5, array_spacing=0.5, array_azimuth_deg=30, array_elevation_deg=40)
    ).receivers
    np.testing.assert_allclose(row.mean(axis=0), (15, 10, 1.5))
    step = np.diff(row, axis=0)
    np.testing.assert_allclose(np.linalg.norm(step, axis=1), 0.5)
    np.testing.assert_allclose(np.arctan2(step[:, 1], step[:, 0]), math.pi / 6)
    np.testing.assert_allclose(step[:, 2], 0.5 * math.sin(math.radians(40)))


def test_refused_in_words() -> None:
    with pytest.raises(SpecError, match='"Ear" in the scene; it has Mouth'):
        ends_of(Reverb(receiver_objects="Ear"), {"Mouth": (0.0, 0.0, 1.0)})
    with pytest.raises(SpecError, match="above the ground"):
        ends_of(Reverb(source_objects="Mouth"), {"Mouth": (0.0, 0.0, 0.0)})
    with pytest.raises(SpecError, match="below the ground"):
        ends_of(Reverb(array=9, array_spacing=1.0, array_elevation_deg=90))
    with pytest.raises(SpecError, match="above the ground"):
        Place(position=(0.0, 0.0, -1.0))


def test_each_channel_is_as_if_alone() -> None:
    rng = np.random.default_rng(0)
    trunks = Trunks(rng.uniform(-15, 35, (70, 2)), np.full(70, 0.2), np.arange(70))
    reverb = Reverb(
        sources=(Place(position=(0.0, 0.0, 2.0)),), array=2, duration=0.3, sample_rate=8000.0
    )
    found = impulse_response(trunks, reverb, AIR)
    assert [channel.channel for channel in found.channels] == list(ends_of(reverb).channels)
    for (source, receiver), channel in zip(ends_of(reverb).pairs, found.channels, strict=True):
        alone = Reverb(
            source=tuple(source), receiver=tuple(receiver), duration=0.3, sample_rate=8000.0
        )
        np.testing.assert_allclose(
            channel.samples,
            impulse_response(trunks, alone, AIR).samples,
            atol=1e-12,
        )
    assert not np.array_equal(found.samples, found.further[0].samples)


def test_all_channels_stand_in_the_same_forest() -> None:
    """Two receivers at one place hear the same, also of what goes on beyond the field."""
    rng = np.random.default_rng(0)
    trunks = Trunks(rng.uniform(0, 20, (40, 2)), np.full(40, 0.1), np.arange(40))
    reverb = Reverb(continue_to=80.0, duration=0.3, sample_rate=4000.0)
    twice = replace(reverb, receivers=(Place(position=reverb.receiver),))
    found = impulse_response(
        trunks, twice, AIR, rng=stream(1, "beyond"), field=((0.0, 0.0), (20.0, 20.0))
    )
    assert found.continued > 100
    np.testing.assert_array_equal(found.samples, found.further[0].samples)


def test_progress_runs_on_over_channels() -> None:
    trunks = Trunks(np.array([[9.0, 9.0]]), np.array([0.1]), np.zeros(1, np.int64))
    steps: list[tuple[int, int]] = []
    impulse_response(
        trunks,
        Reverb(array=3, duration=0.1, sample_rate=4000.0),
        AIR,
        progress=lambda done, total: steps.append((done, total)),
    )
    assert steps == [(1, 3), (2, 3), (3, 3)]


# ------------------------------------------------------------------------------------------ auralise
# A dry sound in the forest: convolution, rates, levels, files.


def test_a_unit_impulse_changes_nothing_and_channels_are_mixed() -> None:
    dry = np.random.default_rng(0).standard_normal((40, 2))
    np.testing.assert_allclose(
        auralise(np.array([1.0]), dry, 8000, 8000)[:, 0], dry.mean(axis=1), atol=1e-15
    )


@pytest.mark.parametrize("rates", [(44_100.0, 48_000.0), (48_000.0, 24_000.0), (8000.0, 192_000.0)])
def test_a_tone_keeps_pitch_and_level_at_another_rate(rates: tuple[float, float]) -> None:
    old, new = rates
    tone = np.sin(2 * math.pi * 1000.0 * np.arange(int(old / 2)) / old)
    heard = resample(tone, old, new)
    middle = slice(int(0.1 * new), int(0.4 * new))
    expected = np.sin(2 * math.pi * 1000.0 * np.arange(len(heard)) / new)
    np.testing.assert_allclose(heard[middle], expected[middle], atol=1e-3)


def test_what_lies_above_the_new_band_is_gone() -> None:
    tone = np.sin(2 * math.pi * 15_000.0 * np.arange(48_000) / 48_000)
    heard = resample(tone, 48_000, 24_000)
    assert np.abs(heard[2400:-2400]).max() < 1e-3


def test_normalising_says_its_gain() -> None:
    samples = np.array([0.5, -4.0, 1.0])
    louder, gain = normalised(samples, -6.0)
    assert np.abs(louder).max() == pytest.approx(10 ** (-0.3))
    assert gain == pytest.approx(-6.0 - 20 * math.log10(4.0))


def test_a_wav_that_would_clip_keeps_its_peaks(tmp_path: Path) -> None:
    samples = np.array([[0.1, 7.5], [-3.0, 0.2]])
    for rate in (4000, 192_000):
        write_wav(tmp_path / "loud.wav", samples, rate)
        found, told = read_wav(tmp_path / "loud.wav")
        assert told == rate
        np.testing.assert_array_equal(found, samples.astype(np.float32))


@pytest.mark.parametrize(
    ("kind", "values", "expected"),
    [
        (np.int16, [-32768, 0, 16384], [-1, 0, 0.5]),
        (np.uint8, [0, 128, 192], [-1, 0, 0.5]),
        (np.int32, [-(2**31), 0, 2**30], [-1, 0, 0.5]),
    ],
)
def test_whole_numbers_become_shares_of_full_scale(
    tmp_path: Path, kind: type, values: list[int], expected: list[float]
) -> None:
    wavfile.write(tmp_path / "a.wav", 8000, np.array(values, kind))
    np.testing.assert_allclose(read_wav(tmp_path / "a.wav")[0], expected)


def test_auralise_bad_files_are_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "text.wav").write_text("no sound")
    wavfile.write(tmp_path / "empty.wav", 8000, np.empty(0, np.int16))
    wavfile.write(tmp_path / "nan.wav", 8000, np.array([np.nan], np.float32))
    for name, said in (
        ("none", "there is no such file"),
        ("text", "cannot be read as a WAV file"),
        ("empty", "no sound"),
        ("nan", "NaN"),
    ):
        with pytest.raises(SpecError, match=said):
            read_wav(tmp_path / f"{name}.wav")


# -------------------------------------------------------------------------------------------- moving
# Sources and receivers that move: pitch by the closed form, and what stands still as ever.

SPEED, MOVING_RATE = 343.0, 8000.0
MOVING_AIR = Air(sound_speed=SPEED)
NOTHING = Trunks(np.empty((0, 2)), np.empty(0), np.empty(0, np.int64))
FEW = Trunks(np.array([[9.0, 11.0], [3.0, 14.0]]), np.array([0.3, 0.2]), np.arange(2))


def walk(folder: Path, name: str, *rows: tuple[float, ...]) -> str:
    lines = ["time, x, y, z", *(", ".join(map(str, row)) for row in rows)]
    (folder / name).write_text("\n".join(lines))
    return name


def respond(folder: Path, trunks: Trunks = NOTHING, **settings: object) -> ImpulseResponse:
    reverb = Reverb(**{"duration": 0.2, "sample_rate": MOVING_RATE, "ground": 0.0} | settings)
    return impulse_response(trunks, reverb, MOVING_AIR, ends=ends_of(reverb, None, folder))


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
    time = np.arange(int(2 * MOVING_RATE)) / MOVING_RATE
    heard = heard_moving(found, np.sin(2 * math.pi * tone * time), SPEED)[:, 0]
    v_s = np.array([fast, 0.0]) if who != "receiver" else np.zeros(2)
    v_r = np.array([-fast, 0.0]) if who != "source" else np.zeros(2)
    s0 = np.array([-20.0, 0.0]) if who != "receiver" else np.zeros(2)
    r0 = np.array([20.0, aside]) if who != "source" else np.array([0.0, aside])
    for middle in (0.4, 0.9, 1.0, 1.1, 1.6):
        some = slice(int((middle - 0.01) * MOVING_RATE), int((middle + 0.01) * MOVING_RATE))
        when = np.arange(len(heard))[some] / MOVING_RATE
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
    wanted = auralise(channels_of(still), dry, MOVING_RATE, MOVING_RATE)[:, 0]
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
    (tmp_path / "mics.csv").write_text("Messe\nX;Y;Z;Name\n0;0;0;links\n0;1,0;0;rechts\n", "utf-16")
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
        ends_of(Reverb(source_path=path, path_step=1e-4), None, tmp_path)


def test_background_noise_has_the_levels_asked_for(tmp_path: Path) -> None:
    """By octave, within four standard errors of a mean square over 8 s."""
    levels = (-40.0, -20.0, -30.0, -10.0)
    dry = np.zeros(int(8 * MOVING_RATE))
    dry[:] = np.random.default_rng(1).standard_normal(len(dry))
    still = respond(tmp_path)
    reverb = Reverb(sample_rate=MOVING_RATE, noise_db=levels)
    noisy, _ = wet_sound_of(reverb, still, dry, MOVING_RATE)
    clean, _ = wet_sound_of(reverb.changed(noise_db=()), still, dry, MOVING_RATE)
    noise = (noisy - clean)[:, 0]
    power = np.abs(np.fft.rfft(noise)) ** 2 / len(noise) ** 2 * 2
    frequency = np.fft.rfftfreq(len(noise), 1 / MOVING_RATE)
    for number, level in enumerate(levels):
        middle = 63.0 * 2**number
        inside = (frequency >= middle / math.sqrt(2)) & (frequency < middle * math.sqrt(2))
        error = 4.0 / math.sqrt(inside.sum())
        found = power[inside].sum() / np.mean(dry**2) / 10 ** (level / 10)
        assert abs(found - 1) < error
    assert power[frequency > 63 * 2**3.5 + 1].sum() < 1e-20
