"""What `ros2 run mhsb_model` starts."""

from mhsb_model.process import command, run_named

check = command("mhsb_model.check")

if __name__ == "__main__":
    run_named(globals())
