"""Pictures and pages of what was measured: figures, animations and tables."""
