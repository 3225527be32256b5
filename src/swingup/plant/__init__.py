"""The double pendulum: its numbers, its files and its equations. NumPy alone."""
