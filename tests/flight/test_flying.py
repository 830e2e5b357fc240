"""Policies in plane forests: what they reach, what is certain, what may go wrong; without Blender."""

import tracemalloc
from itertools import pairwise

import numpy as np
import pytest

from forest_addon.acoustics.air import absorption
from forest_addon.base.trimesh import LEAF, WOOD, TriMesh, join
from forest_addon.flight import policies
from forest_addon.flight.bodies import ACTIONS, GRAVITY, at_rest, move
from forest_addon.flight.flying import fly, interval
from forest_addon.flight.listening import (
    SONAR,
    EchoTask,
    Listener,
    area_under_curve,
    discriminant,
    network,
    noisy,
    sensed,
)
from forest_addon.flight.obstacles import (
    MeshObstacles,
    Solid,
    distances,
    stopping,
    touched,
    touches,
)
from forest_addon.flight.policies import SIZE, Gap, Straight, Trained, policy_of
from forest_addon.flight.senses import LIDAR, SONAR as EARS, EarSense, LidarSense
from forest_addon.flight.simulation import Flyers
from forest_addon.flight.stems import PlaneTrunks, StemWorld
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.sonar.calls import synthesise
from forest_addon.spec import Air, Flight, SpecError, Wind
from forest_addon.stand.wind import WindField
from studies.flight import speed as theory
from studies.flight.learn import train

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


def test_a_way_back_into_room_of_before_is_looked_at_whole():
    """It begins beyond what was free around the way before, behind a trunk."""
    one = flyers(ALONG, world([[0.0, 0.0]]), lidar=False)
    places = [np.array([place]) for place in ([-1.0, 0, 1.5], [0.0, 1, 1.5], [-0.5, -0.15, 1.5])]
    shares = [one._touched(here, there)[0] for here, there in pairwise(places)]
    assert shares[0] == np.inf
    met = places[1] + shares[1] * (places[2] - places[1])
    assert np.hypot(*met[0, :2]) == pytest.approx(0.3 + ALONG.radius, abs=1e-9)


def test_a_trunk_encloses_what_is_within_however_it_stands():
    scene = forest()
    solids = [Solid(scene.meshes[0], 0.02)]
    for number, transform in enumerate(scene.transform):
        obstacles = MeshObstacles(scene.take(np.array([number])), solids)
        for own, inside in (([0.25, 0.0, 2.0], True), ([0.25, 0.6, 2.0], False)):
            assert obstacles.encloses(transform @ [*own, 1.0]) is inside
    assert solids[0].may_enclose(np.array([0.25, 0.0, 2.0]))
    assert not solids[0].may_enclose(
        np.array([0.0, 0.0, 60.0])
    )  # few directions are asked for none


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
    peak = np.linspace(-1, 1, SIZE)

    def score(weights, _round):
        return -np.square(weights - peak).sum(axis=1)

    found = train(score, np.random.default_rng(0), rounds=60, drawings=200)
    assert score(found[None], 0)[0] > 0.2 * score(np.zeros((1, SIZE)), 0)[0]


def test_what_was_learnt_is_kept(tmp_path):
    lidar = LidarSense(LIDAR)
    made = Trained(ALONG, lidar, np.linspace(-1, 1, SIZE))
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


# -------------------------------------------------------------------------------------------- bodies
# Bodies move within their limits, and as closed forms say.


def flown(flight, action, steps=200, count=1):
    state = at_rest(flight, np.zeros((count, 3)), np.zeros(count))
    states = [state]
    for _ in range(steps):
        state, corners = move(flight, state, np.broadcast_to(action, (count, len(action))))
        assert np.array_equal(corners[:, -1], state.position)
        states.append(state)
    return states


def test_a_bat_keeps_its_limits():
    flight = Flight(
        speed=6.0, slowest=1.0, acceleration=9.0, turn_rate_deg=400.0, climb=1.5, step=0.02
    )
    rng = np.random.default_rng(0)
    state = at_rest(flight, np.zeros((8, 3)), np.zeros(8))
    for _ in range(300):
        before = state
        state, _ = move(flight, state, rng.uniform(-1, 1, (8, 3)))
        speed = np.hypot(*state.velocity[:, :2].T)
        assert (speed <= 6 + 1e-12).all()
        assert (speed >= 1 - 1e-12).all()
        assert (np.abs(state.velocity[:, 2]) <= 1.5 + 1e-12).all()
        turn = np.angle(np.exp(1j * (state.heading - before.heading))) / flight.step
        assert (np.abs(turn) <= np.deg2rad(400) + 1e-9).all()
        assert (np.abs(turn) * speed <= 9.0 + 1e-9).all()
        assert np.allclose(state.position - before.position, state.velocity * flight.step)


def test_a_planar_flyer_turns_in_a_circle():
    """Dubins: at full turn its places lie on one circle of radius v/ω, the chord's of a polygon."""
    flight = Flight(body="planar", speed=4.0, turn_rate_deg=90.0, acceleration=100.0, step=0.01)
    place = np.array([s.position[0] for s in flown(flight, np.array([1.0]), 400)])
    assert np.ptp(place[:, 2]) == 0

    away = np.hypot(
        *(place - place[:-1].mean(axis=0))[:, :2].T
    )  # one whole turn: its mean is the centre
    assert np.ptp(away) < 0.01
    assert away.mean() == pytest.approx(4.0 / (np.pi / 2), rel=1e-3)


def test_a_bird_keeps_its_course():
    flight = Flight(body="bird", speed=7.0, sideways=2.0, step=0.1)
    state = flown(flight, np.array([-0.5]), 10)[-1]
    assert state.position[0] == pytest.approx([7.0, -1.0, 0.0])
    assert state.heading[0] == 0


def test_a_quadrotor_follows_its_command_and_reaches_its_speed():
    flight = Flight(
        body="quadrotor", speed=8.0, tilt_deg=30.0, response=0.2, step=0.05, wind=(1.0, 0, 0)
    )
    states = flown(flight, np.array([1.0, 0, 0, 0]), 400)
    tilt = np.array([s.tilt[0, 0] for s in states])
    time = 0.05 * np.arange(len(tilt))
    assert np.allclose(
        tilt, np.deg2rad(30) * -np.expm1(-time / 0.2), atol=1e-12
    )  # first order, exactly
    assert states[-1].velocity[0, 0] == pytest.approx(
        9.0, rel=1e-3
    )  # through the air, and the wind
    assert abs(states[-1].position[0, 2]) < 1e-9
    first = (states[1].velocity[0] - states[0].velocity[0]) / 0.05
    assert 0 < first[0] < GRAVITY * np.tan(np.deg2rad(30))


@pytest.mark.parametrize("body", ACTIONS)
def test_wind_carries_every_body(body):
    still, blown = (
        flown(Flight(body=body, wind=wind, step=0.05), np.zeros(len(ACTIONS[body])), 100)[-1]
        for wind in ((0.0, 0.0, 0.0), (0.0, 1.5, 0.0))
    )
    drift = blown.position[0] - still.position[0]
    assert drift == pytest.approx([0, 7.5, 0], abs=0.7 if body == "quadrotor" else 1e-9)


# --------------------------------------------------------------------------------------------- sweep
# A swept sphere against closed forms, and against dense samples in float64 that share no code with it.

FLOOR = np.array([[[-9.0, -9, 0], [9, -9, 0], [0, 20, 0]]])


def first_touch(start, way, radius, corners):
    return touches(start, way, radius, corners).min(initial=np.inf)


def nearest_by_samples(point, corners, steps=60):
    """Distance to points strewn densely over triangles."""
    u, v = (g.ravel() for g in np.meshgrid(*[np.linspace(0, 1, steps)] * 2))
    keep = u + v <= 1 + 1e-12
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    places = a[:, None] + u[keep, None] * (b - a)[:, None] + v[keep, None] * (c - a)[:, None]
    return np.linalg.norm(places - point, axis=2).min(axis=1)


@pytest.mark.parametrize(
    ("start", "way", "share"),
    [
        ((0.0, 0, 2), (0.0, 0, -4), 1.5 / 4),  # face: the plane, a radius before it
        ((0.0, 0, -2), (0.0, 0, 4), 1.5 / 4),  # from behind
        ((0.0, -12, 0), (0.0, 6, 0), 2.5 / 6),  # edge, in its plane
        ((-12.0, -9, 0), (6.0, 0, 0), 2.5 / 6),  # corner
        ((0.0, 0, 2), (0.0, 0, 4), np.inf),  # away
        ((0.0, 0, 2), (5.0, 0, 0), np.inf),  # alongside
        ((0.0, 0, 0.4), (0.0, 0, 4), 0.0),  # touches already
        ((0.0, 0, 2), (0.0, 0, 0), np.inf),  # stands still
        ((0.0, 0, 500), (0.0, 0, -1e6), 499.5 / 1e6),  # a very long step
    ],
)
def test_closed_forms(start, way, share):
    found = first_touch(np.array(start), np.array(way), 0.5, FLOOR)
    assert found == pytest.approx(share, rel=1e-12)


def test_distances_are_those_of_dense_samples():
    rng = np.random.default_rng(1)
    corners = rng.normal(0, 1, (40, 3, 3))
    for point in rng.normal(0, 2, (12, 3)):
        exact, sampled = distances(point, corners), nearest_by_samples(point, corners)
        assert (exact <= sampled + 1e-12).all()
        assert (sampled - exact < 0.08).all()  # steps of at most 4 m / 60


@pytest.mark.medium
def test_touch_is_where_the_distance_first_is_the_radius():
    """At the share the sphere touches, before it never does (40 places along), and misses are misses."""
    rng = np.random.default_rng(2)
    met = 0
    for _ in range(50):
        corners = rng.normal(0, 1, (9, 3, 3)) * rng.uniform(0.01, 1.5)
        start, radius = rng.normal(0, 3, 3), rng.uniform(0.01, 0.5)
        way = corners.mean(axis=(0, 1)) - start + rng.normal(0, 0.5, 3)
        share = first_touch(start, way, radius, corners)
        end = min(share, 1.0)
        along = [distances(start + s * way, corners).min() for s in np.linspace(0, end, 40)[:-1]]
        assert min(along) > radius - 1e-9 or share == 0
        if 0 < share <= 1:
            met += 1
            assert distances(start + share * way, corners).min() == pytest.approx(radius, abs=1e-9)
    assert met > 10


def test_degenerate_triangles_are_points_and_lines():
    point = np.zeros((1, 3, 3))
    line = np.array([[[0.0, -5, 0], [0, 5, 0], [0, 0, 0]]])
    for corners in (point, line):
        assert first_touch(np.array([4.0, 0, 0]), np.array([-8.0, 0, 0]), 1.0, corners) == 3 / 8


def forest(count=30, seed=3):
    """Bent trunks with twigs and leaves, turned and scaled."""
    rng = np.random.default_rng(seed)
    way = np.stack([np.linspace(0, 0.5, 9), np.zeros(9), np.linspace(0, 4, 9)], axis=1)
    trunk = TriMesh.of_part(*tube(way, np.linspace(0.2, 0.1, 9), 8), WOOD)
    twig = TriMesh.of_part(*tube(way[::4] * [3, 1, 0.1] + [0, 0, 2], np.full(3, 0.004), 5), WOOD)
    leaf = TriMesh.of_part(
        np.array([[1.0, 0, 2], [2, 0, 2], [1, 1, 2]]), np.array([[0, 1, 2]]), LEAF
    )
    turn, scale = rng.uniform(0, 6.3, count), rng.uniform(0.7, 1.3, count)
    transform = np.zeros((count, 3, 4))
    transform[:, 0, 0] = transform[:, 1, 1] = scale * np.cos(turn)
    transform[:, 1, 0] = scale * np.sin(turn)
    transform[:, 0, 1] = -transform[:, 1, 0]
    transform[:, 2, 2] = scale
    transform[:, :2, 3] = rng.uniform(0, 12, (count, 2))
    none = np.full(count, -1)
    meshes = (join([trunk, twig, leaf]),)
    return SceneGeometry(meshes, transform, np.zeros(count, int), ("t",) * count, none, none)


def test_leaves_and_thin_twigs_do_not_stop():
    mesh = forest().meshes[0]
    assert (mesh.part[stopping(mesh, 0.0)] == WOOD).all()
    thick = stopping(mesh, 0.02)
    assert len(thick) == len(tube(np.zeros((9, 3)) + np.arange(9)[:, None], np.ones(9), 8)[1])
    assert mesh.vertices[mesh.triangles[thick]].max() > 3.9


@pytest.mark.medium
@pytest.mark.parametrize("step", [0.3, 10.0])
def test_forests_are_met_as_all_their_triangles_are(step):
    """Cells, boxes and the map lose nothing: all triangles of all trees, one by one, say the same."""
    scene = forest()
    solid = Solid(scene.meshes[0], 0.02)
    obstacles = MeshObstacles(scene, [solid])
    every = np.concatenate([solid.corners @ m[:, :3].T + m[:, 3] for m in scene.transform])
    rng = np.random.default_rng(4)
    start = np.column_stack([rng.uniform(-1, 13, (40, 2)), rng.uniform(0.2, 3, 40)])
    start[:20] = scene.transform[:20, :, 3] + rng.uniform(-0.7, 0.7, (20, 3)) + [0, 0, 1]
    way = rng.normal(0, 1, (40, 3)) * [1, 1, 0.2]
    way *= step / np.linalg.norm(way, axis=1, keepdims=True)
    found, free = touched(obstacles, start, start + way, 0.1)
    truth = np.array([first_touch(p, w, 0.1, every) for p, w in zip(start, way, strict=True)])
    assert np.allclose(found, truth, atol=1e-9)
    assert np.isfinite(truth).any()
    exact = np.array([distances(p, every).min() for p in start])
    room = obstacles.room(start)
    assert (room <= exact + 1e-12).all()
    far = exact > 1.0
    assert (room[far] > 0.5).all()  # a bound that is of use
    wanted = np.minimum(2.0 * exact, 0.5)
    np.testing.assert_allclose(obstacles.room(start, wanted).clip(max=0.5), exact.clip(max=0.5))
    exact = np.array([distances(p, every).min() for p in start + way / 2])
    assert (free <= exact).all()
    assert (free > step / 2).any() == (step < 1)


def test_trunks_of_a_plan_are_circles():
    stems = PlaneTrunks(np.array([[5.0, 0.0], [5.0, 9.0]]), np.array([0.5, 1.0]))
    start, end = (
        np.array([[0.0, 0, 1], [0, 3, 1], [0, 0.8, 1]]),
        np.array([[10.0, 0, 1], [10, 3, 1], [10, 0.8, 1]]),
    )
    found, _ = touched(stems, start, end, 0.5)
    assert found == pytest.approx([0.4, np.inf, (5 - np.sqrt(1 - 0.64)) / 10], rel=1e-12)
    inside, _ = touched(stems, np.array([[5.0, 0.2, 1]]), np.array([[6.0, 0, 1]]), 0.1)
    assert inside[0] == 0


def test_nothing_stands_in_an_empty_world():
    nothing = np.empty(0, dtype=np.int64)
    scene = SceneGeometry((), np.empty((0, 3, 4)), nothing, (), nothing, nothing)
    for empty in (MeshObstacles(scene, []), PlaneTrunks(np.empty((0, 2)), np.empty(0))):
        assert touched(empty, np.zeros((1, 3)), np.full((1, 3), 1e4), 1.0)[0][0] == np.inf


# ------------------------------------------------------------------------------------------- echoes
# Echoes that flyers hear, by closed forms: trunks, noise, filters, and ways to tell.

AIR = Air()
LOW, HIGH = SONAR.band
FLIGHT = Flight(start=(0.0, 0.0, 1.5), position_sd=0.1, distance=5.0)
HEARS = EARS.changed(call="impulse", band=(30e3, 50e3), sample_rate=125e3, max_range=4.0)


def trunk(ahead, radius):
    return StemWorld(np.array([[ahead, 0.0]]), np.array([radius]), np.zeros(2), np.ones(2))


def loss(frequency, metres):
    """Share of the pressure that is left after so many metres of air."""
    return float(np.exp(-absorption(frequency) * metres))


@pytest.mark.parametrize("radius", [0.05, 0.2])
def test_a_trunk_sounds_as_a_large_cylinder_does(radius):
    """Geometrical acoustics: sqrt(a/(a + r))/(2r) at r from the near side; the first echo at 2r/c."""
    ears, ahead = EarSense(HEARS.changed(ears=1, ear_turn_deg=0.0), AIR), 2.0
    state = at_rest(FLIGHT, np.array([[0.0, 0.0, 1.5]]), np.zeros(1))
    echo = ears.ping(trunk(ahead, radius), state)
    near = ahead - radius
    expected = np.sqrt(radius / ahead) / (2 * near)
    peak = echo.envelopes[0].max()
    assert 0.9 * loss(50e3, 2 * near) < peak / expected < 1.1 * loss(30e3, 2 * near)
    at = echo.time[echo.envelopes[0].argmax()]
    assert at == pytest.approx(2 * near / AIR.speed(), abs=1 / 20e3)


def test_a_pole_adds_its_echo_to_the_leaves():
    task = EchoTask("pole", 1.4, 0.1)
    pole = task.heard(3, 5, True) - task.heard(3, 5, False)
    first = np.flatnonzero(np.abs(pole[0]) > 0.1 * np.abs(pole).max())[0] / SONAR.sample_rate
    assert 2 * 1.4 / AIR.speed() < first < 2 * 1.75 / AIR.speed()
    with pytest.raises(SpecError, match="not known"):
        EchoTask("tunnel")


def test_noise_is_as_far_below_the_peak_as_is_said():
    """The root mean square of the lines within the band, of 40 drawn records."""
    silent, loudness, snr = np.zeros((1, 3300)), 0.03, 12.0
    drawn = np.array([noisy(silent, snr, loudness, 1, number)[0] for number in range(40)])
    assert np.array_equal(drawn[3], noisy(silent, snr, loudness, 1, 3)[0])
    lines = np.abs(np.fft.rfft(drawn)) ** 2
    frequency = np.fft.rfftfreq(3300, 1 / SONAR.sample_rate)
    inside = (frequency >= LOW) & (frequency <= HIGH)
    power = 2 * lines[:, inside].sum(axis=1).mean() / 3300**2
    # Each record has some 1,650 independent numbers: 66,000 in all, so 1 % is 2.6 standard errors or more.
    assert np.sqrt(power) == pytest.approx(loudness * 10 ** (-snr / 20), rel=0.02)


def test_a_matched_filter_finds_the_call_and_keeps_its_peak():
    call = synthesise(SONAR).samples
    sound, at = np.zeros((1, 3300)), 1234
    sound[0, at : at + len(call)] = 0.5 * call
    power = sensed(sound)
    assert np.all(np.abs(power[1:-1].argmax(axis=1) - at) <= 4)
    assert sensed(2 * sound) == pytest.approx(4 * power, rel=1e-4, abs=1e-12)
    early = power[:, : at - 400].max()
    assert early < 1e-3 * power.max()


def test_a_network_tells_what_no_plane_can():
    rng = np.random.default_rng(0)
    inputs = rng.normal(0, 1, (600, 2))
    is_it = inputs[:, 0] * inputs[:, 1] > 0
    weights = network(inputs[:300], is_it[:300], np.random.default_rng(1))
    first = weights[:-9].reshape(8, 3)
    score = np.tanh(inputs @ first[:, :2].T + first[:, 2]) @ weights[-9:-1] + weights[-1]
    assert area_under_curve(score[300:], is_it[300:]) > 0.95
    plane = discriminant(inputs[:300], is_it[:300])
    assert area_under_curve(inputs[300:] @ plane[:2], is_it[300:]) < 0.65


def test_listeners_tell_what_their_feature_holds():
    """Noise of which half is twice as strong, or begins later: energy, or first crossing, tells it."""
    rng, is_it = np.random.default_rng(2), np.arange(80) % 2 == 1
    power = rng.exponential(1e-6, (80, 8, 640))
    louder, later = power.copy(), power.copy()
    louder[is_it] *= 2.0
    later[is_it, :, :200] *= 1e-6
    later[is_it] *= power[is_it].sum(axis=(1, 2), keepdims=True) / later[is_it].sum(
        axis=(1, 2), keepdims=True
    )
    for name, told, blind in (("energy", louder, later), ("first crossing", later, None)):
        listener = Listener(name)
        score = listener.fit(told[:40], is_it[:40]).score(told[40:])
        assert area_under_curve(score, is_it[40:]) > 0.95
        assert ((score > 0) == is_it[40:]).mean() > 0.9
        if blind is not None:
            score = listener.fit(blind[:40], is_it[:40]).score(blind[40:])
            assert 0.2 < area_under_curve(score, is_it[40:]) < 0.8
    with pytest.raises(SpecError, match="not known"):
        Listener("luck")


def test_a_policy_by_ear_feels_which_side_is_louder():
    sense = EarSense(HEARS, AIR)
    policy = Trained(FLIGHT, sense, np.zeros(SIZE))
    assert policy.sensors == ("sonar",)
    felt = []
    for side in (0.3, -0.3):
        state = at_rest(FLIGHT, np.array([[0.0, 0.0, 1.5]]), np.zeros(1))
        place = StemWorld(np.array([[1.5, side]]), np.array([0.1]), np.zeros(2), np.ones(2))
        told = {"sonar": sense.listen(place, state)}
        felt.append(policy.felt(told)[0])
    left, right = felt
    assert left[:7].max() > 0.3
    assert right[:7].min() < -0.3
    assert left[-1] == pytest.approx(right[-1], abs=0.01)  # from the other side as loud
    with pytest.raises(SpecError, match="two ears"):
        Trained(FLIGHT, EarSense(HEARS, AIR, "waveforms"), np.zeros(SIZE))
