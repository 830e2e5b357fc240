"""Rays: engines that cast rays in an evaluated scene."""
