"""Recordings: read, checked, smoothed and cut into windows."""
