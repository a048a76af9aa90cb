"""Experiments over many runs: the servo study, tuning, planners side by side."""
