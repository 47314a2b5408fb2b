"""Sweeps: many machines through the same tests, on all cores or on a cluster, into one Parquet data set."""
