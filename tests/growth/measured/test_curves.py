"""Smooth limbs: the nodes stay, elbows go, collars swell, and all that a tree knows of itself still holds."""

from pathlib import Path

import numpy as np
import pytest
from references.solid_brute import union_volume

from forest_addon.base.rng import stream
from forest_addon.growth.library.species_file import find_species, load_species
from forest_addon.growth.measured.curves import TAPER, TIGHT, curved
from forest_addon.growth.measured.wanted import Wanted, dbh_of
from forest_addon.growth.mesh.meshing import mesh_wood
from forest_addon.growth.skeleton import LeafSites, Skeleton, find_axes
from forest_addon.growth.tree import grow
from forest_addon.growth.truth import shared_once, volume_of
from forest_addon.spec import Detail

BRANCH = Skeleton(
    start=np.array([[0, 0, 0], [0, 0, 2], [0, 0, 2], [1, 0, 2.0]]),
    end=np.array([[0, 0, 2], [0, 0, 3], [1, 0, 2], [1.5, 0, 2.5]]),
    radius=np.array([[0.1, 0.1], [0.1, 0.1], [0.04, 0.04], [0.04, 0.02]]),
    parent=np.array([-1, 0, 0, 2]),
    order=np.array([0, 0, 1, 1]),
    generation=np.array([0, 1, 1, 2]),
)


def elbow(angle, length=0.4, radius=0.05):
    """One axis with a sharp bend by ``angle`` in its middle."""
    turn = np.array([np.sin(angle), 0, np.cos(angle)])
    points = np.array([[0, 0, 0], [0, 0, length], [0, 0, 2 * length]])
    points = np.concatenate([points, points[2] + length * turn * np.array([[1], [2]])])
    count = len(points) - 1
    return Skeleton(
        points[:-1],
        points[1:],
        np.full((count, 2), radius),
        np.arange(count) - 1,
        np.zeros(count, np.int64),
        np.arange(count),
    )


def bends(wood):
    """Angle between neighbouring segments of an axis, and the radius of the bend over the limb's."""
    axes = find_axes(wood)
    inner = np.ones(len(wood), dtype=bool)
    inner[axes.first[1:] - 1] = False
    at = np.flatnonzero(inner)
    one, other = axes.segment[at], axes.segment[at + 1]
    way = wood.end - wood.start
    length = np.linalg.norm(way, axis=1)
    cosine = np.einsum("bi,bi->b", way[one], way[other]) / (length[one] * length[other])
    angle = np.arccos(np.clip(cosine, -1, 1))
    arc = (length[one] + length[other]) / 2 / (2 * np.tan(np.maximum(angle, 1e-9) / 2))
    return angle, arc / wood.radius[one, 1]


def test_a_straight_limb_stays_as_it_is():
    line = elbow(0.0)
    wood, _ = curved(line, LeafSites.none())
    assert wood.start == pytest.approx(line.start, abs=1e-12)
    assert wood.radius.tolist() == line.radius.tolist()


@pytest.mark.parametrize("angle", [0.4, 0.9, 1.4])
def test_an_elbow_becomes_a_bend_no_tighter_than_the_limb_is_thick(angle):
    for radius in (0.02, 0.06, 0.12):
        before = elbow(angle, radius=radius)
        wood, _ = curved(before, LeafSites.none())
        turn, arc = bends(wood)
        assert turn.max() < 0.36
        assert arc.min() > 0.5 * TIGHT  # of the cut curve; of the circles through its nodes TIGHT
        moved = np.abs(before.end[:, None] - wood.end).max(axis=2).min(axis=1)
        if radius == 0.02:
            assert moved.max() < 1e-12  # a wide bend goes through its nodes


def test_a_limb_is_as_thick_as_asked_at_its_parents_surface():
    wood, _ = curved(BRANCH, LeafSites.none(), 0.5)
    limb = np.flatnonzero(wood.order == 1)
    axis = np.concatenate([wood.start[limb], wood.end[limb[-1:]]])
    metres = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(axis, axis=0), axis=1))])
    radius = np.append(wood.radius[limb, 0], wood.radius[limb[-1], 1])
    assert np.interp(0.1, metres, radius) == pytest.approx(1.5 * 0.04, rel=0.02)
    beyond = metres > 0.11
    assert (np.diff(radius[beyond]) <= 1e-12).all()  # narrows all the way
    assert np.interp(0.4, metres, radius) == pytest.approx(0.04, rel=0.02)
    assert radius[metres < 0.1].max() < 0.1  # stays within the parent
    assert wood.start[limb[0]].tolist() == [0, 0, 2]


def test_the_truth_has_the_collars_volume():
    plain, swollen = (curved(BRANCH, LeafSites.none(), c)[0] for c in (0.0, 0.5))
    assert volume_of(swollen) == pytest.approx(union_volume(swollen, 60_000), rel=4e-3)
    assert volume_of(swollen) > volume_of(plain) + 1e-4
    mesh = mesh_wood(swollen, 2e-4, uv=False)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    pieces = float(
        np.einsum("ti,ti->", a, np.cross(b, c)) / 6
    )  # the limb's part in her counts twice
    r1, r2 = swollen.radius.T
    length = np.linalg.norm(swollen.end - swollen.start, axis=1)
    assert pieces == pytest.approx(
        float((np.pi * length * (r1**2 + r1 * r2 + r2**2) / 3).sum()), rel=0.01
    )


@pytest.mark.medium
def test_wood_with_collars_is_closed_and_its_truth_is_the_volume_of_the_union():
    species, kind = load_species(find_species("european-beech", Path()))
    wood = grow(species, kind, stream(1, "closed"), Wanted(0.3, 18.0, 7.0, 6.0, 20.0)).skeleton
    mesh = mesh_wood(wood, 5e-4, uv=False)
    ahead, after = (mesh.triangles[:, k].astype(np.int64).ravel() for k in ([0, 1, 2], [1, 2, 0]))
    keys, times = np.unique(ahead * len(mesh.vertices) + after, return_counts=True)
    assert (times == 1).all()  # every edge once in each direction
    assert np.array_equal(keys, np.unique(after * len(mesh.vertices) + ahead))
    corners = mesh.vertices[mesh.triangles]
    pieces = np.einsum("ti,ti->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    union = shared_once(corners) * pieces  # by upright lines through the mesh
    assert union == pytest.approx(volume_of(wood), rel=0.012)
    assert pieces > 1.02 * union  # what lies within the parent counts twice there


@pytest.mark.medium
@pytest.mark.parametrize("name", ["silver-birch", "scots-pine"])
def test_a_measured_tree_keeps_its_measures(name):
    species, kind = load_species(find_species(name, Path()))
    wanted = Wanted(0.25, 18.0, 5.0, 6.0, 60.0)
    trees = {
        limbs: grow(species.changed(detail=Detail(limbs=limbs)), kind, stream(1, "curves"), wanted)
        for limbs in ("straight", "curves", "auto")
    }
    plain, tree = trees["straight"], trees["curves"]
    wood = tree.skeleton
    assert np.array_equal(trees["auto"].skeleton.end, wood.end)
    assert dbh_of(wood) == pytest.approx(0.25, abs=1e-9)
    assert tree.height == pytest.approx(plain.height, abs=0.02)
    assert len(tree.leaves) == len(plain.leaves)
    assert (wood.parent < np.arange(len(wood))).all()
    assert np.array_equal(wood.generation[1:], wood.generation[wood.parent[1:]] + 1)
    assert np.bincount(
        wood.order[find_axes(wood).segment[find_axes(wood).first[:-1]]]
    ).tolist() == (
        np.bincount(
            plain.skeleton.order[
                find_axes(plain.skeleton).segment[find_axes(plain.skeleton).first[:-1]]
            ]
        ).tolist()
    )
    angle, arc = bends(wood)
    thick = wood.radius[find_axes(wood).segment].max(axis=1)
    assert arc.min() > 1
    assert angle.max() < 1.0 < bends(plain.skeleton)[0].max() + 0.6
    assert thick.max() == pytest.approx(plain.skeleton.radius.max(), rel=0.01)
    assert 0.97 < volume_of(wood) / volume_of(plain.skeleton) < 1.05
    far = [len(mesh_wood(t.skeleton, 0.05, uv=False).triangles) for t in (plain, tree)]
    assert far[1] < 1.45 * far[0]  # from afar the nodes are left out again


def test_trees_of_rules_are_curved_only_where_the_species_asks():
    species, kind = load_species(find_species("abop-monopodial-a", Path()))
    plain = grow(species, kind, stream(1, "rules")).skeleton
    again = grow(
        species.changed(detail=Detail(limbs="straight")), kind, stream(1, "rules")
    ).skeleton
    smooth = grow(species.changed(detail=Detail(limbs="curves")), kind, stream(1, "rules")).skeleton
    assert plain.end.tobytes() == again.end.tobytes()
    assert len(smooth) > len(plain)


def test_a_limb_has_no_shoulder_where_it_loses_a_branch():
    """The stem of 20 cm goes on with 12 cm: it narrows by TAPER a metre at most, and never below its own."""
    points = np.linspace([0, 0, 0.0], [0, 0, 3.0], 31)
    own = np.where(points[:, 2] < 1.05, 0.1, 0.06)
    stem = Skeleton(
        points[:-1],
        points[1:],
        np.stack([own[:-1], own[1:]], axis=1),
        np.arange(30) - 1,
        np.zeros(30, np.int64),
        np.arange(30),
    )
    wood, _ = curved(stem, LeafSites.none())
    fall = wood.radius[:, 0] - wood.radius[:, 1]
    length = np.linalg.norm(wood.end - wood.start, axis=1)
    assert (fall / length).max() <= TAPER + 1e-9
    assert wood.radius[0, 0] == 0.1
    assert wood.radius[-1, 1] == pytest.approx(0.06)
    assert (wood.radius.min(axis=1) >= 0.06 - 1e-12).all()
