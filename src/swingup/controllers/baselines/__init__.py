"""The optimal-control baselines, and swing-ups continued to other plants."""
