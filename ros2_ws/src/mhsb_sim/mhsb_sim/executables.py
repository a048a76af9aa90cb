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


MOVED_COMMANDS = (
    "simulate",
    "compare",
    "study",
    "tune",
    "record",
    "report",
    "animate",
    "demo",
    "viewer",
)
"""Commands that belong to mhsb_tools; `ros2 run mhsb_sim NAME` forwards to them."""
globals().update({name: forward_to_tools(name) for name in MOVED_COMMANDS})

if __name__ == "__main__":
    run_named(globals())
