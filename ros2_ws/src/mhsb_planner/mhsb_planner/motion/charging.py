"""What servo pumps take to charge lines before boosts begin.

A line that is to be boosted is brought from P_S to its supply pressure p, and is there a while
before its cylinder needs it, since pumps take time and may be slower than is known. Its servo pump
gives for that

    E = [½ V/β (p − P_S)² + (A_dir |v| + leakage) (p − P_S) T] / η,   T = CHARGED_AHEAD · preview

with V the oil of the line, in shared boost that of the rail as well where nobody draws on it yet:
the oil's compression, and what the cylinder and its valve take meanwhile.
"""

from __future__ import annotations

import numpy as np

from mhsb_model.hydraulics import boosted_supply, inlet_area, leakage, oil_of
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
    boosted = BOOSTED[modes]
    begins = boosted[1:] & ~boosted[:-1]
    if not begins.any():
        return 0.0
    m, oil, circuit = machine.arrays, oil_of(machine.arrays), machine.config.circuit
    ahead = CHARGED_AHEAD * machine.config.servo.coordinated.preview
    work = 0.0
    for row, j in np.argwhere(begins).tolist():
        k = row + 1
        v, cap, rod = float(speed[k, j]), float(m.cap_area[j]), float(m.rod_area[j])
        volume, on_rail = circuit.line_volume, ON_RAIL[modes[k]]
        valve = float(m.valve_coefficient[j])
        supply = boosted_supply(oil, valve, cap, rod, float(force[k, j]), v)
        if on_rail[j] and not ON_RAIL[modes[row]].any():
            volume += circuit.rail_volume / float(on_rail.sum())
        rise = supply - m.supply_pressure
        drawn = inlet_area(cap, rod, v) * abs(v) + leakage(oil, supply)
        work += 0.5 * volume / circuit.bulk_modulus * rise * rise + drawn * rise * ahead
    return float(work / m.servo_pump_efficiency)
