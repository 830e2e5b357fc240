"""Trunks from cut meshes, against analytic cylinders, cones and leaning stems."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import special

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import LEAF, OTHER, WOOD, TriMesh, join
from forest_addon.sensing.rays.geometry import SceneGeometry
from forest_addon.sensing.reverb.trunks import (
    convex_hull,
    equivalent_circle,
    largest_radii,
    trunks_at_height,
)


def tube(
    start: tuple[float, float, float],
    end: tuple[float, float, float],
    radius: tuple[float, float],
    sides: int = 24,
    part: int = WOOD,
) -> TriMesh:
    """An open n-gon tube whose rings have the perimeter of the circle, as ``growth/mesh/meshing`` makes."""
    foot, top = np.asarray(start, float), np.asarray(end, float)
    axis = (top - foot) / np.linalg.norm(top - foot)
    across = np.cross(axis, [0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * np.cross(axis, across)
    ring *= math.pi / (sides * math.sin(math.pi / sides))
    vertices = np.concatenate([foot + radius[0] * ring, top + radius[1] * ring])
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    triangles = np.concatenate(
        [np.stack([i, j, j + sides], 1), np.stack([i, j + sides, i + sides], 1)]
    )
    return TriMesh.of_part(vertices, triangles, part)


def scene_of(*meshes: TriMesh, transform: np.ndarray | None = None) -> SceneGeometry:
    count = len(meshes)
    moved = np.tile(np.eye(3, 4), (count, 1, 1)) if transform is None else transform
    return SceneGeometry(
        meshes=tuple(meshes),
        transform=moved,
        mesh_index=np.arange(count),
        object_name=tuple("tree" for _ in meshes),
        tree=np.arange(count) + 7,
        species=np.zeros(count, np.int64),
    )


def turn_about_x(angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])


@pytest.mark.parametrize("sides", [3, 8, 24])
def test_upright_cylinder(sides: int) -> None:
    trunks = trunks_at_height(scene_of(tube((2, 3, 0), (2, 3, 5), (0.2, 0.2), sides)), 1.5, 0.01)
    np.testing.assert_allclose(trunks.position, [[2, 3]], atol=1e-14)
    np.testing.assert_allclose(trunks.radius, [0.2], rtol=1e-14)
    assert (trunks.tree.tolist(), trunks.thin, trunks.inside) == ([7], 0, 0)


def test_cone_under_instance_transforms() -> None:
    cone = tube((0.1, -0.2, 0), (0.1, -0.2, 4), (0.4, 0.0), 64)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    transform = np.zeros((3, 3, 4))
    transform[0, :, :3], transform[0, :, 3] = 2.0 * turn, (5, 6, -1)
    transform[1, :, :3], transform[1, :, 3] = np.diag([1.0, 1.0, -1.0]), (4e5, 5e6, 3.0)  # mirrored
    transform[2, :, :3] = np.diag([1.0, 1.0, 0.0])  # flattened into the ground: never cut
    scene = SceneGeometry(
        (cone,), transform, np.zeros(3, np.int64), ("a",) * 3, np.array([4, -1, 9]), np.zeros(3)
    )
    trunks = trunks_at_height(scene, 1.0, 0.01)
    assert trunks.tree.tolist() == [4, -1]
    assert trunks.instance is not None
    assert trunks.instance.tolist() == [0, 1]
    np.testing.assert_allclose(trunks.position[0], [5 + 2 * 0.2, 6 + 2 * 0.1], atol=1e-12)
    np.testing.assert_allclose(trunks.position[1], [4e5 + 0.1, 5e6 - 0.2], atol=1e-8)
    # Chord against slant height bends the section of a cone of many sides by next to nothing.
    np.testing.assert_allclose(trunks.radius, [2 * 0.4 * 0.75, 0.4 * 0.5], rtol=1e-8)


@pytest.mark.parametrize("lean_deg", [5.0, 30.0, 60.0])
def test_leaning_cylinder_keeps_its_radius(lean_deg: float) -> None:
    transform = np.zeros((1, 3, 4))
    transform[0, :, :3] = turn_about_x(math.radians(lean_deg))
    transform[0, :, 3] = 1.0, 2.0, 0.0
    scene = scene_of(tube((0, 0, -9), (0, 0, 9), (0.15, 0.15), 48), transform=transform)
    trunks = trunks_at_height(scene, 1.5)
    np.testing.assert_allclose(trunks.radius, [0.15], rtol=1e-12)
    reach = -1.5 * math.tan(math.radians(lean_deg))
    np.testing.assert_allclose(trunks.position, [[1.0, 2.0 + reach]], atol=1e-12)


def test_elliptic_trunk_has_its_mean_width() -> None:
    transform = np.zeros((1, 3, 4))
    transform[0, :, :3] = np.diag([2.0, 1.0, 1.0])
    scene = scene_of(tube((0, 0, 0), (0, 0, 4), (0.1, 0.1), 512), transform=transform)
    perimeter = 4 * 0.2 * special.ellipe(1 - 0.5**2)
    np.testing.assert_allclose(
        trunks_at_height(scene, 2.0).radius, [perimeter / (2 * np.pi)], rtol=1e-4
    )


def test_plane_through_vertices() -> None:
    """A ring of vertices exactly in the plane neither splits nor loses a stem, nor doubles it."""
    scene = scene_of(
        join([tube((0, 0, 0), (0, 0, 2), (0.2, 0.2)), tube((0, 0, 2), (0, 0, 3), (0.2, 0.2))])
    )
    np.testing.assert_allclose(trunks_at_height(scene, 2.0).radius, [0.2], rtol=1e-14)
    np.testing.assert_allclose(trunks_at_height(scene, 3.0).radius, [0.2], rtol=1e-14)  # its top
    assert len(trunks_at_height(scene, 0.0)) == 0  # its foot
    assert len(trunks_at_height(scene, 3.0 + 1e-6)) == 0
    assert len(trunks_at_height(scene, -1e-6)) == 0


def test_one_vertex_in_the_plane() -> None:
    """A leaning tube whose ring touches the plane in single vertices stays one contour."""
    mesh = tube((0, 0, 0), (0.3, 0, 4), (0.2, 0.15), 16)
    inner = tube((0, 0, 0), (0.3, 0, 4), (0.2, 0.15), 16).vertices[20, 2]
    assert len(trunks_at_height(scene_of(mesh), float(inner))) == 1


def test_unwelded_triangles_are_one_contour() -> None:
    mesh = tube((0, 0, 0), (0, 0, 2), (0.2, 0.2))
    soup = TriMesh.of_part(
        mesh.vertices[mesh.triangles].reshape(-1, 3),
        np.arange(mesh.triangles.size).reshape(-1, 3),
        WOOD,
    )
    np.testing.assert_allclose(trunks_at_height(scene_of(soup), 1.0).radius, [0.2], rtol=1e-14)


def test_open_mesh() -> None:
    """A tube with a slit, and one with half its wall: the hull closes what is left."""
    mesh = tube((0, 0, 0), (0, 0, 2), (0.2, 0.2), 180)
    keep = np.ones(len(mesh.triangles), bool)
    keep[[10, 190]] = False
    np.testing.assert_allclose(
        trunks_at_height(scene_of(mesh.select(keep)), 1.0).radius, [0.2], rtol=1e-3
    )
    keep = np.tile(np.arange(180) < 90, 2)
    half = trunks_at_height(scene_of(mesh.select(keep)), 1.0)
    np.testing.assert_allclose(half.radius, [0.2 * (math.pi + 2) / (2 * math.pi)], rtol=1e-3)


def test_thin_and_inner_stems_are_counted() -> None:
    mesh = join(
        [
            tube((0, 0, 0), (0, 0, 4), (0.2, 0.2)),
            tube((0, 0, 0.5), (0.3, 0, 4), (0.05, 0.05)),  # a branch that is still in its trunk
            tube((1, 0, 0), (1, 0, 4), (0.02, 0.02)),
            tube((2, 0, 0), (2, 0, 4), (0.004, 0.004)),
            tube((3, 0, 0), (3, 0, 4), (0.3, 0.3), part=OTHER),
            tube((4, 0, 0), (4, 0, 4), (0.3, 0.3), part=LEAF),
        ]
    )
    trunks = trunks_at_height(scene_of(mesh), 1.0, 0.01)
    np.testing.assert_allclose(trunks.radius, [0.2, 0.02], rtol=1e-12)
    assert (trunks.thin, trunks.inside) == (1, 1)
    assert len(trunks_at_height(scene_of(mesh), 3.9, 0.01)) == 3  # the branch has left it


def test_nothing_to_cut() -> None:
    empty = TriMesh.of_part(np.empty((0, 3)), np.empty((0, 3)), WOOD)
    trunks = trunks_at_height(scene_of(empty), 1.0)
    assert (len(trunks), trunks.position.shape, trunks.tree.dtype) == (0, (0, 2), np.int64)


def test_broken_coordinates_are_passed_over() -> None:
    mesh = tube((0, 0, 0), (0, 0, 2), (0.2, 0.2), 180)
    mesh.vertices[5] = np.nan
    np.testing.assert_allclose(trunks_at_height(scene_of(mesh), 1.0).radius, [0.2], rtol=1e-3)


def test_hull_of_degenerate_points() -> None:
    assert convex_hull(np.empty((0, 2))).shape == (0, 2)
    assert convex_hull(np.zeros((4, 2))).tolist() == [[0, 0]]
    line = np.linspace(0, 1, 5)[:, None] * [2.0, 1.0]
    assert sorted(convex_hull(line).tolist()) == [[0, 0], [2, 1]]


def test_flat_sheet_is_a_strip_of_its_width() -> None:
    ends = np.array([[[0.0, 0], [0.5, 0]], [[0.5, 0], [1, 0]]])
    centre, radius = equivalent_circle(ends, np.tile([0.0, 1, 0], (2, 1)))
    np.testing.assert_allclose(centre, [0.5, 0])
    np.testing.assert_allclose(radius, 2 / (2 * math.pi))


@pytest.mark.parametrize("name", ["upright", "leaning", "flat", "open"])
def test_no_radius_is_above_its_bound(name):
    """Random outlines of a few to many segments, of tubes that stand, lean and lie, and of loose ends."""
    rng = stream(8, "contours", name)
    ends, normal, contour, radius = [], [], [], []
    for number in range(60):
        count = int(rng.integers(3, 40))
        turn = np.sort(rng.uniform(0, 2 * np.pi, count))
        ring = rng.uniform(0.01, 0.5) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        slant = {"upright": 0.0, "leaning": 0.6, "flat": 1.45, "open": 0.3}[name]
        across = np.array([np.cos(number), np.sin(number)])
        longer = ring + np.outer(ring @ across, across) * (1 / np.cos(slant) - 1)
        some = np.stack([longer, np.roll(longer, -1, axis=0)], axis=1)
        facing = np.concatenate([ring, np.zeros((count, 1))], axis=1)
        facing -= np.outer(ring @ across, [*across, 0]) * (1 - np.cos(slant))
        facing[:, 2] = -np.sin(slant) * (ring @ across)
        facing /= np.linalg.norm(facing, axis=1, keepdims=True)
        if name == "open":
            some += rng.normal(0, 0.05, some.shape)
        radius.append(equivalent_circle(some, facing)[1])
        ends.append(some)
        normal.append(facing)
        contour.append(np.full(count, number))
    every = (np.concatenate(ends), np.concatenate(normal), np.concatenate(contour))
    most = largest_radii(*every, 60)
    assert (most >= radius).all()
    if name == "upright":  # an octagon's perimeter is at most 1.28 of what it is drawn about
        assert (most <= 1.3 * np.array(radius)).all()


def test_wood_is_cut_alike_whether_it_is_kept_and_however_it_stands():
    leaning = tube((0, 0, 0), (0.3, 0.1, 9), (0.2, 0.1))
    upright, wood = scene_of(leaning, tube((2, 0, 0), (2, 0, 9), (0.1, 0.05))), {}
    almost = np.tile(np.eye(3, 4), (2, 1, 1))
    almost[:, 2, 0] = 1e-300  # not upright: every vertex is asked
    other = scene_of(*upright.meshes, transform=almost)
    for height in (1.0, 4.5, 7.0):
        found = [trunks_at_height(scene, height, 0.01) for scene in (upright, other)]
        found.append(trunks_at_height(upright, height, 0.01, wood))
        assert len(found[0]) == 2
        for one in found[1:]:
            assert np.array_equal(one.position, found[0].position)
            assert np.array_equal(one.radius, found[0].radius)
    assert len(wood) == 2
