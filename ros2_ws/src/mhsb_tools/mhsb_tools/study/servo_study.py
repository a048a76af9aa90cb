"""Servo study: every controller over every scenario, in numbers, and two controllers compared.

The plans of a scenario are made once, with the posture table of its payload, and given to each
controller, so that only the servo differs.
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d

from mhsb_control import select_controllers
from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.goal import format_position
from mhsb_model.holding import choose_holding_modes
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, Position
from mhsb_planner.executor import Jobs, create_executor, yield_results
from mhsb_planner.motion.energy import Energy, compute_motion_energy
from mhsb_planner.online.commit_horizon import compute_offline_horizon
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import PlanOptions
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_sim.circuit.audit import sum_energy_by_source
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.moves.needed_pressure import compute_needed_pressure
from mhsb_tools.study.energy_comparison import EnergyPart, list_energy_parts, sum_parts
from mhsb_tools.study.energy_comparison import as_text as energy_text
from mhsb_tools.study.replay import Replay, replay
from mhsb_tools.study.scenarios import Scenario

SCENARIO_PLANNER = "table"
"""Planner of all scenarios."""

NEED_WINDOW = 0.1
"""Pressure that is needed within this time ahead may already be in the line, since lines are
charged in time [s].
"""

PRESSURE_ALLOWANCE = 2e5
"""Reserve above the needed pressure that does not count as overshoot [Pa]."""

PLANNED_EVERY = 10
"""Number of steps from one point of the followed reference to the next, for the planner's
energy.
"""


@dataclass(frozen=True)
class StudyRecord:
    """Measured numbers of one controller in one scenario.

    Attributes:
        scenario: Name of the scenario.
        controller: Name of the controller.
        tip_error_rms_mm: Root mean square distance of the measured tip from the servo's reference
            [mm].
        tip_error_max_mm: Largest such distance [mm].
        supply_peak_mpa: Highest pressure in any supply line [MPa].
        supply_overshoot_mpa: Largest excess of a supply line, see `compute_supply_overshoot` [MPa].
        chamber_peak_mpa: Highest pressure in any cylinder chamber [MPa].
        relief_opened: Whether any relief valve let oil through.
        energy_mp_j: Energy that the main pump gave to its oil [J].
        energy_sp_j: Energy at the servo pumps' shafts, so with their losses [J].
        energy_planned_series_j: Energy of the followed motion by the planner's model, pumps in
            series [J].
        mode_switches: Number of changes of the mode in force, over all actuators.
        held_out: Whether gains were tuned without this scenario.
        energy_mp_shaft_j: Energy at the main pump's shaft [J].
        energy_sp_hydraulic_j: Energy that the servo pumps gave to their oil [J].
        interventions: Number of times that the guard boosted or slowed beyond the plan.
    """

    scenario: str
    controller: str
    tip_error_rms_mm: float
    tip_error_max_mm: float
    supply_peak_mpa: float
    supply_overshoot_mpa: float
    chamber_peak_mpa: float
    relief_opened: bool
    energy_mp_j: float
    energy_sp_j: float
    energy_planned_series_j: float
    mode_switches: int
    held_out: bool
    energy_mp_shaft_j: float
    energy_sp_hydraulic_j: float
    interventions: int = 0


@dataclass(frozen=True, eq=False)
class PlannedScenario:
    """A scenario's machine and plans.

    Attributes:
        scenario: The scenario.
        machine: The arm with the scenario's payload and pump lag.
        commands: Commands by increasing stamp.
        refused: Sentence for each goal that was refused; the motion before it went on.
    """

    scenario: Scenario
    machine: Machine
    commands: tuple[Command, ...]
    refused: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ScenarioResult:
    """Results of all controllers in one scenario.

    Attributes:
        scenario: The scenario.
        records: Record of each controller.
        refused: Sentence for each goal that was refused.
        traces: Signals by controller, shape (k, 3 + n), 100 rows a second: time [s], tip error [m],
            supply pressure of each actuator [Pa], highest needed pressure [Pa].
        elements: Planned and simulated energy of each part, by controller.
    """

    scenario: Scenario
    records: tuple[StudyRecord, ...]
    refused: tuple[str, ...]
    traces: dict[str, FloatArray]
    elements: dict[str, list[EnergyPart]]

    @property
    def records_by_controller(self) -> dict[str, StudyRecord]:
        """Record by name of the controller."""
        return {record.controller: record for record in self.records}


def plan_scenario(machine: Machine, scenario: Scenario) -> PlannedScenario:
    """Plan all goals of a scenario; each plan continues the motion of the one before.

    The first plan begins at rest in the start posture. Planning is assumed to take no time. If a
    goal cannot be planned, it counts as refused, and the motion before it goes on. The posture
    table for the scenario's payload is built if it is not cached.

    Args:
        machine: The arm as its machine file has it.
        scenario: The scenario.

    Returns:
        The machine with the scenario's payload and pump lag, the plans, and a sentence for each
        refused goal.

    Raises:
        MachineFileError: The scenario's payload or pump lag is not allowed for the machine.
        EmptyTableError: No node of the posture table has a posture.
        HoldingError: Holding the start posture needs more booster modules than the machine has.
    """
    loaded = scenario.apply_to(machine)
    replanner = Replanner(loaded, load_or_build_table(loaded))
    options = PlanOptions(weights=scenario.weights, planner=SCENARIO_PLANNER)
    timed = [(each * scenario.interval, goal) for each, goal in enumerate(scenario.goals)]
    commands, refusals = plan_goals(loaded, replanner, timed, options)
    refused = [
        f"{scenario.name}: goal {format_position(goal, 'g')}: {error}" for goal, error in refusals
    ]
    return PlannedScenario(scenario, loaded, tuple(commands), tuple(refused))


def make_hold_command(machine: Machine) -> Command:
    """Return the command that holds the start posture from time 0 on.

    Raises:
        HoldingError: Holding the posture needs more booster modules than the machine has.
    """
    start = np.array(machine.config.simulation.start_posture)
    return Command.hold(0, start, choose_holding_modes(machine, machine.piston_forces(start)))


def plan_goals(
    machine: Machine,
    replanner: Replanner,
    goals: Iterable[tuple[float, Position]],
    options: PlanOptions,
) -> tuple[list[Command], list[tuple[Position, MhsbError]]]:
    """Plan goals one after the other; each plan continues the motion of the one before.

    The first plan begins at rest in the start posture. Planning is assumed to take no time. If a
    goal cannot be planned, the motion before it goes on.

    Args:
        machine: The arm.
        replanner: Its planner.
        goals: Time at which each goal comes [s], and the goal.
        options: Options of the plans.

    Returns:
        The plans, and each refused goal with the reason. A goal at which the arm is already has no
        plan and is not refused.

    Raises:
        HoldingError: Holding the start posture needs more booster modules than the machine has.
    """
    commands: list[Command] = []
    refused: list[tuple[Position, MhsbError]] = []
    command, horizon = make_hold_command(machine), compute_offline_horizon(machine)
    for time, goal in goals:
        try:
            replan = replanner.replan(command, round(time * SECOND_NS), goal, horizon, options)
        except MhsbError as error:
            refused.append((goal, error))
            continue
        if replan is not None:
            command = replan.command
            commands.append(command)
    return commands, refused


def compute_supply_overshoot(machine: Machine, run: Replay) -> FloatArray:
    """Compute by how much the pressure in each supply line exceeds what the motion itself needs.

        excess(t) = p_line(t) − p(t) − PRESSURE_ALLOWANCE
        p(t) = max(max of need(t') for t ≤ t' ≤ t + NEED_WINDOW,
                   p(t − dt) − q_leak/(C_line + C_rail) dt)

    p_line is the pressure in the supply line [Pa]. need(t) is the supply pressure that the
    reference needs, at least P_S [Pa]. q_leak is the leakage of a valve [m³/s], and C the volume of
    line or rail divided by the bulk modulus [m³/Pa]. dt is the step [s]. The maximum over
    NEED_WINDOW accounts for lines that are charged in advance. The second term of p accounts for a
    boosted line whose pump stands: its pressure falls only by leakage of the valve. The line is
    taken as joined to the rail, as in mode SB.

    Args:
        machine: The arm that was simulated.
        run: The record of k steps with n joints.

    Returns:
        Excess [Pa], shape (k, n); negative if the line is below p(t) + PRESSURE_ALLOWANCE.
    """
    width = round(NEED_WINDOW / run.step) + 1
    need = compute_needed_pressure(machine, run.reference, run.modes)
    ahead = maximum_filter1d(need, width, axis=0, mode="nearest", origin=-(width // 2))
    oil = machine.config.circuit
    capacity = (oil.line_volume + oil.rail_volume) / oil.bulk_modulus
    fall = machine.arrays.leakage_flow / capacity * run.time[:, None]
    fading = np.maximum.accumulate(ahead + fall, axis=0) - fall
    return run.supply_pressure - fading - PRESSURE_ALLOWANCE


def evaluate_run(
    script: PlannedScenario, controller: str, run: Replay, planned: Energy
) -> StudyRecord:
    """Measure a run: tip errors, pressures, energies and mode switches.

    Args:
        script: The planned scenario that was simulated.
        controller: Name of the controller.
        run: The record of the run.
        planned: Energy that the planner's model gives for the motion that was followed.

    Returns:
        The measured numbers.
    """
    machine = script.machine
    error = 1e3 * run.tip_error(machine)
    source = sum_energy_by_source(run.energies)
    return StudyRecord(
        scenario=script.scenario.name,
        controller=controller,
        tip_error_rms_mm=float(np.sqrt(np.mean(error**2))),
        tip_error_max_mm=float(error.max()),
        supply_peak_mpa=float(run.supply_pressure.max() / 1e6),
        supply_overshoot_mpa=float(compute_supply_overshoot(machine, run).max() / 1e6),
        chamber_peak_mpa=float(run.chamber_pressure.max() / 1e6),
        relief_opened=run.energies["relief_valves"] > 0.0,
        energy_mp_j=source["main_pump"]["hydraulic"],
        energy_sp_j=source["servo_pumps"]["shaft"],
        energy_mp_shaft_j=source["main_pump"]["shaft"],
        energy_sp_hydraulic_j=source["servo_pumps"]["hydraulic"],
        energy_planned_series_j=planned.series,
        mode_switches=int(np.count_nonzero(np.diff(run.modes.astype(int), axis=0))),
        held_out=script.scenario.held_out,
        interventions=run.interventions,
    )


def study_scenario(machine: Machine, scenario: Scenario) -> ScenarioResult:
    """Plan one scenario, and simulate each suitable controller with the same plans.

    Args:
        machine: The arm as its machine file has it; its sensors determine which controllers are
            suitable.
        scenario: The scenario.

    Returns:
        Measured numbers, signals and energies of each controller, and the refused goals.

    Raises:
        MhsbError: The scenario cannot be planned with this machine, or a simulation diverged.
    """
    script = plan_scenario(machine, scenario)
    records, traces, elements = [], {}, {}
    for controller in select_controllers(machine):
        simulator = Simulator(script.machine, controller)
        run = replay(simulator, script.commands, scenario.duration)
        planned = compute_motion_energy(script.machine, *run.followed_motion(PLANNED_EVERY))
        records.append(evaluate_run(script, controller, run, planned))
        traces[controller] = _trace(script.machine, run)
        elements[controller] = list_energy_parts(planned, run.energies)
    return ScenarioResult(scenario, tuple(records), script.refused, traces, elements)


def run_study(
    machine: Machine, scenarios: Sequence[Scenario], jobs: Jobs = None
) -> Iterator[ScenarioResult]:
    """Run all scenarios in parallel processes.

    Args:
        machine: The arm as its machine file has it.
        scenarios: The scenarios.
        jobs: Number of processes or a cluster; None takes one process for each processor.

    Yields:
        The result of each scenario, as it is ready, in any order.

    Raises:
        ClusterError: The cluster does not answer.
        RequestError: The number of processes is below 1.
    """
    with create_executor(jobs) as pool:
        yield from yield_results(pool.submit(study_scenario, machine, each) for each in scenarios)


def _trace(machine: Machine, run: Replay) -> FloatArray:
    """Return some signals of a run, with 100 rows for each second.

    Args:
        machine: The arm that was simulated.
        run: The record of the run.

    Returns:
        Shape (k, 3 + n): time [s], tip error [m], supply pressure of each actuator [Pa], highest
        needed pressure of all actuators [Pa].
    """
    need = compute_needed_pressure(machine, run.reference, run.modes).max(axis=1)
    columns = [run.time, run.tip_error(machine), *run.supply_pressure.T, need]
    every = max(1, round(0.01 / run.step))
    return np.column_stack(columns)[::every]


COMPARED_CONTROLLERS = ("coordinated", "independent")

TRACKED_ERROR = 5.0
"""Energies are compared only if both controllers stay within this tip error RMS [mm]."""


def compare(results: Sequence[ScenarioResult]) -> dict[str, Any]:
    """Compare the coordinated controller with the independent one.

    Supply overshoot is the pressure in a supply line beyond what the motion needs; negative values
    count as 0.

    Args:
        results: Results of at least one scenario, each with both controllers.

    Returns:
        A dictionary for JSON. A number "by controller" is a dictionary by name of the controller.

        - scenarios: number of scenarios
        - tip_error_rms_max_mm: largest tip error RMS, by controller
        - tracking_ratio: tip error RMS, independent / coordinated: `least` and `mean` (geometric)
            over the scenarios
        - overshoot_max_mpa, overshoot_mean_mpa: largest and mean supply overshoot, by controller
        - overshoot_ratio: overshoot, coordinated / independent: `of_largest` (ratio of the largest
            values), `of_mean` (ratio of the means) and `worst_scenario` (highest ratio in one
            scenario). Scenarios without overshoot of the independent controller have no ratio; all
            three are None if there are no others
        - energy_ratio: largest energy ratio, coordinated / independent; only scenarios with a tip
            error RMS of at most 5 mm of both count; None if there is none
        - energy_ratio_scenarios: number of these scenarios
        - planned_ratio: energy of the coordinated controller, planned / simulated: `least` and
            `largest`; planned energies price boosted oil as `series` (servo pump in series with
            the main pump)
        - energy_elements_j: its planned and simulated energy, part by part, summed over all
            scenarios
        - relief_opened: number of scenarios in which a relief valve opened, by controller
        - goals_refused: a sentence for each refused goal
    """
    pairs = [
        [each.records_by_controller[side] for side in COMPARED_CONTROLLERS] for each in results
    ]
    errors = np.array([[r.tip_error_rms_mm for r in pair] for pair in pairs])
    energies = np.array([[_energy(r) for r in pair] for pair in pairs])
    relief = [sum(r.relief_opened for r in side) for side in zip(*pairs, strict=True)]
    tracking = errors[:, 1] / errors[:, 0]
    tracked = energies[errors.max(axis=1) <= TRACKED_ERROR]
    planned = np.array([a.energy_planned_series_j for a, _ in pairs]) / energies[:, 0]
    return {
        "scenarios": len(pairs),
        "tip_error_rms_max_mm": _by_controller(errors.max(axis=0).tolist()),
        "tracking_ratio": {
            "least": float(tracking.min()),
            "mean": float(np.exp(np.mean(np.log(tracking)))),
        },
        **_compare_overshoot(np.array([[r.supply_overshoot_mpa for r in pair] for pair in pairs])),
        "energy_ratio": max((tracked[:, 0] / tracked[:, 1]).tolist(), default=None),
        "energy_ratio_scenarios": len(tracked),
        "planned_ratio": {"least": float(planned.min()), "largest": float(planned.max())},
        "energy_elements_j": [asdict(element) for element in sum_energies(results)],
        "relief_opened": _by_controller(relief),
        "goals_refused": [reason for result in results for reason in result.refused],
    }


def _compare_overshoot(overshoot: FloatArray) -> dict[str, Any]:
    """Compare the supply overshoot of both controllers.

    Args:
        overshoot: Overshoot [MPa], shape (scenarios, 2): column 0 for the coordinated, column 1 for
            the independent controller. Negative values count as 0.

    Returns:
        `overshoot_max_mpa` and `overshoot_mean_mpa` by controller. `overshoot_ratio`, coordinated /
        independent: `of_largest`, `of_mean` and `worst_scenario` (highest ratio in one scenario).
        Scenarios without overshoot of the independent controller have no ratio. If no scenario
        has a ratio, all three are None.
    """
    overshoot = overshoot.clip(0.0)
    largest, mean = overshoot.max(axis=0), overshoot.mean(axis=0)
    both = overshoot[overshoot[:, 1] > 0.0]
    return {
        "overshoot_max_mpa": _by_controller(largest.tolist()),
        "overshoot_mean_mpa": _by_controller(mean.tolist()),
        "overshoot_ratio": {
            "of_largest": float(largest[0] / largest[1]) if len(both) else None,
            "of_mean": float(mean[0] / mean[1]) if len(both) else None,
            "worst_scenario": float((both[:, 0] / both[:, 1]).max()) if len(both) else None,
        },
    }


def _by_controller(values: Sequence[float]) -> dict[str, float]:
    """Return the values of both controllers by their names."""
    return dict(zip(COMPARED_CONTROLLERS, values, strict=True))


def as_text(results: Sequence[ScenarioResult], comparison: dict[str, Any]) -> list[str]:
    """Format the results of a servo study as text.

    Args:
        results: Result of each scenario.
        comparison: Result of `compare` for these results.

    Returns:
        Lines without line breaks. First a table with a line for each scenario: RMS and largest tip
        error [mm], supply overshoot [MPa] and energy [J] of both controllers. Then planned and
        simulated energies of the coordinated controller, part by part. At the end are the other
        numbers of the comparison as JSON, and a line for each refused goal.
    """
    lines = [
        f"{'':30s} {'coordinated':^32s}   {'independent':^32s}",
        f"{'scenario':30s}" + 2 * "   RMS    max mm  over MPa      J   ",
    ]
    for result in results:
        mark = " " if result.scenario.held_out else "*"
        lines.append(
            f"{result.scenario.name:28s} {mark}"
            + "  ".join(_columns(record) for record in result.records)
        )
    lines.append("* gains were tuned on this scenario; R: a relief valve opened")
    lines += ["", "coordinated, all scenarios together:", *energy_text(sum_energies(results)), ""]
    shown = {k: v for k, v in comparison.items() if k not in ("goals_refused", "energy_elements_j")}
    return [*lines, json.dumps(shown), *comparison["goals_refused"]]


def sum_energies(results: Sequence[ScenarioResult]) -> list[EnergyPart]:
    """Return the coordinated controller's planned and simulated energy over all scenarios."""
    return sum_parts(result.elements["coordinated"] for result in results)


def _columns(record: StudyRecord) -> str:
    """Format RMS and largest tip error [mm], overshoot [MPa] and energy [J] of one record."""
    relief = "R" if record.relief_opened else " "
    return (
        f"{record.tip_error_rms_mm:7.2f} {record.tip_error_max_mm:8.2f} "
        f"{record.supply_overshoot_mpa:8.2f}{relief} {_energy(record):7.0f}"
    )


def _energy(record: StudyRecord) -> float:
    """Return the energy of all pumps [J]: main pump's oil and servo pumps' shafts."""
    return record.energy_mp_j + record.energy_sp_j
