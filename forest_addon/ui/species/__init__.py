"""Species: chosen by picture, edited, taken from STL files."""
