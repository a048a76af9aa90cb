"""Runs of all discrete paths in the paper's Section 3: its cases and its parameter sweeps.

    runs = evaluate(load_machine())
    runs["1-1"].path.energy.sum()

Nothing is fitted or drawn here, so that a machine can be judged in a few seconds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np

from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_planner.cases.paper_cases import PaperCase, load_paper_cases
from mhsb_planner.executor import Jobs, yield_results_of_ranges
from mhsb_planner.integrated import integrated_search
from mhsb_planner.posture import s1_global_search
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.fixed_j3 import build_fixed_j3_graph, find_elbow_side
from mhsb_planner.search.manipulability_loss import create_area_cost
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_published import DEFAULT_HEURISTIC_SCALE
from mhsb_planner.search.s2_search import PathQuery, SearchMethod, Weights, search
from mhsb_planner.search.s2_start_goal_edges import find_postures_by_rule

ENERGY_WEIGHTS = (0.0, 0.25, 0.5, 0.75, 1.0)
TIME_WEIGHTS = (0.0, 5.0, 10.0, 15.0, 20.0)
"""Weights w₁ [1/J] and w₂ [1/s] of Figure 10. w₃ is 0 there: with both at 0, the paper says, the
cost is H alone.
"""

PISTON_SPEEDS = (0.006, 0.009, 0.012, 0.015, 0.020, 0.025, 0.026, 0.028, 0.030)
"""Values of V_max in the paper's sweep [m/s]."""
SWITCH_WEIGHTS = tuple(float(w3) for w3 in range(21))
"""Values of w₃ in the paper's sweep."""
SUPPLY_PRESSURES = (2.5e6, 10e6)
"""Values of P_S in the paper's sweep [Pa]."""

AREA_WEIGHTS = (100.0, 300.0, 1000.0, 2000.0, 3000.0, 5000.0, 10000.0, 50000.0)
"""Weights w₄ of the integrated planner's plans for Case 4, in addition to 0 [1/m]."""

HEURISTIC_SCALES = (0.0, 1.0, 30.0, 100.0, 300.0, 1000.0)
"""Scales of the heuristic H with which the published search is judged [1/m]; the paper does not
state H's scale.
"""

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Setting:
    """Conditions of one run: a case and what the run changes of it.

    Attributes:
        case: The case: start, goal, weights, planner.
        search: Method of the graph search, `exact` or `published`.
        heuristic_scale: Scale of the published search's heuristic [1/m].
        supply_pressure: P_S [Pa]; None keeps the machine's own.
        v_max: V_max [m/s]; None keeps the machine's own.
        keep_table: Whether the posture table stays that of the machine's own P_S.
        area_weight: Weight w₄ of the integrated planner [1/m].
    """

    case: PaperCase
    search: SearchMethod = "exact"
    heuristic_scale: float = DEFAULT_HEURISTIC_SCALE
    supply_pressure: float | None = None
    v_max: float | None = None
    keep_table: bool = False
    area_weight: float = 0.0

    @property
    def table_pressure(self) -> float | None:
        """P_S for which the posture table is built [Pa]; None is the machine's own."""
        return None if self.keep_table else self.supply_pressure


@dataclass(frozen=True, eq=False)
class Run:
    """A setting and the path found under it.

    Attributes:
        setting: The setting.
        machine: The machine with the setting's changes.
        path: The path; None if none was found.
        failure: Why there is no path, in one sentence; empty if there is one.
    """

    setting: Setting
    machine: Machine
    path: DiscretePath | None
    failure: str = ""


@dataclass(frozen=True, eq=False)
class Runs:
    """Runs of a machine by name, and the posture tables that they use.

    Attributes:
        machine: The arm, without changes.
        tables: Posture table by the P_S for which it was built [Pa]; None is the machine's own.
        runs: Runs by name, such as `1-1` or `c5.vmax 0.025`.
    """

    machine: Machine
    tables: Mapping[float | None, PostureTable]
    runs: Mapping[str, Run]

    @property
    def table(self) -> PostureTable:
        """Posture table of the machine's own P_S."""
        return self.tables[None]

    def __getitem__(self, name: str) -> Run:
        return self.runs[name]

    def by_published_search(self, scale: float = DEFAULT_HEURISTIC_SCALE) -> Runs:
        """Select the runs of the published search, and cut the search from their names.

        Args:
            scale: Scale of the heuristic [1/m].

        Returns:
            Only the runs of the published search with this scale. `1-1 published 30`, for example,
            gets the name `1-1`, which the exact search's run has in this object.
        """
        suffix = published_run("", scale)
        found = {
            name.removesuffix(suffix): run
            for name, run in self.runs.items()
            if name.endswith(suffix)
        }
        return Runs(self.machine, self.tables, found)


def weight_run(w1: float, w2: float) -> str:
    """Return the name of the run of Figure 10 with weights w₁ of energy and w₂ of time."""
    return f"c5.weights {w1:g} {w2:g}"


def speed_run(v_max: float) -> str:
    """Return the name of the run with a V_max [m/s]."""
    return f"c5.vmax {v_max:g}"


def switch_run(w3: float) -> str:
    """Return the name of the run with a weight w₃ of mode switches."""
    return f"c5.w3 {w3:g}"


def pressure_run(supply_pressure: float, *, keep_table: bool = False) -> str:
    """Return the name of the run with a supply pressure [Pa], its table rebuilt or kept."""
    return f"c5.ps {supply_pressure:g}" + (" kept table" if keep_table else "")


def integrated_run(case: str) -> str:
    """Return the name of the run of a case with the integrated planner."""
    return f"{case} integrated"


def published_run(name: str, scale: float = DEFAULT_HEURISTIC_SCALE) -> str:
    """Return the name of a run with the published search and a scale of its heuristic [1/m]."""
    return f"{name} published {scale:g}"


def area_run(w4: float) -> str:
    """Return the name of the integrated planner's run of Case 4 with a weight w₄ [1/m]."""
    return integrated_run("4-1") + (f" w4 {w4:g}" if w4 > 0.0 else "")


def settings(cases: Mapping[str, PaperCase] | None = None) -> dict[str, Setting]:
    """Return the conditions of all cases and sweeps of the paper, by name of the run.

    Args:
        cases: Cases by name in place of the paper's; None takes the paper's.

    Returns:
        The settings, in this order:

        - the cases
        - Figure 10: Case 1-1 with other weights w₁ of energy and w₂ of time, and w₃ = 0
        - the sweep over V_max (piston speed for planning), which changes Case 1-2
        - the sweep over the weight w₃ of mode switches, which changes Case 1-2
        - the sweep over supply pressure, which changes Case 1-1: for each pressure a run with a
            posture table built for it, then a run with the table of the machine's own pressure

        The run of Figure 10 in which all weights are 0 uses the published search algorithm. All
        other runs use the exact search.
    """
    cases = load_paper_cases() if cases is None else cases
    found = {name: Setting(case) for name, case in cases.items()}
    lifting, fastest = cases["1-1"], cases["1-2"]
    for w1 in ENERGY_WEIGHTS:
        for w2 in TIME_WEIGHTS:
            case = replace(lifting, weights=Weights(w1, w2, 0.0))
            method: SearchMethod = "published" if w1 == w2 == 0.0 else "exact"
            found[weight_run(w1, w2)] = Setting(case, search=method)
    for v_max in PISTON_SPEEDS:
        found[speed_run(v_max)] = Setting(fastest, v_max=v_max)
    for w3 in SWITCH_WEIGHTS:
        case = replace(fastest, weights=replace(fastest.weights, switches=w3))
        found[switch_run(w3)] = Setting(case)
    for supply in SUPPLY_PRESSURES:
        for keep in (False, True):
            name = pressure_run(supply, keep_table=keep)
            found[name] = Setting(lifting, supply_pressure=supply, keep_table=keep)
    return found


def published_settings(scale: float = DEFAULT_HEURISTIC_SCALE) -> dict[str, Setting]:
    """Return the conditions of all cases and sweeps with the published search, by name of the run.

    Args:
        scale: Scale of the search's heuristic, cost per distance from the goal [1/m].
    """
    return {
        published_run(name, scale): replace(each, search="published", heuristic_scale=scale)
        for name, each in settings().items()
    }


def integrated_settings() -> dict[str, Setting]:
    """Return the integrated planner's settings for all cases of the table planner, by run name."""
    return {
        integrated_run(name): Setting(replace(case, planner="integrated"))
        for name, case in load_paper_cases().items()
        if case.planner == "table"
    }


def area_settings() -> dict[str, Setting]:
    """Return the settings of Case 4 for the integrated planner with each weight w₄, by run name."""
    case = replace(load_paper_cases()["4-1"], planner="integrated")
    return {area_run(w4): Setting(case, area_weight=w4) for w4 in AREA_WEIGHTS}


def count_work_units(asked: Mapping[str, Setting]) -> int:
    """Return the number of work units that `evaluate` reports as its progress.

    Args:
        asked: Settings to evaluate, by name of the run.

    Returns:
        Number of runs, plus the number of posture tables. There is one table for the machine's own
        supply pressure, and one for each other pressure for which a setting needs its own table.
    """
    return len({setting.table_pressure for setting in asked.values()} | {None}) + len(asked)


def evaluate(
    machine: Machine,
    asked: Mapping[str, Setting] | None = None,
    jobs: Jobs = None,
    progress: Progress | None = None,
    known: Runs | None = None,
) -> Runs:
    """Search a discrete path for each setting.

    Posture tables are built first: one for the machine's own supply pressure, and one for each
    other pressure that a setting has (`Setting.table_pressure`). The result does not depend on
    `jobs`. A run for which no path is found is a result, not an error.

    Args:
        machine: The arm.
        asked: Settings by name of the run; None takes all cases and sweeps of the paper with the
            exact search.
        jobs: Number of threads, or a cluster; None takes one thread for each processor.
        progress: Function that is called with the number of work units done since its last call;
            `count_work_units` gives the total. None reports nothing.
        known: Earlier runs of this machine. Their posture tables are used again; None builds all
            tables.

    Returns:
        The runs, in the order of the settings.

    Raises:
        MachineFileError: A supply pressure or V_max (piston speed for planning) of a setting is
            beyond what the machine may have.
        EmptyTableError: No node of a posture table has a posture.
        RequestError: The number of threads is below 1.
        ClusterError: The cluster failed.
    """
    asked = settings() if asked is None else asked
    report_units = progress or (lambda units: None)
    s1_global_search.warm_up(machine)
    tables: dict[float | None, PostureTable] = {} if known is None else {**known.tables}
    for pressure in (None, *(s.table_pressure for s in asked.values())):
        if pressure not in tables:
            changed = machine.changed(supply_pressure=pressure)
            tables[pressure] = build_posture_table(changed, jobs=jobs)
            report_units(1)
    evaluator = _Evaluator(machine, tables, asked)
    if jobs is None or isinstance(jobs, int):
        evaluator.own_graph(jobs)
    found: dict[str, Run] = {}
    with closing(
        yield_results_of_ranges(evaluator.evaluate_groups, len(evaluator.groups), 1, jobs)
    ) as parts:
        for part in parts:
            found |= part
            report_units(len(part))
    return Runs(machine, tables, {name: found[name] for name in asked})


class _Evaluator:
    """Evaluator of settings in groups that share a step graph; can be sent to workers.

    Attributes:
        groups: Names of the settings in each group.
    """

    def __init__(
        self,
        machine: Machine,
        tables: Mapping[float | None, PostureTable],
        asked: Mapping[str, Setting],
    ) -> None:
        """Group the settings that can share a step graph (all steps of the graph search, priced).

        Settings are in one group if posture table, supply pressure and V_max (piston speed for
        planning) are equal.

        Args:
            machine: The arm.
            tables: Posture table by the P_S for which it was built [Pa]; None is the machine's own.
            asked: Settings by run name.
        """
        self._machine = machine
        self._tables = tables
        self._asked = asked
        self._own: StepGraph | None = None
        groups: dict[tuple[float | None, ...], list[str]] = {}
        for name, setting in asked.items():
            key = setting.table_pressure, setting.supply_pressure, setting.v_max
            groups.setdefault(key, []).append(name)
        self.groups = list(groups.values())

    def own_graph(self, jobs: int | None) -> StepGraph:
        """Return the step graph of the machine without changes.

        The step graph has all steps of the graph search with their prices. It is built on the first
        call. This object has no lock, so the first call must come before threads share it.

        Args:
            jobs: Number of threads that build it; None takes one for each processor.

        Returns:
            The step graph, the same object at each call.
        """
        if self._own is None:
            self._own = StepGraph(self._machine, self._tables[None], jobs)
        return self._own

    def evaluate_groups(self, begin: int, end: int) -> dict[str, Run]:
        """Run the path search with all settings of some of the `groups`.

        The settings of a group share a step graph, which is built once for the group.

        Args:
            begin: Index of the first group.
            end: Index after the last group.

        Returns:
            Runs by name. A run without a path has the reason in `failure`.
        """
        own = self.own_graph(1)
        found: dict[str, Run] = {}
        for names in self.groups[begin:end]:
            first = self._asked[names[0]]
            graph = _graph(own, self._tables[first.table_pressure], first)
            found |= {name: _run(graph, self._asked[name]) for name in names}
        return found


def _graph(own: StepGraph, table: PostureTable, setting: Setting) -> StepGraph:
    """Return the step graph (all steps of the graph search, priced) for a setting.

    `own` itself is returned if the setting keeps supply pressure and V_max (piston speed for
    planning). If the setting changes one of them but keeps the posture table, the result is a copy
    of `own` with new prices. With another posture table, a new graph is built.

    Args:
        own: Step graph of the machine without changes.
        table: Posture table of the setting.
        setting: The setting.

    Returns:
        The step graph for the changed machine.

    Raises:
        MachineFileError: The setting's supply pressure or V_max is not allowed for the machine.
    """
    if setting.supply_pressure is None and setting.v_max is None:
        return own
    machine = own.machine.changed(
        supply_pressure=setting.supply_pressure, max_piston_speed=setting.v_max
    )
    if table is own.table:
        return own.create_for(machine)
    return StepGraph(machine, table, jobs=1)


def _run(graph: StepGraph, setting: Setting) -> Run:
    """Search the path of one setting with the planner of its case.

    The arm starts at rest, with all actuators in mode N (fed by the main pump). The posture table
    gives the start posture; for the planner `fixed`, the case gives it. This planner keeps joint 3
    at the case's angle or, if the case has none, at its angle in the start posture.

    Args:
        graph: Step graph of the setting's machine.
        setting: The setting; its case names the planner.

    Returns:
        The run. If no path was found, `path` is None and `failure` has the reason.
    """
    case, machine = setting.case, graph.machine
    normal = np.full(machine.joint_count, Mode.N)
    begin, goal = (
        machine.convert_to_plane(place, preferred_slew=0.0).tip for place in (case.start, case.goal)
    )
    try:
        if case.planner == "integrated":
            start = find_postures_by_rule(graph, *begin)[0]
            area = create_area_cost(setting.area_weight, graph.table)
            query = PathQuery(start, normal, goal, case.weights)
            path = integrated_search.search(machine, query, area=area)
            return Run(setting, machine, path)
        if case.planner == "fixed":
            start = case.start_posture(machine)
            j3 = float(start[2]) if case.initial_j3 is None else case.initial_j3
            graph = build_fixed_j3_graph(
                machine, graph.table, j3, find_elbow_side(machine, start), jobs=1
            )
        else:
            start = find_postures_by_rule(graph, *begin)[0]
        path = search(
            graph,
            PathQuery(start, normal, goal, case.weights),
            method=setting.search,
            heuristic_scale=setting.heuristic_scale,
        )
    except MhsbError as error:
        return Run(setting, machine, None, str(error))
    return Run(setting, machine, path)
