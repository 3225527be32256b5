"""Training runs: presets, folders, metrics, evaluation by the judge, checkpoints and resuming."""
