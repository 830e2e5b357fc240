"""Stand: where the trees are, from an intensity function to positions."""
