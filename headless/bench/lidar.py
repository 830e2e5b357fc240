"""LiDAR: rays a second of the engines, pulses a second of whole scans, and the errors of both."""

from __future__ import annotations

from . import Say, lidar_pulses, lidar_rays

TITLE = "lidar: rays and pulses a second, and their errors"


def run(say: Say) -> None:
    """Print the tables of rays, then those of pulses."""
    lidar_rays.run(say)
    lidar_pulses.run(say)
