"""Make a machine file of your own from a shipped one, and plan for it.

    python examples/05_own_machine.py [FOLDER]

Here joint 1 gets a larger cylinder and the arm a heavier payload. Writes my_arm.yaml to FOLDER. The
posture table of the new machine is built, which takes a few seconds, and kept in the user's cache.
"""

import sys
from pathlib import Path

import yaml

from mhsb_model import MhsbError, MotionState, find_config_file, load_machine
from mhsb_planner import Planner

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
folder.mkdir(parents=True, exist_ok=True)

content = yaml.safe_load(find_config_file("mhsb_arm3.yaml").read_text())
content["name"] = "my_arm"
content["joints"][0]["cylinder"]["bore"] = 0.032  # [m]
content["payload"]["mass"] = 16.0  # [kg]
file = folder / "my_arm.yaml"
file.write_text(yaml.safe_dump(content, sort_keys=False))

machine = load_machine(file)  # every problem of a file is named with its path
for name in ("mhsb_arm3.yaml", file):
    arm = load_machine(find_config_file(name) if isinstance(name, str) else name)
    start = MotionState.at_rest(arm.config.simulation.start_posture)
    plan = Planner(arm).plan((0.55, 0.60), start)
    print(f"{arm.name}, {arm.arrays.payload:g} kg: {plan!r}")

try:
    machine.changed(supply_pressure=40)  # [Pa]: 40 bar were meant
except MhsbError as error:
    print(f"a refused value: {error}")
