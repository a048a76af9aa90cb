"""Reports of an arm, or of its simulator: the fate of plans, and the arm's own state."""

from dataclasses import dataclass
from enum import StrEnum


class HandOverOutcome(StrEnum):
    """Fate of a plan that was sent to the arm."""

    APPLIED = "applied"
    """The arm follows the plan."""
    REFUSED = "refused"
    """The arm rejected the plan at its hand-over."""
    DROPPED = "dropped"
    """The plan was discarded before its hand-over."""


class HandOverReason(StrEnum):
    """Reason why a plan was not applied; planners act on it."""

    NONE = ""
    """The plan was applied."""
    LATE = "late"
    """The plan met the reference at its stamp, but the arm has since passed their common part."""
    JUMP = "jump"
    """The plan did not meet the reference at its stamp."""
    STAMP = "stamp"
    """The stamp is not newer than the previous plan's, or is far ahead of the arm's time."""
    INVALID = "invalid"
    """The plan cannot be read or followed."""
    INCOMPLETE = "incomplete"
    """Only one of both parts arrived: the trajectory or the modes."""
    NEWER = "newer"
    """A newer plan came before this plan could be applied."""
    STOPPED = "stopped"
    """The arm was stopped after the plan had been made."""
    RESET = "reset"
    """The arm was restarted, or a fault cleared, after the plan had been made."""
    FAULT = "fault"
    """The arm has a fault and accepts no plans."""


@dataclass(frozen=True)
class HandOverReport:
    """Result of one plan; there is exactly one report for each stamp.

    Attributes:
        outcome: Result of the plan.
        sentence: Explanation for a person.
        plan_stamp_ns: Stamp of the plan [ns].
        position_jump: Largest difference between the new and the old reference position over all
            joints, at the instant of the hand-over [rad or m]; NaN if unknown.
        velocity_jump: Largest difference between the new and the old reference velocity over all
            joints, at the same instant [rad/s or m/s]; NaN if unknown.
        reason: Reason why the plan was not applied.
    """

    outcome: HandOverOutcome
    sentence: str
    plan_stamp_ns: int
    position_jump: float = float("nan")
    velocity_jump: float = float("nan")
    reason: HandOverReason = HandOverReason.NONE


@dataclass(frozen=True)
class SimulatorReport:
    """Status of the simulator.

    Attributes:
        sentence: Sentence for a person; it names the fault or the warning if there is one.
        faulty: Whether a fault has stopped the arm, so that it accepts no plans.
        sim_time_ns: Simulated time [ns].
        real_time_factor: Simulated time over real time since the previous report [-].
        main_pump_j: Energy that the main pump has delivered since the start [J].
        servo_pumps_j: Energy that all servo pumps have delivered since the start [J].
        warning: Whether the sentence warns of something that has not stopped the arm.
        last_stop_ns: Simulated time of the last call of ~/stop since the start [ns]; 0 if there was
            none.
        plan_delay: Time by which the reference lags behind the plan, because the plan was slowed
            [s].
        interventions: Number of times that the reference governor has boosted an actuator beyond
            the plan, or has slowed the plan.
        lost_servo_pumps: Numbers, from 1, of servo pumps that have failed and are not used.
        machine: Name of the arm's machine file; empty if it is not reported.
        machine_hash: `Machine.planning_hash` of that file; empty if it is not reported.
        faults: Number of callbacks of the node that have failed since the start.
        last_fault: Sentence of the last failed callback; empty if there was none.
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
    machine: str = ""
    machine_hash: str = ""
    faults: int = 0
    last_fault: str = ""


@dataclass(frozen=True)
class Estimate:
    """Estimate of a quantity of the arm, made by its servo.

    Attributes:
        quantity: payload [kg]; friction, leakage, valve_gain, bulk_modulus [times the machine
            file's value]; overlap [share of the stroke]; pump_lag, delay,
            valve_lag [s].
        actuator: Name of the actuator; empty if the quantity concerns the whole arm.
        value: Estimated value, in the unit given above.
        deviation: Standard deviation of the value.
        known: Whether the motion so far was enough to estimate the quantity.
    """

    quantity: str
    actuator: str
    value: float
    deviation: float
    known: bool
