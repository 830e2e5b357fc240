"""The forest: what is planted where, how it is built, started, painted and dragged."""
