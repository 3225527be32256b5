"""Policies for other programs: C, ONNX, a page, a folder for a robot. NumPy alone."""
