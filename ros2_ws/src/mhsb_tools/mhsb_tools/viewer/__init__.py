"""Live view in a browser: the arm in 3-D, plots, goals, and playback of recordings."""
