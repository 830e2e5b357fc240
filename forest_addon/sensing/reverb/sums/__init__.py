"""The sum over trunks: paths, exact and fast sums, and the length of the record."""
