"""Limbs and dead branches of measured species, held to a model of a scanned beech. Smooth limbs: the nodes
stay, elbows go, collars swell, and all that a tree knows of itself still holds.
"""

from pathlib import Path

import numpy as np
import pytest
from references.solid_brute import union_volume

from forest_addon.base.rng import stream
from forest_addon.base.trimesh import DEAD, LEAF
from forest_addon.formats.toml_file import read_settings
from forest_addon.growth.library import find_species, load_species
from forest_addon.growth.measured.allometry import Wanted, dbh_of, width_of
from forest_addon.growth.measured.curves import TIGHT, curved
from forest_addon.growth.measured.meet import grow_crown
from forest_addon.growth.mesh.blades import shoot_of
from forest_addon.growth.mesh.meshing import mesh_wood
from forest_addon.growth.skeleton import LeafSites, Skeleton, find_axes
from forest_addon.growth.tree import grow
from forest_addon.growth.truth import segment_table, shared_once, volume_of, wood_of_tree
from forest_addon.spec import Detail, Species

BEECH = Wanted(0.517, 22.0, 12.0, 5.5, 330.0)
PINE = Wanted(0.2, 16.5, 3.2, 9.0, 40.0)
BRANCH = Skeleton(
    start=np.array([[0, 0, 0], [0, 0, 2], [0, 0, 2], [1, 0, 2.0]]),
    end=np.array([[0, 0, 2], [0, 0, 3], [1, 0, 2], [1.5, 0, 2.5]]),
    radius=np.array([[0.1, 0.1], [0.1, 0.1], [0.04, 0.04], [0.04, 0.02]]),
    parent=np.array([-1, 0, 0, 2]),
    order=np.array([0, 0, 1, 1]),
    generation=np.array([0, 1, 1, 2]),
)


def tree_of(name, wanted, seed=0):
    species, kind = load_species(find_species(name, Path()))
    return grow(species, kind, stream(seed, "scaffold"), wanted)


def limbs_of(skeleton):
    """First segments of living limbs of order 1, and how thick they are a diameter of the stem away."""
    parent = np.maximum(skeleton.parent, 0)
    first = np.flatnonzero((skeleton.order == 1) & (skeleton.order[parent] == 0))
    first = first[~skeleton.is_dead[first]]
    thick = []
    for row in first:
        chain = skeleton.axis(int(row))
        far = np.linalg.norm(skeleton.end[chain] - skeleton.start[row], axis=1)
        at = chain[int(np.argmax(far > 2 * skeleton.radius[skeleton.parent[row]].mean()))]
        thick.append(2 * skeleton.radius[at].mean())
    return first, np.array(thick)


@pytest.mark.slow
def test_a_beech_divides_into_as_few_limbs_as_a_scanned_one():
    # TreeQSM of a beech of 22 m (R package aRchi): 7 limbs of order 1 over 5 cm with 1,379 l, 3,897 l in all.
    for seed in range(2):
        skeleton = tree_of("european-beech", BEECH, seed).skeleton
        first, thick = limbs_of(skeleton)
        assert 7 / 1.5 <= (thick > 0.05).sum() <= 7 * 1.5
        table = segment_table(skeleton)
        litres = 1000 * np.bincount(table["order"], table["volume_m3"])
        assert litres[1] == pytest.approx(1379, rel=0.25)
        assert litres.sum() == pytest.approx(3897, rel=0.15)
        heavy = first[thick > 0.15]
        assert skeleton.start[heavy, 2].min() < 7.5  # the scanned one divides 5.5 m up


@pytest.mark.medium
@pytest.mark.parametrize(
    "wanted",
    [
        Wanted(0.18, 20.9, 4.9, 12.6, 30.0),
        Wanted(0.85, 20.1, 10.8, 5.9, 300.0),
    ],
)
def test_a_forest_tree_has_as_many_limbs_as_scanned_ones(wanted):
    # Models of twelve scanned trees (L1-Tree): 5 to 47 limbs on the stem, of 1.4 to 4.9 m by a tree's median.
    skeleton = tree_of("european-ash", wanted).skeleton
    first, thick = limbs_of(skeleton)
    limbs = first[thick > 0.015]
    long = [skeleton.length[skeleton.axis(int(row))].sum() for row in limbs]
    assert 5 <= len(limbs) <= 30
    assert 1.4 / 1.3 < np.median(long) < 4.9 * 1.3


def test_a_young_beech_keeps_its_leader():
    skeleton = tree_of("european-beech", Wanted(0.06, 7.0, 2.6, 1.5, 15.0)).skeleton
    stem = skeleton.order == 0
    assert skeleton.end[stem, 2].max() > 6.0
    table = segment_table(skeleton)
    assert table["volume_m3"][stem].sum() > 0.5 * table["volume_m3"].sum()


def test_conifers_stand_in_whorls():
    skeleton = tree_of("norway-spruce", Wanted(0.2, 16.0, 4.0, 5.0, 60.0)).skeleton
    first, _ = limbs_of(skeleton)
    level = np.sort(skeleton.start[first, 2])
    gap = np.diff(level)
    assert np.mean(gap < 0.05) > 0.5
    assert (gap > 0.15).sum() >= 10


@pytest.fixture(scope="module")
def pine():
    return tree_of("scots-pine", PINE)


def test_dead_branches_hang_below_the_crown(pine):
    wood = pine.skeleton
    dead = wood.is_dead
    foot = np.flatnonzero(dead & (wood.order == 1) & ~dead[np.maximum(wood.parent, 0)])
    assert len(foot) > 30
    assert (wood.order[wood.parent[foot]] == 0).all()
    height = wood.start[foot, 2]
    assert height.max() < PINE.crown_base
    assert height.min() < 1.0
    assert (height > 6).sum() > 1.4 * (height < 3).sum()  # they fall in the end
    reach = np.linalg.norm(wood.end[dead, :2], axis=1)
    # What died on a tree a third as high is a third as long as what died last, or is rotten.
    assert reach[wood.end[dead, 2] < 3].max() < 0.45 * reach[wood.end[dead, 2] > 7].max()
    assert not dead[wood.parent[~dead & (wood.parent >= 0)]].any()  # nothing lives on dead wood
    on_axis = wood.start[foot] - wood.start[wood.parent[foot]]
    way = wood.end[wood.parent[foot]] - wood.start[wood.parent[foot]]
    assert np.linalg.norm(np.cross(on_axis, way), axis=1).max() < 1e-6
    assert (wood.radius[dead, 1] <= wood.radius[dead, 0] + 1e-12).all()


def test_dead_wood_has_a_label_and_no_leaves_and_counts_as_wood(pine):
    mesh, living = pine.mesh, pine.skeleton.some(~pine.skeleton.is_dead)
    height = mesh.vertices[mesh.triangles][:, :, 2]
    assert 0 < height[mesh.part == DEAD].max() < PINE.crown_base + 1.0
    assert (mesh.leaf[mesh.part == DEAD] == -1).all()
    assert height[mesh.part == LEAF].min() > PINE.crown_base - 1.0
    assert wood_of_tree(pine).volume > 0.97 * segment_table(living)["volume_m3"].sum()


def test_without_shade_nothing_has_died():
    tree = tree_of("scots-pine", Wanted(0.2, 10.0, 5.0, 0.4, 60.0))
    assert (tree.mesh.part == DEAD).sum() < 0.02 * len(tree.mesh.part)


def test_every_measured_species_names_its_model():
    folder = find_species("maple", Path()).parent
    found = [read_settings(path, Species) for path in folder.glob("*.toml")]
    grown = [s for s in found if s.crown is not None]
    assert grown
    assert all(s.architecture is not None and s.architecture.model for s in grown)


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
    mesh = mesh_wood(swollen, 2e-4)
    a, b, c = (mesh.vertices[mesh.triangles[:, k]] for k in range(3))
    pieces = float(
        np.einsum("ti,ti->", a, np.cross(b, c)) / 6
    )  # the limb's part in her counts twice
    assert pieces == pytest.approx(segment_table(swollen)["volume_m3"].sum(), rel=0.01)


@pytest.mark.medium
def test_wood_with_collars_is_closed_and_its_truth_is_the_volume_of_the_union():
    species, kind = load_species(find_species("european-beech", Path()))
    wood = grow(species, kind, stream(1, "closed"), Wanted(0.3, 18.0, 7.0, 6.0, 20.0)).skeleton
    mesh = mesh_wood(wood, 5e-4)
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
@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("silver-fir", Wanted(0.4, 23.5, 7.0, 14.0, 380.0)),
        ("norway-spruce", Wanted(0.4, 23.0, 7.0, 8.0, 400.0)),
    ],
)
def test_a_crown_in_the_shade_hides_most_of_the_circle_that_it_spans(name, wanted):
    # Outlines of crowns fill 0.83 to 0.97 of the circle of their mean diameter (pytreedb, nine species), and
    # of pulses within 1.2 m of a stem 6 or 7 in 100 reach the ground (Chablais 3). Cells of 1/16 m on the
    # ring from 0.6 to 0.85 of the radius; with half of the crown kept empty 0.7 of them had foliage above.
    species, _ = load_species(find_species(name, Path()))
    blade = shoot_of(species.needles, species.leaf.length.mean)
    _, sites, _ = grow_crown(species, wanted, blade, 3)
    radius = wanted.crown_width / 2
    away = np.linalg.norm(sites.foot[:, :2], axis=1) / radius
    cells = np.unique(np.floor(16 * sites.foot[(away > 0.6) & (away < 0.85), :2]), axis=0)
    assert len(cells) / 16**2 > 0.85 * np.pi * (0.85**2 - 0.6**2) * radius**2


@pytest.mark.parametrize(
    "wanted", [("european-beech", 0.15, 14.0, 4.6), ("scots-pine", 0.2, 16.0, 3.2)]
)
def test_a_crown_stands_aside_of_an_upright_stem(wanted):
    name, dbh, height, width = wanted
    tree = tree_of(name, Wanted(dbh, height, width, 6.0, 30.0, aside=0.4))
    low, high = np.quantile(tree.leaves.centre[:, :2], [0.02, 0.98], axis=0)
    assert (low + high)[0] / width == pytest.approx(0.32, abs=0.12)  # of the outermost leaves
    assert abs((low + high)[1]) / width < 0.2
    assert width_of(tree.leaves.centre) == pytest.approx(width, rel=0.05)
    stem = tree.skeleton.end[tree.skeleton.order == 0]
    assert np.abs(stem[stem[:, 2] < 3.0, :2]).max() < 0.3


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
    axes = [(s, find_axes(s)) for s in (wood, plain.skeleton)]
    counts = [np.bincount(s.order[a.segment[a.first[:-1]]]).tolist() for s, a in axes]
    assert counts[0] == counts[1]
    angle, arc = bends(wood)
    thick = wood.radius[find_axes(wood).segment].max(axis=1)
    assert arc.min() > 1
    assert angle.max() < 1.0 < bends(plain.skeleton)[0].max() + 0.6
    assert thick.max() == pytest.approx(plain.skeleton.radius.max(), rel=0.01)
    assert 0.97 < volume_of(wood) / volume_of(plain.skeleton) < 1.05
    far = [len(mesh_wood(t.skeleton, 0.05).triangles) for t in (plain, tree)]
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
    """The stem of 20 cm goes on with 12 cm: it narrows by 0.22 a metre at most, and never below its own."""
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
    assert (fall / length).max() <= 0.22 + 1e-9
    assert wood.radius[0, 0] == 0.1
    assert wood.radius[-1, 1] == pytest.approx(0.06)
    assert (wood.radius.min(axis=1) >= 0.06 - 1e-12).all()
