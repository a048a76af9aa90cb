"""Path, posture and modes decided together, in the space of the cylinders' lengths.

There joint limits are a box, and where no cylinder needs boost a motion costs the oil it takes,
a weighted sum of strokes: every way that never turns back is as cheap as the lower bound. A route
is a polygon of cylinder lengths; the pipeline in `integrated_search`:

    goal_postures   the goal's posture set, sampled along ψ
    route           what a route costs, with the best modes along it
    lattice         A* over lattice points and mode patterns
    refinement      corners taken out and moved, the goal's ψ turned
    certificate     what no plan between these end points undercuts
"""
