"""Policies as C99 headers."""
