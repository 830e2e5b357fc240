"""Where pulses go: patterns of sweeps, ways of platforms."""

from dataclasses import replace

import numpy as np
import pytest
from references.rays import BruteCaster, ground, scene_with, wall
from scipy import stats
from scipy.spatial.transform import Rotation
from scipy.special import erf

from forest_addon.base.rng import child_keys, first_key, keyed_uniform, stream
from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.formats.helios.device import Digitiser
from forest_addon.formats.helios.motion import STILL, PartMotion
from forest_addon.formats.table import write_csv
from forest_addon.sensing.lidar.footprint import radii, spread
from forest_addon.sensing.lidar.pattern import Pulses, pattern_of
from forest_addon.sensing.lidar.surveys.digitised import Haze, SurveyScan
from forest_addon.sensing.lidar.surveys.like import (
    FlightLine,
    lines_of,
    pattern_like,
    pulses_of,
    scanner_like,
    split_lines,
)
from forest_addon.sensing.lidar.surveys.stepped import SteppedPath
from forest_addon.sensing.lidar.surveys.trajectories import COLUMNS, RECORD, read_trajectory
from forest_addon.sensing.moving import MovingScene
from forest_addon.sensing.moving_rays import MovingCaster
from forest_addon.sensing.rays.caster import hit_normals
from forest_addon.sensing.rays.exact import ExactCaster
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.rays.paths import SceneMotion
from forest_addon.sensing.trajectory import along, through
from forest_addon.spec import Airborne, Beam, Mobile, Noise, Pose, SpecError, Terrestrial


def all_pulses(scanner, path=None):
    pattern = pattern_of(scanner, path)
    return pattern.pulses(np.arange(pattern.count))


SCANNERS = [
    Terrestrial(angle_step_deg=5.0),
    *(
        Airborne(pattern=p, pulse_rate=1000.0, line_rate=20.0, track=30.0, heading_deg=30.0)
        for p in ("lines", "fans", "zigzag", "circles", "spinning", "rosette")
    ),
]


@pytest.mark.parametrize("scanner", SCANNERS, ids=lambda s: getattr(s, "pattern", s.kind))
def test_a_pulse_depends_on_its_number_alone_and_its_sweep_is_across_it(scanner):
    pattern = pattern_of(scanner)
    number = np.arange(pattern.count)
    whole, some = pattern.pulses(number), pattern.pulses(number[17:31])
    assert (some.direction == whole.direction[17:31]).all()
    assert (some.origin == whole.origin[17:31]).all()
    assert whole.time == pytest.approx(number / scanner.pulse_rate)
    assert np.linalg.norm(whole.direction, axis=1) == pytest.approx(1)
    assert np.linalg.norm(whole.across, axis=1) == pytest.approx(1)
    assert np.einsum("pi,pi->p", whole.direction, whole.across) == pytest.approx(0, abs=1e-12)


def test_a_tripod_with_its_own_step_in_elevation():
    pulses = all_pulses(
        Terrestrial(elevation_deg=(-15.0, 15.0), angle_step_deg=10.0, line_step_deg=2.0)
    )
    assert len(pulses) == 36 * 16
    assert np.rad2deg(pulses.scan_angle[:16]) == pytest.approx(np.arange(-15, 16, 2))


def test_parallel_lines_start_on_the_left_each_time():
    flight = Airborne(
        position=(0.0, 0.0, 100.0), heading_deg=0.0, track=10.0, speed=10.0,
        pulse_rate=1000.0, line_rate=50.0, field_deg=(-45.0, 45.0),
    )  # fmt: skip
    pulses = all_pulses(flight)
    lines = np.rad2deg(pulses.scan_angle).reshape(50, 20)
    assert lines == pytest.approx(np.tile(-45 + 90 * np.arange(20) / 20, (50, 1)), abs=1e-6)
    onto = pulses.origin + pulses.direction * (-100 / pulses.direction[:, 2])[:, None]
    assert onto[:, 1] == pytest.approx(-100 * np.tan(pulses.scan_angle), abs=1e-6)  # left is +Y
    assert onto[:, 0] == pytest.approx(10 * pulses.time)


def test_a_zigzag_turns_at_both_ends():
    flight = Airborne(
        pattern="zigzag", track=10.0, speed=10.0, pulse_rate=1000.0, line_rate=10.0,
        field_deg=(-20.0, 20.0),
    )  # fmt: skip
    angle = np.rad2deg(all_pulses(flight).scan_angle)
    assert np.abs(np.diff(angle)).max() == pytest.approx(0.4, rel=1e-6)
    assert angle.max() == pytest.approx(20)
    assert angle[50] == pytest.approx(0, abs=1e-9)
    assert angle[150] == pytest.approx(0, abs=1e-9)


def test_circles_lie_on_a_cone_about_nadir():
    flight = Airborne(pattern="circles", field_deg=(0.0, 20.0), pulse_rate=1e4, track=5.0)
    pulses = all_pulses(flight)
    assert -pulses.direction[:, 2] == pytest.approx(np.cos(np.deg2rad(20)))
    assert np.rad2deg(np.abs(pulses.scan_angle)) == pytest.approx(20)
    turn = np.arctan2(pulses.direction[:, 0], pulses.direction[:, 1])
    assert np.ptp(turn) > 6.2


def test_strips_go_there_and_back():
    flight = Airborne(
        position=(5.0, 0.0, 50.0), heading_deg=90.0, track=20.0, speed=10.0, strips=3, spacing=30.0,
        pulse_rate=100.0,
    )  # fmt: skip
    pulses = all_pulses(flight)
    strip = pulses.origin.reshape(3, 200, 3)
    assert strip[:, :, 0] == pytest.approx(np.tile([[5.0], [35.0], [65.0]], (1, 200)))
    assert strip[0, :, 1] == pytest.approx(np.arange(200) * 0.1)
    assert strip[1, :, 1] == pytest.approx(20 - np.arange(200) * 0.1)
    assert strip[2, 0, 1] == pytest.approx(0)


def test_channels_spin_about_the_vertical():
    scanner = Mobile(
        pattern="spinning", channels=16, field_deg=(-15.0, 15.0), line_rate=10.0, pulse_rate=28800.0,
        poses=(Pose(position=(0.0, 0.0, 2.0)),),
    )  # fmt: skip
    pulses = all_pulses(scanner)
    assert len(pulses) == 2880  # one turn of a scanner that stands
    assert np.rad2deg(np.arcsin(pulses.direction[:16, 2])) == pytest.approx(np.arange(-15, 16, 2))
    azimuth = np.rad2deg(np.arctan2(pulses.direction[::16, 1], pulses.direction[::16, 0])) % 360
    assert azimuth == pytest.approx(-2.0 * np.arange(180) % 360, abs=1e-6)  # clockwise


def test_poses_are_passed_evenly_by_the_shortest_turn():
    path = through(
        [
            Pose(time=5.0, position=(0.0, 0.0, 1.0), heading_deg=350.0),
            Pose(time=7.0, position=(4.0, 2.0, 1.0), heading_deg=10.0, pitch_deg=30.0),
        ]
    )
    where, attitude = path.at(np.array([4.0, 5.0, 6.0, 7.0, 9.0]))
    assert where[:, 0] == pytest.approx([0, 0, 2, 4, 4])
    forward = attitude.apply([1.0, 0, 0])
    heading = np.rad2deg(np.arctan2(forward[:, 1], forward[:, 0]))
    assert heading[[0, 1, 3, 4]] == pytest.approx([-10, -10, 10, 10])
    assert abs(heading[2]) < 1  # not by way of 180°
    assert np.rad2deg(np.arcsin(forward[3, 2])) == pytest.approx(30)  # nose up


def test_roll_sinks_the_right_side():
    _, attitude = through([Pose(roll_deg=20.0)]).at(np.zeros(1))
    assert attitude.apply([0, -1.0, 0])[0, 2] == pytest.approx(-np.sin(np.deg2rad(20)))


def test_a_polyline_is_followed_at_an_even_speed():
    path = along(np.array([[0, 0, 0], [3, 0, 0], [3, 0, 0], [3, 4, 0.0]]), speed=2.0)
    assert path.duration == pytest.approx(3.5)
    where, attitude = path.at(np.array([0.0, 1.0, 2.5, 3.5]))
    assert where[:, :2] == pytest.approx(np.array([[0, 0], [2, 0], [3, 2], [3, 4]]))
    assert attitude.apply([1.0, 0, 0])[[0, 3]] == pytest.approx(
        np.array([[1, 0, 0], [0, 1, 0]]), abs=1e-12
    )
    with pytest.raises(ValueError, match="two different points"):
        along(np.zeros((4, 3)), 1.0)


def test_a_scanner_is_turned_on_its_platform():
    scanner = Mobile(
        field_deg=(-1e-6, 1e-6), mount_deg=(0.0, 90.0, 0.0), poses=(Pose(heading_deg=90.0),)
    )
    pulses = all_pulses(scanner)
    # Nadir, tipped up by 90°, looks ahead: north.
    assert pulses.direction[0] == pytest.approx([0, 1, 0], abs=1e-6)


def test_nowhere_to_go():
    with pytest.raises(SpecError, match="poses: are missing"):
        pattern_of(Mobile())


def test_three_fans_look_down_ahead_and_back_by_turns():
    flight = Airborne(
        pattern="fans", fan_deg=10.0, position=(0.0, 0.0, 100.0), heading_deg=0.0, track=6.0, speed=10.0,
        pulse_rate=1000.0, line_rate=50.0, field_deg=(-50.0, 50.0),
    )  # fmt: skip
    pulses = all_pulses(flight)
    onto = pulses.origin + pulses.direction * (-100 / pulses.direction[:, 2])[:, None]
    ahead = (onto[:, 0] - pulses.origin[:, 0]).reshape(30, 20)
    lean = 100 * np.tan(
        np.deg2rad([0.0, 10.0, -10.0])
    )  # a plane that leans meets level ground in a line
    assert ahead == pytest.approx(np.tile(lean, 10)[:, None] * np.ones(20), abs=1e-9)
    off = np.linalg.norm(np.cross(pulses.direction, np.roll(pulses.direction, -1, axis=0)), axis=1)
    within = off.reshape(30, 20)[:, :-1]  # great circles: even steps of 5 degrees
    assert np.rad2deg(np.arcsin(within)) == pytest.approx(5.0)


def test_a_rosette_fills_its_field_and_repeats_only_with_whole_petals():
    def turned(petals):
        scanner = Mobile(
            pattern="rosette", petals=petals, field_deg=(-7.0, 52.0), line_rate=10.0, pulse_rate=2e4,
            poses=(Pose(), Pose(time=0.4)),
        )  # fmt: skip
        return all_pulses(scanner).direction.reshape(4, 2000, 3)

    whole, odd = turned(12.0), turned(12.7)
    assert whole == pytest.approx(np.broadcast_to(whole[0], whole.shape), abs=1e-9)
    assert np.linalg.norm(odd[1] - odd[0], axis=1).max() > 0.5
    elevation = np.rad2deg(np.arcsin(odd[..., 2])).ravel()
    assert [elevation.min(), elevation.max()] == pytest.approx([-7.0, 52.0], abs=0.01)
    # Time spent at each height is that of a sine: the arcsine law.
    share = np.mean(elevation < 22.5 - 29.5 / 2)
    assert share == pytest.approx(1 / 3, abs=0.01)


# ----------------------------------------------------------------------------------------- footprint
# Sub-rays against the Gaussian beam: moments, shares of energy at edges, widths at every range.


def pulses_along_x(count):
    def every(vector):
        return np.tile(np.array(vector, float), (count, 1))

    return Pulses(
        every([0, 0, 0]), every([1, 0, 0]), every([0, 1, 0]), np.zeros(count), np.zeros(count)
    )


def spots(beam, distance, count=1):
    """(P, N, 2) where sub-rays cross the plane at this distance: along the sweep, and across it."""
    keys = child_keys(first_key(1, "test"), np.arange(count))
    origin, way = spread(pulses_along_x(count), beam, keys)
    origin, way = np.broadcast_to(origin, way.shape), way
    at = origin + way * ((distance - origin[:, :1]) / way[:, :1])
    return at[:, 1:].reshape(count, -1, 2)


@pytest.mark.parametrize("subrays", [5, 50])
def test_each_ray_stands_for_a_ring_of_equal_energy(subrays):
    edges = np.sqrt(-np.log(1 - np.arange(subrays) / subrays) / 2)
    assert (radii(subrays) > edges).all()
    assert (radii(subrays)[:-1] < edges[1:]).all()


def test_one_ray_is_the_axis():
    assert spots(Beam(divergence_mrad=(1.0, 1.0), exit_diameter=0.1), 50.0).tolist() == [[[0, 0]]]


@pytest.mark.parametrize("distance", [0.0, 5.0, 28.6, 1000.0])
def test_widths_are_the_gaussian_beams_at_every_range(distance):
    beam = Beam(subrays=4000, divergence_mrad=(0.7, 0.2), exit_diameter=0.02)
    spot = spots(beam, distance)[0]
    for axis, theta in enumerate((0.7e-3, 0.2e-3)):
        radius = np.sqrt(0.01**2 + (distance * theta / 2) ** 2)  # at 1/e², so twice the sd
        assert np.std(spot[:, axis]) == pytest.approx(radius / 2, rel=2e-3)


def test_the_error_at_an_edge_falls_with_the_number_of_sub_rays():
    def error(subrays):
        beam = Beam(subrays=subrays, divergence_mrad=(1.0, 1.0))
        share = np.mean(spots(beam, 100.0, count=400)[:, :, 0] > 0.013, axis=1)
        return np.std(share - (0.5 - 0.5 * erf(np.sqrt(2) * 0.26)))

    errors = [error(n) for n in (10, 100, 1000)]
    assert errors[0] > 3 * errors[1] > 9 * errors[2]  # random points would give a factor of 3.2


# ------------------------------------------------------------------------------------------- stepped
# Parts that move by steps, as rays meet them, held against the still scene of each pulse.

RATE = 1000.0
PLATE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.2], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.4]])


def two_that_step() -> tuple[SceneGeometry, SceneMotion]:
    """A plate that stands, one that turns every 60 pulses and one that goes every 40."""
    mesh = TriMesh.of_part(PLATE, np.array([[0, 1, 2], [0, 2, 3]]), OTHER)
    transform = np.tile(np.eye(4)[:3], (3, 1, 1))
    transform[:, :, 3] = [[0.0, 0.0, -2.0], [1.5, 0.0, 0.0], [-1.5, 0.0, 0.0]]
    none = np.full(3, -1, dtype=np.int64)
    scene = SceneGeometry(
        (mesh,), transform, np.zeros(3, dtype=np.int64), ("a", "b", "c"), none, none.copy()
    )
    turn = Rotation.from_euler("xyz", [9, 5, 20], degrees=True).as_matrix()
    turns, goes = STILL.copy(), STILL.copy()
    turns[0, :3, :3], goes[1, :3, 3] = turn, [0.05, 0.1, 0.02]
    steps = {1: (turns, 60), 2: (goes, 40)}
    paths = {
        part: SteppedPath(
            transform[part],
            transform[part, :, 3],
            PartMotion((step,), (0,), 1, every),
            RATE,
            (30, 600),
        )
        for part, (step, every) in steps.items()
    }
    return scene, SceneMotion(paths)


def test_rays_meet_parts_where_their_steps_have_taken_them() -> None:
    """Against the still scene of each pulse."""
    scene, motion = two_that_step()
    rng = np.random.default_rng(8)
    count = 600
    time = (rng.permutation(count) + 1) / RATE
    origin = rng.uniform([-3, -1.5, 3], [3, 1.5, 4], (count, 3))
    way = rng.normal([0, 0, -3], 0.4, (count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    moving = MovingScene(scene, motion)
    found = MovingCaster(moving, ExactCaster).cast(origin, way, 20.0, time=time)
    assert set(found.instance.tolist()) == {-1, 0, 1, 2}
    normals = moving.normals(found, time)
    for row in range(0, count, 3):
        places = scene.transform.copy()
        for part, path in motion.paths.items():
            places[part] = path.at(time[[row]])[0]
        still = replace(scene, transform=places)
        one = ExactCaster(still).cast(origin[[row]], way[[row]])
        assert one.instance[0] == found.instance[row] or one.distance[0] > 20.0
        if found.found[row]:
            assert one.triangle[0] == found.triangle[row]
            assert abs(one.distance[0] - found.distance[row]) < 1e-9
            np.testing.assert_allclose(hit_normals(still, one)[0], normals[row], atol=1e-9)
    met = np.flatnonzero(found.instance == 2)
    points = origin[met] + found.distance[met, None] * way[met]
    asked = points, found.instance[met], found.triangle[met], time[met]
    velocity, rest = moving.velocities(*asked)
    np.testing.assert_allclose(velocity, np.tile([0.05, 0.1, 0.02], (len(met), 1)) * RATE / 40)
    went = motion.paths[2].at(time[met])[:, :, 3] - scene.transform[2, :, 3]
    np.testing.assert_allclose(points - went, rest, atol=1e-9)


# --------------------------------------------------------------------------------------------- like
# A pattern read from a cloud is the one that the cloud was flown with; trajectories from files.


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
    record[0, 1] = np.nan
    record.astype("<f8").tofile(tmp_path / "a.sbet")
    with pytest.raises(SpecError, match="no radians"):
        read_trajectory(tmp_path / "a.sbet", "EPSG:32612")


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
