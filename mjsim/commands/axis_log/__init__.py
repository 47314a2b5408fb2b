"""What the commands do with axis logs."""
