"""Surveys of HELIOS++ whose platforms forces drive, and whose parts are swapped, against closed forms."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest

from forest_addon.formats.helios import platforms
from forest_addon.formats.helios.platforms import DrivenLeg, SurveyTrack, drive
from forest_addon.formats.helios.survey import read_survey
from forest_addon.spec import SpecError
from headless.surveys import scan_survey

from .test_survey import LEG, written

COPTER = '<platform type="multicopter" drag="0.01"/>'  # 0.1/0.01: 10 m/s at most
TRACTOR = '<platform type="groundvehicle" drag="0.005"/>'  # 0.02/0.005: 4 m/s at most
RATE = 5000.0


def flown(
    platform: str, places: list[tuple[float, float, float]], settings: str
) -> tuple[list[SurveyTrack], list[str]]:
    """Tracks of legs between places, all with the same settings."""
    points = [np.array(place, dtype=float) for place in places]
    legs = [
        DrivenLeg(a, b, c, fromstring(f"<platformSettings {settings}/>"), RATE)
        for a, b, c in zip(points, points[1:], [*points[2:], None], strict=False)
    ]
    return drive(fromstring(platform), legs, Path("library.xml"))


@pytest.mark.medium
def test_copter_gains_speed_by_a_factor_and_then_flies_at_its_most() -> None:
    (track,), notes = flown(COPTER, [(0, 0, 20), (0, 80, 20)], 'slowdownEnabled="false"')
    # the force grows from 1e-4 to 0.1 by exp(2 t): ln(1000)/2 s and (10 - 0.01)/2 m
    seconds = np.log(1000) / 2 + (80 - (10 - 0.01) / 2) / 10
    assert track.time[-1] == pytest.approx(seconds, abs=0.03)  # the drag's lag is 0.02 s here
    assert not notes
    np.testing.assert_allclose(track.place[-1], [0, 80, 20], atol=0.01)
    assert np.abs(track.place[:, 2] - 20).max() < 0.05
    assert track.angles is not None
    np.testing.assert_array_equal(track.angles[:, 2], 0.0)


@pytest.mark.medium
def test_copter_turns_smoothly_at_its_rate_and_looks_along_the_next_leg() -> None:
    setting = 'smoothTurn="true" slowdownEnabled="false" movePerSec_m="8"'
    tracks, _ = flown(COPTER, [(0, 0, 9), (0, 60, 9), (60, 60, 9)], setting)
    yaw = tracks[0].angles
    assert yaw is not None
    turns = np.flatnonzero(np.diff(yaw[:, 2]))
    took = tracks[0].time[turns[-1] + 1] - tracks[0].time[turns[0]]
    assert took == pytest.approx(90 / 85.94, abs=0.005)
    assert yaw[-1, 2] == pytest.approx(-np.pi / 2, abs=0.001)
    rest = np.hypot(*(tracks[0].place[-1] - tracks[1].place[0])[:2])
    assert rest == 0.0  # a leg begins where the one before ended


def test_copter_that_stops_before_its_waypoint_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platforms, "STEPS_A_SECOND", 500)
    with pytest.raises(SpecError, match=r"leg 0 never arrives.*slowdownEnabled"):
        flown(COPTER, [(0, 0, 20), (0, 80, 20)], 'movePerSec_m="5"')


@pytest.mark.medium
def test_tractor_that_turns_round_and_round_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platforms, "STEPS_A_SECOND", 500)
    with pytest.raises(SpecError, match=r"leg 1 never arrives.*round and round.*wider curves"):
        flown(TRACTOR, [(0, 0, 0), (0, 12, 0), (7, 15, 0)], 'movePerSec_m="3"')


@pytest.mark.medium
def test_tractor_drives_at_its_speed_and_backs_to_turn() -> None:
    tracks, notes = flown(TRACTOR, [(0, 0, 0), (0, 30, 0), (20, 30, 0)], 'movePerSec_m="3"')
    assert tracks[0].time[-1] == pytest.approx(10, abs=0.1)
    assert not notes
    np.testing.assert_allclose(tracks[0].place[-1], [0, 30, 0], atol=0.01)
    np.testing.assert_allclose(tracks[1].place[-1], [20, 30, 0], atol=0.1)
    way = np.diff(tracks[1].place[:, :2], axis=0)
    yaw = tracks[1].angles
    assert yaw is not None
    ahead = -np.sin(yaw[1:, 2]) * way[:, 0] + np.cos(yaw[1:, 2]) * way[:, 1]
    assert (ahead < 0).any()  # 90 degrees are too narrow to steer by forwards
    gone = np.abs(ahead[ahead < 0]).sum()
    turned = np.abs(yaw[-1, 2])
    assert turned == pytest.approx(np.pi / 2, abs=0.15)
    assert gone == pytest.approx((turned - np.pi / 5) / 0.25, rel=0.5)


@pytest.mark.medium
@pytest.mark.parametrize("platform", [COPTER, TRACTOR])
def test_steps_of_many_pulses_go_where_single_ones_go(
    platform: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    setting = 'movePerSec_m="3" smoothTurn="true" slowdownEnabled="false"'
    places = [(0.0, 0.0, 5.0), (0.0, 12.0, 5.0), (12.0, 30.0, 5.0)]
    exact, _ = flown(platform, places, setting)  # a step is one pulse at 5 kHz
    monkeypatch.setattr(platforms, "STEPS_A_SECOND", 500)
    coarse, _ = flown(platform, places, setting)
    for one, other in zip(exact, coarse, strict=True):
        assert other.time[-1] == pytest.approx(one.time[-1], abs=0.05)
        time = np.linspace(0, min(one.time[-1], other.time[-1]), 200)
        away = one.at(time)[0] - other.at(time)[0]
        assert np.linalg.norm(away, axis=1).max() < 0.1


def test_survey_with_a_copter_is_read(tmp_path: Path) -> None:
    legs = """<leg><platformSettings x="0" y="0" z="9" movePerSec_m="3" slowdownEnabled="false"/>
    <scannerSettings template="t" scanAngle_deg="20"/></leg>
    <leg><platformSettings x="0" y="0.4" z="9"/><scannerSettings active="false"/></leg>"""
    (leg,) = read_survey(written(tmp_path, legs, "copter")).legs
    assert leg.track is not None
    assert leg.seconds[1] == leg.track.time[-1] > 4  # drag 1: 0.1 m/s at most


SWAPS = """<swap swapStep="2"><filter type="scale"><param key="scale" value="6"/></filter>
<filter type="rotate"><param key="rotation"><rot axis="z" angle_deg="90"/></param></filter></swap>
<swap force_null="true"/>"""


def test_swapped_parts_stand_for_their_plays(tmp_path: Path) -> None:
    plays = read_survey(written(tmp_path, extra=SWAPS)).plays
    assert [len(play.parts) for play in plays] == [2, 2, 2, 1]
    assert [len(play.reflectance) for play in plays] == [2, 2, 2, 1]
    low = [play.parts[1].corners.min(axis=(0, 1)) for play in plays[:3]]
    # 3 m turned by 90 degrees is -3..0, 0..3 about (10, 0); 6 m turned by 180 is -6..0, -6..0
    np.testing.assert_allclose(low, [[7, 0, 2], [4, -6, 2], [4, -6, 2]], atol=1e-12)


INDEXED = """<swap swapIndices="[4]" force_null="true"/>
<swap swapIndices="[2, 3]"><filter type="scale"><param key="scale" value="6"/></filter></swap>"""


def test_swaps_may_say_which_plays_are_theirs(tmp_path: Path) -> None:
    plays = read_survey(written(tmp_path, extra=INDEXED)).plays
    assert [len(play.parts) for play in plays] == [2, 2, 2, 2, 1]
    size = [float(np.ptp(play.parts[1].corners[..., 0])) for play in plays[:4]]
    assert size == pytest.approx([3, 3, 6, 6])  # the baseline stands in play 1, which none names


def test_each_play_goes_to_files_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    legs = scan_survey(written(tmp_path, LEG, extra=SWAPS), tmp_path / "out/c.npz")
    assert [leg.name for leg in legs] == [f"play{k}-leg000" for k in range(4)]
    assert (tmp_path / "out/c-play3-leg000.npz").is_file()
    assert "played 4 times" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("swap", "words"),
    [
        ("<swap/>", "without filters"),
        ('<swap swapStep="0" force_null="true"/>', "at least 1"),
        ('<swap swapIndices="[1, 3]" force_null="true"/>', "on end"),
        ('<swap swapIndices="all" force_null="true"/>', "no list"),
        (
            '<swap swapIndices="[1]" force_null="1"/><swap swapIndices="[1]" force_null="1"/>',
            "another",
        ),
        ('<swap force_null="true"/><dmotion id="a" loop="1"/>', "only one is supported"),
    ],
)
def test_broken_swaps_are_refused(tmp_path: Path, swap: str, words: str) -> None:
    with pytest.raises(SpecError, match=words):
        read_survey(written(tmp_path, extra=swap))
