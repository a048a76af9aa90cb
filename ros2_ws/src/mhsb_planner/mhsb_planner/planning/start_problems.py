"""Messages on a start that is not admissible: beyond joint limits, or in an obstacle."""

from __future__ import annotations

import numpy as np

from mhsb_model.errors import suggest_unit_of_number
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.search.goal_clearance import describe_start_contact

NAMED_EXCESS = 1e-3
"""Excess over a joint limit above which a message names the joint [rad or m]. It is more than the
noise of a joint's sensor.
"""


def describe_limit_excess(machine: Machine, posture: FloatArray) -> str:
    """Describe which joints are beyond their limits in a posture.

    Args:
        machine: The arm.
        posture: Joint positions, shape (n,) [rad or m].

    Returns:
        Name, value, excess and limit of each joint whose excess is above NAMED_EXCESS; empty if
        there is none. An example is "joint_1 at 2.494 rad, 0.02 rad beyond its upper limit of 2.474
        rad".
    """
    a, words = machine.arrays, []
    for j, value in enumerate(posture.tolist()):
        unit, low, high = machine.joint_units[j], a.joint_min[j], a.joint_max[j]
        side, limit = ("upper", high) if value > high else ("lower", low)
        excess = max(value - high, low - value)
        if excess > NAMED_EXCESS:
            words.append(
                f"{machine.joint_names[j]} at {value:.4g} {unit}, {excess:.4g} {unit} beyond its "
                f"{side} limit of {limit:.4g} {unit}"
            )
    return " and ".join(words)


def suggest_unit_of_start(machine: Machine, posture: FloatArray) -> str:
    """Return a clause that asks whether a start posture was meant in degrees or in mm.

    Args:
        machine: The arm.
        posture: Joint positions, shape (n,) [rad or m].

    Returns:
        The clause, for the first joint that exceeds a limit by more than its whole range. Empty if
        there is no such joint.
    """
    low, high = machine.arrays.joint_min, machine.arrays.joint_max
    for j in np.flatnonzero(np.maximum(posture - high, low - posture) > high - low):
        unit = machine.joint_units[j]
        return suggest_unit_of_number(float(posture[j]), unit, float(low[j]), float(high[j]))
    return ""


def describe_start_problems(machine: Machine, posture: FloatArray) -> str:
    """Return a clause on joints beyond their limits and on obstacles touched at the start.

    Args:
        machine: The arm.
        posture: Start posture, shape (n,) [rad or m].

    Returns:
        The clause; empty if nothing is wrong.
    """
    beyond = describe_limit_excess(machine, posture)
    clauses = (
        f"the arm starts with {beyond}" if beyond else "",
        describe_start_contact(machine, posture),
    )
    return "; ".join(filter(None, clauses))
