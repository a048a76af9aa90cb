"""After the warm-up nothing is compiled any more: the first goal is answered like the next."""

import subprocess
import sys
from itertools import product

import numpy as np
import pytest
from tests.support.compiled_kernels import COUNT_COMPILED
from tests.support.forked_programs import run_forked

from mhsb_model.machine import load_machine
from mhsb_model.trajectory import MotionState
from mhsb_planner.planner import PLANNER_KINDS, Planner, warm_up
from mhsb_planner.posture.s1_global_search import build_posture_table

SCRIPT = (
    """
import sys
from contextlib import suppress
import numpy as np
from mhsb_model.errors import MhsbError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_planner.posture.s1_global_search import build_posture_table, find_postures_at
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.integrated import integrated_search
from mhsb_model.braking import extract_remainder
from mhsb_model.trajectory import MotionState
from mhsb_planner import planner as planning
from mhsb_planner.deadline import Deadline
from mhsb_planner.motion.s3_hard_braking import iterate_harder_brakings
from mhsb_planner.search.s2_search import PathQuery, Weights, search, warm_up
from mhsb_planner.search.s2_step import compute_step_costs

"""
    + COUNT_COMPILED
    + """
machine = load_machine()
table = PostureTable.load(sys.argv[1], machine)
graph = StepGraph(machine, table)
warm_up(graph)
integrated_search.warm_up(machine)
before = compiled()
q = table.posture[graph.grid.node_at(0.55, 0.2), 0]
modes = np.array([0, 1, 0], dtype=np.uint8)
psi = float(machine.postures(0.61, 0.31, np.linspace(-3, 3, 99))[0].sum())
weights = Weights(0.5, 0.0, 2.0)
search(graph, PathQuery(q, modes, (0.60, 0.30), Weights(1, 0, 2)))
search(graph, PathQuery(q, list(modes), [0.61, 0.31], weights, "series"))
search(graph, PathQuery(q - 0.01, modes, (0.61, 0.31), weights, goal_psi=psi))
search(graph, PathQuery(q, modes, (0.56, 0.21), weights))
changed = graph.create_for(machine.changed(payload=2.0))
search(changed, PathQuery(q, modes, (0.61, 0.31), weights))
for x, z in ((0.61, 0.31), (0.50, -0.20), (0.30, 0.60), (0.80, 0.10)):
    for weights in (Weights(0.5, 0, 2), Weights(0, 15, 2)):
        with suppress(MhsbError):
            integrated_search.search(machine, PathQuery(q, modes, (x, z), weights))
query = PathQuery(q, modes, (0.61, 0.31), Weights(1, 0, 2), goal_psi=psi)
integrated_search.search(machine, query)
by_searches = {name: count for name, count in compiled().items() if count != before.get(name)}
planner = planning.Planner(machine, table)
planning.warm_up(planner)
before = compiled()
compute_step_costs(machine, q, q - 0.01)  # as planners of others and first moves into the limits do
for options in (
    *(planning.PlanOptions(planner=kind) for kind in planning.PLANNER_KINDS),
    planning.PlanOptions(planner="integrated", area_weight=300.0),
    planning.PlanOptions(planner="table", search="published"),
):
    for x, z in ((0.60, 0.30), (0.61, 0.31)):
        start = MotionState.at_rest(q)
        plan = planner.plan((x, z), start, options=options, deadline=Deadline.after(3600.0))
        motion = plan.motion.trajectory
        halfway = motion.duration_ns // 2
        remainder = extract_remainder(motion, halfway)
        moving = motion.sample(halfway)
        planner.plan((x, z), moving, options=options, remainder=remainder)
        planner.plan((x, z + 0.02), moving, options=options, remainder=remainder)
        assert list(iterate_harder_brakings(machine, motion, halfway))
out = table.posture[graph.grid.node_at(0.95, 0.0), 0]  # stretched: lifting takes boost
for options in (planning.PlanOptions(planner=kind) for kind in planning.PLANNER_KINDS):
    plan = planner.plan((0.85, 0.40), MotionState.at_rest(out), options=options)
    assert (plan.motion.schedule.modes[1:] > 0).any(), options
crowded = machine.changed(zones=Zones(boxes=((0.65, 0.1, 0.95, 0.3),)))
planner.change_machine(crowded)
for kind in planning.PLANNER_KINDS:
    with suppress(MhsbError):
        planner.plan((0.5, -0.2), start, options=planning.PlanOptions(planner=kind))
by_plans = {name: count for name, count in compiled().items() if count != before.get(name)}
arm = load_machine(find_config_file("excavator.yaml"))
planner = planning.Planner(arm, build_posture_table(arm.planar_arm, 6.0 * arm.spacing))
planning.warm_up(planner)
before = compiled()
planner.change_machine(arm.changed(zones=Zones(boxes=((1.2, -0.1, -2.0, 3.5, 0.1, 0.3),))))
place = arm.convert_to_plane((2.6, -1.5, -0.8), 0.0)
posture = find_postures_at(arm.planar_arm, *place.tip).posture[0]
start = MotionState.at_rest(np.append(place.slew, posture))
for kind in planning.PLANNER_KINDS:
    planner.plan((2.0, 1.8, -0.5), start, options=planning.PlanOptions(planner=kind))
by_slews = {name: count for name, count in compiled().items() if count != before.get(name)}
print(by_searches | by_plans | by_slews)
"""
)

PLAN_FROM_REST = (
    """
import importlib, sys
from mhsb_model.machine import load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import MotionState
from mhsb_planner.kernel_parts import list_parts_for_rest
from mhsb_planner.planner import Planner, PlanOptions
from mhsb_planner.posture.s1_posture_table import PostureTable

"""
    + COUNT_COMPILED
    + """
machine, name, far = load_machine(), sys.argv[2], Zones(circles=((-0.5, 0.5, 0.05),))
if sys.argv[3] == "obstacle":
    machine = machine.changed(zones=far)
for part in list_parts_for_rest(name, has_obstacles=sys.argv[3] == "obstacle"):
    module, function = part.split(":")
    getattr(importlib.import_module(module), function)()
before = compiled()
planner = Planner(machine, PostureTable.load(sys.argv[1], machine))
start = MotionState.at_rest(machine.config.simulation.start_posture)
planner.plan((0.55, 0.60), start, options=PlanOptions(planner=name))
print({name: count for name, count in compiled().items() if count != before.get(name)})
"""
)

FIRST_CALL = """
import concurrent.futures, queue, subprocess, sys, threading, time
time.monotonic = time.perf_counter = time.process_time  # however busy the machine is
from mhsb_model import MotionState, load_machine
from mhsb_planner import Deadline, Planner, PostureTable
machine = load_machine()
planner = Planner(machine, PostureTable.load(sys.argv[1], machine))
start = MotionState.at_rest(machine.config.simulation.start_posture)
print(planner.plan((0.55, 0.60), start, deadline=Deadline.after(0.3)).planning_time < 0.3)
"""

FIRST_CALL_WITHOUT_DEADLINE = FIRST_CALL.replace(", deadline=Deadline.after(0.3)", "").replace(
    "< 0.3", "< 3.0"
)


def run_with_table(script, table, folder, *arguments):
    table.save(folder / "table.npz")
    return subprocess.run(
        [sys.executable, "-c", script, str(folder / "table.npz"), *arguments],
        capture_output=True,
        text=True,
        check=False,
    )


def test_no_kernel_is_compiled_by_the_first_plans(table, tmp_path):
    done = run_with_table(SCRIPT, table, tmp_path)
    assert done.stdout.strip() == "{}", done.stderr


CASES = list(product(PLANNER_KINDS, ("free", "obstacle")))


@pytest.fixture(scope="module")
def compiled_from_rest(table, tmp_path_factory):
    """Output and errors of a process for each case; it prints the kernels that a plan compiled."""
    folder = tmp_path_factory.mktemp("rest")
    table.save(folder / "table.npz")
    programs = [(PLAN_FROM_REST, "table.npz", *case) for case in CASES]
    modules = "mhsb_planner.planner", "mhsb_planner.kernel_parts"
    return dict(zip(CASES, run_forked(programs, folder, modules), strict=True))


@pytest.mark.parametrize(("planner", "surroundings"), CASES)
def test_the_parts_of_a_planner_have_all_kernels_of_its_plan_from_rest(
    planner, surroundings, compiled_from_rest
):
    assert compiled_from_rest[planner, surroundings] == ("{}\n", "")


def test_compiling_does_not_count_against_the_deadline_of_the_first_plan(table, tmp_path):
    done = run_with_table(FIRST_CALL, table, tmp_path)
    assert done.stdout.strip() == "True", done.stderr


@pytest.mark.slow
def test_the_first_plan_in_python_compiles_in_workers_and_not_in_its_planning_time(
    table, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    done = run_with_table(FIRST_CALL_WITHOUT_DEADLINE, table, tmp_path)
    assert done.stdout.strip() == "True", done.stderr
    assert "compiling kernels, once" in done.stderr


def test_a_machine_without_boost_is_warmed_up_too():
    alone = load_machine().with_values({"hydraulics.modules.count": 0})
    planner = Planner(alone, build_posture_table(alone, 0.25))
    warm_up(planner)
    table = planner.graph.table
    begin, end = np.flatnonzero(np.isfinite(table.posture[:, 0]).all(axis=1))[:2]
    goal = tuple((table.nodes[end] * table.spacing).tolist())
    plan = planner.plan(goal, MotionState.at_rest(table.posture[begin, 0]))
    assert not plan.motion.schedule.modes.any()
    assert alone.tip_position(plan.motion.trajectory.position[-1]) == pytest.approx(goal, abs=1e-6)
