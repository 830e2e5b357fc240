"""Trees and records of sway that ``validate wind`` compares."""
