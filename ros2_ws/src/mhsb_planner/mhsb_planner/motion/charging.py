"""What servo pumps take to charge lines before boosts begin.

A line that is to be boosted is brought from P_S to its supply pressure p, and is there a while
before its cylinder needs it, since pumps take time and may be slower than is known. Its servo pump
gives for that

    E = [½ V/β (p − P_S)² + (A_dir |v| + leakage) (p − P_S) T] / η,   T = CHARGED_AHEAD · preview

with V the oil of the line, in shared boost that of the rail as well where nobody draws on it yet:
the oil's compression, and what the cylinder and its valve take meanwhile.
"""

from __future__ import annotations

from mhsb_model.arrays import MachineArrays
from mhsb_model.hydraulics import boosted_supply, inlet_area, leakage, oil_of
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED, ON_RAIL
from mhsb_model.types import FloatArray, ModeArray

CHARGED_AHEAD = 0.4
"""Share of the servo's preview for which a line is at its pressure before the boost begins;
measured, 0.40 on 22 boosts of the simulated arm."""


def charging_energy(
    machine: Machine, speed: FloatArray, force: FloatArray, modes: ModeArray
) -> float:
    """Shaft work [J] that charges lines before the boosts that begin after the first row.

    speed, force  float64[k, n] m/s, N, at the beginning of each row
    modes         uint8[k, n]
    """
    m, circuit = machine.arrays, machine.config.circuit
    ahead = CHARGED_AHEAD * machine.config.servo.coordinated.preview
    volumes = circuit.line_volume, circuit.rail_volume
    work = _work(m, *volumes, circuit.bulk_modulus, ahead, speed, force, modes)
    return float(work / m.servo_pump_efficiency)


@kernel(borrows=True)
def _work(
    m: MachineArrays,
    line_volume: float,
    rail_volume: float,
    bulk_modulus: float,
    ahead: float,
    speed: FloatArray,
    force: FloatArray,
    modes: ModeArray,
) -> float:
    """What reaches the oil [J], of lines of these volumes [m³].

    It is called for motions without a boost, too: the first one with a boost is then as fast as
    others. Oracle: sums done by hand.
    """
    oil, work = oil_of(m), 0.0
    for k in range(1, len(modes)):
        for j in range(modes.shape[1]):
            if not BOOSTED[modes[k, j]] or BOOSTED[modes[k - 1, j]]:
                continue
            v, cap, rod, volume = speed[k, j], m.cap_area[j], m.rod_area[j], line_volume
            if ON_RAIL[modes[k, j]] and _on_rail(modes, k - 1) == 0:
                volume += rail_volume / _on_rail(modes, k)
            supply = boosted_supply(oil, m.valve_coefficient[j], cap, rod, force[k, j], v)
            rise = supply - oil.supply_pressure
            drawn = inlet_area(cap, rod, v) * abs(v) + leakage(oil, supply)
            work += 0.5 * volume / bulk_modulus * rise * rise + drawn * rise * ahead
    return work


@kernel(borrows=True)
def _on_rail(modes: ModeArray, k: int) -> int:
    """How many actuators draw on the rail in row k."""
    count = 0
    for j in range(modes.shape[1]):
        if ON_RAIL[modes[k, j]]:
            count += 1
    return count
