"""Planner that decides path, posture and modes together, in the space of cylinder lengths.

In this space the joint limits form a box. If no cylinder needs boost, the energy of a motion is a
weighted sum of piston strokes. Every path on which no piston turns back then has the least possible
cost. A cylinder path is a polyline of cylinder lengths, and its corners are the waypoints.

`integrated_search` runs the pipeline over these modules:

    goal_postures   the postures in which a motion may end, sampled along the end-link angle ψ
    cylinder_path   cost of a cylinder path with the best mode combinations along it
    lattice         A* over lattice points of cylinder lengths and mode combinations
    refinement      removal and displacement of waypoints, change of the goal posture
    lower_bound     lower bound on the cost of every plan between the same end points
"""
