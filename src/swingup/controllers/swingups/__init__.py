"""Swing-ups by iterative LQR: the problem, its solver, its search and its files."""
