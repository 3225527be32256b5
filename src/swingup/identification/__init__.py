"""Identification: the parameters of a pendulum and its loop from recordings of its motion."""
