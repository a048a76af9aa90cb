"""The guard: boosts what the plan does not, and slows the plan down, before the arm sags.

A schedule of modes and its timing are a proposal, made for the machine as its file says. The guard
goes by what is measured. Of each actuator

    p_L = (F + a p_T)/A extending, (−F + A p_T)/a retracting    load pressure, F = p_A A − p_B a
    r   = p̂ + T ṗ̂ − p_L − m(v)                                  reserve [Pa] in T, at full pace

with p̂, ṗ̂ the filtered pressure of its line and how fast it falls. Where the reserve that the main
pump leaves it in N is too small, it is boosted until there has been plenty of it for a while. What
boosting cannot give, or not yet, slowing does: the pace falls with the smallest reserve, with a
valve that stays nearly open, and with the tip's distance from its reference, down to a hold.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mhsb_model.hydraulics import pressure_against
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import extended, turned
from mhsb_model.linkages.linkage import motion
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED, Mode
from mhsb_model.statics import Chain, chain_of
from mhsb_model.types import FloatArray, ModeArray
from mhsb_sim.records import Record, Records
from mhsb_sim.servo.controller import ServoSignals
from mhsb_sim.servo.pace import keep_pace
from mhsb_sim.servo.reference import Reference

SMOOTHING = 0.1
"""α of what is measured, in the α-β filter with β = α²/(2 − α): 10 ms at 1 kHz."""

BOOSTED_SMOOTHING = 0.03
"""Time constant of a boosted line's reserve [s]: what it lacks for a moment, its pump gives."""

FORESIGHT = 0.04
"""T, about what a pump takes to charge a line [s]."""

BOOST_BELOW, BOOST_AFTER = -3e4, 0.01
"""Reserve in N [Pa] below which an actuator is boosted, once it has lasted [s]: a plan may use all
of P_S, of which the main pump's droop and the check valve take 0.025 MPa."""

KEPT_BELOW = -1.5e5
"""Reserve in N [Pa] below which a boost that the plan ends is kept. A line that needs less beyond
P_S loses next to nothing while `BOOST_AFTER` tells whether it lasts: the plan lets inertia
use up its margin, and a reserve that is measured comes late."""

RELEASE_ABOVE, RELEASE_AFTER = 4.5e5, 0.3
"""Reserve in N [Pa] above which it is let go, once it has lasted [s]."""

FULL_PACE_ABOVE, HOLD_BELOW = -8e4, -2.0e5
"""Reserve in N [Pa]: full pace above, none below, linear in between."""

BOOSTED_FULL_ABOVE, BOOSTED_HOLD_BELOW = -0.5e5, -2.5e5
"""The same of a boosted line, which is kept at what is needed."""

WIDE, WIDE_OPEN, OPENING_SMOOTHING = 0.7, 0.9, 0.1
"""Opening of a valve: full pace below, none above, linear in between, and the time constant of its
filter [s]. A valve that stays nearly open has no flow left to catch up with."""

ERROR_HOLDS = 1.7
"""Distance of the tip from its reference, in usual ones: full pace up to one, none from here on."""

HELD = 0.02
"""Rate below which a plan counts as held."""

ERROR_LIFTS = 0.9
"""Distance of the tip from its reference, in usual ones, beyond which a load that has sagged counts
as held, also where it is let down: it has to be lifted back."""

LIFTING = 1e5
"""Pressure beyond what holds it [Pa] that this takes: a piston that stalls has all there is."""

SOON = 1
"""Number of the point of the reference by which it is told that a motion sets out."""

MOVING, SETTING_OUT = 1e-5, 1e-3
"""Speeds of a piston [m/s] from which on it moves, now and soon."""

GUARDED = np.dtype(
    [
        ("line", "f8"),  # Pa, filtered pressure of its line
        ("force", "f8"),  # N, filtered
        ("off", "f8"),  # rad, of the joint from its reference
        ("opening", "f8"),  # of its valve, as commanded, filtered
        ("reserve", "f8"),  # Pa, of its line
        ("share", "f8"),  # of the full pace that this allows
        ("unboosted", "f8"),  # Pa, what it would be in N
        ("lasting", "f8"),  # s, for which it has been too small, or plenty while boosted
        ("wanted", "i8"),  # mode that the guard asks for
    ]
)

OVERALL = np.dtype(
    [
        ("step", "f8"),  # s
        ("usual_error", "f8"),  # m, of the tip
        ("supply", "f8"),  # Pa, what the main pump leaves at the lines in N, filtered
        ("supply_rate", "f8"),  # Pa/s
        ("error", "f8"),  # m, of the tip
        ("behind", "f8"),  # m, likewise, less what it is ahead
        ("awake", "f8"),  # 0 until the filters have begun
        ("slowings", "f8"),  # times that the pace began to fall
        ("slowed", "f8"),  # s, in all
        ("held", "f8"),  # s, for which the pace has been next to nothing
    ]
)


class Guard(NamedTuple):
    """What the guard works on, as its kernels take it."""

    sensors: Records  # SENSOR[n], likewise as in ServoSignals the two below
    modes: ModeArray
    scheduled: ModeArray  # [n] what the plan has now, or prepares
    reference: FloatArray
    pace: Records  # PACE[1] of the reference, likewise the one below
    wanted: FloatArray
    cylinders: Records  # of the circuit as the servo knows it, likewise the one below
    constants: Records
    commands: Records  # of the circuit's actuators
    linkage: FloatArray  # [n, LINKAGE_WIDTH]
    chain: Chain
    actuators: Records  # GUARDED[n]
    overall: Records  # OVERALL[1]


def guard_of(
    machine: Machine, signals: ServoSignals, reference: Reference, usual_error: float
) -> Guard:
    """The guard of a machine at its start.

    usual_error  of an arm of the paper's size, as the controller has it [m]
    """
    overall = np.zeros(1, OVERALL)
    overall["step"] = machine.config.simulation.step
    overall["usual_error"] = machine.scale * usual_error
    return Guard(
        sensors=signals.sensors,
        modes=signals.modes,
        scheduled=signals.modes.copy(),
        reference=signals.reference,
        pace=reference.pace,
        wanted=reference.wanted,
        cylinders=signals.circuit.cylinders,
        constants=signals.circuit.constants,
        commands=signals.circuit.actuators,
        linkage=machine.arrays.linkage,
        chain=chain_of(machine.arrays),
        actuators=np.zeros(machine.joint_count, GUARDED),
        overall=overall,
    )


@kernel(borrows=True)
def watch(g: Guard) -> bool:
    """One step of the guard: look, ask for boost, set the pace.

    Whether what it asks for has changed.
    """
    look(g)
    pace, o, changed = g.pace[0], g.overall[0], False
    share = max((ERROR_HOLDS - o.behind / o.usual_error) / (ERROR_HOLDS - 1.0), 0.0)
    for j in range(len(g.actuators)):
        actuator = g.actuators[j]
        changed = ask(actuator, BOOSTED[g.scheduled[j]], o.step) or changed
        actuator.opening += o.step / OPENING_SMOOTHING * (
            abs(g.commands[j].valve_command) - actuator.opening
        )
        actuator.share = share_of(actuator, BOOSTED[g.modes[j]])
        share = min(share, actuator.share)
    before = pace.rate
    keep_pace(pace, min(share, 1.0), o.step)
    if pace.rate < 1.0:
        o.slowed += o.step
        o.slowings += 1.0 if before == 1.0 else 0.0
    o.held = o.held + o.step if pace.rate < HELD else 0.0
    return changed


@kernel(borrows=True)
def look(g: Guard) -> None:
    """Filter what is measured, and write every actuator's reserves and the tip's error."""
    c, o = g.constants[0], g.overall[0]
    supply = math.inf
    for j in range(len(g.actuators)):
        if not BOOSTED[g.modes[j]]:
            supply = min(supply, g.sensors[j].line_pressure)
    if o.awake == 0.0:
        o.supply = min(supply, c.supply_pressure)
    if supply < math.inf:
        o.supply, o.supply_rate = followed(o.supply, o.supply_rate, supply, o.step)
    for j in range(len(g.actuators)):
        actuator, sensor, cylinder = g.actuators[j], g.sensors[j], g.cylinders[j]
        cap, rod = cylinder.cap_area, cylinder.rod_area
        force = cap * sensor.cap_pressure - rod * sensor.rod_pressure
        if o.awake == 0.0:
            actuator.line, actuator.force = sensor.line_pressure, force
        actuator.line += SMOOTHING * (sensor.line_pressure - actuator.line)
        actuator.force += SMOOTHING * (force - actuator.force)
        length, arm, _ = motion(g.linkage[j], g.reference[0, 0, j])
        away = sensor.length - length
        actuator.off = away / arm
        speed, ahead = arm * g.wanted[j], arm * g.reference[SOON, 1, j]
        k, tank, needed, soon = cylinder.valve_coefficient, c.tank_pressure, 0.0, 0.0
        if cylinder.min_length < sensor.length < cylinder.max_length:  # no end stop carries it
            if abs(speed) > MOVING:
                needed = pressure_against(k, cap, rod, tank, actuator.force, speed)
            if abs(ahead) > SETTING_OUT:
                soon = pressure_against(k, cap, rod, tank, actuator.force, ahead)
            if o.error > ERROR_LIFTS * o.usual_error and away * actuator.force < 0.0:
                held = pressure_against(k, cap, rod, tank, actuator.force, 0.0)
                needed = max(needed, held + LIFTING)
        least = max(0.0, needed, soon)
        actuator.unboosted = o.supply + FORESIGHT * min(o.supply_rate, 0.0) - least
        if BOOSTED[g.modes[j]]:
            lasting = actuator.line - max(0.0, needed) - actuator.reserve
            actuator.reserve += o.step / BOOSTED_SMOOTHING * lasting
        else:
            actuator.reserve = actuator.unboosted
    o.error, o.behind = tip_errors(g.chain, g.reference[0, 0], g.wanted, g.actuators)
    o.awake = 1.0


@kernel
def followed(value: float, rate: float, measured: float, step: float) -> tuple[float, float]:
    """α-β filter: value and its rate a step [s] later. Source: Kalata, IEEE TAES-20, 1984."""
    away = measured - value - step * rate
    beta = SMOOTHING * SMOOTHING / (2.0 - SMOOTHING)
    return value + step * rate + SMOOTHING * away, rate + beta / step * away


@kernel
def ask(actuator: Record, scheduled: bool, step: float) -> bool:
    """Ask for boost or let it go, by the reserve in N; whether that has changed.

    Of an actuator that the plan boosts, too, nothing is kept: what it takes to get going is no
    reason to boost it after that.
    """
    boosts, reserve = actuator.wanted != Mode.N, actuator.unboosted
    if boosts:
        due = reserve > (KEPT_BELOW if scheduled else RELEASE_ABOVE)
        after = 0.0 if scheduled else RELEASE_AFTER
    else:
        due = reserve < (KEPT_BELOW if scheduled else BOOST_BELOW)
        after = BOOST_AFTER
    actuator.lasting = actuator.lasting + step if due else 0.0
    if not due or actuator.lasting < after:
        return False
    actuator.lasting = 0.0
    actuator.wanted = Mode.N if boosts else Mode.DB
    return True


@kernel
def share_of(actuator: Record, boosted: bool) -> float:
    """Share of the full pace that an actuator's reserve and its valve allow, 0 … 1."""
    full = BOOSTED_FULL_ABOVE if boosted else FULL_PACE_ABOVE
    none = BOOSTED_HOLD_BELOW if boosted else HOLD_BELOW
    pressure = (actuator.reserve - none) / (full - none)
    opening = (WIDE_OPEN - actuator.opening) / (WIDE_OPEN - WIDE)
    return min(max(min(pressure, opening), 0.0), 1.0)


@kernel(borrows=True)
def tip_errors(
    c: Chain, q: FloatArray, speed: FloatArray, actuators: Records
) -> tuple[float, float]:
    """|J Δq|, how far the tip is from its reference [m], and the same less what it is ahead.

    Across the plane, where joint 1 slews, as well as in it.
    q[n] [rad], speed[n] [rad/s] at full pace. What it is ahead, slowing would not mend.
    """
    angle = off = turning = x = z = along = across = 0.0
    distance = c.slew_offset  # from the slew's axis
    for j in range(len(q)):
        angle += turned(c.turns, q, j)
        cosine, sine = math.cos(angle), math.sin(angle)
        if c.slides[j]:
            x += actuators[j].off * cosine
            z += actuators[j].off * sine
            along += speed[j] * cosine
            across += speed[j] * sine
        elif c.turns[j]:
            off += actuators[j].off
            turning += speed[j]
        reach = extended(c.slides, c.length, q, j)
        distance += reach * cosine
        right, up = -reach * sine, reach * cosine
        x += right * off
        z += up * off
        along += right * turning
        across += up * turning
    error, fast, ahead = math.hypot(x, z), math.hypot(along, across), x * along + z * across
    if c.slews:
        y, aside = distance * actuators[0].off, distance * speed[0]
        error, fast, ahead = math.hypot(error, y), math.hypot(fast, aside), ahead + y * aside
    if ahead <= 0.0:
        return error, error
    ahead /= fast
    return error, math.sqrt(max(0.0, error * error - ahead * ahead))
