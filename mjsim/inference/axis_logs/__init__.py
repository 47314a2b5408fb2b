"""Axis logs as an estimation problem: one axis at a time, all its recordings at once."""
