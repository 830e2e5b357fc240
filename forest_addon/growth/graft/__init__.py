"""Branch templates, cut and grafted."""
