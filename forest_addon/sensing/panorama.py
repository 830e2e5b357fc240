"""A scan from a tripod as an image: the range of the first return by azimuth and elevation."""

from __future__ import annotations

import numpy as np

from ..spec import Terrestrial
from .cloud import Cloud


def range_image(cloud: Cloud, scanner: Terrestrial) -> np.ndarray:
    """(E, A) metres: a row an elevation, from the lowest; NaN where nothing came back."""
    step, line_step = scanner.angle_step_deg, scanner.line_step_deg or scanner.angle_step_deg
    (low_az, high_az), (low_el, high_el) = scanner.azimuth_deg, scanner.elevation_deg
    first = cloud.number == 1
    turned = (np.rad2deg(cloud.azimuth[first]) - low_az + step / 2) % 360 - step / 2
    column = np.rint(turned / step).astype(int)
    row = np.rint((np.rad2deg(cloud.elevation[first]) - low_el) / line_step).astype(int)
    image = np.full(
        (round((high_el - low_el) / line_step) + 1, round((high_az - low_az) / step) + 1), np.nan
    )
    image[row, column] = cloud.returns.distance[first]
    return image
