"""Terrain: exact heights and slopes, overhangs and holes, and feet without a gap."""

import numpy as np
import pytest

from forest_addon.base.rng import stream
from forest_addon.spec import Forest, Grammar, Planting, Scene, Species, Terrain
from forest_addon.stand.compose import Inputs
from forest_addon.stand.forest import grow_forest
from forest_addon.stand.intensity.surface import (
    DEEPEST,
    Flat,
    Heightmap,
    IntensityError,
    Triangulated,
    normals,
    sink,
    slope,
)
from forest_addon.stand.plan import plan_field, plan_stand

LOW, SIZE = np.array([500_000.0, 5_400_000.0]), np.array([60.0, 40.0])


def plane(a=0.3, b=-0.8, c=7.0, columns=9, rows=6):
    """A heightmap of the plane a·x + b·y + c, from the corner of the map."""
    x, y = (np.arange(n) + 0.5 for n in (columns, rows))
    heights = a * x * SIZE[0] / columns + b * y[:, None] * SIZE[1] / rows + c
    return Heightmap(heights[::-1], LOW, SIZE, "plane")


def inner(count=500):
    """Places off the outer half pixels, where a map goes on level."""
    return LOW + stream(1, "inner").uniform(0.15, 0.85, (count, 2)) * SIZE


def test_heights_and_normals_of_a_plane_are_exact():
    points, ground = inner(), plane()
    expected = (points - LOW) @ [0.3, -0.8] + 7
    assert ground.height(points) == pytest.approx(expected, abs=1e-8)
    assert slope(ground, points) == pytest.approx(np.arctan(np.hypot(0.3, 0.8)), abs=1e-8)
    normal = np.array([-0.3, 0.8, 1]) / np.sqrt(1 + 0.09 + 0.64)
    assert normals(ground, points) == pytest.approx(np.tile(normal, (500, 1)), abs=1e-8)


def test_gradient_is_that_of_the_bilinear_surface():
    ground = Heightmap(stream(2, "hill").random((7, 9)), LOW, SIZE, "hill")
    points, step = inner(), 1e-3
    numeric = np.column_stack(
        [
            (ground.height(points + step * e) - ground.height(points - step * e)) / (2 * step)
            for e in np.eye(2)
        ]
    )
    cell = (points - LOW) / SIZE * [9, 7] - 0.5
    smooth = (np.abs(cell - np.rint(cell)) > 1e-3).all(axis=1)  # not across a kink
    assert ground.gradient(points)[smooth] == pytest.approx(numeric[smooth], abs=1e-5)


def test_there_is_no_ground_beyond_a_map():
    points = np.array([LOW - 0.1, LOW + SIZE + 0.1, LOW + SIZE / 2])
    assert np.isnan(plane().height(points)).tolist() == [True, True, False]
    assert np.isnan(plane().gradient(points)[:, 0]).tolist() == [True, True, False]


def test_a_height_that_is_no_number_is_refused_with_its_place():
    pixels = np.zeros((3, 4))
    pixels[2, 1] = np.inf
    with pytest.raises(IntensityError, match=r"row 2, column 1 .*inf"):
        Heightmap(pixels, LOW, SIZE, "h.tif")


def test_the_triangles_shown_meet_the_map_at_its_nodes():
    ground = Heightmap(stream(2, "hill").random((7, 9)), LOW, SIZE, "hill")
    vertices, triangles = ground.triangles()
    assert ground.height(vertices[:, :2]) == pytest.approx(vertices[:, 2], abs=1e-9)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)[:, 2] / 2
    assert area.min() >= 0  # all face up
    assert area.sum() == pytest.approx(SIZE.prod())
    surface = Triangulated(vertices, triangles)
    twist = 0.25 * 2  # a quarter of the largest twist that heights of 0 to 1 have
    assert np.abs(surface.height(inner()) - ground.height(inner())).max() <= twist


# ------------------------------------------------------------------------------ triangulated ground


def roof(x0, y0, x1, y1, z):
    corner = np.array([[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]], dtype=float)
    return corner, np.array([[0, 1, 2], [0, 2, 3]])


def joined(*parts):
    vertices, triangles, count = [], [], 0
    for corner, faces in parts:
        vertices.append(corner)
        triangles.append(faces + count)
        count += len(corner)
    return np.concatenate(vertices), np.concatenate(triangles)


def test_the_topmost_surface_counts_and_holes_are_no_ground():
    wall = (np.array([[4, 2, 0], [4, 8, 0], [4, 8, 9.0]]), np.array([[0, 1, 2]]))  # on edge
    under = roof(0, 0, 10, 10, 1.0)
    under = (under[0], under[1][:, ::-1])  # faces down, still ground
    ground = Triangulated(*joined(under, roof(5, 5, 8, 8, 3.0), wall))
    points = np.array([[1.0, 1.0], [6.0, 6.0], [4.0, 3.0], [11.0, 5.0]])
    assert ground.height(points)[:3].tolist() == pytest.approx([1.0, 3.0, 1.0])
    assert np.isnan(ground.height(points)[3])
    frame = Triangulated(*joined(roof(0, 0, 10, 4, 0), roof(0, 6, 10, 10, 0)))
    assert np.isnan(frame.height(np.array([[5.0, 5.0]]))[0])


def test_triangles_equal_the_plane_they_sample():
    rng = stream(3, "tin")
    from scipy.spatial import Delaunay

    corner = rng.uniform(0, 60, (3000, 2)) + LOW
    heights = (corner - LOW) @ [0.2, 0.5] - 3
    found = Triangulated(np.column_stack([corner, heights]), Delaunay(corner - LOW).simplices)
    points = inner(5000)
    assert found.height(points) == pytest.approx((points - LOW) @ [0.2, 0.5] - 3, abs=1e-7)
    assert slope(found, points) == pytest.approx(np.arctan(np.hypot(0.2, 0.5)), abs=1e-5)


def test_no_gap_between_neighbouring_triangles():
    """Places exactly on shared edges and corners have ground."""
    x, y = (k.ravel() for k in np.meshgrid(np.linspace(0, 10, 201), np.linspace(0, 10, 201)))
    ground = Triangulated(*joined(roof(0, 0, 5, 10, 1), roof(5, 0, 10, 10, 1)))
    assert set(ground.height(np.column_stack([x, y])).tolist()) == {1.0}


def test_a_mesh_without_area_from_above_is_refused():
    with pytest.raises(ValueError, match="no area from above"):
        Triangulated(np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1.0]]), np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="not finite"):
        Triangulated(np.array([[0, 0, 0], [1, 0, 0], [1, np.nan, 1.0]]), np.array([[0, 1, 2]]))


# ------------------------------------------------------------------------------------------- feet


@pytest.mark.medium
@pytest.mark.parametrize("steep", [0.0, 0.1, 0.7, 2.0])
def test_a_foot_on_a_slope_leaves_no_gap(steep):
    """On a plane of this steepness a foot of radius r reaches r·tan(slope) below its axis."""
    turn = np.linspace(0, 2 * np.pi, 37)[:-1]
    for angle in turn:
        ground = plane(steep * np.cos(angle), steep * np.sin(angle))
        points, radius = inner(20), np.linspace(0.05, 0.8, 20)
        found = sink(ground, points, radius)
        assert (found >= radius * steep - 1e-7).all()
        assert (found <= radius * steep * 1.01 + 1e-7).all()


def test_a_foot_over_a_cliff_is_sunk_so_far_and_no_farther():
    ground = Triangulated(*joined(roof(0, 0, 5, 10, 100.0), roof(5, 0, 10, 10, 0.0)))
    assert sink(ground, np.array([[4.9, 5.0]]), np.array([0.3])) == pytest.approx(DEEPEST * 0.3)
    edge = Triangulated(*roof(0, 0, 5, 10, 2.0))  # nothing beyond: no ground to reach
    assert sink(edge, np.array([[4.9, 5.0]]), np.array([0.3])) == pytest.approx(0)
    assert sink(Flat(3.0), np.zeros((2, 2)), np.ones(2)).tolist() == [0, 0]


def test_trees_stand_on_the_ground_with_their_feet_in_it():
    scene = Scene(
        forest=Forest(size=tuple(SIZE), origin=tuple(LOW)),
        plantings=(Planting(species="x.toml", expected=40),),
    )
    ground = plane(0.4, 0.3)
    species = Species(name="plain", grammar=Grammar(generations=2, radius=0.2))
    forest = grow_forest(scene, [(species, None)], inputs=Inputs(terrain=ground))
    stand = forest.stand
    assert stand.position[:, 2] == pytest.approx(ground.height(stand.position[:, :2]))
    foot = np.array([forest.variant_of(t).skeleton.radius[0, 0] for t in range(len(stand))])
    lowest = foot * stand.scale * 0.5  # on the slope; on the level outer half pixels less
    assert (stand.sink <= lowest * 1.01).all()
    assert stand.sink.max() == pytest.approx(lowest.max(), rel=0.3)
    assert forest.transforms()[:, 2, 3] == pytest.approx(stand.position[:, 2] - stand.sink)


def test_trees_over_holes_are_left_out_and_counted():
    ground = Triangulated(*joined(roof(0, 0, 10, 20, 1.0), roof(15, 0, 20, 20, 2.0)))
    planting = Planting(species="m", expected=4000)
    stand = plan_stand(1, Forest(size=(20.0, 20.0)), [planting], Inputs(terrain=ground))
    level = plan_stand(1, Forest(size=(20.0, 20.0)), [planting])
    hole = (level.position[:, 0] > 10) & (level.position[:, 0] < 15)
    assert stand.off_ground.tolist() == [hole.sum()]
    assert (stand.position[:, :2] == level.position[~hole, :2]).all()
    assert set(stand.position[:, 2].tolist()) == {1.0, 2.0}


@pytest.mark.parametrize("corner", [10.0, 20.0])
def test_rows_of_a_field_are_drawn_alone_as_all_at_once(corner):
    """Turns are plain draws of their stream, whether all trees stand or not."""
    inputs = Inputs(terrain=Triangulated(*roof(0, 0, corner, 20, 1.0)))
    plantings = [Planting(species=n, expected=900, scale=(0.5, 2.0), variants=9) for n in "mn"]
    drawn = plan_field(1, Forest(size=(20.0, 20.0)), plantings, inputs)
    stand = plan_stand(1, Forest(size=(20.0, 20.0)), plantings, inputs)
    turn = 2 * np.pi * stream(1, "stand", "m", "turn").random(2000)
    mine = stand.species == 0
    assert (stand.rotation[mine] == turn[stand.number[mine]]).all()
    rng, count = stream(3, "rows"), len(stand)
    assert drawn.counts().tolist() == stand.counts().tolist()
    for some in (1, 5, 300, count):
        rows = np.sort(rng.permutation(count)[:some])
        part = drawn.select(rows)
        for name in ("position", "rotation", "scale", "species", "variant", "id", "number"):
            assert (getattr(part, name) == getattr(stand, name)[rows]).all(), name


@pytest.mark.medium
def test_slope_and_altitude_limit_where_trees_stand():
    ground = Heightmap(30 * stream(5, "hill").random((6, 9)), LOW, SIZE, "hill")
    field = Forest(size=tuple(SIZE), origin=tuple(LOW))
    planting = Planting(species="m", expected=800, slope_deg=(10.0, 50.0), altitude=(8.0, 20.0))
    stand = plan_stand(1, field, [planting], Inputs(terrain=ground))
    points = stand.position[:, :2]
    steep = np.rad2deg(slope(ground, points))
    assert steep.min() >= 10
    assert steep.max() <= 50
    assert stand.position[:, 2].min() >= 8
    assert stand.position[:, 2].max() <= 20
    assert abs(len(stand) - 800) < 5 * np.sqrt(800)  # false alarm 6e-7


def test_flat_ground_has_its_height():
    field = Forest(size=(20.0, 20.0), terrain=Terrain(base=12.5))
    stand = plan_stand(1, field, [Planting(species="m", expected=20)])
    assert set(stand.position[:, 2].tolist()) == {12.5}
