"""Leaves as discs: exact under every transform."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from forest_addon.base.trimesh import LEAF, WOOD, TriMesh
from forest_addon.growth.mesh.leaves import measure_leaves
from forest_addon.sensing.rays.geometry import SceneGeometry, apply_transform
from forest_addon.sensing.sonar.leaves import LeafEchoes, leaf_discs


def leafy_mesh(flat: bool = True, count: int = 5) -> TriMesh:
    """Wood, and leaves of two triangles each, some of them wound the other way."""
    rng = np.random.default_rng(2)
    corners, triangles, leaf = [np.eye(3)], [[0, 1, 2]], [-1]
    for number in range(count):
        quad = rng.normal(size=(4, 3))
        if flat:
            quad[3] = quad[0] + quad[2] - quad[1]  # a parallelogram
        first = 3 + 4 * number
        corners.append(quad)
        triangles += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
        if number % 2:
            triangles[-1] = triangles[-1][::-1]
        leaf += [number, number]
    part = np.where(np.array(leaf) < 0, WOOD, LEAF).astype(np.int8)
    return TriMesh(
        np.concatenate(corners),
        np.array(triangles, np.int32),
        part,
        np.array(leaf, np.int32),
        np.zeros(len(leaf), np.int32),
    )


def scene_of(mesh: TriMesh, *transforms: np.ndarray) -> SceneGeometry:
    count = len(transforms)
    return SceneGeometry(
        (mesh,),
        np.array(transforms).reshape(-1, 3, 4),
        np.zeros(count, np.int64),
        ("tree",) * count,
        np.arange(count) + 3,
        np.zeros(count, np.int64),
    )


def transform(
    linear: np.ndarray, shift: tuple[float, float, float] = (1.0, -2.0, 0.5)
) -> np.ndarray:
    return np.column_stack([linear, shift])


def rotation() -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


SHEAR = np.array([[1.0, 0.5, 0.2], [0.0, 0.3, -1.0], [0.7, 0.0, 2.0]])
TRANSFORMS = {
    "identity": np.eye(3),
    "rotated": rotation(),
    "scaled": 0.37 * rotation(),
    "mirrored": np.diag([-1.0, 1.0, 1.0]) @ rotation(),
    "squeezed": np.diag([1.0, 0.2, 3.0]) @ rotation(),
    "sheared": SHEAR,
    "flattened": np.diag([1.0, 1.0, 0.0]),
}


@pytest.mark.parametrize("flat", [True, False])
@pytest.mark.parametrize("name", TRANSFORMS)
def test_same_as_measuring_the_moved_mesh(name: str, flat: bool) -> None:
    mesh = leafy_mesh(flat)
    moved = transform(TRANSFORMS[name])
    found = leaf_discs(scene_of(mesh, moved))
    world = TriMesh(
        apply_transform(moved, mesh.vertices), mesh.triangles, mesh.part, mesh.leaf, mesh.material
    )
    expected = measure_leaves(world)
    np.testing.assert_allclose(found.centre, expected.centre, atol=1e-12)
    np.testing.assert_allclose(found.radius, expected.radius, rtol=1e-11, atol=1e-15)
    if name != "flattened" and (flat or name in ("identity", "rotated", "scaled", "mirrored")):
        along = np.abs(np.einsum("li,li->l", found.normal, expected.normal))
        np.testing.assert_allclose(along, 1, rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.normal, axis=1), 1, rtol=1e-12)


def test_a_square_leaf_squeezed_along_its_side() -> None:
    square = np.array([(0, 0, 0), (0.1, 0, 0), (0.1, 0.1, 0), (0, 0.1, 0)], np.float64)
    mesh = TriMesh(
        square,
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        np.full(2, LEAF, np.int8),
        np.full(2, 41, np.int32),  # numbers may have gaps
        np.zeros(2, np.int32),
    )
    discs = leaf_discs(scene_of(mesh, transform(np.diag([4.0, 1.0, 7.0]), (0, 0, 0))))
    np.testing.assert_allclose(discs.radius, [math.sqrt(0.04 / math.pi)])
    np.testing.assert_allclose(discs.centre, [[0.2, 0.05, 0]])
    np.testing.assert_allclose(np.abs(discs.normal), [[0, 0, 1]], atol=1e-15)
    assert (discs.leaf[0], discs.instance[0], discs.tree[0]) == (41, 0, 3)


def test_instances_and_numbers() -> None:
    mesh = leafy_mesh()
    scene = scene_of(mesh, transform(np.eye(3)), transform(2 * np.eye(3)))
    discs = leaf_discs(scene)
    assert len(discs) == 10
    assert discs.leaf.tolist() == [0, 1, 2, 3, 4] * 2
    assert discs.instance.tolist() == [0] * 5 + [1] * 5
    assert discs.tree.tolist() == [3] * 5 + [4] * 5
    np.testing.assert_allclose(discs.radius[5:], 2 * discs.radius[:5])


def test_no_leaves_and_no_instances() -> None:
    wood = TriMesh.of_part(np.eye(3), np.array([[0, 1, 2]]), WOOD)
    assert len(leaf_discs(scene_of(wood, transform(np.eye(3)), transform(SHEAR)))) == 0
    assert leaf_discs(scene_of(wood)).centre.shape == (0, 3)


def test_leaf_without_area() -> None:
    mesh = leafy_mesh(count=2)
    mesh.vertices[3:7] = mesh.vertices[3]
    for linear in (np.eye(3), SHEAR):
        discs = leaf_discs(scene_of(mesh, transform(linear)))
        assert discs.radius[0] == 0
        np.testing.assert_allclose(
            discs.centre[0], apply_transform(transform(linear), mesh.vertices[3][None])[0]
        )
        assert np.isfinite(discs.normal).all()
        assert discs.radius[1] > 0


def test_incidence_keeps_its_digits_face_on_and_edge_on() -> None:
    """Against 50 digits, down to 1e-9 from either."""
    rng = np.random.default_rng(1)
    point, centre = np.array([3.0, -2.0, 1.0]), 10.0 * rng.normal(size=(60, 3))
    small = 10.0 ** -rng.uniform(1, 9, 20)
    angle = np.concatenate([small, np.pi / 2 - small, rng.uniform(0, np.pi / 2, 20)])[:, None]
    away = centre - point
    unit = away / np.linalg.norm(away, axis=1, keepdims=True)
    across = np.cross(unit, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    normal = np.cos(angle) * unit + np.sin(angle) * across
    ones = np.ones(60)
    leaves = LeafEchoes(centre, np.arange(60), normal, ones, ones, "exact")
    with mpmath.workdps(50):
        for found, a, n in zip(
            leaves.incidence(point), away.tolist(), normal.tolist(), strict=True
        ):
            (x, y, z), (u, v, w) = map(mpmath.mpf, a), map(mpmath.mpf, n)
            grazing = mpmath.sqrt(
                (y * w - z * v) ** 2 + (z * u - x * w) ** 2 + (x * v - y * u) ** 2
            )
            known = float(mpmath.atan2(grazing, abs(x * u + y * v + z * w)))
            assert found == pytest.approx(known, abs=1e-15)
