"""Sensing: LiDAR, sonar and reverb on arrays of an evaluated scene."""
