"""Pictures of stands and results: by numpy where there is no matplotlib (``strips``), else as figures."""
