"""Rehearsal: an exported folder in a process of its own, in the loop of a simulated robot."""
