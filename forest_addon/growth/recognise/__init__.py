"""A tree recognised in facets."""
