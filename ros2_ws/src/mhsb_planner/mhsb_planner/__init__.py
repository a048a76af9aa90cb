"""Motion planner: posture table, search over path and modes, trajectory, mode schedule."""
