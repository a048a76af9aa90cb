"""Study on two processes: what payload and supply pressure do to the energy of a move.

    python examples/10_study.py [FOLDER]

Each process makes one planner and plans for the machines that it is given. Writes study.csv to
FOLDER. `mhsb_planner.cluster` has executors of a Dask cluster in place of processes.
"""

import sys
from itertools import product
from pathlib import Path

from mhsb_model import MhsbError, MotionState, load_machine
from mhsb_planner import Planner
from mhsb_planner.executor import SharedStateExecutor
from mhsb_planner.result_files import write_rows

PAYLOADS = (0.0, 10.0, 20.0)  # [kg]
PRESSURES = (3e6, 4e6, 5e6, 6e6)  # of the main pump [Pa]


def make_planner():
    """Make the planner of a process."""
    machine = load_machine()
    return machine, Planner(machine)


def plan_move(state, payload, pressure):
    """Return energy [J] and duration [s] of the move; a sentence if there is none."""
    machine, planner = state
    planner.change_machine(machine.changed(payload=payload, supply_pressure=pressure))
    start = MotionState.at_rest(machine.config.simulation.start_posture)
    try:
        plan = planner.plan((0.55, 0.60), start)
    except MhsbError as error:
        return payload, pressure, None, str(error)
    return payload, pressure, plan.energy.paper, plan.duration


if __name__ == "__main__":  # the processes import this file
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
    with SharedStateExecutor(2, make_planner) as workers:
        tasks = [workers.submit(plan_move, *values) for values in product(PAYLOADS, PRESSURES)]
        rows = [task.result() for task in tasks]
    for payload, pressure, energy, duration in rows:
        told = duration if energy is None else f"{energy:7.1f} J in {duration:5.2f} s"
        print(f"{payload:4.0f} kg at {1e-6 * pressure:g} MPa: {told}")
    write_rows(folder / "study.csv", ("payload_kg", "pressure_pa", "energy_j", "duration_s"), rows)
