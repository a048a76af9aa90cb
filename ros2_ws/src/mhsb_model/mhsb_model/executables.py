"""Executables of `ros2 run mhsb_model`."""

from mhsb_model.process import forward_to_tools, run_named

check = forward_to_tools("check")
"""Forwards to the command `check` in mhsb_tools, so that its earlier spelling works."""

if __name__ == "__main__":
    run_named(globals())
