"""All discrete paths that the paper's Section 3 speaks of: its cases and its parameter sweeps.

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
from mhsb_planner.cluster import Cluster
from mhsb_planner.evaluation.paper_cases import PaperCase, paper_cases
from mhsb_planner.integrated import integrated_search
from mhsb_planner.posture import s1_global_search
from mhsb_planner.posture.grid import grid_nodes
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.area_shortfall import area_term
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.fixed_j3 import elbow_side, fixed_j3_graph
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_joining import postures_by_rule
from mhsb_planner.search.s2_published import DEFAULT_HEURISTIC_SCALE
from mhsb_planner.search.s2_search import SearchMethod, Weights, search
from mhsb_planner.workers import Jobs, over_ranges

ENERGY_WEIGHTS = (0.0, 0.25, 0.5, 0.75, 1.0)
TIME_WEIGHTS = (0.0, 5.0, 10.0, 15.0, 20.0)
"""w₁ and w₂ of Figure 10. w₃ is 0 there: with both at 0 the cost is said to be H alone."""

PISTON_SPEEDS = (0.006, 0.009, 0.012, 0.015, 0.020, 0.025, 0.026, 0.028, 0.030)  # m/s
SWITCH_WEIGHTS = tuple(float(w3) for w3 in range(21))
SUPPLY_PRESSURES = (2.5e6, 10e6)  # Pa

AREA_WEIGHTS = (100.0, 300.0, 1000.0, 2000.0, 3000.0, 5000.0, 10000.0, 50000.0)
"""w₄ with which Case 4 is planned by the integrated planner, beside 0 [1/m]."""

HEURISTIC_SCALES = (0.0, 1.0, 30.0, 100.0, 300.0, 1000.0)
"""With which the published search is judged [1/m]: the paper tells nothing of its H's scale."""

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Setting:
    """What a run changes of its case's conditions.

    heuristic_scale         of the published search [1/m]
    supply_pressure, v_max  Pa, m/s; None: the machine's own
    keep_table              keep the machine's posture table with the changed supply pressure
    area_weight             w₄ of the integrated planner [1/m]
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
        """Supply pressure for which the table is built; None: the machine's own."""
        return None if self.keep_table else self.supply_pressure

    @property
    def circuit(self) -> tuple[float | None, float | None, float | None]:
        """Runs that agree in this share their steps."""
        return self.table_pressure, self.supply_pressure, self.v_max


@dataclass(frozen=True, eq=False)
class Run:
    """A setting, the machine as changed by it, and the path found.

    path is None where there is none; `failure` then says why in one sentence.
    """

    setting: Setting
    machine: Machine
    path: DiscretePath | None
    failure: str = ""


@dataclass(frozen=True, eq=False)
class Runs:
    """All runs of a machine by name (`1-1`, `c5.vmax 0.025`), and the posture tables they use.

    tables  by the supply pressure that they are built for [Pa]; None: the machine's own
    """

    machine: Machine
    tables: Mapping[float | None, PostureTable]
    runs: Mapping[str, Run]

    @property
    def table(self) -> PostureTable:
        """The machine's own."""
        return self.tables[None]

    def __getitem__(self, name: str) -> Run:
        return self.runs[name]

    def by_published_search(self, scale: float = DEFAULT_HEURISTIC_SCALE) -> Runs:
        """The runs of `published_settings` with this scale [1/m], under the names of `settings`."""
        suffix = published_run("", scale)
        found = {
            name.removesuffix(suffix): run
            for name, run in self.runs.items()
            if name.endswith(suffix)
        }
        return Runs(self.machine, self.tables, found)


def weight_run(w1: float, w2: float) -> str:
    """Name of the run of Figure 10 with these weights of energy and time."""
    return f"c5.weights {w1:g} {w2:g}"


def speed_run(v_max: float) -> str:
    """Name of the run with this V_max [m/s]."""
    return f"c5.vmax {v_max:g}"


def switch_run(w3: float) -> str:
    """Name of the run with this weight of mode switches."""
    return f"c5.w3 {w3:g}"


def pressure_run(supply_pressure: float, *, keep_table: bool = False) -> str:
    """Name of the run with this supply pressure [Pa]."""
    return f"c5.ps {supply_pressure:g}" + (" kept table" if keep_table else "")


def integrated_run(case: str) -> str:
    """Name of the run of a case with the integrated planner."""
    return f"{case} integrated"


def published_run(name: str, scale: float = DEFAULT_HEURISTIC_SCALE) -> str:
    """Name of a run with the published search instead, its heuristic scaled so [1/m]."""
    return f"{name} published {scale:g}"


def area_run(w4: float) -> str:
    """Name of the run of Case 4 with the integrated planner and this weight of the area [1/m]."""
    return integrated_run("4-1") + (f" w4 {w4:g}" if w4 > 0.0 else "")


def settings(cases: Mapping[str, PaperCase] | None = None) -> dict[str, Setting]:
    """All runs by name."""
    cases = paper_cases() if cases is None else cases
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


def published_settings(
    cases: Mapping[str, PaperCase] | None = None, scale: float = DEFAULT_HEURISTIC_SCALE
) -> dict[str, Setting]:
    """All of `settings` with the published search, its heuristic scaled so [1/m], by name."""
    return {
        published_run(name, scale): replace(each, search="published", heuristic_scale=scale)
        for name, each in settings(cases).items()
    }


def integrated_settings(cases: Mapping[str, PaperCase] | None = None) -> dict[str, Setting]:
    """The cases of the posture table planned by the integrated planner instead, by name."""
    cases = paper_cases() if cases is None else cases
    return {
        integrated_run(name): Setting(replace(case, planner="integrated"))
        for name, case in cases.items()
        if case.planner == "table"
    }


def area_settings(cases: Mapping[str, PaperCase] | None = None) -> dict[str, Setting]:
    """Case 4 planned by the integrated planner with ever more weight on the area, by name."""
    case = replace((paper_cases() if cases is None else cases)["4-1"], planner="integrated")
    return {area_run(w4): Setting(case, area_weight=w4) for w4 in AREA_WEIGHTS}


def work_units(machine: Machine, asked: Mapping[str, Setting]) -> int:
    """How many units of progress `evaluate` tells: nodes of tables, and runs."""
    tables = {setting.table_pressure for setting in asked.values()} | {None}
    return len(tables) * len(grid_nodes(machine, machine.spacing)) + len(asked)


def evaluate(
    machine: Machine,
    asked: Mapping[str, Setting] | None = None,
    jobs: Jobs = None,
    progress: Progress | None = None,
    known: Runs | None = None,
) -> Runs:
    """Run the settings asked for (default: all), in threads or on a cluster.

    progress is told how many of `work_units` are done now. The result does not depend on jobs.
    known: other runs of this machine, whose tables serve here, too.
    Raises MachineFileError where the machine does not allow a change, ClusterError; a run without
    path is a result.
    """
    asked = settings() if asked is None else asked
    tell = progress or (lambda units: None)
    s1_global_search.warm_up(machine)
    tables: dict[float | None, PostureTable] = {} if known is None else {**known.tables}
    for pressure in (None, *(s.table_pressure for s in asked.values())):
        if pressure not in tables:
            tables[pressure] = _table(machine.changed(supply_pressure=pressure), jobs, tell)
    evaluator = _Evaluator(machine, tables, asked)
    if not isinstance(jobs, Cluster):
        evaluator.price(jobs)
    found: dict[str, Run] = {}
    with closing(over_ranges(evaluator.runs, len(evaluator.groups), 1, jobs)) as parts:
        for part in parts:
            found |= part
            tell(len(part))
    return Runs(machine, tables, {name: found[name] for name in asked})


class _Evaluator:
    """Runs of a machine, by groups that share their steps.

    groups  names of the settings of each
    """

    def __init__(
        self,
        machine: Machine,
        tables: Mapping[float | None, PostureTable],
        asked: Mapping[str, Setting],
    ) -> None:
        self._machine = machine
        self._tables = tables
        self._asked = asked
        self._own: StepGraph | None = None
        groups: dict[tuple[float | None, ...], list[str]] = {}
        for name, setting in asked.items():
            groups.setdefault(setting.circuit, []).append(name)
        self.groups = list(groups.values())

    def price(self, jobs: int | None) -> StepGraph:
        """The steps of the machine itself; to be called before threads share this."""
        if self._own is None:
            self._own = StepGraph(self._machine, self._tables[None], jobs)
        return self._own

    def runs(self, begin: int, end: int) -> dict[str, Run]:
        """All runs of some of the groups."""
        own = self.price(1)
        found: dict[str, Run] = {}
        for names in self.groups[begin:end]:
            first = self._asked[names[0]]
            graph = _graph(own, self._tables[first.table_pressure], first)
            found |= {name: _run(graph, self._asked[name]) for name in names}
        return found


def _table(machine: Machine, jobs: Jobs, tell: Progress) -> PostureTable:
    told = 0

    def progress(done: int, total: int) -> None:
        nonlocal told
        tell(done - told)
        told = done

    return build_posture_table(machine, jobs=jobs, progress=progress)


def _graph(own: StepGraph, table: PostureTable, setting: Setting) -> StepGraph:
    if setting.supply_pressure is None and setting.v_max is None:
        return own
    machine = own.machine.changed(
        supply_pressure=setting.supply_pressure, max_piston_speed=setting.v_max
    )
    if table is own.table:
        return own.changed(machine)
    return StepGraph(machine, table, jobs=1)


def _run(graph: StepGraph, setting: Setting) -> Run:
    case, machine = setting.case, graph.machine
    normal = np.full(machine.joint_count, Mode.N)
    begin, goal = (machine.in_plane(place, near=0.0).tip for place in (case.start, case.goal))
    try:
        if case.planner == "integrated":
            start = postures_by_rule(graph, *begin)[0]
            area = area_term(setting.area_weight, graph.table)
            path = integrated_search.search(
                machine, start, normal, goal, case.weights, area=area
            )
            return Run(setting, machine, path)
        if case.planner == "fixed":
            start = case.start_posture(machine)
            j3 = float(start[2]) if case.initial_j3 is None else case.initial_j3
            graph = fixed_j3_graph(machine, graph.table, j3, elbow_side(machine, start), jobs=1)
        else:
            start = postures_by_rule(graph, *begin)[0]
        path = search(
            graph,
            start,
            normal,
            goal,
            case.weights,
            method=setting.search,
            heuristic_scale=setting.heuristic_scale,
        )
    except MhsbError as error:
        return Run(setting, machine, None, str(error))
    return Run(setting, machine, path)
