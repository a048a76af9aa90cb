"""Experiments over many runs: servo study, tuning, mismatch benchmark, faults."""
