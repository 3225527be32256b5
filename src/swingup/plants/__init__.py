"""Plants: which double pendulum a command simulates, by name or from a file."""
