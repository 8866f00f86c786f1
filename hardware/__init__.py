"""Drivers, recordings and simulation of the robot: bytes to Measurements."""
