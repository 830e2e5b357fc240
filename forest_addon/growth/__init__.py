"""Growth: one tree, from an L-system and STL templates to arrays."""
