"""Benchmarks: time and error side by side, a section a file."""
