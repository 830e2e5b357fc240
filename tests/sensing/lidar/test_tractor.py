"""SIMLIDAR's tractor in scenes whose every distance is known in closed form."""

from dataclasses import replace

import numpy as np
import pytest
from references.rays import BruteCaster, ground, scene_with, sheet, wall

from forest_addon.base.trimesh import GROUND, WOOD, TriMesh
from forest_addon.growth.mesh.meshing import tube
from forest_addon.sensing.lidar import tractor as driven
from forest_addon.sensing.lidar.cloud import ESCAPED
from forest_addon.spec import Tractor

TRACTOR = Tractor(position=(1.0, 0.0, 1.0), track=0.1, step=0.002, gap=9, reach=5.0, top=4.0)


@pytest.fixture
def simlidar():
    return pytest.importorskip("studies.papers.simlidar")


def test_the_fan_and_the_track_are_simlidars():
    angle, track = driven.fan(TRACTOR), driven.positions(TRACTOR)
    assert angle[0] == pytest.approx(-np.arctan(1 / 5))
    assert np.diff(angle) == pytest.approx(np.deg2rad(0.25))
    assert np.arctan(3 / 5) - np.deg2rad(0.25) < angle[-1] <= np.arctan(3 / 5) + 1e-12
    assert track == pytest.approx([0, 0.02, 0.04, 0.06, 0.08, 0.1])


def test_ground_and_sky_without_trees():
    scan = driven.drive(TRACTOR, BruteCaster(scene_with(ground())))
    down = scan.angle < 0
    # The lowest beam meets z = 0 at the reach; beams at or above the horizon escape.
    expected = 1.0 / np.sin(-scan.angle[down])
    seen = expected <= TRACTOR.max_range
    assert scan.distance[:, down][:, seen] == pytest.approx(np.tile(expected[seen], (6, 1)))
    assert np.isinf(scan.distance[:, down][:, ~seen]).all()
    assert np.isinf(scan.distance[:, ~down]).all()
    assert (scan.organ[:, ~down] == ESCAPED).all()
    assert (scan.organ[:, down][:, seen] == GROUND).all()


@pytest.mark.parametrize(
    ("heading", "side", "x"), [(90, "right", 6.0), (-90, "left", 6.0), (90, "left", -4.0)]
)
def test_a_wall_beside_the_track(heading, side, x):
    tractor = Tractor(
        position=(1.0, 0.0, 1.0),
        track=0.1,
        gap=9,
        reach=8.0,
        top=4.0,
        heading_deg=heading,
        side=side,
    )
    scan = driven.drive(tractor, BruteCaster(scene_with(ground(), wall(x))))
    high = scan.angle > -np.arctan(1 / 5)  # lower beams meet the ground before the wall
    assert scan.distance[:, high] == pytest.approx(np.tile(5 / np.cos(scan.angle[high]), (6, 1)))
    assert (scan.organ[:, high] == WOOD).all()
    assert (scan.returns.tree.reshape(scan.organ.shape)[:, high] == 0).all()


def test_a_beam_that_begins_on_a_surface_has_a_finite_intensity():
    scan = driven.drive(TRACTOR, BruteCaster(scene_with(ground(), wall(-4.0))))
    met = np.flatnonzero(np.isfinite(scan.returns.distance))
    scan.returns.distance[met[:5]] = 0.0
    cloud = driven.to_cloud(scan, TRACTOR)
    assert np.isfinite(cloud.intensity).all()
    assert cloud.true_range[0] == 0


# -------------------------------------------------------------------------------------- wood indices
# Indices of wood against closed forms, and S's solid beam against the sector that it stands for.

WOOD_INDICES_TRACTOR = Tractor(
    position=(1.0, 0.0, 1.0), track=0.098, step=0.002, reach=4.0, top=5.0
)


def post(x, low, high):
    """A board at right angles to the beams."""
    return sheet(x, WOOD, low=low, high=high)


def test_a_wall_has_its_distance_times_the_fan(simlidar):
    """l·cos θ = D, so the sum tends to D·(θ₂ - θ₁) a metre of track, to about a step of θ."""
    far = 3.0
    fine = replace(
        WOOD_INDICES_TRACTOR, angle_step_deg=0.05, reach=20.0
    )  # above the horizon: a wall, no ground
    scan = driven.drive(fine, BruteCaster(scene_with(ground(), wall(1.0 + far))))
    areas = simlidar.beam_areas(scan, fine)
    above = scan.angle >= 0
    step = np.deg2rad(0.05)
    exact = fine.step * far * (np.sin(scan.angle + step) - np.sin(scan.angle)) / np.cos(scan.angle)
    assert areas[:, above] == pytest.approx(np.tile(exact[above], (50, 1)), rel=1e-12)
    span = scan.angle[-1] + step - scan.angle[above][0]
    assert areas[:, above].sum() == pytest.approx(50 * 0.002 * far * span, rel=step)
    assert (areas[scan.organ != WOOD] == 0).all()
    # With θ from the vertical the same sum is D·∫tan θ = D·ln(cos θ₁/cos θ₂).
    upright = simlidar.beam_areas(scan, fine, from_vertical=True)[:, above].sum()
    logarithm = np.log(np.cos(scan.angle[above][0]) / np.cos(scan.angle[-1] + step))
    assert upright == pytest.approx(50 * 0.002 * far * logarithm, rel=2 * step)


@pytest.mark.medium
def test_a_vertical_cylinder_has_its_visible_front(simlidar):
    """At y from the axis, l·cos θ = D - √(r² - y²); over y and θ that is (2rD - πr²/2)·(θ₂ - θ₁)."""
    r, far = 0.04, 1.5
    points = np.array([[1.0 + far, 0.05, -60.0], [1.0 + far, 0.05, 60.0]])
    vertices, triangles = tube(points, np.full(2, r), 64)
    scene = scene_with(ground(), TriMesh.of_part(vertices, triangles, WOOD))
    tractor = replace(WOOD_INDICES_TRACTOR, step=0.0005, track=0.1, angle_step_deg=1.0)
    scan = driven.drive(tractor, BruteCaster(scene))
    areas = simlidar.beam_areas(scan, tractor)[:, scan.angle > 0]
    wide = np.sin(scan.angle + np.deg2rad(1.0)) - np.sin(scan.angle)
    fan = (wide / np.cos(scan.angle))[scan.angle > 0].sum()  # S's sum in place of θ₂ - θ₁
    assert areas.sum() == pytest.approx((2 * r * far - np.pi * r**2 / 2) * fan, rel=0.01)


def test_areas_by_tree_add_up_to_the_orchard(simlidar):
    scene = scene_with(ground(), post(3.0, 0.011, 0.031), post(4.0, 0.021, 0.071))
    scan = driven.drive(WOOD_INDICES_TRACTOR, BruteCaster(scene))
    by_tree = simlidar.impacted_by_tree(scan, WOOD_INDICES_TRACTOR, 2)
    assert by_tree.sum() == pytest.approx(
        simlidar.beam_areas(scan, WOOD_INDICES_TRACTOR).sum(), rel=1e-12
    )
    # 10 scans at 2 m; of the 25 at 3 m the first 5 are hidden.
    assert by_tree[0] / by_tree[1] == pytest.approx(2.0 / 3.0 * 10 / 20, rel=1e-12)


@pytest.mark.parametrize("parts", [1, 2, 4])
@pytest.mark.parametrize("gap", [0, 3])
def test_a_solid_beam_meets_whatever_is_in_its_sector(parts, gap):
    """A board wider than Δy/P is never passed, so the beams that meet it are those whose sector does."""
    tractor = replace(WOOD_INDICES_TRACTOR, splits=parts, gap=gap, angle_step_deg=5.0)
    width = 0.002 / parts * 1.01
    for low in np.linspace(0.0401, 0.0479, 7):
        scan = driven.drive(tractor, BruteCaster(scene_with(ground(), post(2.0, low, low + width))))
        sector = (scan.track <= low + width) & (scan.track + tractor.step >= low)
        assert np.array_equal((scan.organ == WOOD).all(axis=1), sector)
        assert np.array_equal((scan.organ == WOOD).any(axis=1), sector)


@pytest.mark.medium
def test_one_ray_passes_what_a_solid_beam_meets():
    """On a track of 2 mm a board of 0.5 mm is met by one ray in four, and always by P = 4."""
    lows = 0.04 + 0.002 * np.arange(0.005, 1, 0.01)
    met = {0: 0, 4: 0}
    for parts in met:
        tractor = replace(WOOD_INDICES_TRACTOR, splits=parts, angle_step_deg=45.0)
        for low in lows:
            scene = scene_with(ground(), post(2.0, low, low + 0.0005))
            met[parts] += bool((driven.drive(tractor, BruteCaster(scene)).organ == WOOD).any())
    assert met == {0: 25, 4: 100}


def test_the_nearest_hit_of_the_sector_counts():
    """A slanting wall is nearest at a corner of the sector, which is one of its rays."""
    a, b = 2.0, 0.5  # x = a + b·y
    slant = sheet(a, WOOD, np.arctan(b), -1.0, 1.0)
    tractor = replace(WOOD_INDICES_TRACTOR, splits=2, angle_step_deg=1.0, track=0.02)
    scan = driven.drive(tractor, BruteCaster(scene_with(slant)))
    within = np.linspace(0.0, 1.0, 101)
    y = scan.track[:, None] + tractor.step * within
    theta = scan.angle[:, None] + np.deg2rad(1.0) * within
    least = (a - 1.0 + b * y).min(axis=1)[:, None] / np.cos(theta).max(axis=1)
    steep = np.abs(scan.angle + np.deg2rad(0.5)) > np.deg2rad(0.5)  # else θ = 0 lies within
    assert scan.distance[:, steep] == pytest.approx(least[:, steep], rel=1e-12)
    assert (scan.distance >= least - 1e-12).all()


def test_one_part_of_none_is_the_ray_of_before():
    """P = 0 casts the beam's own ray; every larger P holds it, so nothing is farther."""
    scene = scene_with(ground(), post(2.0, 0.03, 0.05), wall(4.0))
    one = driven.drive(WOOD_INDICES_TRACTOR, BruteCaster(scene)).distance
    two = driven.drive(replace(WOOD_INDICES_TRACTOR, splits=2), BruteCaster(scene)).distance
    assert (two <= one + 1e-9).all()
    assert (two < one - 1e-3).any()


def test_the_escape_value_stands_in_the_matrix_only():
    tractor = replace(WOOD_INDICES_TRACTOR, escape=-1.0)
    scan = driven.drive(tractor, BruteCaster(scene_with(ground())))
    assert (scan.matrix[np.isinf(scan.distance)] == -1.0).all()
    assert np.array_equal(scan.matrix[scan.organ != -1], scan.distance[scan.organ != -1])
    assert np.isinf(
        driven.drive(WOOD_INDICES_TRACTOR, BruteCaster(scene_with(ground()))).matrix
    ).any()
