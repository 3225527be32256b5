"""A policy for other programs: a folder for RealAIGym, an ONNX graph, or a C header."""
