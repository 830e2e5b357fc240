"""A scan from a tripod as an image: the range of the first return by azimuth and elevation."""

from __future__ import annotations

import numpy as np

from ...spec import Terrestrial
from .cloud import Cloud
from .scanner import directions


def range_image(cloud: Cloud, scanner: Terrestrial) -> np.ndarray:
    """(E, A) metres: a row an elevation, from the lowest; NaN where nothing came back."""
    azimuth, elevation = directions(scanner)
    step = np.deg2rad(scanner.angle_step_deg)
    line_step = np.deg2rad(scanner.line_step_deg or scanner.angle_step_deg)
    first = cloud.number == 1
    rounding = step / 1000  # the first column may be a little less than a whole turn away
    turned = (cloud.azimuth[first] - azimuth[0] + rounding) % (2 * np.pi) - rounding
    column = np.rint(turned / step).astype(int)
    row = np.rint((cloud.elevation[first] - elevation[0]) / line_step).astype(int)
    image = np.full((len(elevation), len(azimuth)), np.nan)
    image[row, column] = cloud.returns.distance[first]
    return image
