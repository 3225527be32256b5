"""Refining a policy on the score itself, by its gradient through the simulation."""
