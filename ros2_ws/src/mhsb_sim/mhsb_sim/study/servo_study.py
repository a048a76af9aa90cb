"""The servo study: every controller over every scenario, in numbers.

The plans of a scenario are made once, with the posture table of its payload, and given to each
controller: what differs is the servo alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d

from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.goal import place
from mhsb_model.holding import holding_modes
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray
from mhsb_planner.motion.energy import Energy, motion_energy
from mhsb_planner.online.lead import OFFLINE_LEAD
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.planner import PlanOptions
from mhsb_planner.posture.posture_table_cache import table_for
from mhsb_planner.workers import Jobs, processes, results_of
from mhsb_sim.circuit.audit import energy_by_source
from mhsb_sim.servo import CONTROLLERS
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.study.energy_comparison import Element, energy_elements
from mhsb_sim.study.needed_pressure import needed_pressure
from mhsb_sim.study.replay import Replay, replay
from mhsb_sim.study.scenarios import Scenario

WINDOW = 0.1
"""What is needed within this time ahead may be there now: lines are charged in time [s]."""

ALLOWANCE = 2e5
"""What a servo may keep in reserve above the need, before it counts as overshoot [Pa]."""

PLANNED_EVERY = 10
"""Steps from one point of the followed reference to the next, for the planner's energy."""


@dataclass(frozen=True)
class StudyRecord:
    """One controller in one scenario.

    tip_error_…            measured tip against the servo's reference, the whole run [mm]
    supply_peak_mpa        highest pressure in any actuator's supply line
    supply_overshoot_mpa   largest excess of a supply line, see `supply_overshoot`
    chamber_peak_mpa       highest pressure in any cylinder
    relief_opened          whether any relief valve let oil through
    energy_mp_j            delivered by the main pump to its oil
    energy_sp_j            delivered to the servo pumps' shafts: another boundary
    energy_planned_series_j  the planner's model, pumps in series, of the motion that was followed
    mode_switches          changes of the mode in force, summed over the actuators
    held_out               whether gains were tuned without this scenario
    energy_mp_shaft_j      at the main pump's shaft
    energy_sp_hydraulic_j  delivered by the servo pumps to their oil
    interventions          times that the guard boosted or slowed beyond the plan
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
class Script:
    """A scenario's machine and plans.

    commands  in the order of their stamps
    refused   why goals were refused; the motion went on
    """

    scenario: Scenario
    machine: Machine
    commands: tuple[Command, ...]
    refused: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ScenarioResult:
    """All controllers in one scenario: a record of each, and pressures and errors to draw.

    traces    per controller float64[k, 3 + n]: time [s], tip error [m], supply pressure of
              each actuator [Pa], the highest need [Pa]; 100 rows a second
    elements  per controller the planned and the simulated energy, element by element
    """

    scenario: Scenario
    records: tuple[StudyRecord, ...]
    refused: tuple[str, ...]
    traces: dict[str, FloatArray]
    elements: dict[str, list[Element]]

    @property
    def records_by_controller(self) -> dict[str, StudyRecord]:
        """The records under their controllers' names."""
        return {record.controller: record for record in self.records}


def script_of(machine: Machine, scenario: Scenario) -> Script:
    """Plan all goals of a scenario; a goal that is refused leaves the motion as it is."""
    loaded = scenario.machine(machine)
    replanner = Replanner(loaded, table_for(loaded))
    start = np.array(loaded.config.simulation.start_posture)
    command = Command.hold(0, start, holding_modes(loaded, loaded.piston_forces(start)))
    options = PlanOptions(weights=scenario.weights)
    commands, refused = [], []
    for number, goal in enumerate(scenario.goals):
        now_ns = round(number * scenario.interval * SECOND_NS)
        try:
            replan = replanner.replan(command, now_ns, goal, OFFLINE_LEAD, options)
        except MhsbError as error:
            refused.append(f"{scenario.name}: goal {place(goal, 'g')}: {error}")
            continue
        if replan is not None:
            command = replan.command
            commands.append(command)
    return Script(scenario, loaded, tuple(commands), tuple(refused))


def perform(script: Script, controller: str, machine: Machine | None = None) -> Replay:
    """Let a controller follow a script; `machine` may differ from the script's in its gains."""
    simulator = Simulator(machine or script.machine, controller)
    return replay(simulator, script.commands, script.scenario.duration)


def supply_overshoot(machine: Machine, run: Replay) -> FloatArray:
    """Excess of each supply line over what the trajectory itself needs, float64[k, n] Pa.

    p_line(t) − p(t), where p(t) is the highest of

        need(t') + ALLOWANCE                     for t ≤ t' ≤ t + WINDOW: lines are charged ahead
        p(t − dt) − q_leak/(C_line + C_rail) dt  pressure that was needed goes no faster than a
                                                 shut line loses it through its valve's leakage

    and need is that of `needed_pressure`: statics, dynamics, friction, the valve's drop and the
    machine's `boost_margin`, of the neediest of the actuators that share a rail, at least P_S.
    """
    width = round(WINDOW / run.step) + 1
    need = needed_pressure(machine, run.reference, run.modes)
    ahead = maximum_filter1d(need, width, axis=0, mode="nearest", origin=-(width // 2))
    oil = machine.config.circuit
    capacity = (oil.line_volume + oil.rail_volume) / oil.bulk_modulus
    fall = machine.arrays.leakage_flow / capacity * run.time[:, None]
    fading = np.maximum.accumulate(ahead + fall, axis=0) - fall
    return run.supply_pressure - fading - ALLOWANCE


def planned_energy(script: Script, run: Replay) -> Energy:
    """The planner's model of the motion that was followed."""
    return motion_energy(script.machine, *run.followed(PLANNED_EVERY))


def judge(script: Script, controller: str, run: Replay) -> StudyRecord:
    """The numbers of a run."""
    machine = script.machine
    error = 1e3 * run.tip_error(machine)
    source = energy_by_source(run.energies)
    return StudyRecord(
        scenario=script.scenario.name,
        controller=controller,
        tip_error_rms_mm=float(np.sqrt(np.mean(error**2))),
        tip_error_max_mm=float(error.max()),
        supply_peak_mpa=float(run.supply_pressure.max() / 1e6),
        supply_overshoot_mpa=float(supply_overshoot(machine, run).max() / 1e6),
        chamber_peak_mpa=float(run.chamber_pressure.max() / 1e6),
        relief_opened=run.energies["relief_valves"] > 0.0,
        energy_mp_j=source["main_pump"]["hydraulic"],
        energy_sp_j=source["servo_pumps"]["shaft"],
        energy_mp_shaft_j=source["main_pump"]["shaft"],
        energy_sp_hydraulic_j=source["servo_pumps"]["hydraulic"],
        energy_planned_series_j=planned_energy(script, run).series,
        mode_switches=int(np.count_nonzero(np.diff(run.modes.astype(int), axis=0))),
        held_out=script.scenario.held_out,
        interventions=run.interventions,
    )


def study_scenario(machine: Machine, scenario: Scenario) -> ScenarioResult:
    """Every controller in one scenario."""
    script = script_of(machine, scenario)
    records, traces, elements = [], {}, {}
    for controller in CONTROLLERS:
        run = perform(script, controller)
        records.append(judge(script, controller, run))
        traces[controller] = _trace(script.machine, run)
        elements[controller] = energy_elements(planned_energy(script, run), run.energies)
    return ScenarioResult(scenario, tuple(records), script.refused, traces, elements)


def run_study(
    machine: Machine, scenarios: Sequence[Scenario], jobs: Jobs = None
) -> Iterator[ScenarioResult]:
    """Results as they come, scenario by scenario, each done by one of `jobs`."""
    with processes(jobs) as pool:
        yield from results_of(pool.submit(study_scenario, machine, each) for each in scenarios)


def as_dicts(results: Sequence[ScenarioResult]) -> list[dict[str, object]]:
    """All records as plain dicts, ready for JSON."""
    return [asdict(record) for result in results for record in result.records]


def _trace(machine: Machine, run: Replay) -> FloatArray:
    need = needed_pressure(machine, run.reference, run.modes).max(axis=1)
    columns = [run.time, run.tip_error(machine), *run.supply_pressure.T, need]
    every = max(1, round(0.01 / run.step))
    return np.column_stack(columns)[::every]
