"""Many campaigns side by side, on all cores or a cluster: tables of what was found, and a page with the trends."""
