"""Text at the end of the demo: what became of the goals, how well, and at which energy."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mhsb_model.goal import format_position
from mhsb_planner.planner import DEFAULT_PLANNER

PLANNER_WORDS = {
    "integrated": "integrated planner",
    "table": "planner of the paper (posture table)",
    "fixed": "conventional planner (joint 3 kept)",
}
"""Description of each planner of the suite."""

FATE_WORDS = {"at_goal": "there already", "under_way": "under way at the end"}
"""Words for fates of goals (`JudgedGoal.fate`) that are no words themselves."""


def format_story(summary: Mapping[str, Any], tour: Mapping[str, Any], output: Path) -> list[str]:
    """Describe the results of a demo in lines of text.

    Args:
        summary: The report's summary (`mhsb_tools.report.summary.compute_summary`).
        tour: Planned energies for the same goals by each planner and at constant pressure, as
            `compare_on_tour` returns them. Each of these motions is from rest to rest.
        output: Folder of the results.

    Returns:
        Lines without line breaks: what became of each goal; counts of accepted goals and of
        each fate; planning time and accuracy; energies; where the pictures and numbers are.
    """
    return [
        "Most goals come before the one before is reached, and the arm replans in motion:",
        *_goal_lines(summary),
        "",
        *_accuracy_lines(summary),
        "",
        *_energy_lines(summary, tour),
        "",
        f"pictures: {output}/report, a page for each move: mhsb report {output}/bag --moves "
        f"--output {output}/moves",
        f"all numbers: {output}/summary.json; the arm as recorded: mhsb view {output}/bag",
    ]


def _goal_lines(summary: Mapping[str, Any]) -> list[str]:
    """Return a line on the fate of each goal that has a verdict, and a last line with counts.

    Args:
        summary: The report's summary; reads `goals`, `goal_fates`, `goals_sent` and
            `goals_accepted`.

    Returns:
        Lines without line breaks. The last one always counts replaced and reached goals, and other
        fates if above 0.
    """
    goals, fates = summary["goals"], dict(summary["goal_fates"])
    lines = [
        f"goal {number:2d} {_place(goal):24s} {_describe_fate(goal, number < len(goals))}"
        for number, goal in enumerate(goals, start=1)
    ]
    replaced, reached = fates.pop("replaced", 0), fates.pop("reached", 0)
    others = "".join(f", {count} {FATE_WORDS.get(fate, fate)}" for fate, count in fates.items())
    return [
        *lines,
        f"{summary['goals_sent']} goals sent, {summary['goals_accepted']} accepted: {replaced} "
        f"replaced in motion by the next goal, {reached} reached{others}",
    ]


def _place(entry: Mapping[str, Any]) -> str:
    """Return the coordinates of a goal as text.

    Args:
        entry: Entry of a goal in the summary, with `x_m`, `z_m` and, if the arm slews, `y_m` [m];
            None for a coordinate that is not finite.

    Returns:
        The coordinates with three decimals, or "not a finite position".
    """
    axes = ("x_m", "y_m", "z_m")
    if any(entry.get(axis, 0.0) is None for axis in axes):
        return "not a finite position"
    return format_position((entry[axis] for axis in axes if axis in entry), ".3f")


def _describe_fate(goal: Mapping[str, Any], has_next: bool) -> str:
    """Describe the fate of a goal.

    Args:
        goal: Entry of a goal in the summary. Reads `fate`, `explanation`, `distance_at_rest_mm` and
            `code` of the verdict.
        has_next: Whether another goal followed.

    Returns:
        Words without a period, such as "reached; the tip rests 1.20 mm from it".
    """
    match goal["fate"]:
        case "reached":
            away = goal["distance_at_rest_mm"]
            return "reached" if away is None else f"reached; the tip rests {away:.2f} mm from it"
        case "replaced":
            return f"replaced in motion{' by the next goal' if has_next else ''}"
        case "at_goal":
            return "the tip was there already"
        case "under_way":
            return FATE_WORDS["under_way"]
        case "refused":
            return f"{goal['code']}: {goal['explanation']}"
        case fate:
            return f"{fate}: {goal['explanation']}"


def _accuracy_lines(summary: Mapping[str, Any]) -> list[str]:
    """Format planning times, jumps of the reference, tracking errors and cavitation of a demo.

    Args:
        summary: The report's summary.

    Returns:
        At most one line each on planning time, largest jump of the reference at a hand-over, and
        the tip's distance from its reference. A line is missing if its values are None. Then one
        line for each cavitation event of a cylinder.
    """
    lines = []
    planning, lead = summary["replan_ms"]["p50"], summary["lead_ms"]["p50"]
    if planning is not None and lead is not None:
        lines.append(
            f"planning: {planning:.0f} ms until a plan is published, {lead:.0f} ms until the arm "
            f"leaves the old one (medians); {summary['switches_in_motion']} took over in motion"
        )
    jump = summary["reference_jump_max_rad"]
    if jump is not None:
        lines.append(f"hand-over: the reference jumped by at most {jump:.1g} rad")
    rms, largest = summary["tip_error_rms_mm"], summary["tip_error_max_mm"]
    if rms is not None and largest is not None:
        lines.append(
            f"tracking: the tip was {rms:.2f} mm RMS from its reference, {largest:.1f} mm at most"
        )
    return lines + [
        f"note: for {each['duration_s']:.2f} s a load moved {each['actuator']} faster than oil "
        f"fills its inlet ({abs(each['force_n']):.0f} N); plans warn of such loads"
        for each in summary["cavitation"]
    ]


def _energy_lines(summary: Mapping[str, Any], tour: Mapping[str, Any]) -> list[str]:
    """Format the energy of a demo, and the planned energies of the same goals by other methods.

    Args:
        summary: The report's summary. Only `energy_measured_j` is read: a dictionary with the
            simulated energy of the main pump (`mp`) and of the servo pumps (`sp`) [J].
        tour: Planned energies for the same goals, each motion from rest to rest, as
            `compare_on_tour` returns them.

    Returns:
        A line with the simulated energy; left out if it was not recorded. Then lines with the
        energy of the default planner, of the other planners, and of one constant pressure without
        boosters. These further lines are left out if the energy of the default planner, or the
        constant pressure, is missing.
    """
    lines = []
    pumps = summary["energy_measured_j"]
    if pumps["mp"] is not None and pumps["sp"] is not None:
        lines.append(
            f"energy given to the oil in this run, simulated: {pumps['mp'] + pumps['sp']:.0f} J, "
            f"{pumps['sp']:.0f} J of it by the servo pumps"
        )
    planned, pressure = tour["planned_j"], tour["constant_pressure_pa"]
    own = planned.get(DEFAULT_PLANNER)
    if not own or not pressure:
        return lines
    compared = {
        PLANNER_WORDS.get(kind, kind): energy
        for kind, energy in planned.items()
        if kind != DEFAULT_PLANNER
    }
    compared[f"no boosters, one constant pressure of {pressure / 1e6:.1f} MPa"] = tour[
        "constant_pressure_j"
    ]
    lines += [
        "energy given to the oil for the same goals, each from rest to rest, as planned "
        "(pictures compare this run):",
        f"  {PLANNER_WORDS[DEFAULT_PLANNER]:52s}{own:7.0f} J",
        *(
            f"  {name:52s}{energy:7.0f} J, {energy / own:.2f} times as much"
            for name, energy in compared.items()
        ),
    ]
    return lines
