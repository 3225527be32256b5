"""Controllers: the interface, baselines, swing-ups and the stack of a policy."""
