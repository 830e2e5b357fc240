"""Trees that move: the few ways in which a skeleton bends, and where points of a tree hold on to it."""
