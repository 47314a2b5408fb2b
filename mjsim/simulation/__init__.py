"""Drives and transmissions, compiled, inside MuJoCo."""
