"""Sweeps: many training runs over seeds and settings, on any ``concurrent.futures.Executor``."""
