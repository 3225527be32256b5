"""Policies by NumPy alone: what runs on the robot."""
