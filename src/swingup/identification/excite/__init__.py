"""Motions that show the parameters, within limits that are checked over a prior."""
