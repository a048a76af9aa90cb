"""Energy that servo pumps need to charge lines before boosts begin.

A line to be boosted is raised from P_S to its supply pressure p. It reaches p some time before its
cylinder needs it, since pumps take time and may be slower than is known. For this its servo pump
delivers

    E = [½ V/β (p − P_S)² + (A_dir |v| + leakage) (p − P_S) T] / η,   T = CHARGED_AHEAD · preview

V is the volume of the line. In shared boost the volume of the rail is added, divided among the
actuators that join it, if no actuator was on the rail before. The first term compresses
the oil. The second is the flow that cylinder and valve take during T.
"""

from __future__ import annotations

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import (
    boosted_supply,
    compute_valve_leakage,
    get_shared_hydraulics,
    inlet_area,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED_MODES, RAIL_MODES
from mhsb_model.types import FloatArray, ModeArray

CHARGED_AHEAD = 0.4
"""Share of the servo's preview during which a line is at its pressure before the boost begins [-].

Measured: 0.40 on 22 boosts of the simulated arm."""


def charging_energy(
    machine: Machine, speed: FloatArray, force: FloatArray, modes: ModeArray
) -> float:
    """Compute the shaft work that charges lines before boosts.

    A boost begins in a row whose mode is boosted after a row whose mode is not. A boost that is in
    force in the first row costs nothing.

    Args:
        machine: Machine with its circuit and servo settings.
        speed: Piston speeds at the beginning of each row, shape (k, n) [m/s]. Further rows are
            ignored.
        force: Piston forces at the beginning of each row, shape (k, n) [N].
        modes: Mode codes of each row, shape (k, n).

    Returns:
        Shaft work of the servo pumps [J].
    """
    m, circuit = machine.arrays, machine.config.circuit
    ahead = CHARGED_AHEAD * machine.servo_preview
    volumes = circuit.line_volume, circuit.rail_volume
    work = _compute_charging_work(m, volumes, circuit.bulk_modulus, ahead, speed, force, modes)
    return float(work / m.servo_pump_efficiency)


@kernel(borrows=True)
def _compute_charging_work(
    m: MachineArrays,
    volumes: tuple[float, float],
    bulk_modulus: float,
    charged_time: float,
    speed: FloatArray,
    force: FloatArray,
    modes: ModeArray,
) -> float:
    """Compute the hydraulic work that charges lines before boosts, without pump losses.

    The caller also calls it for motions without boost, so that it is compiled before the first
    boost. Test oracle: sums computed by hand.

    Args:
        m: Arrays of the machine.
        volumes: Oil volume of each actuator's line and of the shared boost line [m³].
        bulk_modulus: Bulk modulus β of the oil [Pa].
        charged_time: Time T for which a line is at its pressure before the boost begins [s].
        speed: Piston speeds at the beginning of each row, shape (k, n) [m/s]. Further rows are
            ignored.
        force: Piston forces at the beginning of each row, shape (k, n) [N].
        modes: Mode codes of each row, shape (k, n).

    Returns:
        Work that reaches the oil [J].
    """
    oil, work, (line_volume, rail_volume) = get_shared_hydraulics(m), 0.0, volumes
    for k in range(1, len(modes)):
        for j in range(modes.shape[1]):
            if not BOOSTED_MODES[modes[k, j]] or BOOSTED_MODES[modes[k - 1, j]]:
                continue
            v, cap, rod, volume = speed[k, j], m.cap_area[j], m.rod_area[j], line_volume
            if RAIL_MODES[modes[k, j]] and _count_on_rail(modes, k - 1) == 0:
                volume += rail_volume / _count_on_rail(modes, k)
            supply = boosted_supply(oil, m.valve_coefficient[j], cap, rod, force[k, j], v)
            rise = supply - oil.supply_pressure
            drawn = inlet_area(cap, rod, v) * abs(v) + compute_valve_leakage(oil, supply)
            work += 0.5 * volume / bulk_modulus * rise * rise + drawn * rise * charged_time
    return work


@kernel(borrows=True)
def _count_on_rail(modes: ModeArray, k: int) -> int:
    """Count the actuators whose mode in row k joins them to the rail.

    Args:
        modes: Mode codes, shape (rows, n).
        k: Index of the row.

    Returns:
        Number of actuators on the rail.
    """
    count = 0
    for j in range(modes.shape[1]):
        if RAIL_MODES[modes[k, j]]:
            count += 1
    return count
