"""Remarks on what keeps an arm from moving: its start, its payload, and obstacles."""

import numpy as np

from mhsb_model.errors import MhsbError, suggest_unit_of_number
from mhsb_model.hydraulics import (
    compute_required_pressures,
    get_max_supply_pressure,
    get_shared_hydraulics,
)
from mhsb_model.machine import Machine
from mhsb_model.types import FloatArray
from mhsb_planner.errors import DeadlineError, NoPathError
from mhsb_planner.motion.s3_trajectory import FitError
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.goal_clearance import describe_start_contact

NAMED_EXCESS = 1e-3
"""Excess over a joint limit above which a message names the joint [rad or m], more than the noise
of a joint's sensor.
"""

NAMED_OVERLOAD_SHARE = 0.1
"""Share of the table's nodes at which no posture holds the payload from which on a remark names it
[-].
"""


def append_remarks(
    error: MhsbError, machine: Machine, table: PostureTable, start: FloatArray
) -> MhsbError:
    """Append clauses on problems of the start and of the payload to an error's sentence.

    Problems of the start are joints beyond their limits and an obstacle that the arm touches. The
    payload is mentioned only in a NoPathError or FitError, and only if the arm cannot carry it.
    Obstacles are named in a DeadlineError, since the goal may be out of reach only because of them.
    A clause that the sentence contains already is not repeated.

    Args:
        error: Error that planning raised. Its `args` are changed in place.
        machine: The whole arm.
        table: Posture table of its plane.
        start: Posture at the start, shape (n,) [rad or m].

    Returns:
        The same error.
    """
    remarks = [describe_start_problems(machine, start)]
    if isinstance(error, NoPathError | FitError):
        remarks.append(describe_overload(machine, table, start))
    if isinstance(error, DeadlineError) and (names := machine.obstacles.names):
        remarks.append(f"all motions must keep clear of {', '.join(names)}")
    for remark in remarks:
        if remark and remark not in str(error):
            error.args = (f"{error}; {remark}",)
    return error


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
        there is no such joint, or if its value is beyond the limits in the other unit too.
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


def describe_overload(machine: Machine, table: PostureTable, start: FloatArray) -> str:
    """Describe where the arm cannot hold its payload, which may be why there is no path.

    The start is checked first, then the posture table.

    Args:
        machine: The whole arm.
        table: Posture table of its plane. Only `posture` is read.
        start: Posture at the start, shape (n,) [rad or m].

    Returns:
        A clause. If the payload cannot be held at the start, the clause names payload, actuator,
        needed pressure and highest supply pressure. Otherwise it gives the share of the table's
        nodes at which no posture holds the payload. Empty if that share is below
        NAMED_OVERLOAD_SHARE.
    """
    m = machine.arrays
    highest = get_max_supply_pressure(get_shared_hydraulics(m), m.module_count)
    needed = _find_needed_pressures(machine, start[None, :])[0]
    j = int(np.argmax(needed))
    if needed[j] > highest:
        return (
            f"to hold the payload of {m.payload:.4g} kg at the start, {machine.actuator_names[j]} "
            f"needs {needed[j] / 1e6:.3g} MPa, and the highest pressure is {highest / 1e6:.3g} MPa"
        )
    needed_at_nodes = np.full(table.posture.shape[:2], np.inf)
    reached = np.isfinite(table.posture[..., 0])
    postures = np.ascontiguousarray(table.posture[reached])
    needed_at_nodes[reached] = _find_needed_pressures(machine.planar_arm, postures).max(axis=1)
    least = needed_at_nodes.min(axis=1)[reached.any(axis=1)]
    share = float(np.mean(least > highest))
    if share < NAMED_OVERLOAD_SHARE:
        return ""
    return (
        f"at {100 * share:.0f} % of the table's nodes, no posture holds the payload "
        f"of {m.payload:.4g} kg with the highest pressure of {highest / 1e6:.3g} MPa"
    )


def _find_needed_pressures(machine: Machine, postures: FloatArray) -> FloatArray:
    """Compute the supply pressure that each actuator needs to hold the arm at rest, per posture.

    Args:
        machine: The arm.
        postures: Postures, shape (k, n) [rad or m].

    Returns:
        Pressures, shape (k, n) [Pa], aligned with `postures`.
    """
    force = machine.piston_forces_in(postures)
    return compute_required_pressures(machine.arrays, force, np.zeros_like(force))
