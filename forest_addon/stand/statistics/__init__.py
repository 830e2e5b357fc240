"""What a map of trees says: estimates of its intensity, and tests of a law."""
