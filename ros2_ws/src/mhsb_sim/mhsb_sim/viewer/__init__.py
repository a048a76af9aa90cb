"""The live view in a browser: the arm in 3-D, plots, goals, and recordings played back."""
