"""Statistics of a map of trees: estimates of its intensity, and tests of a law."""
