"""Intensities: values, true bounds, closed integrals, and what is refused."""

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from scipy import integrate

from forest_addon.base.places import ASSETS
from forest_addon.base.rng import stream
from forest_addon.drawing.figures import blank_figure
from forest_addon.drawing.stands import show_intensity
from forest_addon.formats.raster_file import GeoRaster
from forest_addon.formats.toml_file import read_settings
from forest_addon.spec import Forest, Gaussian, Grammar, Planting, Raster, Scene, Species, Terrain
from forest_addon.stand.compose import Inputs, Painted, process_of
from forest_addon.stand.forest import grow_forest
from forest_addon.stand.intensity import functions
from forest_addon.stand.intensity.functions import Constant, Mixture, Polygon, Product, Sum
from forest_addon.stand.intensity.surface import (
    DEEPEST,
    Flat,
    Heightmap,
    IntensityError,
    Triangulated,
    sink,
)
from forest_addon.stand.layouts import Process, quadrature
from forest_addon.stand.plan import plan_field, plan_stand
from forest_addon.stand.statistics.intensity import Window

LOW, SIZE = np.array([500_000.0, 5_400_000.0]), np.array([60.0, 40.0])  # UTM: far from the origin
STAR = np.array(
    [
        [(20, 8)[k % 2] * np.cos(k * np.pi / 5), (20, 8)[k % 2] * np.sin(k * np.pi / 5)]
        for k in range(10)
    ]
)
HOLE = [[-3, -3], [3, -3], [3, 3], [-3, 3]]


def mixture():
    return Mixture(
        np.array([2.0, 5.0]), np.add(LOW, [[10, 10], [50, 35]]), np.array([[4.0, 9.0], [0.8, 0.5]])
    )


def raster(rows=7, columns=11, seed=1):
    return functions.RasterIntensity(stream(seed, "pixels").random((rows, columns)), LOW, SIZE)


def painted_mesh():
    """A bumpy surface over part of the field, with a fold that hangs over."""
    rng = stream(2, "mesh")
    x, y = np.meshgrid(np.linspace(5, 50, 12), np.linspace(2, 38, 9))
    corner = np.column_stack([x.ravel(), y.ravel()]) + rng.uniform(-1, 1, (108, 2))
    vertices = np.column_stack([corner + LOW, rng.random(108)])
    first = (np.arange(8)[:, None] * 12 + np.arange(11)).ravel()
    triangles = np.concatenate(
        [
            np.column_stack([first, first + 1, first + 13]),
            np.column_stack([first, first + 13, first + 12]),
        ]
    )
    return Painted(vertices, triangles, rng.random(108))


def terrain():
    return Heightmap(10 * stream(3, "hill").random((6, 9)), LOW, SIZE, "hill")


EVERY = {
    "constant": lambda: Constant(0.3),
    "mixture": mixture,
    "raster": raster,
    "mask": lambda: functions.RasterMask(raster(), 0.6),
    "mesh": lambda: functions.PaintedMesh(painted_mesh(), 2.0),
    "polygon": lambda: Polygon(STAR + LOW + 20, [np.array(HOLE) + LOW + 20]),
    "limits": lambda: functions.TerrainLimits(terrain(), (0.1, 0.7), (2.0, 8.0)),
    "limits on triangles": lambda: functions.TerrainLimits(
        Triangulated(painted_mesh().vertices, painted_mesh().triangles), (0.05, 0.3), (0.2, 0.9)
    ),
    "sum": lambda: Sum((mixture(), raster(), Constant(0.1))),
    "product": lambda: Product((mixture(), raster(), Polygon(STAR + LOW + 20)), 1.5),
}


@pytest.mark.parametrize("name", EVERY)
def test_bounds_hold_in_cells_of_every_size(name):
    intensity, rng = EVERY[name](), stream(5, "cells", name)
    count = 400
    middle = LOW + rng.uniform(-5, 65, (count, 2))
    half = 30 * 10 ** rng.uniform(-6, 0, (count, 1)) * rng.uniform(0.2, 1, (count, 2))
    low, high = middle - half, middle + half
    lower, upper = intensity.bounds(low, high)
    room = 1e-9 * np.maximum(1, upper)
    for _ in range(60):
        part = rng.random((count, 2))
        edge = rng.random((count, 2)) < 0.3  # also on the closed edge
        part = np.where(edge, np.rint(part), part)
        value = intensity.at(np.minimum(low + part * (high - low), high))
        assert (value <= upper + room).all()
        assert (value >= lower - room).all()


def test_raster_bounds_are_exact_in_cells_of_up_to_two_patches():
    grid, rng = raster(), stream(6, "exact")
    low = LOW + rng.uniform(0, 1, (100, 2)) * (SIZE - 6)
    high = low + rng.uniform(0.5, 5, (100, 2))
    lower, upper = grid.bounds(low, high)
    for k in range(100):
        x, y = (np.linspace(low[k, a], high[k, a], 101) for a in (0, 1))
        seen = grid.at(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
        assert upper[k] == pytest.approx(seen.max(), abs=0.02)
        assert lower[k] == pytest.approx(seen.min(), abs=0.02)
        assert lower[k] <= seen.min() + 1e-12
        assert upper[k] >= seen.max() - 1e-12


def test_raster_is_bilinear_between_centres():
    """Against scipy's spline of order 1, in the pixels' own coordinates."""
    from scipy.ndimage import map_coordinates

    pixels = stream(1, "pixels").random((7, 11))
    points = LOW + stream(7, "points").random((500, 2)) * SIZE
    x, y = ((points - LOW) / SIZE * [11, 7]).T
    expected = map_coordinates(pixels[::-1], [y - 0.5, x - 0.5], order=1, mode="nearest")
    assert raster().at(points) == pytest.approx(expected, abs=1e-9)
    north_west = np.add(LOW, [0.01, SIZE[1] - 0.01])
    assert raster().at(north_west[None])[0] == pixels[0, 0]  # the first row is the north edge
    assert raster().at(LOW[None] - 0.1)[0] == 0


@pytest.mark.medium
@pytest.mark.parametrize("name", ["constant", "raster", "polygon", "sum"])
def test_closed_integrals_agree_with_quadrature(name):
    intensity, rng = EVERY[name](), stream(8, "rect", name)
    for _ in range(2):
        corners = np.sort(LOW + rng.random((2, 2)) * SIZE, axis=0)
        closed = intensity.closed_integral(*corners)
        numeric = quadrature(intensity, *corners)
        assert closed == pytest.approx(numeric.value, rel=2e-4, abs=numeric.error)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mask", "mesh", "limits", "product"])
def test_integrals_without_closed_form_are_within_their_stated_error(name):
    intensity = EVERY[name]()
    found = quadrature(intensity, LOW, LOW + SIZE)
    # A midpoint sum on 400 x 400 places, whose own error is a part of what is allowed here.
    x, y = (LOW[a] + (np.arange(400) + 0.5) * SIZE[a] / 400 for a in (0, 1))
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    total = intensity.at(places).sum() * (SIZE.prod() / 400**2)
    assert abs(found.value - total) < found.error + 4e-4 * total
    assert found.error < 0.02 * found.value


def test_mixture_integral_is_that_of_scipy():
    hills = mixture()

    def at(y, x):
        return float(hills.at(np.array([[x, y]]))[0])

    low, high = np.add(LOW, [3, 4]), np.add(LOW, [30, 20])
    numeric = integrate.dblquad(at, low[0], high[0], low[1], high[1], epsabs=1e-7)[0]
    assert hills.closed_integral(low, high) == pytest.approx(numeric, abs=1e-5)


def test_the_preset_has_the_hills_of_the_example():
    """The example of 2020a is unsquared, 0.4 exp(-(x-5)²/5 - (y-5)²/6); the preset converts it."""
    (maple, _) = read_settings(ASSETS / "scenes" / "tanveer-20m.toml", Scene).plantings
    (written,) = maple.gaussians
    hill = Mixture(*(np.array([value]) for value in (written.peak, written.centre, written.width)))
    value = hill.at(np.array([[6.0, 7.0]]))[0]
    assert value == pytest.approx(0.4 * np.exp(-1 / 5 - 4 / 6), rel=1e-9)


def spoiled(shape, place, value):
    """Ones, but in one place."""
    pixels = np.ones(shape)
    pixels[place] = value
    return pixels


def painted(weight=1.0, stretch=(1, 1, 1)):
    """The painted mesh with another weight of a vertex, or drawn out."""
    mesh = painted_mesh()
    mesh.weight[17] = weight
    return functions.PaintedMesh(Painted(mesh.vertices * stretch, mesh.triangles, mesh.weight), 1.0)


SQUARE = [[0, 0], [9, 0], [9, 9], [0, 9]]
UPRIGHT = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1.0]])
REFUSED = [
    *(
        (
            lambda bad=bad: functions.RasterIntensity(spoiled((4, 6), (1, 4), bad), LOW, SIZE, "d"),
            rf"row 1, column 4 .* is {bad:g}.*1 of 24",
        )
        for bad in (np.nan, -0.5, np.inf)
    ),
    (lambda: painted(weight=-1), "vertex 17"),
    (lambda: painted(stretch=(1, 0, 1)), "no area"),
    (lambda: Heightmap(spoiled((3, 4), (2, 1), np.inf), LOW, SIZE, "h"), "row 2, column 1 .*inf"),
    (lambda: Triangulated(UPRIGHT, np.array([[0, 1, 2]])), "no area from above"),
    (lambda: Triangulated(UPRIGHT * [1, np.nan, 1], np.array([[0, 1, 2]])), "not finite"),
    *(
        (lambda corners=corners, holes=holes: Polygon(corners, holes), said)
        for corners, holes, said in (
            ([[0, 0], [5, 0], [10, 0]], [], "no area"),
            ([[0, 0], [5, 5]], [], "no area"),
            ([[1, 1]] * 4, [], "no area"),
            ([[0, 0], [10, 10], [10, 0], [0, 9]], [], "cross"),
            ([[0, 0], [10, 0], [10, 10], [5, 0], [0, 10]], [], "cross or touch"),  # its base
            ([[0, 0], [10, 0], [4, 0], [4, 5]], [], "cross"),  # folds back over itself
            (SQUARE, [[[8, 8], [10, 8], [10, 10]]], "cross"),
            (SQUARE, [[[20, 20], [22, 20], [22, 22]]], "within the outline"),
            ([[0, 0], [9, 0], [9, np.nan]], [], "not finite"),
        )
    ),
]


@pytest.mark.parametrize(("make", "said"), REFUSED)
def test_what_is_no_intensity_no_polygon_and_no_ground_is_refused(make, said):
    with pytest.raises(ValueError, match=said):  # IntensityError is one
        make()


def test_painted_weights_are_barycentric_and_of_the_topmost_triangle():
    lower = [[0, 0, 0], [4, 0, 0], [0, 4, 0]]
    upper = [[0, 0, 1], [2, 0, 1], [0, 2, 1]]
    mesh = Painted(
        np.array(lower + upper, dtype=float),
        np.array([[0, 1, 2], [3, 4, 5]]),
        np.array([0, 4, 8, 1, 1, 1.0]),
    )
    at = functions.PaintedMesh(mesh, 2.0).at
    assert at(np.array([[3.0, 0.5]]))[0] == pytest.approx(2 * (4 * 0.75 + 8 * 0.125))
    assert at(np.array([[0.5, 0.5]]))[0] == pytest.approx(2.0)
    assert at(np.array([[3.0, 3.0]]))[0] == 0


# ------------------------------------------------------------------------------------- polygons


def test_polygon_holds_what_winding_says():
    from matplotlib.path import Path

    star, points = STAR + LOW + 20, LOW + stream(9, "in").uniform(-5, 45, (20_000, 2))
    outer = Path(star - LOW).contains_points(points - LOW)
    inner = Path(np.array(HOLE) + 20).contains_points(points - LOW)
    found = Polygon(star, [np.array(HOLE) + LOW + 20]).at(points) > 0
    assert (found == (outer & ~inner)).all()


def test_area_of_a_polygon_within_a_rectangle():
    everywhere = np.full(2, -1e7), np.full(2, 1e7)
    square = Polygon([[0, 0], [10, 0], [10, 10], [0, 10]], [[[2, 2], [4, 2], [4, 4], [2, 4]]])
    assert square.closed_integral(*everywhere) == pytest.approx(96)
    assert square.closed_integral(np.array([3, 0]), np.array([20, 5])) == pytest.approx(35 - 2)
    far = Polygon(STAR + LOW, [np.array(HOLE) + LOW])
    near = Polygon(STAR, [HOLE]).closed_integral(*everywhere)
    assert far.closed_integral(*everywhere) == pytest.approx(near, rel=1e-8)


# -------------------------------------------------------------------------------------- settings


def test_a_planting_adds_multiplies_and_masks():
    field = Forest(size=(60.0, 40.0), origin=tuple(LOW))
    shade, only = stream(4, "shade").random((5, 5)), np.tile([0.0, 1.0], (4, 2))
    planting = Planting(
        species="m",
        base=0.2,
        gaussians=(Gaussian(peak=2.0, centre=tuple(LOW + 10), width=(4.0, 9.0)),),
        rasters=(
            Raster(file="shade", use="add", value=3.0),
            Raster(file="shade", use="multiply", value=0.5),
            Raster(file="only", use="mask"),
        ),
    )
    process = process_of(
        planting, field, Inputs(rasters={"shade": GeoRaster(shade), "only": GeoRaster(only)})
    )
    points = LOW + stream(5, "points").random((2000, 2)) * SIZE
    image = functions.RasterIntensity(shade, LOW, SIZE).at(points)
    hill = 2 * np.exp(-(((points - LOW - 10) / [4, 9]) ** 2).sum(axis=1))
    within = functions.RasterIntensity(only, LOW, SIZE).at(points) >= 0.5
    assert process.at(points) == pytest.approx((0.2 + hill + 3 * image) * 0.5 * image * within)


def ramp():
    """Ground that is level up to x = 24 m and rises by 45° behind."""
    vertices = np.array(
        [[x, y, max(x - 24.0, 0.0)] for x in (0.0, 24.0, 60.0) for y in (0.0, 40.0)]
    )
    triangles = np.array([[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]])
    return Triangulated(vertices, triangles)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limits", "share"),
    [
        ({"slope_deg": (30.0, 90.0), "altitude": (0.0, 12.0)}, 12 / 60),
        ({"polygon": ((0.0, 0.0), (30.0, 0.0), (30.0, 40.0), (0.0, 40.0))}, 30 / 60),
    ],
)
def test_a_density_is_that_of_the_ground_where_it_may_stand(limits, share):
    planting = Planting(species="m", density=0.5, **limits)
    process = process_of(planting, Forest(size=(60.0, 40.0)), Inputs(terrain=ramp()))
    assert process.expected == pytest.approx(0.5 * share * 2400, rel=5e-3)
    points = stream(6, "points").random((500, 2)) * [60.0, 40.0]
    there = process.at(points)
    assert there[there > 0] == pytest.approx(0.5, rel=1e-9)  # exactly so, as it is even


@pytest.mark.slow
def test_a_density_of_uneven_ground_is_its_mean_there():
    hill = Gaussian(centre=(30.0, 20.0), width=(20.0, 20.0))
    planting = Planting(species="m", density=0.5, gaussians=(hill,), slope_deg=(0.0, 30.0))
    process = process_of(planting, Forest(size=(60.0, 40.0)), Inputs(terrain=ramp()))
    exact = integrate.dblquad(
        lambda y, x: np.exp(-(((x - 30) / 20) ** 2) - ((y - 20) / 20) ** 2), 0, 24, 0, 40
    )[0]
    assert process.factor * exact == pytest.approx(0.5 * 24 * 40, rel=5e-3)


def test_a_density_where_nothing_may_stand_is_refused():
    planting = Planting(species="m", density=0.5, slope_deg=(60.0, 90.0))
    with pytest.raises(IntensityError, match=r"0\.5 trees/m² cannot be expected"):
        process_of(planting, Forest(size=(60.0, 40.0)), Inputs(terrain=ramp()))


def test_an_expected_number_within_a_mask_counts_what_the_mask_leaves():
    triangle = ((0.0, 0.0), (20.0, 0.0), (0.0, 20.0))
    hill = Gaussian(centre=(5.0, 5.0), width=(6.0, 6.0))
    planting = Planting(species="m", expected=500, gaussians=(hill,), polygon=triangle)
    process = process_of(planting, Forest(size=(20.0, 20.0)))
    assert isinstance(process, Process)
    bare = Mixture(np.array([1.0]), np.array([[5.0, 5.0]]), np.array([[6.0, 6.0]]))
    exact = integrate.dblquad(
        lambda y, x: bare.at(np.array([[x, y]]))[0], 0, 20, 0, lambda x: 20 - x, epsabs=1e-4
    )[0]
    assert process.expected == pytest.approx(500, rel=1e-12)
    assert process.factor * exact == pytest.approx(500, abs=2 * process.total.error + 0.05)


# ------------------------------------------------------------------------------------------- terrain
# Terrain: exact heights and slopes, overhangs and holes, and feet without a gap.


def plane(a=0.3, b=-0.8, c=7.0, columns=9, rows=6):
    """A heightmap of the plane a·x + b·y + c, from the corner of the map."""
    x, y = (np.arange(n) + 0.5 for n in (columns, rows))
    heights = a * x * SIZE[0] / columns + b * y[:, None] * SIZE[1] / rows + c
    return Heightmap(heights[::-1], LOW, SIZE, "plane")


def inner(count=500):
    """Places off the outer half pixels, where a map goes on level."""
    return LOW + stream(1, "inner").uniform(0.15, 0.85, (count, 2)) * SIZE


def test_heights_and_gradients_of_a_plane_are_exact():
    points, ground = inner(), plane()
    expected = (points - LOW) @ [0.3, -0.8] + 7
    assert ground.height(points) == pytest.approx(expected, abs=1e-8)
    assert ground.gradient(points) == pytest.approx(np.tile([0.3, -0.8], (500, 1)), abs=1e-8)


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
    steep = np.linalg.norm(found.gradient(points), axis=1)
    assert steep == pytest.approx(np.hypot(0.2, 0.5), abs=1e-5)


def test_no_gap_between_neighbouring_triangles():
    """Places exactly on shared edges and corners have ground."""
    x, y = (k.ravel() for k in np.meshgrid(np.linspace(0, 10, 201), np.linspace(0, 10, 201)))
    ground = Triangulated(*joined(roof(0, 0, 5, 10, 1), roof(5, 0, 10, 10, 1)))
    assert set(ground.height(np.column_stack([x, y])).tolist()) == {1.0}


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


def test_slope_and_altitude_limit_where_trees_stand():
    ground = Heightmap(30 * stream(5, "hill").random((6, 9)), LOW, SIZE, "hill")
    field = Forest(size=tuple(SIZE), origin=tuple(LOW))
    planting = Planting(species="m", expected=800, slope_deg=(10.0, 50.0), altitude=(8.0, 20.0))
    stand = plan_stand(1, field, [planting], Inputs(terrain=ground))
    points = stand.position[:, :2]
    steep = np.rad2deg(np.arctan(np.linalg.norm(ground.gradient(points), axis=1)))
    assert steep.min() >= 10
    assert steep.max() <= 50
    assert stand.position[:, 2].min() >= 8
    assert stand.position[:, 2].max() <= 20
    assert abs(len(stand) - 800) < 5 * np.sqrt(800)  # false alarm 6e-7


def test_flat_ground_has_its_height():
    field = Forest(size=(20.0, 20.0), terrain=Terrain(base=12.5))
    stand = plan_stand(1, field, [Planting(species="m", expected=20)])
    assert set(stand.position[:, 2].tolist()) == {12.5}


def test_trees_are_seen_on_a_uniform_intensity():
    """Contrast of dots and ground by WCAG, of which 3 is what shapes need."""
    figure = blank_figure((4.0, 4.0))
    axes = figure.add_subplot()
    window = Window.rectangle((0.0, 0.0), (50.0, 50.0))
    show_intensity(axes, np.full((1, 2), 25.0), lambda places: np.full(len(places), 0.02), window)
    (image,), (dot, *_) = axes.images, axes.lines
    shown = np.array(image.cmap(image.norm(200.0))[:3])
    paper = np.array(to_rgb(axes.get_facecolor()))
    ground = paper + (shown - paper) * (1.0 if image.get_alpha() is None else image.get_alpha())

    def luminance(colour):
        linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    dark, light = sorted((luminance(np.array(to_rgb(dot.get_color()))), luminance(ground)))
    assert (light + 0.05) / (dark + 0.05) > 3.0
