"""LinuxCNC as the real control in the loop: it runs a program headless, and what it tells the axes is recorded."""
