"""URDF and MJCF, the model files of other programs, from and to a plant's numbers. NumPy alone."""
