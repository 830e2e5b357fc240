"""L-systems: strings that are rewritten, and turtles that read them."""
