"""What the commands do with ball-bar tests."""
