"""Measurement files of other systems, brought into a campaign."""
