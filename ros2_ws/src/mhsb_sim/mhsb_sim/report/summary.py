"""The numbers of a recorded run: the content of `summary.json`.

Lengths in mm, pressures in MPa, energies in J, times in s or ms, as each name says. What a
recording has no data for is null.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from mhsb_model.cavitation import cavitations
from mhsb_model.goal import Goal
from mhsb_model.modes import Mode
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py.sim_status import APPLIED
from mhsb_sim.recording.recording import Recording
from mhsb_sim.report.goal_fates import Fate, GoalFate
from mhsb_sim.report.recorded_energy import EnergyRecord
from mhsb_sim.report.recorded_goals import GoalRecord
from mhsb_sim.report.recorded_motion import TipMotion
from mhsb_sim.report.recorded_run import RecordedRun

Summary = dict[str, Any]

PER_MM, PER_MPA, PER_S = 1e3, 1e-6, 1e-9

LEAST_SPEED = 2e-4
"""Measured piston speed up to which a cylinder counts as held by its valve [m/s]."""


def summary(run: RecordedRun) -> Summary:
    """Plain numbers, texts, lists and dicts, ready for JSON.

    goals_sent, goals_accepted  goal poses, and accepting verdicts
    goals_…                     reached; superseded, refused and lost as `goal_fates` says
    places_not_reached          of goals, however often they were replaced there
    switches_in_motion          accepted goals whose plan took over while the reference moved
    tip_error_rms_mm            measured tip against reference tip, from the first to the last
                                moment at which the reference moved; tip_error_max_mm likewise
    tip_error_rest_max_mm       largest distance of the tip at rest from a goal that was reached
                                (`GoalRecord.distance_at_rest`)
    reference_jump_max_…        new minus old reference at the swap, as the simulator measured it
    mode_switches               changes of the mode in force, summed over the actuators
    energy_…                    as `recorded_energy` counts them
    max_…_pressure_mpa          over all actuators; relief tells where the valves open
    min_chamber_pressure_mpa    likewise; 0 and less where a chamber has run empty
    cavitation                  of actuators whose measured force drives a piston faster than
                                its inlet chamber fills at P_S (`mhsb_model.cavitation`)
    plans_…                     stamps that the simulator applied; refused or dropped
    replan_ms                   goal received to plan published
    lead_ms                     goal received to where the plan that was applied left the old one
    guard_interventions         times that the guard boosted or slowed beyond the plan
    plan_delay_max_s            most by which plans were followed later than they say
    real_time_factor            simulated over real time, between the simulator's reports
    """
    content: Summary = _without_infinite(_everything(run))
    return content


def _everything(run: RecordedRun) -> Summary:
    """Return the summary, in which numbers of messages may be infinite or no numbers."""
    recording = run.recording
    time_ns = recording.joint_states.time_ns
    return {
        "machine": run.machine.name,
        "duration_s": PER_S * int(time_ns[-1] - time_ns[0]),
        "real_time_factor": real_time_factor(recording),
        "goals_sent": recording.goals_sent,
        "goals_accepted": sum(goal.verdict.code.accepted for goal in run.goals),
        "goals_reached": sum(goal.outcome is Outcome.REACHED for goal in run.goals),
        "goals_replaced": sum(goal.outcome is Outcome.REPLACED for goal in run.goals),
        "places_not_reached": _places_not_reached(run.goals),
        "goals_superseded": sum(each.fate is Fate.SUPERSEDED for each in run.fates),
        "goals_refused": sum(each.fate is Fate.REFUSED for each in run.fates),
        "goals_lost": sum(each.fate is Fate.LOST for each in run.fates),
        "switches_in_motion": sum(goal.in_motion for goal in run.goals),
        **_tip_errors(run.tip, run.goals),
        **_plans(recording),
        **jumps(recording),
        "mode_switches": run.modes.switches,
        **_guard(recording),
        "modes_used": [Mode(code).name for code in np.unique(run.modes.modes)],
        **_energies(run.energy),
        **_pressures(run),
        "cavitation": _cavitation(run),
        "replan_ms": spread(_replan_times(run.goals)),
        "lead_ms": spread(each.lead_ms for each in run.fates),
        "unreadable_messages": recording.unreadable_count,
        "goals": [_goal(goal) for goal in run.goals],
        "lost": [_lost(each) for each in run.fates if each.fate is Fate.LOST],
    }


def _places_not_reached(goals: Sequence[GoalRecord]) -> int:
    there = {
        goal.verdict.goal.position
        for goal in goals
        if goal.outcome is Outcome.REACHED or goal.verdict.code is Verdict.AT_GOAL
    }
    return len({goal.verdict.goal.position for goal in goals} - there)


def _tip_errors(tip: TipMotion, goals: Iterable[GoalRecord]) -> Summary:
    error = PER_MM * tip.error[tip.moving]
    at_rest = [goal.distance_at_rest for goal in goals if goal.distance_at_rest is not None]
    return {
        "tip_error_rms_mm": _number(np.sqrt(np.mean(error**2)) if len(error) else None),
        "tip_error_max_mm": _largest(error),
        "tip_error_rest_max_mm": _largest([PER_MM * each for each in at_rest]),
    }


def _plans(recording: Recording) -> Summary:
    told = [each.value for each in recording.hand_overs]
    applied = {each.plan_stamp_ns for each in told if each.outcome == APPLIED}
    return {
        "plans_applied": len(applied),
        "plans_refused": len({each.plan_stamp_ns for each in told} - applied),
    }


def jumps(recording: Recording) -> Summary:
    """Largest steps of the reference at hand-overs, as the simulator measured them."""
    applied = [each.value for each in recording.hand_overs if each.value.outcome == APPLIED]
    return {
        "reference_jump_max_rad": _largest([each.position_jump for each in applied]),
        "reference_jump_max_rad_s": _largest([each.velocity_jump for each in applied]),
    }


def _guard(recording: Recording) -> Summary:
    told = [each.value for each in recording.simulator_reports]
    return {
        "guard_interventions": max((each.interventions for each in told), default=0),
        "plan_delay_max_s": _largest([each.plan_delay for each in told]),
    }


def _energies(energy: EnergyRecord) -> Summary:
    def total(counter: np.ndarray) -> float | None:
        return float(counter[-1]) if len(counter) > 1 else None

    return {
        "energy_planned_j": total(energy.planned),
        "energy_planned_series_j": total(energy.planned_series),
        "energy_measured_j": {"mp": total(energy.main_pump), "sp": total(energy.servo_pumps)},
        "energy_span_s": PER_S * int(np.ptp(energy.time_ns)) if len(energy.time_ns) else None,
    }


def _pressures(run: RecordedRun) -> Summary:
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


def _cavitation(run: RecordedRun) -> list[Summary]:
    """Of each actuator that has any; times count from the recording's first hydraulic state."""
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
        for each in cavitations(run.machine, time, force, speed, LEAST_SPEED)
    ]


def _replan_times(goals: Iterable[GoalRecord]) -> list[float]:
    return [
        goal.verdict.plan.plan_ms
        for goal in goals
        if goal.verdict.code is Verdict.OK and goal.verdict.plan is not None
    ]


def spread(values: Iterable[float | None]) -> Summary:
    """Median, 0.99 quantile and largest of those values that are there."""
    known = [value for value in values if value is not None]
    if not known:
        return {"p50": None, "p99": None, "max": None}
    p50, p99 = np.percentile(known, [50, 99])
    return {"p50": _number(p50), "p99": _number(p99), "max": _number(max(known))}


def real_time_factor(recording: Recording) -> float | None:
    """Each report's factor belongs to the time since the report before."""
    simulated = real = 0.0
    for before, after in pairwise(each.value for each in recording.simulator_reports):
        span = PER_S * (after.sim_time_ns - before.sim_time_ns)
        if span > 0.0 and after.real_time_factor > 0.0:
            simulated += span
            real += span / after.real_time_factor
    return simulated / real if real > 0.0 else None


def _lost(fate: GoalFate) -> Summary:
    return {**_place(fate.goal), "reason": fate.reason}


def _place(goal: Goal) -> Summary:
    beside = {} if goal.y is None else {"y_m": _number(goal.y)}
    return {"x_m": _number(goal.x), **beside, "z_m": _number(goal.z)}


def _goal(goal: GoalRecord) -> Summary:
    verdict = goal.verdict
    plan = verdict.plan
    return {
        **_place(verdict.goal),
        "code": verdict.code.value,
        "sentence": verdict.sentence,
        "outcome": goal.outcome.value if goal.outcome else None,
        "in_motion": goal.in_motion,
        "plan_ms": _number(plan.plan_ms) if plan else None,
        "plan_energy_j": _number(plan.energy_j) if plan else None,
        "plan_duration_s": _number(plan.duration_s) if plan else None,
        "distance_at_rest_mm": _number(goal.distance_at_rest, PER_MM),
    }


def _largest(values: Any) -> float | None:
    """The largest finite value, None where there is none."""
    array = np.asarray(values, dtype=np.float64).ravel()
    array = array[np.isfinite(array)]
    return float(array.max()) if len(array) else None


def _without_infinite(content: Any) -> Any:
    """Return content in which None stands for every number that JSON does not have."""
    if isinstance(content, dict):
        return {key: _without_infinite(value) for key, value in content.items()}
    if isinstance(content, list):
        return [_without_infinite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def _number(value: float | None, factor: float = 1.0) -> float | None:
    """A plain float times a factor; None where there is no finite value."""
    return None if value is None or not math.isfinite(value) else factor * float(value)
