"""S1: the posture with the largest velocity polytope, for every point and mode pattern."""
