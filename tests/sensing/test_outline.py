"""Outlines: drawn where the sensor itself says that it looks."""

import math

import numpy as np
import pytest

from forest_addon.sensing.kind import AROUND
from forest_addon.sensing.kinds import outline
from forest_addon.sensing.sonar.beam import beam_offsets
from forest_addon.sensing.trajectory import frame_of
from forest_addon.spec import Airborne, Mobile, Pose, Reverb, Sonar, Terrestrial, Tractor


@pytest.mark.parametrize("axis", [(0, 0), (110, 12), (-30, 90), (45, -90)])
@pytest.mark.parametrize("width", [(30.0, 30.0), (10.0, 60.0), (5.0, 170.0)])
def test_the_contour_of_a_beam_is_where_it_has_lost_3_db(axis, width):
    sonar = Sonar(
        position=(1, 2, 3),
        azimuth_deg=axis[0],
        elevation_deg=axis[1],
        beam_width_deg=width,
        max_range=7.0,
    )
    contour = outline(sonar)[:AROUND, 0] - sonar.position
    np.testing.assert_allclose(np.linalg.norm(contour, axis=1), 7.0, rtol=1e-12)
    az, el = np.degrees(beam_offsets(contour / 7.0, frame_of(*np.radians(axis))))
    lost = 3.0 * ((2 * az / width[0]) ** 2 + (2 * el / width[1]) ** 2)  # dB of a Gaussian
    np.testing.assert_allclose(lost, 3.0, atol=1e-9)


def test_the_fan_of_a_tractor_starts_at_the_ground_and_ends_at_the_top():
    tractor = Tractor(position=(1, 2, 1), heading_deg=90, reach=20, top=12, track=30)
    ends = outline(tractor)
    assert ends[0].tolist() == pytest.approx(np.array([(1, 2, 1), (1, 32, 1)]))
    fan = ends[1:, 1]
    assert fan[:, 0].max() > 20  # to the right of a drive towards +Y
    angles = np.degrees(np.arctan2(fan[:, 2] - 1, fan[:, 0] - 1))
    assert angles.max() == pytest.approx(math.degrees(math.atan2(11, 20)))
    assert angles[angles < 0].min() == pytest.approx(-math.degrees(math.atan2(1, 20)))
    mirrored = outline(Tractor(position=(1, 2, 1), side="left"))
    assert mirrored[1:, 1, 0].min() < -10


def test_the_window_of_a_scanner_keeps_to_its_angles():
    scanner = Terrestrial(position=(5, 5, 2), azimuth_deg=(10, 50), elevation_deg=(-20, 40))
    seen = (outline(scanner) - scanner.position).reshape(-1, 3)
    azimuth = np.degrees(np.arctan2(seen[:, 1], seen[:, 0]))
    elevation = np.degrees(np.arcsin(seen[:, 2] / np.linalg.norm(seen, axis=1)))
    assert (azimuth.min(), azimuth.max()) == pytest.approx((10, 50))
    assert (elevation.min(), elevation.max()) == pytest.approx((-20, 40))


def test_the_ground_path_is_as_long_as_from_the_mirrored_source():
    reverb = Reverb(source=(0, 0, 1), receiver=(9, 0, 2))
    direct, down, up = outline(reverb)
    assert np.linalg.norm(direct[1] - direct[0]) == pytest.approx(math.hypot(9, 1))
    assert down[1][2] == 0
    length = np.linalg.norm(down[1] - down[0]) + np.linalg.norm(up[1] - up[0])
    assert length == pytest.approx(math.hypot(9, 3))


def test_a_flight_is_its_strips_and_where_its_beams_meet_the_ground():
    flight = Airborne(position=(0, 0, 50), heading_deg=90, track=80, strips=2, spacing=30)
    segments = outline(flight)
    np.testing.assert_allclose(segments[0], [(0, 0, 50), (0, 80, 50)], atol=1e-12)
    np.testing.assert_allclose(segments[4], [(30, 80, 50), (30, 0, 50)], atol=1e-12)  # flown back
    reach = 50 * math.tan(math.radians(30))
    np.testing.assert_allclose(segments[1:3, 1], [(-reach, 0, 0), (reach, 0, 0)], atol=1e-12)


def test_a_mobile_scanner_is_its_poses():
    poses = (Pose(), Pose(time=1, position=(5, 0, 2)), Pose(time=2, position=(5, 5, 2)))
    assert outline(Mobile(poses=poses)).tolist() == [
        [[0, 0, 2], [5, 0, 2]],
        [[5, 0, 2], [5, 5, 2]],
    ]
    assert len(outline(Mobile())) == 0
