"""Moves and simulated situations on which planners are compared and tested."""
