"""Posture tables (S1): the posture with the largest velocity polytope at every tip position.

The velocity polytope contains all velocities of the tip that the pistons' limits allow. Each mode
combination (one mode for each actuator) has its own posture.
"""
