"""The window against closed forms and numerical integration."""

import numpy as np
import pytest
from scipy import integrate

from forest_addon.base.rng import stream
from forest_addon.stand.statistics.intensity import Window

TRIANGLE = Window((np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 3.0]]),))
HOLED = Window(
    (
        np.array([[0, 0], [10, 0], [10, 8], [4, 9], [0, 5.0]]),
        np.array([[2, 2], [4, 2], [4, 4.0], [2, 3]]),
    )
)
UTM = np.array([432_100.0, 5_612_300.0])


@pytest.mark.parametrize(
    ("centre", "deviation"), [((1.0, 0.5), (0.7, 1.1)), ((-2.0, 4.0), (2.0, 1.5)), ((9, 9), (1, 3))]
)
def test_moments_of_a_gaussian_over_a_triangle(centre, deviation):
    mass, first, second = TRIANGLE.gaussian_moments(np.array([centre]), np.array([deviation]))

    def moment(power_x, power_y):
        def of(y, x):
            z = (x - centre[0]) / deviation[0], (y - centre[1]) / deviation[1]
            density = np.exp(-(z[0] ** 2 + z[1] ** 2) / 2) / (2 * np.pi * np.prod(deviation))
            return z[0] ** power_x * z[1] ** power_y * density

        return integrate.dblquad(of, 0, 3, 0, lambda x: 3 - x, epsabs=1e-9, epsrel=1e-9)[0]

    assert mass[0] == pytest.approx(moment(0, 0), abs=1e-9)
    assert first[0] == pytest.approx([moment(1, 0), moment(0, 1)], abs=1e-9)
    assert second[0] == pytest.approx([moment(2, 0), moment(0, 2)], abs=1e-9)


def test_a_hole_takes_its_part_away():
    outline, hole = Window(HOLED.rings[:1]), Window(HOLED.rings[1:])
    of = (np.array([[3.0, 3.0], [-1.0, 6.0]]), np.array([[1.0, 2.0], [3.0, 0.5]]))
    whole = zip(outline.gaussian_moments(*of), hole.gaussian_moments(*of), strict=True)
    for both, kept in zip(whole, HOLED.gaussian_moments(*of), strict=True):
        assert kept == pytest.approx(both[0] - both[1], abs=1e-14)
    assert HOLED.area == pytest.approx(outline.area - hole.area)


def test_the_moments_over_a_rectangle_are_those_over_its_halves():
    halves = [
        Window((np.array([[0.0, 0.0], [7.0, 0.0], [0.0, 4.0]]),)),
        Window((np.array([[7.0, 0.0], [7.0, 4.0], [0.0, 4.0]]),)),
    ]
    of = (np.array([[3.0, 3.0], [-1.0, 6.0], [9.0, 1.0]]), np.array([[1, 2], [3, 0.5], [4, 40.0]]))
    parts = zip(*(half.gaussian_moments(*of) for half in halves), strict=True)
    whole = Window.rectangle((0, 0), (7, 4)).gaussian_moments(*of)
    for (first, second), both in zip(parts, whole, strict=True):
        assert both == pytest.approx(first + second, abs=1e-14)


def test_the_whole_mass_and_none_of_it():
    window = Window.rectangle((0, 0), (100, 100))
    centre = np.array([[50.0, 50.0], [1e4, 50.0], [0.0, 30.0], [0.0, 0.0]])
    mass = window.gaussian_moments(centre, np.full((4, 2), 0.5))[0]
    assert mass == pytest.approx([1, 0, 0.5, 0.25], abs=1e-14)


def test_orientation_and_place_do_not_matter():
    turned = Window(tuple(ring[::-1] + UTM for ring in HOLED.rings))
    assert turned.area == pytest.approx(HOLED.area, rel=1e-9)
    points = stream(1, "window").uniform(0, 10, (2000, 2))
    assert (turned.contains(points + UTM) == HOLED.contains(points)).all()
    of = np.array([[3.0, 3.0]]), np.array([[1.0, 2.0]])
    there = turned.gaussian_moments(of[0] + UTM, of[1])
    assert there[0] == pytest.approx(HOLED.gaussian_moments(*of)[0], abs=1e-8)


def test_corners_and_edges_are_inside():
    corners = np.concatenate(HOLED.rings) + UTM
    window = Window(tuple(ring + UTM for ring in HOLED.rings))
    assert window.contains(np.vstack([corners, (corners[:1] + corners[1:2]) / 2])).all()
    away = np.array([[-1e-3, 2.0], [3.0, 2.5], [5.0, -1e-3], [20.0, 0.0]]) + UTM
    assert not window.contains(away).any()


def test_coverage_adds_up_to_the_area():
    for window in (TRIANGLE, HOLED):
        cover = window.coverage((50, 40))
        assert cover.mean() * window.extent.prod() == pytest.approx(window.area, rel=1e-3)
        assert cover.min() >= -1e-12
        assert cover.max() <= 1 + 1e-12


@pytest.mark.medium
def test_set_covariance():
    x, y = shift = stream(2, "window").uniform(-2, 2, (200, 2)).T
    # Two right triangles, one moved, overlap in a right triangle.
    side = np.minimum(3, 3 + x + y) - np.maximum(x, 0) - np.maximum(y, 0)
    overlap = np.maximum(side, 0) ** 2 / 2
    assert np.abs(TRIANGLE.set_covariance(shift.T) - overlap).max() < 1e-3 * TRIANGLE.area
    window = Window.rectangle((5, 5), (8, 9))
    found = window.set_covariance(np.array([[1.0, -1.0], [0.0, 0.0], [3.5, 0.0]]))
    assert found.tolist() == [6.0, 12.0, 0.0]


@pytest.mark.medium
def test_the_rectangle_around_points_has_the_right_area_on_average():
    # Uniform points: the widened box has the mean area 1, by Ripley & Rasson. Each area has a standard
    # deviation below 1; 4.5 sigma, false alarm 7e-6.
    rng = stream(3, "around")
    areas = [Window.around(100 * rng.random((6, 2))).area / 1e4 for _ in range(4000)]
    assert abs(np.mean(areas) - 1) < 4.5 * np.std(areas) / np.sqrt(len(areas))
    assert Window.around(np.array([[7.0, 7.0]])).extent.tolist() == [1, 1]
    with pytest.raises(ValueError, match="no points"):
        Window.around(np.empty((0, 2)))


@pytest.mark.parametrize(
    "ring",
    [
        [[0, 0], [1, 1]],
        [[0, 0], [1, 1], [2, 2]],
        [[0, 0], [4, 4], [4, 0], [0, 3]],
        [[0, 0], [1, np.nan], [1, 0]],
    ],
)
def test_a_window_without_an_inside_is_refused(ring):
    with pytest.raises(ValueError, match=r"area|cross|finite"):
        Window((np.array(ring, dtype=float),))
