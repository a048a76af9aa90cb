"""The published energies by several readings of the paper's energy, on the paths of a machine.

    python docs/energy_readings.py [MACHINE]

Readings: the suite's own (A|ΔL|/T and leakage, boosted oil at p_L/η); pumps in series; without
leakage; and Q from V_max and area for every joint that moves, whatever its own speed.
"""

from __future__ import annotations

import sys

import numpy as np

from mhsb_model.hydraulics import inlet_area, load_pressure
from mhsb_model.machine import Machine, load_machine
from mhsb_model.modes import BOOSTED_MODES
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_tools.reproduction import runs
from mhsb_tools.reproduction.expectations import PUBLISHED_ENERGY

MOVES = 1e-6  # m


def energy(machine: Machine, path: DiscretePath, *, leaks: bool, at_v_max: bool) -> float:
    """Σ price (Q + q_leak) T in J, Q either A|ΔL|/T or A V_max where the cylinder moves."""
    m, total = machine.arrays, 0.0
    for k in range(path.steps):
        start, end = path.posture[k : k + 2]
        stroke = machine.cylinder_lengths(end) - machine.cylinder_lengths(start)
        force, duration = machine.piston_forces(0.5 * (start + end)), path.duration[k]
        for j, delta in enumerate(stroke):
            cap, rod = m.cap_area[j], m.rod_area[j]
            price = m.supply_pressure
            if BOOSTED_MODES[path.modes[k, j]]:
                held = load_pressure(cap, rod, m.tank_pressure, force[j], delta)
                price = max(price, held / m.servo_pump_efficiency)
            volume = inlet_area(cap, rod, delta) * abs(delta)
            if at_v_max and abs(delta) > MOVES:
                volume = inlet_area(cap, rod, delta) * m.max_piston_speed[j] * duration
            total += price * (volume + leaks * m.leakage_flow * duration)
    return total


def main() -> None:
    """Print a row for each published energy."""
    machine = load_machine(sys.argv[1] if len(sys.argv) > 1 else None)
    asked = runs.settings() | runs.published_settings()
    names = [name for name, _ in PUBLISHED_ENERGY.values()]
    chosen = {**{n: asked[n] for n in names}}
    chosen |= {runs.published_run(n): asked[runs.published_run(n)] for n in names}
    found = runs.evaluate(machine, chosen)
    print("run                 search     paper   own  series  no leakage  V_max boosted  cm³ in N")
    for name, joules in PUBLISHED_ENERGY.values():
        for search, run in (("exact", found[name]), ("published", found[runs.published_run(name)])):
            if run.path is None:
                continue
            values = [
                energy(run.machine, run.path, leaks=leaks, at_v_max=at_v_max)
                for leaks, at_v_max in ((False, False), (True, True))
            ]
            boosted = float(run.path.duration[BOOSTED_MODES[run.path.modes].any(axis=1)].sum())
            share = boosted / float(run.path.duration.sum())
            oil = energy(run.machine, run.path, leaks=True, at_v_max=False)
            assert np.isclose(oil, run.path.energy.sum(), rtol=0.02), name
            print(
                f"{name:19s} {search:9s} {joules:6.0f} {run.path.energy.sum():5.0f} "
                f"{run.path.energy_series.sum():7.0f} {values[0]:11.0f} {values[1]:6.0f} "
                f"{100 * share:6.0f} % {1e6 * joules / run.machine.arrays.supply_pressure:9.0f}"
            )


if __name__ == "__main__":
    main()
