"""The experiments of the papers, from our own results."""
