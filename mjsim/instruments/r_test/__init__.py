"""A sphere that a nest of three sensors follows while the axes move: the R-test of ISO 10791-6."""
