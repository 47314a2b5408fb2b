"""A calibration sphere whose centre is found with a touch probe at several positions of the rotary axes."""
