"""A pattern read from a cloud is the one that the cloud was flown with; trajectories from files."""

import numpy as np
import pytest
from references.rays import BruteCaster, ground, scene_with, wall
from scipy import stats
from scipy.spatial.transform import Rotation

from forest_addon.base.rng import child_keys, first_key, keyed_uniform, stream
from forest_addon.formats.helios.device import Digitiser
from forest_addon.formats.table import write_csv
from forest_addon.sensing.lidar.pattern import pattern_of
from forest_addon.sensing.lidar.surveys.digitised import Haze, SurveyScan
from forest_addon.sensing.lidar.surveys.like import (
    FlightLine,
    lines_of,
    pattern_like,
    pulses_of,
    scanner_like,
    split_lines,
)
from forest_addon.sensing.lidar.surveys.trajectories import COLUMNS, RECORD, read_trajectory
from forest_addon.spec import Airborne, Beam, Mobile, Noise, Pose, SpecError, Terrestrial


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


@pytest.mark.medium
def test_strips_that_were_taken_as_one_line_are_refused():
    flight = Airborne(
        position=(-20.0, 10.0, 500.0),
        heading_deg=0.0,
        track=85.0,
        speed=60.0,
        strips=2,
        spacing=25.0,
        field_deg=(-8.0, 8.0),
        line_rate=100.0,
        pulse_rate=100e3,
    )
    pattern = pattern_of(flight)
    pulses = pattern.pulses(np.arange(pattern.count))
    reach = [(pulses.origin[:, 2] - level) / -pulses.direction[:, 2] for level in (14.0, 0.0)]
    ends = pulses.origin + np.array(reach)[:, :, None] * pulses.direction
    seen = (np.abs(ends[1, :, :2] - [22.5, 0.0]) < 22.5).all(axis=1)
    place, time = ends[:, seen].swapaxes(0, 1).reshape(-1, 3), np.repeat(pulses.time[seen], 2)
    number = np.tile([1, 2], int(seen.sum()))
    two, angle = np.full(len(number), 2), np.degrees(np.repeat(pulses.scan_angle[seen], 2))

    def speeds(line):
        lines = lines_of(place, time, number, two, line).values()
        for one in lines:
            rows = (line == one.number) & (number == 1)
            pattern_like(one, place[rows], time[rows], angle[rows])
        return [np.linalg.norm(one.velocity) for one in lines]

    assert speeds((time > 85 / 60).astype(int)) == pytest.approx([60.0, 60.0], rel=1e-3)
    with pytest.raises(
        SpecError, match=r"several lines were taken as one; number them as point_so"
    ):
        speeds(split_lines(time, np.zeros(len(time), dtype=int)))


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


# --------------------------------------------------------------------------------------------- flown
# Flight lines from clouds: found again from the beams of a scanner whose way is known.


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
    gap, row = pytest.importorskip("studies.validation.cloud_pair").gaps_of(place, pulse)
    assert gap.tolist() == [2.0, 1.0]
    assert row.tolist() == [1, 3]


# ------------------------------------------------------------------------------------ digitised scan
# Echoes as HELIOS++ finds them: the same wherever a scan is cut.

BEAM = Beam(divergence_mrad=(2.0, 2.0), subrays=19, pulse_ns=4.0, max_returns=9)


def survey(**settings):
    scanner = Terrestrial(
        position=(0.0, 0.0, 1.7),
        azimuth_deg=(-60.0, 60.0),
        elevation_deg=(-20.0, 12.0),
        angle_step_deg=1.5,
        beam=BEAM,
        noise=Noise(),
        **{"min_range": 0.5, "max_range": 300.0} | settings,
    )
    caster = BruteCaster(scene_with(ground(200.0), wall(15.0, 6.0), wall(30.0, 30.0)))
    return SurveyScan(scanner, caster, 3).sampled(Digitiser(3, 0.25, 1.0))


def test_echoes_do_not_know_where_a_scan_is_cut():
    scan = survey()
    whole = scan.look(0, scan.pulses)
    for at_once in (190, 700):
        pieces = [cloud for _, cloud in scan.chunks(at_once=at_once)]
        for name in ("position", "width", "intensity"):
            found = np.concatenate([getattr(piece, name) for piece in pieces])
            np.testing.assert_allclose(found, getattr(whole, name), rtol=0, atol=1e-9)


# -------------------------------------------------------------------------------------------- voxels
# Voxels that light passes by chance, held against the law of Beer and Lambert and a slow march. A correct
# program fails a test of chance in one of a million seeds.

FALSE_ALARM = 1e-6
TURN = Rotation.from_euler("xyz", [10, -25, 70], degrees=True).as_matrix()
PLACE = np.array([3.0, -2.0, 5.0])
SCALE = 1.5


def turned() -> Haze:
    """A grid of 4 x 3 x 5 cells of 0.4 m, a third of them empty, turned, scaled and moved."""
    density = np.arange(60.0).reshape(4, 3, 5) % 7 / 3 * (np.arange(60).reshape(4, 3, 5) % 3 > 0)
    return Haze(0, np.column_stack([SCALE * TURN, PLACE]), np.array([-1.0, 0.5, 2.0]), 0.4, density)


def density_at(haze: Haze, points: np.ndarray) -> np.ndarray:
    """(P,) density at points (P, 3) of the world."""
    local = (points - PLACE) @ TURN / SCALE
    cell = np.floor((local - haze.low) / haze.size).astype(int)
    inside = ((cell >= 0) & (cell < haze.density.shape)).all(axis=1)
    return np.where(inside, haze.density[tuple(np.where(inside[:, None], cell, 0).T)], 0.0)


def test_rays_cross_the_area_of_a_slow_march() -> None:
    rng = np.random.default_rng(5)
    haze = turned()
    middle = PLACE + SCALE * TURN @ (haze.low + haze.size * np.array([2.0, 1.5, 2.5]))
    way = rng.normal(size=(60, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    way[:3] = TURN.T  # along the grid's axes
    start = middle + rng.uniform(-0.4, 0.4, (60, 3)) - way * rng.uniform(0, 4, (60, 1))
    depth = rng.exponential(0.7, 60)
    found = haze.reach(start, way, depth, np.full(60, 8.0))
    assert 10 < np.isfinite(found).sum() < 55
    step = 5e-4
    along = step * (np.arange(16_000) + 0.5)
    for ray in range(60):
        passed = step * np.cumsum(density_at(haze, start[ray] + along[:, None] * way[ray]))
        if np.isfinite(found[ray]):
            index = int(np.searchsorted(along, found[ray])) - 1
            assert abs(passed[index] - depth[ray]) < 10 * step * haze.density.max()
        else:
            assert passed[-1] < depth[ray] + 10 * step * haze.density.max()


def test_nothing_is_met_beyond_the_farthest() -> None:
    haze = Haze(0, np.eye(4)[:3], np.zeros(3), 1.0, np.full((1, 1, 1), 2.0))
    start, way = np.tile([0.5, 0.5, -1.0], (3, 1)), np.tile([0.0, 0.0, 1.0], (3, 1))
    found = haze.reach(start, way, np.array([1.0, 1.0, 3.0]), np.array([5.0, 1.4, 5.0]))
    np.testing.assert_allclose(found, [1.5, np.inf, np.inf])


def test_paths_in_two_densities_follow_beers_law() -> None:
    """Cells of 0.5 and 2 m² a m³: the distance has F(s) = 1 - exp(-σs) in each, 8.2 % pass both."""
    haze = Haze(0, np.eye(4)[:3], np.zeros(3), 1.0, np.array([[[0.5, 2.0]]]))
    keys = child_keys(first_key(3, "lidar", "test"), np.arange(20_000))
    depth = -np.log(keyed_uniform(child_keys(keys, 0), "voxels"))
    start, way = np.tile([0.5, 0.5, -1.0], (20_000, 1)), np.tile([0.0, 0.0, 1.0], (20_000, 1))
    found = haze.reach(start, way, depth, np.full(20_000, 10.0)) - 1
    passed = int(np.isinf(found).sum())
    assert stats.binomtest(passed, 20_000, np.exp(-2.5)).pvalue > FALSE_ALARM / 2
    share = 1 - np.exp(-2.5)

    def law(s: np.ndarray) -> np.ndarray:
        crossed = 0.5 * np.minimum(s, 1) + 2.0 * np.clip(s - 1, 0, 1)
        return np.asarray((1 - np.exp(-crossed)) / share)

    met = found[np.isfinite(found)]
    assert stats.kstest(met, law).pvalue > FALSE_ALARM / 2
