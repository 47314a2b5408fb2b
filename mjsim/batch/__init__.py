"""Many at once, on all cores or a cluster: sweeps of machines, and fleets of campaigns."""
