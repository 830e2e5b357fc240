"""Where pulses go: patterns of sweeps, ways of platforms."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import erf

from forest_addon.base.rng import child_keys, first_key
from forest_addon.base.trimesh import OTHER, TriMesh
from forest_addon.formats.helios.motion import STILL, PartMotion
from forest_addon.sensing.lidar.footprint import radii, spread
from forest_addon.sensing.lidar.pattern import Pulses, pattern_of
from forest_addon.sensing.lidar.surveys.stepped import SteppedPath
from forest_addon.sensing.moving import MovingScene
from forest_addon.sensing.moving_rays import MovingCaster
from forest_addon.sensing.rays.caster import hit_normals
from forest_addon.sensing.rays.exact import ExactCaster
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.rays.paths import SceneMotion
from forest_addon.sensing.trajectory import along, through
from forest_addon.spec import Airborne, Beam, Mobile, Pose, SpecError, Terrestrial


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
