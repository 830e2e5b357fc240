"""Templates: a tree in facets is recognised, cut and grafted."""
