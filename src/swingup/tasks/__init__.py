"""The Markov decision processes: the task interface and the double pendulum's continuing task."""
