"""Truth tables against closed forms and against fine meshes. The volume of wood, joints counted once:
closed forms, random points, and the fine mesh. Volume of pieces that reach into each other, against
closed forms. Cylinders of a tree whose every measure is known, and their sums against the truth of its
segments.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from references.solid_brute import union_volume

from forest_addon.base.rng import stream
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.lsystem.branching import skeleton_of
from forest_addon.growth.mesh.leaves import Leaves
from forest_addon.growth.mesh.meshing import mesh_wood
from forest_addon.growth.skeleton import Skeleton, diameter_at, find_axes
from forest_addon.growth.tree import Tree
from forest_addon.growth.truth import (
    leaf_angles,
    segment_table,
    shared_once,
    tree_truth,
    volume_of,
    wood_of_mesh,
    wood_of_skeleton,
    wood_of_tree,
)

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
FACES = np.array([t for a, b, c, d in SIDES for t in ((a, b, c), (a, c, d))])


def straight(h, r1, r2):
    return Skeleton(
        np.zeros((1, 3)),
        np.array([[0, 0, h]], float),
        np.array([[r1, r2]], float),
        np.array([-1]),
        np.zeros(1, np.int64),
        np.zeros(1, np.int64),
    )


def test_cylinder_is_simlidars():
    d, h = 0.3, 2.0
    wood = wood_of_skeleton(straight(h, d / 2, d / 2))
    assert wood.volume == pytest.approx(np.pi * d**2 * h / 4)
    assert wood.area == pytest.approx(np.pi * d * h)
    assert wood.projected == pytest.approx(d * h)


@pytest.mark.medium
def test_cone_and_frustum():
    cone = wood_of_skeleton(straight(3.0, 0.5, 0.0))
    assert cone.volume == pytest.approx(np.pi * 0.25)
    assert cone.area == pytest.approx(np.pi * 0.5 * np.hypot(3, 0.5))
    assert cone.projected == pytest.approx(1.5)
    fine = mesh_wood(straight(3.0, 0.5, 0.2), 1e-6, uv=False)
    frustum = wood_of_skeleton(straight(3.0, 0.5, 0.2))
    measured = wood_of_mesh(fine)
    assert measured.volume == pytest.approx(frustum.volume, rel=1e-2)
    caps = np.pi * (0.25 + 0.04)
    assert measured.area == pytest.approx(frustum.area + caps, rel=1e-2)


def test_angles_of_random_and_of_flat_leaves():
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(200_000, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    ones = np.ones(len(normal))
    leaves = Leaves(normal, normal, normal, ones, ones, ones, ones.astype(np.int32))
    edges, density = leaf_angles(leaves)
    middle = (edges[1:] + edges[:-1]) / 2
    np.testing.assert_allclose(density, np.sin(middle), atol=0.03)  # spherical distribution
    assert (density * np.diff(edges)).sum() == pytest.approx(1)
    assert leaf_angles(Leaves.none())[1].sum() == 0
    up = np.tile([0, 0, -1.0], (5, 1))
    five = np.ones(5)
    flat = Leaves(up, up, up, five, five, five, five.astype(np.int32))
    assert leaf_angles(flat)[1][0] > 0
    assert leaf_angles(flat)[1][1:].sum() == 0


def test_tree_truth_names_what_it_says():
    skeleton = straight(4.0, 0.2, 0.1)
    tree = Tree(mesh_wood(skeleton, 0.001), Leaves.none(), skeleton, grafted=False)
    truth = tree_truth(tree)
    assert truth["height_m"] == pytest.approx(4.0)
    assert truth["wood_volume_m3"] == pytest.approx(np.pi * 4 * (0.04 + 0.02 + 0.01) / 3)
    assert truth["leaf_area_m2"] == 0
    table = segment_table(skeleton)
    assert table["diameter_m"][0] == pytest.approx(0.3)  # the mean of both ends
    assert all(len(column) == 1 for column in table.values())


def skeleton(*segments):
    """Of (start, end, radius, parent, order)."""
    start, end, radius, parent, order = zip(*segments, strict=True)
    return Skeleton(
        np.array(start, float),
        np.array(end, float),
        np.array([np.broadcast_to(r, 2) for r in radius], float),
        np.array(parent),
        np.array(order),
        np.arange(len(parent)),
    )


def crossing(r=0.2):
    """A trunk, and a branch of the same radius at right angles from the middle of it."""
    return skeleton(
        ((0, 0, 0), (0, 0, 2), r, -1, 0),
        ((0, 0, 2), (0, 0, 4), r, 0, 0),
        ((0, 0, 2), (3, 0, 2), r, 0, 1),
    )


def test_a_branch_shares_half_a_steinmetz_solid_with_its_mother():
    apart = np.pi * 0.04 * 7
    assert wood_of_skeleton(crossing()).volume == pytest.approx(apart)
    assert volume_of(crossing()) == pytest.approx(apart - 8 * 0.2**3 / 3, rel=1e-3)


def test_segments_of_one_axis_add_up():
    bent = skeleton(
        ((0, 0, 0), (0, 0, 2), (0.2, 0.15), -1, 0), ((0, 0, 2), (1, 0, 3), (0.15, 0.0), 0, 0)
    )
    assert volume_of(bent) == pytest.approx(wood_of_skeleton(bent).volume, rel=1e-12)


def test_sisters_that_start_as_one_count_once():
    twins = skeleton(
        ((0, 0, 0), (0, 0, 2), 0.2, -1, 0),
        ((0, 0, 2), (0, 0, 5), 0.2, 0, 1),
        ((0, 0, 2), (0, 0, 5), 0.2, 0, 1),
    )
    assert volume_of(twins) == pytest.approx(np.pi * 0.04 * 5, rel=1e-3)


@pytest.mark.medium
@pytest.mark.parametrize("species", ["abop-monopodial-a", "abop-sympodial-a", "abop-ternary-a"])
def test_a_species_fills_what_random_points_say(species):
    settings, _ = load_species(find_species(species, Path()))
    grown, _ = skeleton_of(settings, stream(1, "solid"))
    union = union_volume(grown)
    assert volume_of(grown) == pytest.approx(union, rel=6e-3)
    assert union < 0.99 * wood_of_skeleton(grown).volume
    bare = Tree(mesh_wood(grown, 0.01), Leaves.none(), grown, grafted=False)
    assert wood_of_tree(bare).volume == volume_of(grown)


def winding(mesh, points):
    """(P,) how often a mesh goes around points, by solid angles (Van Oosterom and Strackee 1983)."""
    total = np.zeros(len(points))
    for corners in mesh.vertices[mesh.triangles]:
        a, b, c = (corner - points for corner in corners)
        la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
        dot = [np.einsum("pk,pk->p", u, v) for u, v in ((a, b), (b, c), (c, a))]
        below = la * lb * lc + dot[0] * lc + dot[1] * la + dot[2] * lb
        total += 2 * np.arctan2(np.einsum("pk,pk->p", a, np.cross(b, c)), below)
    return total / (4 * np.pi)


@pytest.mark.medium
def test_the_mesh_is_that_solid():
    mesh = mesh_wood(crossing(), 0.002, uv=False)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    points = low + np.random.default_rng(0).random((8000, 3)) * (high - low)
    inside = np.mean(winding(mesh, points) > 0.5)
    filled = inside * np.prod(high - low)
    error = np.sqrt(inside * (1 - inside) / len(points)) * np.prod(high - low)
    assert abs(filled - volume_of(crossing())) < 4.5 * error + 0.01 * filled


def box(low, size):
    return (np.asarray(low, float) + CORNERS * size)[FACES]


def turned(corners, angle=0.7):
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]]) @ np.array(
        [[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]
    )
    return corners @ turn.T


@pytest.mark.medium
@pytest.mark.parametrize("turn", [lambda corners: corners, turned])
def test_what_two_boxes_share_counts_once(turn):
    """Two boxes of 1 and 0.5 m3 that share a third of the smaller."""
    both = np.concatenate([box((0, 0, 0), (1, 1, 1)), box((0.5, 0.25, 0.25), (1, 1, 0.5))])
    shared = 0.5 * 0.75 * 0.5
    assert shared_once(turn(both)) == pytest.approx((1.5 - shared) / 1.5, abs=2e-3)


@pytest.mark.medium
def test_pieces_apart_are_as_they_are():
    apart = np.concatenate([box((0, 0, 0), (1, 1, 1)), box((3, 0, 5), (1, 2, 0.5))])
    assert shared_once(turned(apart)) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.medium
def test_a_piece_within_another_and_three_in_one_place():
    nested = [box((0, 0, 0), (1, 1, 1)), box((0.2, 0.2, 0.2), (0.5, 0.5, 0.5))]
    assert shared_once(turned(np.concatenate(nested))) == pytest.approx(1 / 1.125, abs=2e-3)
    thrice = np.concatenate([box((0, 0, 0), (1, 1, 1))] * 3)
    assert shared_once(turned(thrice)) == pytest.approx(1 / 3, abs=1e-9)


def test_a_piece_without_a_cap_says_nothing():
    """Lines through the hole of a third box are left out: between 0.75 of two and 2.5 / 3 of three."""
    both = np.concatenate([box((0, 0, 0), (1, 1, 1)), box((0.5, 0, 0), (1, 1, 1))])
    opened = np.concatenate([both, box((9, 0, 0), (1, 1, 1))[:-2]])
    assert 0.75 < shared_once(turned(opened)) < 0.83
    assert shared_once(np.empty((0, 3, 3))) == 1.0


def fork():
    """A trunk of two segments, a branch of two at its middle, and a twig."""
    start = [[0, 0, 0], [0, 0, 1], [0, 0, 1], [1, 0, 1.5], [1, 0, 1.5]]
    end = [[0, 0, 1], [0, 0, 3], [1, 0, 1.5], [2, 0, 2], [1, 1, 1.5]]
    radius = [[0.2, 0.16], [0.16, 0.08], [0.05, 0.04], [0.04, 0.02], [0.01, 0.01]]
    return Skeleton(
        start=np.array(start, float),
        end=np.array(end, float),
        radius=np.array(radius),
        parent=np.array([-1, 0, 0, 2, 2]),
        order=np.array([0, 0, 1, 1, 2]),
        generation=np.array([0, 1, 1, 2, 2]),
    )


def test_axes_and_extensions():
    axes = find_axes(fork())
    assert axes.onward.tolist() == [1, -1, 3, -1, -1]
    assert axes.of_segment.tolist() == [0, 0, 1, 1, 2]


def test_diameter_at_a_height():
    tree = fork()
    assert diameter_at(tree, 1.3) == pytest.approx(2 * (0.16 - 0.08 * 0.15))
    assert diameter_at(tree, 0.0) == pytest.approx(0.4)
    assert diameter_at(tree, 3.0) == 0.0
    two = replace(
        tree,
        **{
            name: np.concatenate([getattr(tree, name), getattr(tree, name)[:2]])
            for name in ("start", "end", "radius", "parent", "order", "generation")
        },
    )
    assert diameter_at(two, 1.3) == pytest.approx(np.sqrt(2) * diameter_at(tree, 1.3))
