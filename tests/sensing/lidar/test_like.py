"""A pattern read from a cloud is the one that the cloud was flown with; trajectories from files."""

import numpy as np
import pytest

from forest_addon.formats.table import write_csv
from forest_addon.sensing.lidar.pattern import pattern_of
from forest_addon.sensing.lidar.surveys.like import FlightLine, pattern_like, scanner_like
from forest_addon.sensing.lidar.surveys.trajectories import COLUMNS, RECORD, read_trajectory
from forest_addon.spec import Mobile, Pose, SpecError


@pytest.mark.medium
@pytest.mark.parametrize(("sweep", "pitch"), [("lines", 0.0), ("lines", -9.0), ("zigzag", 4.0)])
def test_rates_field_and_tilt_are_read_back(sweep, pitch):
    poses = tuple(Pose(time=t, position=(9.0 * t, 0.0, 100.0)) for t in (0.0, 2.0))
    flown = Mobile(
        name="a",
        poses=poses,
        pattern=sweep,
        field_deg=(-60.0, 60.0),
        line_rate=80.0,
        pulse_rate=160e3,
        mount_deg=(0.0, pitch, 0.0),
    )
    pattern = pattern_of(flown)
    pulses = pattern.pulses(np.arange(pattern.count))
    ground = pulses.origin - pulses.direction * (
        pulses.origin[:, 2] / pulses.direction[:, 2]
    ).reshape(-1, 1)
    seen = (ground[:, 1] > -45) & (ground[:, 1] < -20)  # a plot to the right of the line
    line = FlightLine(1, np.array([0.0, 2.0]), np.array([p.position for p in poses]), 99, 0.0)
    said = np.degrees(np.arctan2(-ground[seen, 1], 100.0))
    found = pattern_like(line, ground[seen], pulses.time[seen], np.rint(said))
    with pytest.raises(SpecError, match=r"beams \d+° from the scan angles"):
        pattern_like(line, ground[seen], pulses.time[seen], said / 3)
    fast = FlightLine(1, line.time / 20, line.place, 99, 0.0)
    with pytest.raises(SpecError, match="flown at 180 m/s; are its coordinates in metres"):
        pattern_like(fast, ground[seen], pulses.time[seen] / 20, said)
    assert found.zigzag == (sweep == "zigzag")
    assert found.line_rate == pytest.approx(80.0, rel=0.02)
    assert found.own_rate == pytest.approx(160e3, rel=0.01)
    assert found.pitch_deg == pytest.approx(pitch, abs=0.05)
    assert found.field_deg[0] == pytest.approx(np.degrees(np.arctan(0.2)) - 1, abs=0.5)
    assert found.field_deg[1] == pytest.approx(np.degrees(np.arctan(0.45)) + 1, abs=0.5)
    again = scanner_like(Mobile(), line, found, np.zeros(3))
    wide = np.ptp(found.field_deg)
    assert again.pulse_rate / again.line_rate == pytest.approx(wide / (120 / 2000), rel=0.02)


def test_csv_goes_to_and_fro_and_times_must_rise(tmp_path):
    rows = np.arange(21.0).reshape(3, 7) / 7
    written = lambda table: {name: table[:, k].tolist() for k, name in enumerate(COLUMNS)}  # noqa: E731
    write_csv(tmp_path / "a.csv", written(rows))
    with open(tmp_path / "a.csv", "a") as file:
        file.write("\n  \n")  # empty lines say nothing
    assert (read_trajectory(tmp_path / "a.csv") == rows).all()
    write_csv(tmp_path / "b.csv", written(rows[::-1]))
    with pytest.raises(SpecError, match="pose 2 is not later"):
        read_trajectory(tmp_path / "b.csv")


def test_sbet_comes_out_in_the_map(tmp_path):
    pytest.importorskip("pyproj")
    record = np.zeros((2, RECORD))
    record[:, 0], record[:, 2], record[:, 3] = [10, 11], np.radians(-111.0), 2300
    record[:, 1] = np.radians([34.4, 34.41])  # on the central meridian of UTM 12N
    record[:, 9], record[:, 10] = 0.3, 0.3  # a platform's heading less the wander angle: north
    record.astype("<f8").tofile(tmp_path / "a.sbet")
    rows = read_trajectory(tmp_path / "a.sbet", "EPSG:32612")
    assert np.allclose(rows[:, 1], 500_000, atol=1e-3)
    assert np.diff(rows[:, 2])[0] == pytest.approx(1109.2 * 0.9996, abs=1.0)
    assert np.allclose(rows[:, 4], 90, atol=1e-6)
    (tmp_path / "a.sbet").rename(tmp_path / "a.SBET")
    feet = read_trajectory(
        tmp_path / "a.SBET", "EPSG:2223"
    )  # Arizona Central in feet, and in metres
    assert feet == pytest.approx(read_trajectory(tmp_path / "a.SBET", "EPSG:26949"), abs=1e-6)
    (tmp_path / "a.SBET").rename(tmp_path / "a.sbet")
    with pytest.raises(SpecError, match="--crs: is missing"):
        read_trajectory(tmp_path / "a.sbet")
