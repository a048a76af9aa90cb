"""Executables that `ros2 run mhsb_sim` starts."""

import os
from typing import NoReturn

from mhsb_model.process import forward_to_tools, make_node_entry, run_named


def sim_node() -> NoReturn:
    """Run the simulator node.

    The node draws nothing, so the variable MUJOCO_GL is set to `disable` unless the user has set
    it. Otherwise MuJoCo would look for GLFW in a separate process. That process prints a traceback
    if a signal ends the node.
    """
    os.environ.setdefault("MUJOCO_GL", "disable")
    make_node_entry("mhsb_sim.ros.sim_node")()


# These commands belong to mhsb_tools; `ros2 run mhsb_sim NAME` forwards to them.
simulate = forward_to_tools("simulate")
compare = forward_to_tools("compare")
study = forward_to_tools("study")
tune = forward_to_tools("tune")
record = forward_to_tools("record")
report = forward_to_tools("report")
animate = forward_to_tools("animate")
demo = forward_to_tools("demo")
viewer = forward_to_tools("viewer")

if __name__ == "__main__":
    run_named(globals())
