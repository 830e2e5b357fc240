"""Studies: benchmarks, validation, papers and experiments; they do not travel in the extension."""
