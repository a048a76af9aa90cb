"""What there is to know of all actuators at one moment."""

from __future__ import annotations

from dataclasses import dataclass

from mhsb_model.types import FloatArray


@dataclass(frozen=True)
class ActuatorStates:
    """State of all actuators, float64[n] each unless said otherwise; SI units."""

    cap_pressure: FloatArray  # Pa
    rod_pressure: FloatArray  # Pa
    supply_pressure: FloatArray  # Pa, of the actuator's line
    force: FloatArray  # N, p_A A − p_B a
    piston_speed: FloatArray  # m/s, positive in extension
    valve_opening: FloatArray  # −1 … 1, positive extends
    valve_command: FloatArray  # likewise, what the servo asks for
    supply_flow: FloatArray  # m³/s, from the line into the cylinder
    servo_pump_flow: FloatArray  # m³/s, float64[modules]
    servo_pump_speed: FloatArray  # share of full speed, float64[modules]
    servo_pump_command: FloatArray  # likewise, what the servo asks for
    rail_pressure: float  # Pa
    manifold_pressure: float  # Pa
