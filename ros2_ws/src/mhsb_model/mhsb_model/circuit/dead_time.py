"""Dead time of a machine: the time from a command to the motion that it causes.

    T = T_c + 2 ζ / ω

T_c is the delay of computer and bus, `imperfections.computing_delay` [s]. ω = 2π f and ζ are
frequency [rad/s] and damping of the valve's spool, whose velocity lag is 2 ζ / ω.

Source: G. F. Franklin, J. D. Powell, A. Emami-Naeini, Feedback Control of Dynamic Systems (steady
error of a second-order system for a ramp).
"""

import math

from mhsb_model.machine import Machine

SETTLING_TIME = 1.0
"""Time after a plan's end within which the tip must be at the goal, without dead time [s]."""

SETTLING_DEAD_TIMES = 8.0
"""Dead times added to SETTLING_TIME [-]: four corrections at rest, with two dead times each."""


def compute_settling_time(machine: Machine) -> float:
    """Compute the time after a plan's end within which the tip must be at the goal [s].

    The result is `SETTLING_TIME` plus `SETTLING_DEAD_TIMES` times the machine's dead time.

    Args:
        machine: The machine as declared in its file (the real one may differ).
    """
    return SETTLING_TIME + SETTLING_DEAD_TIMES * compute_dead_time(machine)


def compute_dead_time(machine: Machine) -> float:
    """Compute how long before a plan's start the servo must know the plan.

    A servo without pressure sensors sends its commands this long ahead of the plan. So it must
    receive a new plan earlier by this time.

    Args:
        machine: The machine as declared in its file (the real one may differ).

    Returns:
        Dead time [s]: the delay of computer and bus plus the velocity lag of the valve's spool, but
        at least `Machine.expected_delay`. The result is 0 for machines with pressure sensors,
        because their servos need not send commands ahead.
    """
    config = machine.config
    if config.imperfections.sensors.pressure != "none":
        return 0.0
    delay = config.imperfections.computing_delay + compute_valve_lag(machine)
    return max(delay, machine.expected_delay)


def compute_valve_lag(machine: Machine) -> float:
    """Compute the lag of a valve's spool behind its command, 2 ζ / ω [s].

    Args:
        machine: The machine as declared in its file (the real one may differ).
    """
    circuit = machine.config.circuit
    return circuit.valve_damping / (math.pi * circuit.valve_frequency)
