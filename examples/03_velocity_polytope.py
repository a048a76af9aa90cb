"""Draw the velocity polytopes of a posture in several mode combinations.

    python examples/03_velocity_polytope.py [FOLDER]

The polytope is the set of tip velocities that valves and pumps allow. In boost the valve has more
pressure to meter with, but the servo pumps limit the flow. Writes polytopes.png to FOLDER.
"""

import sys
from pathlib import Path

import numpy as np

from mhsb_model import Mode, load_machine
from mhsb_model.figure_style import open_figure
from mhsb_model.modes import format_pattern
from mhsb_planner.posture.s1_polytope import compute_polytope_area, compute_polytope_vertices

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
folder.mkdir(parents=True, exist_ok=True)

machine = load_machine()
posture = np.array([0.4, -0.5, -0.3])  # stretched out forward [rad]
x, z = machine.tip_position(posture)
combinations = [
    [Mode.N, Mode.N, Mode.N],
    [Mode.DB, Mode.N, Mode.N],
    [Mode.SB, Mode.N, Mode.N],
    [Mode.SB, Mode.SB, Mode.N],
]

with open_figure(folder / "polytopes.png", height=6.0, width=7.0) as figure:
    axes = figure.add_subplot()
    for modes in combinations:
        pattern = np.array(modes, dtype=np.uint8)
        corners = compute_polytope_vertices(machine, posture, pattern)
        area = compute_polytope_area(machine, posture, pattern)
        label = f"{format_pattern(pattern)}: {area:.4f} m²/s²"
        print(label)
        axes.plot(*np.vstack([corners, corners[:1]]).T, label=label)
    axes.set(xlabel="tip velocity along x [m/s]", ylabel="tip velocity along z [m/s]")
    axes.set_title(f"tip at ({x:.2f}, {z:.2f}) m; modes of actuators 1-2-3 and area")
    axes.legend(loc="upper left")
print(f"picture: {folder / 'polytopes.png'}")
