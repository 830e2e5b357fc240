"""Surveys of HELIOS++ (Winiwarter et al. 2022): scenes, scanners, platforms and legs as plain arrays."""
