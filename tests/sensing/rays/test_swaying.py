"""Rays among pieces that move: closed forms of a plate and a pole, engines of single pieces, and time."""

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import OTHER, WOOD, TriMesh, join
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.moving import KNOTS, SPAN, MovingScene
from forest_addon.sensing.moving_rays import MovingCaster
from forest_addon.sensing.rays.boxes import extents, within
from forest_addon.sensing.rays.caster import Hits, RayCaster
from forest_addon.sensing.rays.cells import Cells, walk
from forest_addon.sensing.rays.exact import ExactCaster, Referee
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.rays.paths import RigidPath, SceneMotion

SPEED, TURN = 0.8, 0.3  # m/s along x, rad/s about y
FAR = 10.0


class Lean:
    """A tree in two pieces: below z = 0 it stands, above it moves along x and its way bends with x."""

    number = {7: 0}  # noqa: RUF012

    def moves(self, tree):
        return tree == 0

    def pieces(self, _tree, mesh):
        return (mesh.vertices[mesh.triangles].mean(axis=1)[:, 2] > 0).astype(np.int64)

    def places(self, _tree, knot):
        time = np.asarray(knot) / KNOTS
        found = np.tile(np.eye(3, 4), (len(time), 2, 1, 1))
        found[:, 1, 0, 3] = -SPEED * time
        found[:, 1, 0, 2] = TURN * time  # leans, without turning: what is linear in time
        return found

    def most(self, _tree, _low, _high, _knot=None):
        return 1e3


def plate():
    """A wall across x of 2 m in rows of 0.1 m, its upper half a piece of its own."""
    z = np.linspace(-1, 1, 21)
    corners = np.stack(
        [np.column_stack([0 * z, 0 * z - 1, z]), np.column_stack([0 * z, 0 * z + 1, z])], axis=1
    )
    first = 2 * np.arange(20)[:, None]
    rows = np.concatenate([first + np.array(way) for way in ((0, 1, 3), (0, 3, 2))])
    return TriMesh.of_part(corners.reshape(-1, 3), rows, WOOD)


def scene(mesh, tree=7):
    wall = TriMesh.of_part(
        np.array([[40.0, -99, -99], [40, 99, -99], [40, 0, 99]]), np.array([[0, 1, 2]]), OTHER
    )
    place = np.stack([np.eye(3, 4), np.eye(3, 4)])
    place[0, 0, 3] = FAR
    return SceneGeometry(
        (mesh, wall),
        place,
        np.array([0, 1]),
        ("tree", "wall"),
        np.array([tree, -1]),
        np.array([0, -1]),
    )


def caster(geometry, sway=None):
    return MovingCaster(MovingScene(geometry, sway=sway or Lean()), ExactCaster)


def fan(count=400, seed=1):
    rng = np.random.default_rng(seed)
    aim = np.column_stack([np.full(count, FAR), rng.uniform(-1.2, 1.2, (count, 2))])
    return (
        np.zeros((count, 3)),
        aim / np.linalg.norm(aim, axis=1, keepdims=True),
        rng.uniform(0, 4, count),
    )


def test_a_leaning_plate_is_met_where_it_is():
    """x = FAR + (TURN t) z - SPEED t above z = 0: a plane, so the range is a closed form."""
    rays = caster(scene(plate()))
    origin, way, time = fan()
    hits = rays.cast(origin, way, time=time)
    # x = FAR - SPEED t + TURN t z with x = s wx, z = s wz
    upper = (FAR - SPEED * time) / (way[:, 0] - TURN * time * way[:, 2])
    lower = FAR / way[:, 0]
    top, side = upper * way[:, 2], np.abs(upper * way[:, 1])
    meets_upper = (top > 0) & (top < 1) & (side < 1)
    meets_lower = (
        (lower * way[:, 2] <= 0) & (lower * way[:, 2] > -1) & (np.abs(lower * way[:, 1]) < 1)
    )
    expected = np.where(meets_upper, upper, np.where(meets_lower, lower, 40.0 / way[:, 0]))
    edge = (np.abs(top) < 0.01) | (np.abs(top - 1) < 0.01) | (np.abs(side - 1) < 0.01)
    edge |= np.abs(np.abs(lower * way[:, 1]) - 1) < 0.01
    edge |= np.abs(lower * way[:, 2] + 1) < 0.01
    # Both neighbours have the triangles of the seam, 0.1 m to both sides of z = 0.
    sure = ~edge & ~((np.abs(top) < 0.12) | (np.abs(lower * way[:, 2]) < 0.12))
    assert meets_upper[sure].sum() > 50
    assert meets_lower[sure].sum() > 50
    assert np.abs(hits.distance - expected)[sure].max() < 1e-9
    points = hits.distance[:, None] * way
    velocity, rest = rays.moving.velocities(points, hits.instance, hits.triangle, time)
    ours = sure & meets_upper
    closed = np.zeros((ours.sum(), 3))
    closed[:, 0] = -SPEED + TURN * points[ours, 2]
    assert np.abs(velocity[ours] - closed).max() < 1e-9
    assert np.abs(rest[ours, 0] - FAR).max() < 1e-9
    assert not velocity[sure & ~meets_upper].any()
    instance, triangle = rays.moving.known(hits.instance, hits.triangle)
    assert set(instance[sure].tolist()) == {0, 1}
    middle = plate().vertices[plate().triangles[triangle[ours]]].mean(axis=1)
    assert np.abs(middle[:, 2] - rest[ours, 2]).max() < 0.07


def test_chained_rays_and_limits():
    """What is left is not met again, what is beyond or before a limit does not count."""
    rays, (origin, way, time) = caster(scene(plate())), fan()
    hits = rays.cast(origin, way, time=time)
    first = np.flatnonzero(hits.distance < 20)
    behind = rays.cast(
        origin[first],
        way[first],
        time=time[first],
        min_distance=hits.distance[first],
        leaving=hits.select(first),
    )
    assert (behind.distance > hits.distance[first]).all()
    assert np.isclose(behind.distance, 40.0 / way[first, 0]).mean() > 0.7  # the seam is twice there
    near = rays.cast(origin, way, hits.distance - 1e-6, time=time)
    assert not near.found[first].any()
    over = rays.cast(origin, way, time=time, min_distance=15.0)
    assert (over.distance > 15).all()
    nowhere = rays.cast(np.full((3, 3), np.nan), np.eye(3), time=np.zeros(3))
    assert not nowhere.found.any()


def test_trees_of_other_numbers_and_dead_ones_stand():
    origin, way, time = fan()
    stands = caster(scene(plate(), tree=3))
    plain = ExactCaster(scene(plate())).cast(origin, way)
    assert np.array_equal(stands.cast(origin, way, time=time).distance, plain.distance)


@pytest.mark.medium
def test_no_ray_slips_between_pieces_of_a_pole():
    """A closed tube bends in eight pieces: rays at its axis meet its near side, never the inside of it."""

    class Bend(Lean):
        def pieces(self, _tree, mesh):
            z = mesh.vertices[mesh.triangles].mean(axis=1)[:, 2]
            return np.clip((z + 4).astype(np.int64), 0, 7)

        def places(self, _tree, knot):
            time = np.asarray(knot)[:, None] / KNOTS
            found = np.tile(np.eye(3, 4), (len(time), 8, 1, 1))
            tilt = 0.004 * np.arange(8) * np.sin(time)  # a rotation about y, to first order
            found[:, :, 0, 2], found[:, :, 2, 0] = tilt, -tilt
            found[:, :, 0, 3] = -np.cumsum(
                np.diff(tilt, axis=1, prepend=0) * (np.arange(8) - 4), axis=1
            )
            return found

    line = np.column_stack([np.zeros((33, 2)), np.linspace(-4, 4, 33)])
    mesh = TriMesh.of_part(*tube(line, np.full(33, 0.2), 24), WOOD)
    rays = caster(scene(mesh), Bend())
    rng = np.random.default_rng(5)
    time = np.sort(rng.uniform(0.5, 1.5, 20_000))
    aim = np.column_stack(
        [np.full(len(time), FAR), np.zeros(len(time)), rng.uniform(-3.5, 3.5, len(time))]
    )
    origin = np.column_stack([np.zeros((len(time), 2)), aim[:, 2]])
    hits = rays.cast(origin, aim - origin, time=time)
    assert np.abs(hits.distance - (FAR - 0.2)).max() < 0.1


def test_a_tree_that_sways_does_nothing_else():
    """What is read of it at other times, as of an object that moves, would stand beside it a second time."""
    read = scene(plate())
    moves = RigidPath(np.array([0.0, 4.0]), np.stack([np.eye(3, 4), np.ones((3, 4))]))
    motion = SceneMotion(
        {0: moves, 2: moves}, spans={0: (0.0, 1.0)}, stands_for=np.array([0, 1, 0])
    )
    whole = read.take(np.array([0, 1, 0]))
    both = MovingCaster(MovingScene(read, motion, whole, Lean()), ExactCaster)
    origin, way, time = fan()
    met, alone = both.cast(origin, way, time=time), caster(read).cast(origin, way, time=time)
    np.testing.assert_array_equal(met.distance, alone.distance)
    then = both.moving.snapshot(2.0)
    np.testing.assert_array_equal(then.transform[0], read.transform[0])
    triangles = [len(then.meshes[mesh].triangles) for mesh in then.mesh_index]
    assert triangles == [len(plate().triangles), 1, 0]


def test_windows_join():
    """On both sides of the end of a window a plate is at the same place."""
    rays = caster(scene(plate()))
    end = SPAN / KNOTS
    time = np.array([end - 1e-12, end, end + 1e-12])
    way = np.tile([1.0, 0.0, 0.05], (3, 1))
    found = rays.cast(np.zeros((3, 3)), way, time=time).distance
    assert np.ptp(found) < 1e-9


@pytest.mark.parametrize("parts", [1, 3])
def test_labels_go_with_pieces(parts):
    one = plate()
    mesh = join([one] * parts)
    pieces = MovingScene(scene(mesh), sway=Lean()).pieces
    assert len(pieces.owner) == 2
    for own, rows in zip(pieces.meshes, pieces.triangle, strict=True):
        assert np.array_equal(own.vertices[own.triangles], mesh.vertices[mesh.triangles[rows]])


def test_what_stands_still_holds_nothing_of_trees_that_sway():
    """Tables of what moves hold all that sways: held twice, it would take the memory of all leaves."""
    assert len(MovingScene(scene(plate()), sway=Lean()).still.part) == 1  # the wall


def test_the_copies_of_a_triangle_at_a_seam_are_known_to_each_other():
    moving = MovingScene(scene(plate()), sway=Lean())
    pieces = moving.pieces
    size = [len(mesh.triangles) for mesh in pieces.meshes]
    piece, triangle = np.repeat(np.arange(2), size), np.concatenate([np.arange(n) for n in size])
    row, *copies = pieces.copies(piece, triangle)
    assert len(row) == 2 * 4 * 2  # two rows of the plate on both sides of the seam, in both pieces
    assert np.array_equal(copies[0].reshape(-1, 2), np.tile([0, 1], (8, 1)))
    own = moving.known(moving.count + piece[row], triangle[row])
    assert np.array_equal(own, moving.known(moving.count + copies[0], copies[1]))


def test_no_bundle_passes_by_a_box_that_its_ways_meet():
    rng = np.random.default_rng(4)
    begin, end = rng.normal(0, 5, (2, 300, 3))
    share = rng.uniform(0, 1, (300, 1))
    middle = begin + share * (end - begin)
    low, high = middle - rng.uniform(0, 2, (300, 3)), middle + rng.uniform(0, 2, (300, 3))
    for row in range(300):
        alone = extents(begin[[row]], end[[row]])
        assert within(low[[row]] - 1e-9, high[[row]] + 1e-9, alone).all()
    beside = low + 0.5, high + 0.5  # half a metre off along each axis, 0.87 m in all
    near = extents(begin, end) + np.array([[-0.9], [0.9]])
    assert within(*beside, near).all()
    far = extents(begin[:1], end[:1])
    assert not within(middle[:1] + 40, middle[:1] + 41, far).any()


# --------------------------------------------------------------------------------------------- cells
# Cells on a line against the interval that the line has in each cell of the box, all cells tried.


def brute(cells, origin, way, reach):
    """{number of a cell: (enter, leave)} of one line, longer than rounding."""
    grid = np.indices(cells.size).reshape(3, -1).T
    low = (cells.low + grid) * cells.edge
    with np.errstate(divide="ignore", invalid="ignore"):
        a, b = (low - origin) / way, (low + cells.edge - origin) / way
    inside = (origin >= low) & (origin < low + cells.edge)
    near = np.where(way == 0, np.where(inside, -np.inf, np.inf), np.minimum(a, b))
    far = np.where(way == 0, np.where(inside, np.inf, -np.inf), np.maximum(a, b))
    enter, leave = np.maximum(near.max(axis=1), 0), np.minimum(far.min(axis=1), reach)
    return {n: (enter[n], leave[n]) for n in np.flatnonzero(leave - enter > 1e-9).tolist()}


def test_lines_pass_the_cells_they_should():
    rng = stream(2, "walk")
    cells = Cells(np.array([-3, 2, 0]), np.array([7, 5, 6]), 0.4)
    origins = rng.uniform(-4, 6, (120, 3))
    ways = rng.normal(0, 1, (120, 3))
    ways[:20, 0] = 0  # along walls
    ways[:10, 1] = 0
    origins[20:100] = rng.uniform([-1.2, 0.8, 0], [1.6, 2.8, 2.4], (80, 3))  # from within
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    reach = rng.uniform(0.5, 12, 120)
    found = {}
    for step in walk(cells, origins, ways, reach):
        for line, cell, enter, leave in zip(
            *(step.line.tolist(), step.cell.tolist(), step.enter, step.leave), strict=True
        ):
            if leave - enter > 1e-9:
                assert (line, cell) not in found
                found[line, cell] = (enter, leave)
    wanted = {
        (line, cell): ends
        for line in range(120)
        for cell, ends in brute(cells, origins[line], ways[line], reach[line]).items()
    }
    assert found.keys() == wanted.keys()
    assert len(wanted) > 200
    for key, ends in wanted.items():
        assert np.allclose(found[key], ends, atol=1e-9)


def test_no_cells_and_no_lines():
    none = Cells.around(np.empty((0, 3), int), 0.5)
    assert not list(walk(none, np.zeros((1, 3)), np.eye(3)[:1], np.ones(1)))
    box = Cells.around(np.array([[0, 0, 0], [2, 2, 2]]), 0.5)
    assert box.count == 27
    assert not list(walk(box, np.empty((0, 3)), np.empty((0, 3)), np.empty(0)))
    assert box.at(np.array([[0.1, 0.1, 0.1], [9.0, 0, 0], [-0.1, 0, 0]])).tolist() == [0, -1, -1]


# ------------------------------------------------------------------------------------------- referee
# The judge between an engine and float64: what it excuses beside an edge, and what not.


def roof(far=0.0):
    """Two faces that meet in the ridge x = 0, z = 0, and fall away at 45°; and such another far away."""
    vertices = np.array([(0, -1, 0), (0, 1, 0), (1, 0, -1), (-1, 0, -1.0)])
    mesh = TriMesh.of_part(vertices, np.array([[0, 1, 2], [1, 0, 3]]), OTHER)
    place = np.tile(np.eye(3, 4), (2, 1, 1))
    place[1, 0, 3] = far
    none = np.full(2, -1)
    return SceneGeometry((mesh,), place, np.zeros(2, int), ("near", "far"), none, none)


class Beside(RayCaster):
    """An engine that names the left face of the roof, at its plane, whatever a ray meets."""

    engine = "beside"

    def __init__(self, scene):
        self.scene = scene

    def cast(self, origins, directions, max_distance=np.inf, **_):
        count = len(origins)
        there = origins[:, 2] - origins[:, 0]  # of the plane z = x, straight down
        named = np.zeros(count, np.int64), np.ones(count, np.int64)
        return Hits(there, *named, np.zeros((count, 3)))


@pytest.mark.parametrize(
    ("far", "aside", "excused"),
    [
        (5.0, 3e-6, True),  # metres from the ridge
        (5.0, 1e-4, False),
        (2000.0, 1e-4, True),  # a float32 has steps of 6e-5 m at half of that
        (2000.0, 1e-3, False),
    ],
)
def test_the_face_beside_an_edge_counts_where_single_precision_does_not_tell(far, aside, excused):
    """A ray meets the right face, and the engine names the left one, whose plane is 2 * aside nearer."""
    scene = roof(far)
    origins, ways = np.array([[aside, 0.1, 3.0]]), np.array([[0.0, 0.0, -1.0]])
    true = ExactCaster(scene).cast(origins, ways)
    assert (true.instance[0], true.triangle[0]) == (0, 0)
    assert true.distance[0] == pytest.approx(3 + aside, abs=1e-12)
    found = Referee(Beside(scene)).cast(origins, ways)
    assert found.triangle[0] == (1 if excused else 0)
    assert found.distance[0] == pytest.approx(3 - aside if excused else 3 + aside, abs=1e-12)
