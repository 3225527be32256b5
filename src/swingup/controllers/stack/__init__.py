"""Policies in JAX: what is trained and judged."""
