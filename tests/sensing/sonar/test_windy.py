"""Echoes of trees in the wind: against leaves laid out where they are then, and Doppler's closed form."""

from __future__ import annotations

import numpy as np
import pytest
from references.echo_scenes import scene_of, square_leaves
from scipy.spatial.transform import Rotation

from forest_addon.base.trimesh import TriMesh
from forest_addon.results.echo_files import write_echo
from forest_addon.sensing.rays.geometry import apply_transform
from forest_addon.sensing.sonar.ping import ping
from forest_addon.sensing.sonar.station import SonarPose, posed
from forest_addon.sensing.sonar.summation import factors
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.sensing.sonar.windy import EchoWind, _proper
from forest_addon.spec import Air, Sonar

AIR = Air(sound_speed=340.0)
GONE = np.array([1.5, -0.4, 0.2])  # m/s of the upper piece
SPIN = np.array([0.1, 0.2, -0.15])  # rad/s of its turn


class Sways:
    """Tree 3 in two pieces: leaves below z = 0 stay, those above turn about their tree's foot and move."""

    number = {3: 0, 4: 1}  # noqa: RUF012

    def __init__(self, flutters=False):
        self.flutters = flutters

    def moves(self, tree):
        return tree == 0

    def pieces(self, _tree, mesh):
        return (mesh.vertices[mesh.triangles].mean(axis=1)[:, 2] > 0).astype(np.int64)

    def pieces_at(self, _tree, points, _leaf):
        return (points[:, 2] > 0).astype(np.int64)

    def moment(self, _tree, time):
        place, rate = np.tile(np.eye(3, 4), (2, 1, 1)), np.zeros((2, 3, 4))
        place[1, :, :3] = Rotation.from_rotvec(SPIN * time).as_matrix()
        place[1, :, 3] = GONE * time
        rate[1, :, :3] = np.cross(SPIN, np.eye(3)).T @ place[1, :, :3]
        rate[1, :, 3] = GONE
        return place, rate

    def flutter(self, _tree, leaf, time):
        size = 0.3 * self.flutters
        vector = np.stack([np.sin(leaf + 9 * time), np.cos(2 * leaf + 7 * time), 0 * leaf], axis=1)
        rate = np.stack(
            [9 * np.cos(leaf + 9 * time), -7 * np.sin(2 * leaf + 7 * time), 0 * leaf], axis=1
        )
        return np.zeros((len(leaf), 3)), size * vector, size * rate


def crown(count=600):
    rng = np.random.default_rng(1)
    return square_leaves(rng.normal(0, 0.8, (count, 3)), rng.normal(size=(count, 3)), 0.04)


PLACED = [
    np.column_stack([np.eye(3), (4.0, 0.3, 0.1)]),
    np.column_stack([Rotation.from_rotvec([0, 0, 1.0]).as_matrix(), (5.0, -1.0, 0.0)]),
]


def posed_mesh(mesh, sways, time):
    """The mesh as it is at a time, corner by corner."""
    place, _ = sways.moment(0, time)
    corners = mesh.vertices[mesh.triangles]
    # A leaf belongs to the piece that its middle is in.
    count = int(mesh.leaf.max()) + 1
    middle = np.stack([np.bincount(mesh.leaf, c, count) for c in corners.mean(axis=1).T], 1) / 2
    upper = (middle[:, 2] > 0)[mesh.leaf]
    foot, vector, _ = sways.flutter(0, np.arange(count), time)
    turned = Rotation.from_rotvec(vector)
    arm = corners - middle[mesh.leaf][:, None]
    corners = np.stack([turned[mesh.leaf].apply(arm[:, k]) for k in range(3)], axis=1)
    corners += (middle + np.cross(vector, middle - foot))[mesh.leaf][:, None]
    corners[upper] = apply_transform(place[1], corners[upper].reshape(-1, 3)).reshape(-1, 3, 3)
    vertices = mesh.vertices.copy()
    vertices[mesh.triangles] = corners
    return TriMesh(vertices, mesh.triangles, mesh.part, mesh.leaf, mesh.material)


@pytest.mark.medium
@pytest.mark.parametrize("flutters", [False, True])
@pytest.mark.parametrize("time", [0.0, 0.37])
def test_an_echo_is_that_of_leaves_where_they_are(flutters, time):
    """Against the same leaves, laid out corner by corner as they are at that moment."""
    mesh, sways = crown(), Sways(flutters)
    scene = scene_of(mesh, *PLACED)
    sonar = Sonar(
        position=(0, 0, 0), cull=0.0, tolerance=0.0, max_range=9, shading="none", record=0.06
    )
    targets = EchoTargets(scene, wind=EchoWind(scene, sways))
    pose = posed(sonar)
    pose = SonarPose(pose.position, pose.frame, pose.velocity, None, time)
    found = ping(targets, sonar, AIR, pose=pose)
    first = scene_of(posed_mesh(mesh, sways, time), PLACED[0])
    other = scene_of(mesh, PLACED[1])
    alone = [ping(EchoTargets(one), sonar, AIR).spectra for one in (first, other)]
    whole = sum(alone)
    assert np.abs(found.spectra - whole).max() < 2e-3 * np.abs(whole).max()


@pytest.mark.medium
def test_what_is_left_out_stays_within_the_bound():
    mesh, sways = crown(1500), Sways(True)
    scene = scene_of(mesh, *PLACED)
    targets = EchoTargets(scene, wind=EchoWind(scene, sways))
    sonar = Sonar(
        position=(0, 0, 0), cull=0.05, tolerance=0.0, max_range=9, shading="none", record=0.06
    )
    pose = posed(sonar)
    pose = SonarPose(pose.position, pose.frame, pose.velocity, None, 0.8)
    some, every = (ping(targets, s, AIR, pose=pose) for s in (sonar, sonar.changed(cull=0.0)))
    assert len(some.heard) < len(every.heard)
    apart = np.abs(some.spectra - every.spectra).max()
    assert apart <= 0.05 * every.heard.amplitude.sum() * 1.2


@pytest.mark.parametrize("away", [-3.0, 0.0, 0.5, 8.0])
@pytest.mark.parametrize("own", [0.0, 5.0])
def test_doppler_of_what_goes_straight_away(away, own):
    """(c + v)(c − u)/((c − v)(c + u)): the sonar nears at v, the leaf recedes at u."""

    class Straight(Sways):
        def moment(self, _tree, time):
            place, rate = np.tile(np.eye(3, 4), (1, 1, 1)), np.zeros((1, 3, 4))
            place[0, 0, 3], rate[0, 0, 3] = away * time, away
            return place, rate

        def pieces(self, _tree, mesh):
            return np.zeros(len(mesh.triangles), np.int64)

        def pieces_at(self, _tree, points, _leaf):
            return np.zeros(len(points), np.int64)

    mesh = square_leaves(np.zeros((1, 3)), np.array([[1.0, 0, 0]]), 0.04)
    scene = scene_of(mesh, np.column_stack([np.eye(3), (4.0, 0, 0)]))
    sonar = Sonar(
        position=(0, 0, 0), speed=own, max_range=9, shading="none", call="fm", doppler=True
    )
    found = ping(EchoTargets(scene, wind=EchoWind(scene, Straight())), sonar, AIR)
    (group,) = found.groups
    c = 340.0
    from forest_addon.sensing.sonar.station import Equipment, Station

    alpha = factors(group, Station(sonar, AIR, posed(sonar), Equipment.of(sonar)), 0)
    expected = (c + own) * (c - away) / ((c - own) * (c + away))
    assert alpha == pytest.approx(expected, rel=1e-12)


def test_velocity_is_the_change_of_place():
    """Of every leaf heard, against two moments a tenth of a millisecond apart."""
    mesh, sways = crown(200), Sways(True)
    scene = scene_of(mesh, *PLACED)
    targets = EchoTargets(scene, wind=EchoWind(scene, sways))
    sonar = Sonar(
        position=(0, 0, 0),
        beam="omni",
        cull=0.0,
        max_range=20,
        shading="none",
        leaf_model="piston",
        near_limit=0.1,
    )
    step, rows = 1e-4, []
    for time in (0.5 - step / 2, 0.5, 0.5 + step / 2):
        pose = SonarPose(np.zeros(3), np.eye(3), np.zeros(3), None, time)
        groups = [g for g in ping(targets, sonar, AIR, pose=pose).groups if len(g)]
        group = max(groups, key=len)
        key = np.lexsort((group.scatterers.number, group.instance))
        rows.append((group.scatterers.centre[key], group.velocity[key]))
    change = (rows[2][0] - rows[0][0]) / step
    assert np.abs(rows[1][1] - change).max() < 0.02 * np.abs(change).max()
    still = np.linalg.norm(change, axis=1) < 1e-9
    assert still.sum() > 100
    assert np.abs(rows[1][1][still]).max() < 1e-9


SWINGS, TONE = 9.0, 2 * np.pi * 6.0  # mm there and back, rad/s: a leaf of 1/3 m/s and 13 m/s²


class Swinging(Sways):
    """All of tree 3 swings along x."""

    def moment(self, _tree, time):
        place, rate = np.tile(np.eye(3, 4), (1, 1, 1)), np.zeros((1, 3, 4))
        place[0, 0, 3] = SWINGS * 1e-3 * np.sin(TONE * time)
        rate[0, 0, 3] = SWINGS * 1e-3 * TONE * np.cos(TONE * time)
        return place, rate

    def pieces(self, _tree, mesh):
        return np.zeros(len(mesh.triangles), np.int64)

    def pieces_at(self, _tree, points, _leaf):
        return np.zeros(len(points), np.int64)


def test_a_long_call_follows_a_leaf_that_turns_back(monkeypatch):
    """Against the tone's own phase: what leaves at t comes back at u = t + 2r(t)/c, sin(2πft) then."""
    mesh = square_leaves(np.zeros((1, 3)), np.array([[1.0, 0, 0]]), 0.02)
    scene = scene_of(mesh, np.column_stack([np.eye(3), (4.0, 0, 0)]))
    sonar = Sonar(
        position=(0, 0, 0),
        max_range=9,
        shading="none",
        absorption=False,
        call="cf-fm",
        call_duration=0.05,
        doppler=True,
        band=(60e3, 83e3),
        record=0.09,
    )
    targets = EchoTargets(scene, wind=EchoWind(scene, Swinging()))
    pose = posed(sonar)
    pose = SonarPose(pose.position, pose.frame, pose.velocity, None, 0.02)
    high = 83e3 - 0.05 * 23e3

    def alike():
        echo = ping(targets, sonar, AIR, pose=pose)
        sent = np.linspace(0.006, 0.036, 20_000)  # in the tone, faded in
        back = sent + 2 * (4.0 + SWINGS * 1e-3 * np.sin(TONE * (0.02 + sent))) / 340.0
        rows = (echo.time > back[0]) & (echo.time < back[-1])
        turn = 2 * np.pi * high * np.interp(echo.time[rows], back, sent)
        own = echo.waveforms[0, rows]
        found = np.abs(np.exp(-1j * turn) @ own) / (np.linalg.norm(own) * np.sqrt(rows.sum() / 2))
        return found

    assert alike() > 0.999
    monkeypatch.setattr("forest_addon.sensing.sonar.summation.STEADY", np.inf)
    assert alike() < 0.9


@pytest.mark.medium
@pytest.mark.parametrize("flutters", [False, True])
def test_truth_tells_where_leaves_rest(flutters, tmp_path):
    mesh, sways = crown(300), Sways(flutters)
    scene = scene_of(mesh, *PLACED)
    sonar = Sonar(position=(0, 0, 0), beam="omni", cull=0.0, max_range=20, shading="none")
    pose = SonarPose(np.zeros(3), np.eye(3), np.zeros(3), None, 0.7)
    echo = ping(EchoTargets(scene, wind=EchoWind(scene, sways)), sonar, AIR, pose=pose)
    heard = echo.heard
    count = int(mesh.leaf.max()) + 1
    corners = mesh.vertices[mesh.triangles]
    middle = np.stack([np.bincount(mesh.leaf, c, count) for c in corners.mean(axis=1).T], 1) / 2
    still = np.stack([apply_transform(place, middle) for place in PLACED])
    assert np.abs(heard.rest - still[heard.instance, heard.number]).max() < 1e-4
    gone = np.linalg.norm(heard.position - heard.rest, axis=1)
    assert (gone > 0.5).sum() > 100
    assert np.abs(gone[heard.instance == 1]).max() < 1e-9
    *_, file = write_echo(tmp_path, "bat", echo, sonar.changed(contributions=True), (100.0, 0, 0))
    with np.load(file) as kept:
        assert np.allclose(kept["rest"], heard.rest + np.array([100.0, 0.0, 0.0]))
        assert np.array_equal(kept["velocity"], heard.velocity)
    still = ping(EchoTargets(scene), sonar, AIR)
    assert still.heard.rest is None
    *_, file = write_echo(tmp_path, "bat", still, sonar.changed(contributions=True))
    with np.load(file) as kept:
        assert "rest" not in kept


def test_the_nearest_rotation_of_what_bends_inside_out_is_one():
    linear = np.random.default_rng(4).normal(size=(200, 3, 3))
    assert (np.linalg.det(linear) < 0).any()
    turned = _proper(linear)
    assert np.linalg.det(turned) == pytest.approx(np.ones(200), abs=1e-12)
    nearest = Rotation.align_vectors
    for given, found in zip(linear[:20], turned[:20], strict=True):
        assert found == pytest.approx(nearest(given.T, np.eye(3))[0].as_matrix(), abs=1e-6)
