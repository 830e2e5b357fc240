"""Sums of many echoes over one band by few modes: tables of modes, and the sum."""
