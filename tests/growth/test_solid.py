"""The volume of wood, joints counted once: closed forms, random points, and the fine mesh."""

from pathlib import Path

import numpy as np
import pytest
from references.solid_brute import union_volume

from forest_addon.base.rng import stream
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.mesh.leaves import no_leaves
from forest_addon.growth.mesh.meshing import mesh_wood
from forest_addon.growth.skeleton import Skeleton
from forest_addon.growth.species import skeleton_of
from forest_addon.growth.tree import Tree
from forest_addon.growth.truth import volume_of, wood_of_skeleton, wood_of_tree


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
    bare = Tree(mesh_wood(grown, 0.01), no_leaves(), grown, grafted=False)
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
