"""Policies in plane forests: what they reach, what is certain, what may go wrong; without Blender."""

import sys
import tracemalloc

import numpy as np
import pytest

from forest_addon.flight import policies
from forest_addon.flight.flying import fly, interval
from forest_addon.flight.listening import area_under_curve, discriminant
from forest_addon.flight.policies import Gap, Straight, policy_of
from forest_addon.flight.senses import LIDAR, LidarSense
from forest_addon.flight.simulation import Flyers
from forest_addon.flight.stems import PlaneTrunks, StemWorld
from forest_addon.spec import Flight, SpecError, Wind
from forest_addon.stand.wind import WindField
from studies.flight import theory

ALONG = Flight(aim="heading", distance=30.0, start=(0.0, 0.0, 1.5), steps=400, speed=4.0, step=0.1)
NONE = np.empty((0, 2))


def world(place=NONE, radius=0.3):
    place = np.asarray(place, dtype=float).reshape(-1, 2)
    return StemWorld(place, np.full(len(place), radius), np.zeros(2), np.full(2, 40.0))


def flyers(flight, where, count=1, lidar=True):
    made = Flyers(flight, count, LidarSense(LIDAR) if lidar else None, None)
    made.enter(where)
    return made


def test_rays_meet_trunks_as_circles():
    rng = np.random.default_rng(0)
    place, radius = rng.uniform(-9, 9, (30, 2)), rng.uniform(0.1, 0.6, 30)
    angle = np.linspace(0, 2 * np.pi, 16)
    way = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    hits = PlaneTrunks(place, radius).cast(np.zeros((16, 3)), way, 12.0)
    along = np.linspace(0, 12, 6001)
    for k in range(16):
        spots = along[:, None] * way[k, :2]
        inside = (np.linalg.norm(spots[:, None] - place, axis=2) <= radius).any(axis=1)
        truth = along[inside.argmax()] if inside.any() else np.inf
        if not inside[0]:
            assert hits.distance[k] == pytest.approx(truth, abs=2.1e-3)


@pytest.mark.medium
def test_straight_flies_into_what_is_there_and_gap_around_it():
    tree = world([[10.0, 0.05]])
    one = flyers(ALONG, tree)
    straight = fly(one, Straight(ALONG), [1])[0]
    assert straight.end == "crashed"
    assert straight.position[-1, 0] == pytest.approx(
        10 - np.sqrt((0.3 + 0.15) ** 2 - 0.05**2), abs=1e-9
    )
    around = fly(one, Gap(ALONG, one.lidar), [1])[0]
    assert around.end == "arrived"
    assert np.hypot(*(around.position[:, :2] - [10.0, 0.05]).T).min() > 0.45
    assert fly(flyers(ALONG, world()), Straight(ALONG), [1])[0].end == "arrived"  # no trees


def test_a_long_step_jumps_over_nothing():
    far = ALONG.changed(step=2.5, speed=4.0, acceleration=1000.0)
    track = fly(flyers(far, world([[10.0, 0.0]], 0.05)), Straight(far), [1])[0]
    assert track.end == "crashed"
    assert track.position[-1, 0] == pytest.approx(10 - 0.2, abs=1e-9)
    near = ALONG.changed(aim="goal", distance=11.0, reached=0.5, step=2.5, acceleration=1000.0)
    assert fly(flyers(near, world()), Straight(near), [1])[0].end == "arrived"  # a goal neither


def test_behind_a_wall_nobody_arrives():
    wall = [[8.0, y] for y in np.arange(-40, 40, 0.4)]
    flight = ALONG.changed(aim="goal", distance=16.0, steps=60)
    one = flyers(flight, world(wall))
    track = fly(one, Gap(flight, one.lidar), [1])[0]
    assert track.end in ("late", "crashed")
    assert track.position[:, 0].max() < 8.0


def test_a_start_in_a_trunk_is_refused():
    for start in ((10.0, 0.1, 1.0), (10.4, 0.0, 1.0)):
        flight = ALONG.changed(start=start)
        with pytest.raises(SpecError, match="is inside or within"):
            flyers(flight, world([[10.0, 0.0]])).start([0], [1])
    crowd = world([[x, y] for x in range(41) for y in range(41)], 0.8)
    with pytest.raises(SpecError, match="no free place was found"):
        flyers(ALONG.changed(start=None), crowd).start([0], [1])


@pytest.mark.medium
def test_each_flies_as_if_alone():
    rng = np.random.default_rng(3)
    where = world(rng.uniform((5, -15), (35, 15), (60, 2)))
    flight = ALONG.changed(position_sd=0.2, heading_sd_deg=3.0, distance=15.0)
    many = flyers(flight, where, 3)
    together = fly(many, Gap(flight, many.lidar), [5, 6, 7])
    for seed, track in zip((5, 6, 7), together, strict=True):
        one = flyers(flight, where)
        alone = fly(one, Gap(flight, one.lidar), [seed])[0]
        assert alone.end == track.end
        assert np.array_equal(alone.position, track.position)
    assert len({track.flown for track in together}) > 1  # their noise differs


@pytest.mark.medium
def test_many_steps_need_no_more_memory():
    flight = ALONG.changed(distance=1e5, steps=10_000_000)
    one = flyers(flight, world([[10.0, 9.0]]), lidar=False)
    one.start([0], [1])
    action = np.array([[0.3, 0.0, 0.0]])
    for _ in range(50):
        one.sense()
        one.step(action)
    tracemalloc.start()
    first = tracemalloc.get_traced_memory()[0]
    for _ in range(700):
        one.sense()
        one.step(action)
    grown = tracemalloc.get_traced_memory()[0] - first
    tracemalloc.stop()
    assert grown < 10_000  # bytes; an array kept of each step would be 70,000 and more


def test_policies_by_name():
    lidar = LidarSense(LIDAR)
    assert isinstance(policy_of("gap", ALONG, lidar, None), Gap)
    for name, words in (
        ("gap", "needs a lidar"),
        ("echo", "needs a sonar"),
        ("zigzag", "not known"),
    ):
        with pytest.raises(SpecError, match=words):
            policy_of(name, ALONG, None, None)


def test_the_cross_entropy_method_finds_a_peak():
    peak = np.linspace(-1, 1, policies.SIZE)

    def score(weights, _round):
        return -np.square(weights - peak).sum(axis=1)

    found = policies.train(score, np.random.default_rng(0), rounds=60, drawings=200)
    assert score(found[None], 0)[0] > 0.2 * score(np.zeros((1, policies.SIZE)), 0)[0]


def test_what_was_learnt_is_kept(tmp_path):
    lidar = LidarSense(LIDAR)
    made = policies.Trained(ALONG, lidar, np.linspace(-1, 1, policies.SIZE))
    made.save(tmp_path / "trained.npz")
    again = policies.load(tmp_path / "trained.npz", ALONG, lidar)
    one = flyers(ALONG, world([[9.0, 1.0]]))
    one.start([0], [1])
    told = one.sense()
    assert np.array_equal(made.act(told), again.act(told))
    (tmp_path / "other.npz").write_text("no")
    with pytest.raises(SpecError, match="cannot be read as a trained policy"):
        policies.load(tmp_path / "other.npz", ALONG, lidar)


def test_ways_through_forests():
    """A wall stops all, a gap lets through who is slow enough: it must be reached within its cone."""
    wall = np.array([[20.0, y] for y in np.arange(0.25, 40, 0.5)])
    reach = np.full(len(wall), 0.4)
    assert theory.passable(wall, reach, 1.0, 50.0, 40.0) == pytest.approx(20, abs=0.5)
    gap = np.abs(wall[:, 1] - 20.0) > 1.0
    assert theory.passable(wall[gap], reach[gap], 0.1, 50.0, 40.0) == 50.0
    second = wall[np.abs(wall[:, 1] - 26.0) > 1.0] + [12.0, 0]
    both = np.concatenate([wall[gap], second])
    radii = np.full(len(both), 0.4)
    # From a gap at y = 20 to one at 26, 12 m on: at least (6 - 1.2)/12 across for each metre ahead.
    assert theory.passable(both, radii, 0.3, 60.0, 40.0) < 40
    assert theory.passable(both, radii, 0.6, 60.0, 40.0) == 60.0


def test_statistics():
    low, high = interval(8, 10)
    assert (low, high) == pytest.approx((0.4902, 0.9433), abs=1e-4)  # Wilson 1927
    score = np.array([0.1, 0.4, 0.35, 0.8])
    assert area_under_curve(score, np.array([False, False, True, True])) == 0.75
    assert area_under_curve(np.ones(6), np.arange(6) > 2) == 0.5
    rng = np.random.default_rng(0)
    is_it = np.arange(400) % 2 == 0
    cloud = rng.normal(0, 1, (400, 3)) + is_it[:, None] * [2.0, 0, 0]
    weights = discriminant(cloud, is_it)
    assert area_under_curve(cloud @ weights[:-1], is_it) > 0.9


@pytest.mark.slow
def test_flight_needs_neither_blender_nor_gymnasium_for_this():
    import subprocess

    code = (
        "import sys; sys.modules['bpy'] = None; sys.modules['mathutils'] = None\n"
        "from forest_addon.flight import policies, flying, simulation\n"
        "print('torch' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


GUSTS = WindField.drawn(
    Wind(speed=4.0, direction_deg=90.0, turbulence=0.3), 12.0, np.full(10, 0.03), 7
)


@pytest.mark.parametrize("body", ["bat", "planar", "bird"])
def test_gusts_carry_a_flyer_by_the_wind_along_its_way(body):
    """Straight ahead through the air: over ground it is off by the sum of the wind that it met."""
    places = {}
    for gusts in (None, GUSTS):
        where = world()
        where.gusts = gusts
        flight = ALONG.changed(body=body, wind=(0.3, -0.2, 0.0))
        made = flyers(flight, where, lidar=False)
        made.start([0], [3])
        way = [made.state.position[0].copy()]
        none = np.zeros((1, {"bat": 3}.get(body, 1)))
        for _ in range(40):
            made.step(none)
            way.append(made.state.position[0].copy())
        places[gusts is None] = np.array(way)
    still, blown = places[True], places[False]
    time = 0.1 * np.arange(40)
    pushed = 0.1 * np.cumsum(GUSTS.at(blown[:-1], time), axis=0)
    apart = blown[1:] - still[1:]
    assert np.allclose(apart[:, :2], pushed[:, :2], atol=1e-9)
    if body != "bat":
        assert np.allclose(apart[:, 2], pushed[:, 2], atol=1e-9)
    assert np.linalg.norm(pushed[-1]) > 0.5


def test_a_quadrotor_drifts_with_the_wind_by_its_drag():
    """Hovering, each step's acceleration is drag times the speed of the air past it."""
    where = world()
    where.gusts = GUSTS
    flight = ALONG.changed(body="quadrotor", step=0.02)
    made = flyers(flight, where, lidar=False)
    made.start([0], [3])
    drag = 9.81 * np.tan(np.deg2rad(flight.tilt_deg)) / flight.speed
    for step in range(50):
        place, velocity = made.state.position.copy(), made.state.velocity[0].copy()
        air = GUSTS.at(place, np.array([0.02 * step]))[0]
        made.step(np.zeros((1, 4)))
        gained = (made.state.velocity[0] - velocity)[:2] / 0.02
        assert np.allclose(gained, drag * (air - velocity)[:2], atol=1e-9)


def test_the_wind_of_a_flyer_is_the_same_among_others_and_again():
    where = world()
    where.gusts = GUSTS
    ways = []
    for seeds in ([5], [9, 5], [5]):
        made = flyers(ALONG.changed(start=None), where, len(seeds), lidar=False)
        made.start(range(len(seeds)), seeds)
        for _ in range(20):
            made.step(np.zeros((len(seeds), 3)))
        ways.append(made.state.position[-1])
    assert np.array_equal(ways[0], ways[2])
    assert np.allclose(ways[0], ways[1], atol=1e-12)
