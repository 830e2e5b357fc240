"""Formats: one small module a file format; writers go through ``atomic``."""
