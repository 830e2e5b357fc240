"""LiDAR: rays a second of the engines, pulses a second of whole scans, tubes for cones, and all errors."""

from __future__ import annotations

from forest_addon.base.progress import Say

from . import lidar_blocks, lidar_moving, lidar_pulses, lidar_rays, lidar_wood

TITLE = "lidar: rays and pulses a second, and their errors"


def run(say: Say) -> None:
    """Print the tables of rays, of rays where bodies move, then those of pulses, of blocks and of wood."""
    lidar_rays.run(say)
    lidar_moving.run(say)
    lidar_pulses.run(say)
    lidar_blocks.run(say)
    lidar_wood.run(say)
