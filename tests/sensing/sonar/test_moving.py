"""Echoes of objects that move and turn: delay of each ping and Doppler against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from references.echoes import amplitude_of, culled, scene_of, square_leaves
from references.rays import BruteCaster
from scipy.spatial.transform import Rotation

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, OTHER, WOOD, TriMesh, join
from forest_addon.results.sonar import write_echo
from forest_addon.sensing.audit import held
from forest_addon.sensing.moving import MovingScene
from forest_addon.sensing.moving_rays import MovingCaster
from forest_addon.sensing.rays.exact import ExactCaster
from forest_addon.sensing.rays.geometry import apply_transform
from forest_addon.sensing.rays.paths import RigidPath, SceneMotion, ShapePath
from forest_addon.sensing.sonar.audit import Pings, parts_of_echoes
from forest_addon.sensing.sonar.echo import Echo
from forest_addon.sensing.sonar.ping import fly, ping
from forest_addon.sensing.sonar.shading import CELL, Extinction
from forest_addon.sensing.sonar.station import Equipment, SonarPose, Station, posed
from forest_addon.sensing.sonar.summation import factors
from forest_addon.sensing.sonar.targets import EchoTargets
from forest_addon.sensing.sonar.windy import EchoMotion, EchoWind, _proper
from forest_addon.spec import Air, Sonar

C = 340.0
AIR = Air(sound_speed=C)
FAR, SPEED, TURN = 6.0, -2.0, 0.9  # m, m/s away, rad/s
SONAR = Sonar(
    position=(0, 0, 0),
    beam="omni",
    absorption=False,
    call="fm",
    doppler=True,
    max_range=15,
    cull=0.0,
    tolerance=1e-8,
)


def plate(half=1.0):
    corners = np.array([[0, -half, -half], [0, half, -half], [0, half, half], [0, -half, half]])
    return TriMesh.of_part(corners.astype(float), np.array([[0, 1, 2], [0, 2, 3]]), OTHER)


def at(x, angle=0.0):
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0, x], [sin, cos, 0, 0], [0, 0, 1, 0]], dtype=float)


def targets_in(scene, motion):
    still = EchoTargets(scene)
    moving = MovingCaster(MovingScene(scene, motion), ExactCaster)
    return EchoTargets(scene, still, None, EchoMotion(moving.moving)), moving


def nearing(mesh, x=FAR):
    scene = scene_of(mesh, at(x))
    path = RigidPath(np.array([0.0, 2.0]), np.array([at(x), at(x + 2 * SPEED)]))
    return targets_in(scene, SceneMotion({0: path}))


def poses_at(times):
    return [replace(posed(SONAR), time=time) for time in times]


def alpha_of(echo, group):
    return factors(group, Station(SONAR, AIR, echo.pose, Equipment.of(SONAR)), 0)


def test_each_ping_hears_a_plate_where_it_is_then():
    targets, moving = nearing(plate())
    times = [0.0, 0.31, 1.0, 1.77]
    echoes = fly(targets, SONAR, AIR, poses_at(times), moving).echoes
    for time, echo in zip(times, echoes, strict=True):
        (group,) = echo.groups
        glint = int(np.argmin(group.paths.distance))
        place = FAR + SPEED * time
        assert group.paths.length[glint, 0] / C == pytest.approx(2 * place / C, rel=1e-12)
        assert alpha_of(echo, group)[glint] == pytest.approx((C - SPEED) / (C + SPEED), rel=1e-12)
        plain = SONAR.changed(call="impulse", doppler=False, record=0.06)
        there = ping(targets, plain, AIR, moving, pose=poses_at([time])[0]).spectra
        still = ping(EchoTargets(scene_of(plate(), at(place))), plain, AIR).spectra
        assert np.abs(there - still).max() < 1e-9 * np.abs(still).max()


def test_a_plate_that_turns_is_heard_by_the_rate_of_its_height():
    """Turned by θ about the vertical at FAR, its plane is FAR·cos(θ) away, at the rate −FAR·θ'·sin(θ)."""
    scene = scene_of(plate(20.0), at(FAR))
    times = np.linspace(0.0, 1.0, 5)
    path = RigidPath(times, np.array([at(FAR, TURN * t) for t in times]))
    targets, _ = targets_in(scene, SceneMotion({0: path}))
    time = 0.37
    echo = ping(targets, SONAR.changed(shading="none"), AIR, pose=poses_at([time])[0])
    (group,) = echo.groups
    glint = int(np.argmin(group.paths.distance))
    height, rate = FAR * np.cos(TURN * time), -FAR * TURN * np.sin(TURN * time)
    assert group.paths.distance[glint] == pytest.approx(height, rel=1e-9)
    assert alpha_of(echo, group)[glint] == pytest.approx((C - rate) / (C + rate), rel=1e-9)


def test_leaves_that_are_carried_are_heard_as_laid_out_there():
    rng = np.random.default_rng(3)
    mesh = square_leaves(rng.normal(0, 0.5, (200, 3)), rng.normal(size=(200, 3)), 0.04)
    targets, _ = nearing(mesh)
    sonar = SONAR.changed(shading="none", call="impulse", doppler=False, record=0.06)
    echo = ping(targets, sonar, AIR, pose=poses_at([0.8])[0])
    laid = ping(EchoTargets(scene_of(mesh, at(FAR + 0.8 * SPEED))), sonar, AIR)
    assert np.abs(echo.spectra - laid.spectra).max() < 1e-9 * np.abs(laid.spectra).max()
    assert np.allclose(echo.groups[0].velocity, (SPEED, 0, 0))


def test_what_nears_hides_what_stands_behind_it_then():
    """A wall moves aside; leaves behind it are hidden before and heard after that."""
    wall = plate(0.6)
    leaves = square_leaves(np.zeros((1, 3)), np.array([[1.0, 0, 0]]), 0.05)
    scene = scene_of(wall, at(2.0))
    scene = replace(
        scene,
        meshes=(wall, leaves),
        transform=np.array([at(2.0), at(4.0)]),
        mesh_index=np.array([0, 1]),
        object_name=("wall", "leaf"),
        tree=np.array([-1, -1]),
        species=np.array([-1, -1]),
        object_index=np.arange(2),
        reflectance=np.full(2, np.nan),
    )
    aside = at(2.0)
    aside[1, 3] = 3.0
    path = RigidPath(np.array([0.0, 1.0]), np.array([at(2.0), aside]))
    targets, moving = targets_in(scene, SceneMotion({0: path}))
    sonar = SONAR.changed(facets=False, leaf_model="piston")
    wood = MovingCaster(moving.moving.solid(), ExactCaster)
    echoes = fly(targets, sonar, AIR, poses_at([0.0, 1.0]), wood).echoes
    assert [echo.hidden for echo in echoes] == [1, 0]
    assert [echo.leaves_heard if echo.groups else 0 for echo in echoes] == [0, 1]


def test_what_is_away_or_bends_sounds_as_it_is_at_each_ping():
    """Two runs of one object: it is there from 0 to 1 s, and its shape moves 1 m towards the sonar."""
    mesh = plate()
    scene = scene_of(mesh, at(FAR))
    shift = np.stack([mesh.vertices, mesh.vertices - (1.0, 0, 0)])
    motion = SceneMotion(
        {0: RigidPath(np.zeros(1), at(FAR)[None])},
        {0: ShapePath(np.array([0.0, 1.0]), shift)},
        {0: (-np.inf, 1.0)},
    )
    targets, moving = targets_in(scene, motion)
    assert moving.moving.motion.shapes
    early, late, gone = fly(
        targets, SONAR.changed(shading="none"), AIR, poses_at([0.0, 0.5, 1.5])
    ).echoes
    for echo, place in ((early, FAR), (late, FAR - 0.5)):
        assert echo.groups[0].paths.distance.min() == pytest.approx(place, rel=1e-12)
    assert not gone.groups
    assert moving.moving.solid().motion.shapes[0].vertices.shape == (2, 4, 3)


@pytest.mark.medium
def test_doppler_knows_how_a_plate_bends():
    """Its middle comes nearer at 1 m/s while its edge stands, and lay 0.5 m farther off at rest."""
    grid = np.linspace(-1, 1, 21)
    y, z = (side.ravel() for side in np.meshgrid(grid, grid, indexing="ij"))
    flat = np.stack([np.zeros_like(y), y, z], axis=1)
    number = np.arange(441).reshape(21, 21)
    first, across = number[:-1, :-1].ravel(), number[1:, 1:].ravel()
    sides = (number[1:, :-1].ravel(), across), (across, number[:-1, 1:].ravel())
    triangles = np.concatenate([np.stack([first, *side], axis=1) for side in sides])
    mesh = TriMesh.of_part(flat, triangles, OTHER)
    dome = flat.copy()
    dome[:, 0] -= 1 - np.hypot(y, z) ** 2 / 2
    scene = scene_of(mesh, at(FAR))
    shift = ShapePath(np.array([0.0, 1.0]), np.stack([flat, dome]))
    motion = SceneMotion({0: RigidPath(np.zeros(1), at(FAR)[None])}, {0: shift})
    targets, _ = targets_in(scene, motion)
    echo = ping(targets, SONAR.changed(shading="none"), AIR, pose=poses_at([0.5])[0])
    (group,) = echo.groups
    y, z = group.scatterers.centre[:, 1:].T
    inside = np.hypot(y, z) < 0.9
    expected = -(1 - np.hypot(y, z) ** 2 / 2)
    assert inside.sum() > 100
    assert np.abs(group.velocity[:, 0] - expected)[inside].max() < 0.02
    assert np.abs(group.motion[inside, 3] - FAR).max() < 1e-6
    glint = int(np.argmin(group.paths.distance))
    u = group.velocity[glint, 0]
    assert u == pytest.approx(-1.0, abs=0.01)
    assert alpha_of(echo, group)[glint] == pytest.approx((C - u) / (C + u), rel=1e-4)


# --------------------------------------------------------------------------------------------- windy
# Echoes of trees in the wind: against leaves laid out where they are then, and Doppler's closed form.

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
def test_an_echo_is_that_of_leaves_where_they_are(flutters):
    """Against the same leaves, laid out corner by corner as they are at that moment."""
    mesh, sways, time = crown(), Sways(flutters), 0.37
    scene = scene_of(mesh, *PLACED)
    sonar = Sonar(
        position=(0, 0, 0), cull=0.0, tolerance=0.0, max_range=9, shading="none", record=0.06
    )
    targets = EchoTargets(scene, wind=EchoWind(scene, sways))
    found = ping(targets, sonar, AIR, pose=replace(posed(sonar), time=time))
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
    sonar = Sonar(position=(0, 0, 0), max_range=9, shading="none")
    culled(targets, sonar, 0.05, pose=replace(posed(sonar), time=0.8))


class Shifted(Sways):
    """All of tree 3 in one piece that is shifted along x by (m, m/s) of a time."""

    def __init__(self, shift):
        super().__init__()
        self.shift = shift

    def moment(self, _tree, time):
        place, rate = np.tile(np.eye(3, 4), (1, 1, 1)), np.zeros((1, 3, 4))
        place[0, 0, 3], rate[0, 0, 3] = self.shift(time)
        return place, rate

    def pieces(self, _tree, mesh):
        return np.zeros(len(mesh.triangles), np.int64)

    def pieces_at(self, _tree, points, _leaf):
        return np.zeros(len(points), np.int64)


@pytest.mark.parametrize(("away", "own"), [(-3.0, 0.0), (0.0, 5.0), (0.5, 5.0), (8.0, 0.0)])
def test_doppler_of_what_goes_straight_away(away, own):
    """(c + v)(c − u)/((c − v)(c + u)): the sonar nears at v, the leaf recedes at u."""

    mesh = square_leaves(np.zeros((1, 3)), np.array([[1.0, 0, 0]]), 0.04)
    scene = scene_of(mesh, np.column_stack([np.eye(3), (4.0, 0, 0)]))
    sonar = Sonar(
        position=(0, 0, 0), speed=own, max_range=9, shading="none", call="fm", doppler=True
    )
    straight = Shifted(lambda time: (away * time, away))
    found = ping(EchoTargets(scene, wind=EchoWind(scene, straight)), sonar, AIR)
    (group,) = found.groups
    alpha = factors(group, Station(sonar, AIR, posed(sonar), Equipment.of(sonar)), 0)
    expected = (C + own) * (C - away) / ((C - own) * (C + away))
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
    size = SWINGS * 1e-3
    swing = Shifted(lambda t: (size * np.sin(TONE * t), size * TONE * np.cos(TONE * t)))
    targets = EchoTargets(scene, wind=EchoWind(scene, swing))
    pose = replace(posed(sonar), time=0.02)
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


def test_truth_tells_where_leaves_rest(tmp_path):
    mesh, sways = crown(300), Sways(True)
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
    *_, file = write_echo(tmp_path, sonar.changed(contributions=True), echo, (100.0, 0, 0))
    with np.load(file) as kept:
        assert np.allclose(kept["rest"], heard.rest + np.array([100.0, 0.0, 0.0]))
        assert np.array_equal(kept["velocity"], heard.velocity)
    still = ping(EchoTargets(scene), sonar, AIR)
    assert still.heard.rest is None
    *_, file = write_echo(tmp_path, sonar.changed(contributions=True), still)
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


# ------------------------------------------------------------------------------------------- shading
# Shading: Beer-Lambert through leaves by rays, trunks as hard edges, both.


def haze(count: int, side: float, seed: int = 0, facing: bool = False) -> TriMesh:
    """Leaves at random in a box 2 to 3 m ahead, 1.2 m wide."""
    rng = np.random.default_rng(seed)
    centre = rng.uniform([2, -0.6, -0.6], [3, 0.6, 0.6], (count, 3))
    normal = np.tile([1.0, 0, 0], (count, 1)) if facing else rng.normal(size=(count, 3))
    return square_leaves(centre, normal, side, seed)


def depths(mesh: TriMesh, distance: float, spread: int = 9) -> np.ndarray:
    sonar = Sonar(position=(0, 0, 0))
    station = Station(sonar, AIR, posed(sonar), Equipment.of(sonar))
    angles = (np.arange(spread) - spread // 2) * CELL / 2
    az, el = (grid.ravel() for grid in np.meshgrid(angles, angles))
    caster = BruteCaster(scene_of(mesh))
    far = np.full(len(az), distance - 1e-3)
    return -np.log(Extinction(caster, station).transmission(np.stack([az, el]), far))


@pytest.mark.medium
@pytest.mark.parametrize(("facing", "g"), [(True, 1.0), (False, 0.5)])
def test_optical_depth_is_projected_leaf_area_on_the_way(facing: bool, g: float) -> None:
    """τ = G·u·s: 1 for leaves face-on, ½ for leaves any way round; within four standard errors."""
    count, side = 1000, 0.05
    mesh = haze(count, side, facing=facing)
    whole = g * count * side**2 / 1.2**2  # leaf area over the area of the box, along x
    error = 4 * math.sqrt(whole / (49 * 16 / 4))
    for distance, share in ((1.9, 0.0), (2.5, 0.5), (4.0, 1.0)):
        found = depths(mesh, distance, spread=7).mean()
        assert found == pytest.approx(share * whole, abs=share * error)


@pytest.mark.medium
def test_two_ways_weaken_the_pressure_by_the_depth() -> None:
    """A target behind a wall of leaves: e^{-τ}, and nothing is lost in front of it."""
    screen = haze(800, 0.05, facing=True)
    target = square_leaves(
        np.array([[4.0, 0, 0], [1.5, 0.3, 0]]), np.array([[1.0, 0, 0]] * 2), 0.05
    )
    targets = EchoTargets(scene_of(join([screen, target])))
    caster = BruteCaster(targets.scene)
    settings = {"position": (0, 0, 0), "cull": 0.0}
    clear = ping(targets, Sonar(shading="none", **settings), AIR)
    dim = ping(targets, Sonar(shading="extinction", **settings), AIR, everything=caster)

    assert amplitude_of(dim, 801) == pytest.approx(amplitude_of(clear, 801), rel=1e-9)
    depth = -math.log(amplitude_of(dim, 800) / amplitude_of(clear, 800))
    assert depth == pytest.approx(depths(screen, 4.0, spread=1)[0], rel=1e-3)
    with pytest.raises(ValueError, match="needs rays"):
        ping(targets, Sonar(shading="extinction", **settings), AIR)


@pytest.mark.medium
def test_trunks_and_leaves_together() -> None:
    board = TriMesh.of_part(
        np.array([(3.5, -5, -5), (3.5, 0, -5), (3.5, 0, 9), (3.5, -5, 9)], np.float64),
        np.array([[0, 1, 2], [0, 2, 3]]),
        WOOD,
    )
    behind = square_leaves(
        np.array([[4.0, 0.2, 0], [4.0, -0.2, 0]]), np.array([[1.0, 0, 0]] * 2), 0.05
    )
    mesh = join([board, haze(800, 0.05, facing=True), behind])
    targets = EchoTargets(scene_of(mesh))
    everything, wood = BruteCaster(targets.scene), BruteCaster(targets.scene.solid())
    settings = {"position": (0, 0, 0), "cull": 0.0, "wood": False}
    both = ping(
        targets,
        Sonar(shading="trunks+extinction", **settings),
        AIR,
        wood,
        everything=everything,
    )
    assert both.hidden == 1
    leaf = {int(n): a for n, a in zip(both.heard.number, both.heard.amplitude, strict=True)}
    assert 801 not in leaf
    clear = ping(targets, Sonar(shading="none", **settings), AIR)
    whole = {int(n): a for n, a in zip(clear.heard.number, clear.heard.amplitude, strict=True)}
    assert leaf[800] < 0.9 * whole[800]


def pinged(targets: EchoTargets, **settings: object) -> Echo:
    base = {"position": (0, 0, 0), "wood": False, "shading": "extinction", "tolerance": 0.0}
    return ping(targets, Sonar(**{**base, **settings}), AIR, everything=BruteCaster(targets.scene))


@pytest.mark.medium
@pytest.mark.parametrize("cull", [1e-2, 0.1])
def test_culling_keeps_its_promise_behind_a_thicket(cull: float) -> None:
    """Loud leaves behind a dense screen; what is left out is weak only until they are shaded."""
    rng = np.random.default_rng(4)
    screen_at = rng.uniform([2, -0.3, -0.3], [2.5, 0.3, 0.3], (120, 3))
    loud_at = rng.uniform([4, -0.2, -0.2], [5, 0.2, 0.2], (20, 3))
    faint_at = rng.uniform([2.5, 0.9, -0.3], [3, 1.2, 0.3], (150, 3))  # beside it, off the beam
    ahead = np.array([[1.0, 0, 0]])
    mesh = join(
        [
            square_leaves(screen_at, ahead + np.zeros((120, 1)), 0.1),
            square_leaves(loud_at, ahead + np.zeros((20, 1)), 0.1),
            square_leaves(faint_at, rng.normal(size=(150, 3)), 0.03),
        ]
    )
    targets = EchoTargets(scene_of(mesh))
    beam = {"beam_width_deg": (25.0, 25.0), "shading": "extinction"}
    sonar = Sonar(position=(0, 0, 0), wood=False, **beam)
    culled(targets, sonar, cull, everything=BruteCaster(targets.scene))


@pytest.mark.parametrize(("side", "passes"), [(0.02, (0.5, 1.0)), (0.6, (0.0, 1e-3))])
def test_a_leaf_larger_than_the_fresnel_zone_casts_a_shadow(side: float, passes) -> None:
    """Half way to a leaf at 4 m the zone's radius is 7 cm: leaves of 1 cm do next to nothing."""
    at = np.array([[2.0, 0.05, 0.05], [4.0, 0.1, 0.1]])
    screen = square_leaves(at[:1], np.array([[1.0, 0, 0]]), side)
    target = square_leaves(at[1:], np.array([[1.0, 0, 0]]), 0.05)
    targets = EchoTargets(scene_of(join([screen, target])))
    dim, clear = (
        amplitude_of(pinged(targets, cull=0.0, shading=way), 1) for way in ("extinction", "none")
    )
    assert passes[0] <= dim / clear <= passes[1]


def test_a_leaf_does_not_shade_itself() -> None:
    """Tilted, its upper half stands before its middle."""
    leaf = square_leaves(np.array([[3.0, 0.05, 0.05]]), np.array([[1.0, 0, 1.0]]), 0.3)
    targets = EchoTargets(scene_of(leaf))
    dim, clear = (pinged(targets, cull=0.0, shading=way) for way in ("extinction", "none"))
    np.testing.assert_allclose(dim.spectrum, clear.spectrum, rtol=1e-12)


# -------------------------------------------------------------------------------------------- audit
# An echo's audit: silent on what is right, loud on what is wrong or was left out.

STILL_AIR = Air()
SMOOTH = 2e-5  # of Σ max|A|, that splines of the exact disc are smooth to, all in phase
BAT = Sonar(position=(0, 0, 0), shading="none", beam_width_deg=(90, 90))


def targets(count=400):
    rng = stream(2, "audit")
    middle = rng.uniform([2, -1, -1], [4, 1, 1], (count, 1, 3))
    corners = middle + rng.normal(0, 0.03, (count, 3, 3))
    mesh = TriMesh.of_part(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), LEAF)
    return EchoTargets(scene_of(replace(mesh, leaf=np.arange(count, dtype=np.int32))))


def audit(echo, sonar, share=0.3, things=None):
    given = (
        [echo],
        [echo.pose],
        things or targets(),
        sonar,
        STILL_AIR,
        None,
        None,
        Equipment.of(sonar),
    )
    return held(parts_of_echoes(Pings(*given), share), stream(1, "a"), 1.0)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("tolerance", "cull", "model"),
    [(1e-2, 0.0, "exact"), (1e-6, 1e-2, "piston"), (1e-8, 1e-2, "exact"), (1e-8, 0.0, "piston")],
)
def test_what_is_right_is_kept(tolerance, cull, model):
    sonar = BAT.changed(tolerance=tolerance, cull=cull, leaf_model=model)
    found = audit(ping(targets(), sonar, STILL_AIR), sonar, share=0.05)
    assert found.kept, str(found)
    least = SMOOTH if model == "exact" else 0.0
    assert spectrum(found).allowed <= max(tolerance, least) + cull + 1e-11
    assert found.checked >= 4


def test_what_was_left_out_without_leave_is_found():
    """An echo that culled a tenth where a ten-thousandth was allowed."""
    sonar = BAT.changed(cull=0.1, beam_width_deg=(20, 20))
    echo = ping(targets(), sonar, STILL_AIR)
    assert echo.cull_bound > 1e-3
    assert not audit(echo, sonar.changed(cull=1e-4), share=2.0).kept


def test_a_short_ping_is_not_looked_for_again():
    """Some bins, not the search for all that could be heard."""
    sonar = BAT.changed(cull=1e-3)
    found = spectrum(audit(ping(targets(), sonar, STILL_AIR), sonar, share=1e-3))
    assert "everything heard" in found.what
    assert found.allowed <= 1.5 * sonar.tolerance


def spectrum(found):
    """The check of a spectrum."""
    return next(check for check in found.checks if "bins of the spectrum" in check.what)


@pytest.mark.slow
def test_waveforms_of_a_moving_sonar_are_looked_at():
    sonar = BAT.changed(call="fm", doppler=True)
    pose = posed(sonar)
    few = targets(12)
    echo = ping(few, sonar, STILL_AIR, pose=replace(pose, velocity=12.0 * pose.frame[0]))
    assert audit(echo, sonar, 0.05, few).kept
    for name in ("waveforms", "called", "responses", "envelopes"):
        louder = {name: 1.01 * getattr(echo, name)}
        assert not audit(replace(echo, **louder), sonar, 0.05, few).kept, name


def test_silence_is_right():
    far = BAT.changed(max_range=1.0)
    assert audit(ping(targets(), far, STILL_AIR), far, share=0.0).error == 0


def test_one_facet_far_off_is_heard_to_the_last_digits_of_its_phase():
    """Two float64 sums of an echo of 10⁵ cycles differ by more than 1e-12 of it; more than that is found."""
    corners = np.array([(160, 0, 0), (160, 0.02, 0), (160.007, 0, 0.02)])
    mesh = TriMesh.of_part(corners, np.arange(3)[None], LEAF)
    obj = EchoTargets(scene_of(replace(mesh, leaf=np.zeros(1, dtype=np.int32))))
    sonar = replace(BAT, tolerance=0.0, cull=0.0, max_range=200.0)
    echo = ping(obj, sonar, STILL_AIR)
    assert audit(echo, sonar, things=obj).kept
    turned = replace(echo, spectra=echo.spectra * np.exp(1e-9j))
    assert not spectrum(audit(turned, sonar, things=obj)).kept
