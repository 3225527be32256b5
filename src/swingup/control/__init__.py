"""Controllers: one interface with explicit state, and the learned policy behind it."""
