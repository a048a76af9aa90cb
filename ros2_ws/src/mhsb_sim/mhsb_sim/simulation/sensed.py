"""What a servo has of its arm at one moment: what sensors tell, and what it asks for."""

from __future__ import annotations

from dataclasses import dataclass

from mhsb_model.types import FloatArray, ModeArray


@dataclass(frozen=True)
class Sensed:
    """Of n actuators and m servo pumps, SI units.

    length         float64[n] m, between the pins of each cylinder
    pressure       float64[n, 3] Pa: cap side, rod side, line
    silent         float64[4 n + 1 + m] s, for which each sensor has told no number: all lengths,
                   the pressures actuator by actuator, the rail's, the pumps' speeds
    valve_command  float64[n] −1 … 1, positive extends
    pump_flow      float64[m] m³/s, by the pumps' speeds
    pump_command   float64[m] m³/s
    modes          uint8[n] that are prepared
    """

    length: FloatArray
    pressure: FloatArray
    silent: FloatArray
    valve_command: FloatArray
    pump_flow: FloatArray
    pump_command: FloatArray
    modes: ModeArray
