"""A user's own tree: recognised in facets, taken apart, and regrown as siblings by a grammar fitted to it."""
