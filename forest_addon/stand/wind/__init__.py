"""Wind over and within a stand, and how its trees answer it."""
