"""Clouds held to clouds, real or simulated, by measures that do not depend on how dense they are."""
