"""What an arm, or its simulator, reports: what became of plans, and how it is itself."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class HandOverOutcome(StrEnum):
    """What became of a plan."""

    APPLIED = "applied"
    REFUSED = "refused"
    DROPPED = "dropped"  # before it came to a hand-over


class HandOverReason(StrEnum):
    """Why a plan was not applied; planners go by it."""

    NONE = ""  # it was applied
    LATE = "late"  # the reference had left the curve that both share
    JUMP = "jump"  # it never was on the reference
    STAMP = "stamp"  # not newer than the plan before, or far ahead of the arm's time
    INVALID = "invalid"  # it cannot be read or followed
    INCOMPLETE = "incomplete"  # its other half did not come
    NEWER = "newer"  # a newer plan came before it could be applied
    STOPPED = "stopped"  # the arm was stopped after it had been made
    RESET = "reset"  # the arm was started anew, or healed, after it had been made
    FAULT = "fault"  # the arm takes no plans


@dataclass(frozen=True)
class HandOverReport:
    """What became of a plan; there is one report for each stamp.

    sentence       the same for a person
    plan_stamp_ns  ns
    position_jump  of the reference at the instant of the swap, new minus old, rad; NaN if unknown
    velocity_jump  likewise, rad/s
    reason         why it was not applied
    """

    outcome: HandOverOutcome
    sentence: str
    plan_stamp_ns: int
    position_jump: float = float("nan")
    velocity_jump: float = float("nan")
    reason: HandOverReason = HandOverReason.NONE


@dataclass(frozen=True)
class SimulatorReport:
    """Where the simulator stands.

    sentence          one sentence, the fault or what it warns of, if there is any
    faulty            whether the arm has been stopped because of a fault and takes no plans
    sim_time_ns       simulated time, ns
    real_time_factor  simulated over real time since the report before
    main_pump_j       energy delivered by the main pump since the start, J
    servo_pumps_j     likewise by the servo pumps, J
    warning           whether the sentence warns of something that has stopped nothing yet
    last_stop_ns      simulated time at which ~/stop was last called since the start, ns; 0 never
    plan_delay        by which plans are followed later than they say, because they were slowed, s
    interventions     times that the arm's guard has boosted or slowed beyond the plan
    lost_servo_pumps  numbers of those that the arm does without since they fail, the first being 1
    """

    sentence: str
    faulty: bool
    sim_time_ns: int
    real_time_factor: float
    main_pump_j: float
    servo_pumps_j: float
    warning: bool = False
    last_stop_ns: int = 0
    plan_delay: float = 0.0
    interventions: int = 0
    lost_servo_pumps: tuple[int, ...] = ()


@dataclass(frozen=True)
class Estimate:
    """One value that an arm has learnt of itself.

    quantity   payload [kg]; friction, leakage, valve_gain, bulk_modulus [times the machine file's];
               overlap [share of the stroke]; pump_lag, delay [s]
    actuator   whose it is, empty for what is the whole arm's
    deviation  standard deviation
    known      False: not to be told from the motion so far
    """

    quantity: str
    actuator: str
    value: float
    deviation: float
    known: bool
