"""Numbers of a recorded run: the content of `summary.json`.

Lengths are in mm, pressures in MPa, energies in J, and times in s or ms, as each name says. Null
stands for what a recording has no data for.
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from mhsb_model.arm_reports import HandOverOutcome
from mhsb_model.feasibility.cavitation import summarize_cavitation
from mhsb_model.goal import Goal
from mhsb_model.modes import Mode
from mhsb_model.verdict import Outcome, Verdict
from mhsb_planner.result_files import replace_non_finite
from mhsb_tools.recording.recording import Recording
from mhsb_tools.report.goal_fates import GoalResult, JudgedGoal, find_unrecorded_goals
from mhsb_tools.report.recorded_energy import EnergyRecord
from mhsb_tools.report.recorded_goals import RecordedGoal
from mhsb_tools.report.recorded_motion import TipMotion
from mhsb_tools.report.recorded_run import EvaluatedRecording

Summary = dict[str, Any]
"""Entries of a summary by their names."""

PER_MM, PER_MPA, PER_S = 1e3, 1e-6, 1e-9

SPEED_WINDOW = 0.05
"""Time over which measured piston speeds are averaged [s]."""

LEAST_SPEED = 2e-4
"""Piston speed up to which a cylinder counts as held by its valve [m/s]."""


COUNTED_FATES = ("reached", "replaced", "superseded", "refused", "stopped", "lost")
"""Fates of goals that have a number of their own in the summary."""


def compute_summary(run: EvaluatedRecording) -> Summary:
    """Compute the summary of a recorded run.

    Args:
        run: The evaluated recording.

    Returns:
        Numbers, texts, lists and dictionaries, ready for JSON. Infinite numbers and nan are
        replaced by None.

        - `machine`: Name of the machine.
        - `duration_s`: Time from the first to the last joint state.
        - `goals_sent`: Goals whose message or verdict was recorded.
        - `goals_not_recorded`: Goals that got a verdict, but whose message was not recorded.
        - `goals_accepted`: Accepting verdicts.
        - `goal_fates`: Number of goals by `JudgedGoal.fate`; only numbers above 0. Their sum is
            `goals_sent`.
        - `goals_reached`, `goals_replaced`, `goals_superseded`, `goals_refused`, `goals_stopped`,
            `goals_lost`: The same numbers, also if 0.
        - `places_not_reached`: Positions of goals that were never reached, however often they were
            sent.
        - `switches_in_motion`: Goals whose plan took over while the reference moved.
        - `tip_error_rms_mm`, `tip_error_max_mm`: Measured tip against reference, from the first to
            the last motion of the reference.
        - `tip_error_rest_max_mm`: Largest distance of the resting tip from a reached goal
            (`RecordedGoal.distance_at_rest`).
        - `reference_jump_max_...`: New minus old reference at the hand-over, as the simulator
            measured it.
        - `mode_switches`: Changes of mode, summed over the actuators.
        - `modes_used`: Names of all modes that were in force.
        - `real_time_factor`: Simulated over real time, between the simulator's reports.
        - `energy_...`: Energies as in `EnergyRecord`.
        - `max_..._pressure_mpa`: Largest pressure of all actuators; `relief_mpa` states where
            relief valves open.
        - `min_chamber_pressure_mpa`: Smallest pressure of all chambers; 0 and less if a chamber has
            run empty.
        - `cavitation`: Actuators whose load drives the piston faster than its inlet chamber fills
            at P_S (`mhsb_model.feasibility.cavitation`).
        - `speed_excess_measured`: Largest |v| / V_max - 1 of all pistons (`compute_speed_excess`).
        - `v_max_of_file_mm_s`: V_max of each actuator in the machine file; speeds are compared with
            it. The recording does not have the planner's parameter `v_max`.
        - `plans_applied`, `plans_refused`: Plans that the simulator applied; refused or dropped.
        - `replan_ms`: Goal received to plan published.
        - `lead_ms`: Goal received to the instant at which the applied plan left the old one.
        - `guard_interventions`: Times that the reference governor boosted or slowed beyond the
            plan.
        - `plan_delay_max_s`: Largest delay with which plans were followed.
        - `unreadable_messages`: Messages that break their contract.
        - `goals`: An entry for each goal that got a verdict.
        - `lost`: Position and reason of each lost goal.
    """
    content: Summary = replace_non_finite(_everything(run))
    return content


def _everything(run: EvaluatedRecording) -> Summary:
    """Compute all entries of the summary.

    Args:
        run: The evaluated recording.

    Returns:
        The entries, with the keys that `compute_summary` lists. Numbers that come from messages may
        be infinite or nan.
    """
    recording = run.recording
    time_ns = recording.joint_states.time_ns
    fates = Counter(each.fate for each in run.judged_goals)
    judged = {each.goal.stamp_ns: each for each in run.judged_goals}
    hand_overs = [each.value for each in recording.hand_overs]
    all_plans = {each.plan_stamp_ns for each in hand_overs}
    applied = {e.plan_stamp_ns for e in hand_overs if e.outcome == HandOverOutcome.APPLIED}
    reports = [each.value for each in recording.simulator_reports]
    verdicts = [goal.verdict for goal in run.goals]
    planned_ms = [v.plan.plan_ms for v in verdicts if v.code is Verdict.OK and v.plan is not None]
    return {
        "machine": run.machine.name,
        "duration_s": PER_S * int(time_ns[-1] - time_ns[0]),
        "real_time_factor": compute_real_time_factor(recording),
        "goals_sent": len(run.judged_goals),
        "goals_not_recorded": len(find_unrecorded_goals(recording)),
        "goals_accepted": sum(goal.verdict.code.accepted for goal in run.goals),
        "goal_fates": dict(fates),
        **{f"goals_{fate}": fates[fate] for fate in COUNTED_FATES},
        "places_not_reached": _places_not_reached(run.goals),
        "switches_in_motion": sum(goal.in_motion for goal in run.goals),
        **_tip_errors(run.tip, run.goals),
        "plans_applied": len(applied),
        "plans_refused": len(all_plans - applied),
        **compute_reference_jumps(recording),
        "mode_switches": run.modes.switch_count,
        "guard_interventions": max((each.interventions for each in reports), default=0),
        "plan_delay_max_s": _largest([each.plan_delay for each in reports]),
        "modes_used": [Mode(code).name for code in np.unique(run.modes.modes)],
        **_energies(run.energy),
        **_pressures(run),
        "cavitation": _cavitation(run),
        "speed_excess_measured": compute_speed_excess(run),
        "v_max_of_file_mm_s": [PER_MM * v for v in run.machine.arrays.max_piston_speed.tolist()],
        "replan_ms": compute_quantiles(planned_ms),
        "lead_ms": compute_quantiles(each.lead_ms for each in run.judged_goals),
        "unreadable_messages": recording.unreadable_count,
        "goals": [_goal(goal, judged[goal.verdict.goal_stamp_ns]) for goal in run.goals],
        "lost": [
            {**_place(each.goal), "reason": each.reason}
            for each in run.judged_goals
            if each.result is GoalResult.LOST
        ],
    }


def _places_not_reached(goals: Sequence[RecordedGoal]) -> int:
    """Count the different goal positions that were never reached.

    A position is reached if the outcome of one of its goals is REACHED, or one of its verdicts is
    AT_GOAL (the arm was there already).

    Args:
        goals: Goals that got a verdict.

    Returns:
        The number of positions. Several goals at one position count once.
    """
    there = {
        goal.verdict.goal.position
        for goal in goals
        if goal.outcome is Outcome.REACHED or goal.verdict.code is Verdict.AT_GOAL
    }
    return len({goal.verdict.goal.position for goal in goals} - there)


def _tip_errors(tip: TipMotion, goals: Iterable[RecordedGoal]) -> Summary:
    """Compute the summary's entries on the errors of the tip.

    Args:
        tip: Measured and reference motion of the tip.
        goals: Goals that got a verdict.

    Returns:
        Three entries [mm]; each is None without data:

        - tip_error_rms_mm, tip_error_max_mm: RMS and maximum of the distance between measured tip
          and reference, from the first to the last motion of the reference
        - tip_error_rest_max_mm: largest distance of the resting tip from a goal that it reached
    """
    error = PER_MM * tip.error[tip.moving]
    at_rest = [goal.distance_at_rest for goal in goals if goal.distance_at_rest is not None]
    return {
        "tip_error_rms_mm": _number(np.sqrt(np.mean(error**2)) if len(error) else None),
        "tip_error_max_mm": _largest(error),
        "tip_error_rest_max_mm": _largest([PER_MM * each for each in at_rest]),
    }


def compute_reference_jumps(recording: Recording) -> Summary:
    """Return by how much the reference jumped at most when a new plan took over.

    Args:
        recording: The recording. Only `hand_overs` is read.

    Returns:
        `reference_jump_max_rad` (position) and `reference_jump_max_rad_s` (velocity), as the
        simulator measured them; None if no plan took over.
    """
    applied = [
        each.value for each in recording.hand_overs if each.value.outcome == HandOverOutcome.APPLIED
    ]
    return {
        "reference_jump_max_rad": _largest([each.position_jump for each in applied]),
        "reference_jump_max_rad_s": _largest([each.velocity_jump for each in applied]),
    }


def _energies(energy: EnergyRecord) -> Summary:
    """Return the summary's entries on energy.

    Args:
        energy: Measured and planned energy up to each report of the simulator.

    Returns:
        Four entries:

        - energy_planned_j, energy_planned_series_j: planned energy [J] with two prices of boosted
          oil, `paper` and `series` (energy readings)
        - energy_measured_j: a dictionary with the energy of main pump (`mp`) and servo pumps (`sp`)
          [J]
        - energy_span_s: time from the first to the last report

        Energies are None if there are fewer than two reports; `energy_span_s` is None without
        reports.
    """

    def total(counter: np.ndarray) -> float | None:
        """Return the last value of a cumulative energy [J]; None with fewer than two reports."""
        return float(counter[-1]) if len(counter) > 1 else None

    return {
        "energy_planned_j": total(energy.planned),
        "energy_planned_series_j": total(energy.planned_series),
        "energy_measured_j": {"mp": total(energy.main_pump), "sp": total(energy.servo_pumps)},
        "energy_span_s": PER_S * int(np.ptp(energy.time_ns)) if len(energy.time_ns) else None,
    }


def _pressures(run: EvaluatedRecording) -> Summary:
    """Return the summary's entries on pressures and relief valves.

    Args:
        run: The evaluated recording.

    Returns:
        Five entries:

        - max_supply_pressure_mpa, max_chamber_pressure_mpa, min_chamber_pressure_mpa: over all
          actuators and times
        - relief_mpa: a dictionary with the relief pressure of the supply lines (`line`) and the
          lowest relief pressure of all chambers (`chamber`)
        - relief_exceeded: whether a pressure was above the opening pressure of its relief valve

        All but `relief_mpa` are None if no hydraulic states were recorded.
    """
    quantity, circuit = run.recording.actuators.quantity, run.machine.config.circuit
    supply = _largest(quantity["supply_pressure"])
    chamber = _largest([quantity["cap_pressure"], quantity["rod_pressure"]])
    lowest = _largest([-quantity["cap_pressure"], -quantity["rod_pressure"]])
    line, reliefs = circuit.line_relief_pressure, run.machine.chamber_reliefs
    beyond = [quantity["supply_pressure"] > line]
    beyond += [quantity[side] > reliefs for side in ("cap_pressure", "rod_pressure")]
    return {
        "max_supply_pressure_mpa": _number(supply, PER_MPA),
        "max_chamber_pressure_mpa": _number(chamber, PER_MPA),
        "min_chamber_pressure_mpa": _number(lowest, -PER_MPA),
        "relief_mpa": {"line": PER_MPA * line, "chamber": PER_MPA * float(reliefs.min())},
        "relief_exceeded": bool(np.any(beyond)) if supply or chamber else None,
    }


def _cavitation(run: EvaluatedRecording) -> list[Summary]:
    """List the actuators that cavitated, as entries of the summary.

    An actuator cavitates if its load drives the piston faster than oil at the main pump's pressure
    fills the inlet chamber.

    Args:
        run: The evaluated recording.

    Returns:
        A dictionary for each actuator that cavitated: `actuator` (name), `begin_s` (first time,
        since the first hydraulic state), `duration_s` (sum of all times) and `force_n` (piston
        force of largest magnitude while it cavitated). Empty if none did or no hydraulic states
        were recorded.
    """
    actuators = run.recording.actuators
    if len(actuators.time_ns) == 0:
        return []
    time = PER_S * (actuators.time_ns - actuators.time_ns[0])
    force, speed = actuators.quantity["force"], actuators.quantity["piston_speed"]
    return [
        {
            "actuator": each.actuator,
            "begin_s": each.begin,
            "duration_s": each.duration,
            "force_n": each.force,
        }
        for each in summarize_cavitation(run.machine, time, force, speed, LEAST_SPEED)
    ]


def compute_speed_excess(run: EvaluatedRecording) -> float | None:
    """Compute the share by which the fastest piston exceeded V_max.

        excess = max(|v| / V_max) − 1,  v = ΔL(q) / Δt

    V_max is the actuator's piston speed in the machine file [m/s], q the measured joint
    positions and L the length of the actuator's cylinder [m]. Δt is about SPEED_WINDOW, because
    momentary velocities oscillate. The maximum is over all actuators and times.

    Args:
        run: The evaluated recording.

    Returns:
        The excess; negative if no piston reached V_max, None if the recording is shorter than
        SPEED_WINDOW.
    """
    joints = run.recording.joint_states
    time = PER_S * (joints.time_ns - joints.time_ns[0])
    later = np.searchsorted(time, time + SPEED_WINDOW)
    first = np.flatnonzero(later < len(time))
    last = later[first]
    if len(first) == 0:
        return None
    length = np.array([run.machine.cylinder_lengths(q) for q in joints.position])
    speed = np.abs(length[last] - length[first]) / (time[last] - time[first])[:, None]
    return float((speed / run.machine.arrays.max_piston_speed).max() - 1.0)


def compute_quantiles(values: Iterable[float | None]) -> Summary:
    """Summarize values by their median, 0.99 quantile and maximum.

    Args:
        values: Numbers; None is skipped.

    Returns:
        Entries `p50`, `p99` and `max`. All are None if there are no values; an entry that is not
        finite is None, too.
    """
    known = [value for value in values if value is not None]
    if not known:
        return {"p50": None, "p99": None, "max": None}
    p50, p99 = np.percentile(known, [50, 99])
    return {"p50": _number(p50), "p99": _number(p99), "max": _number(max(known))}


def compute_real_time_factor(recording: Recording) -> float | None:
    """Compute the mean real-time factor of a recorded simulation.

    It is the ratio of simulated time to real time. Each report of the simulator has the factor
    since the previous report. Intervals without a positive duration or a positive factor are
    skipped.

    Args:
        recording: The recording.

    Returns:
        The factor over all intervals; None if there is none.
    """
    simulated = real = 0.0
    for before, after in pairwise(each.value for each in recording.simulator_reports):
        span = PER_S * (after.sim_time_ns - before.sim_time_ns)
        if span > 0.0 and after.real_time_factor > 0.0:
            simulated += span
            real += span / after.real_time_factor
    return simulated / real if real > 0.0 else None


def _place(goal: Goal) -> Summary:
    """Return the position of a goal as entries of the summary.

    Args:
        goal: The goal.

    Returns:
        `x_m`, `z_m`, and `y_m` if the arm slews [m]; None for a coordinate that is not finite.
    """
    beside = {} if goal.y is None else {"y_m": _number(goal.y)}
    return {"x_m": _number(goal.x), **beside, "z_m": _number(goal.z)}


def _goal(goal: RecordedGoal, judged: JudgedGoal) -> Summary:
    """Return the summary's entry of a goal that got a verdict.

    Args:
        goal: The goal.
        judged: The goal with its judgement.

    Returns:
        Entries:

        - x_m, z_m, and y_m if the arm slews: position [m]
        - code, sentence: verdict of the planner
        - outcome: outcome of the execution; None if no execution was reported
        - fate, explanation: `JudgedGoal.fate` and `JudgedGoal.explanation`
        - in_motion: whether the goal's plan took over while the reference moved
        - plan_ms, plan_energy_j, plan_duration_s: planning time, planned energy and duration of the
          plan; None if no plan was made
        - distance_at_rest_mm: mean distance of the resting tip; None if the goal was not reached
    """
    verdict = goal.verdict
    plan = verdict.plan
    return {
        **_place(verdict.goal),
        "code": verdict.code.value,
        "sentence": verdict.sentence,
        "outcome": goal.outcome.value if goal.outcome else None,
        "fate": judged.fate,
        "explanation": judged.explanation,
        "in_motion": goal.in_motion,
        "plan_ms": _number(plan.plan_ms) if plan else None,
        "plan_energy_j": _number(plan.energy_j) if plan else None,
        "plan_duration_s": _number(plan.duration_s) if plan else None,
        "distance_at_rest_mm": _number(goal.distance_at_rest, PER_MM),
    }


def _largest(values: Any) -> float | None:
    """Return the largest finite value.

    Args:
        values: Numbers in an array or nested lists of any shape.

    Returns:
        The value; None if there is no finite one.
    """
    array = np.asarray(values, dtype=np.float64).ravel()
    array = array[np.isfinite(array)]
    return float(array.max()) if len(array) else None


def _number(value: float | None, factor: float = 1.0) -> float | None:
    """Multiply a number by a factor; return None for None, nan and infinite numbers."""
    return None if value is None or not math.isfinite(value) else factor * float(value)
