"""The suite's own arm with its table and graph, and what one step costs, worked out slowly."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from mhsb_model.linkages.linkage import moment_arm
from mhsb_model.machine import Machine
from mhsb_planner import deadline as deadlines
from mhsb_planner.deadline import Deadline
from mhsb_planner.plan_log import PlanLog, ProposalOutcome
from mhsb_planner.posture.s1_global_search import build_posture_table
from mhsb_planner.posture.s1_posture_table import PostureTable
from mhsb_planner.search.discrete_path import DiscretePath, SearchStatistics
from mhsb_planner.search.s2_graph import StepGraph
from mhsb_planner.search.s2_step import compute_step_costs


class Looks:
    """A clock that counts the looks at it; from a look on that is chosen, time is up."""

    def __init__(self) -> None:
        self.count = 0
        self.last = math.inf

    def __call__(self) -> float:
        """The time [s]: 0, later far beyond any deadline, even one that a warm-up has put off."""
        self.count += 1
        return 0.0 if self.count <= self.last else 1e6

    def deadline_after(self, looks: float) -> Deadline:
        """A deadline that passes after so many looks from now."""
        self.count, self.last = 0, looks
        return Deadline(0.5)


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> Looks:
    """The clock of all deadlines."""
    looks = Looks()
    monkeypatch.setattr(deadlines, "now", looks)
    return looks


@pytest.fixture
def planner_may_fail() -> None:
    """Lets an error end a planner after its first motion, which otherwise fails the test."""


@pytest.fixture(autouse=True)
def no_planner_fails(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A planner that an error ends after its first motion fails the test, though a plan is made."""
    if "planner_may_fail" in request.fixturenames:
        return
    add = PlanLog.add

    def add_unless_failed(self, proposer, outcome, *values, **named):
        assert outcome is not ProposalOutcome.FAILED, (proposer, named)
        add(self, proposer, outcome, *values, **named)

    monkeypatch.setattr(PlanLog, "add", add_unless_failed)


@pytest.fixture(scope="session")
def table(machine: Machine) -> PostureTable:
    return build_posture_table(machine)


@pytest.fixture(scope="session")
def graph(machine: Machine, table: PostureTable) -> StepGraph:
    return StepGraph(machine, table)


@pytest.fixture(scope="session")
def slow_steps() -> Callable[..., dict[int, tuple[float, float, float]]]:
    return steps_by_the_book


def steps_by_the_book(machine, start, end_by_pattern):
    """Admissible steps from a posture to a node, {pattern index: (T, E paper, E series)}.

    The conventions of the discrete path in plain Python, from the machine file's own numbers;
    `end_by_pattern` is the posture at the node for each of the machine's patterns.
    """
    found = {}
    for index, (pattern, end) in enumerate(zip(machine.patterns, end_by_pattern, strict=True)):
        found[index] = _step_by_the_book(machine, start, end, pattern)
    for status in ("consistent", "without need"):
        steps = {index: cost for index, (word, *cost) in found.items() if word == status}
        if steps:
            return {index: tuple(cost) for index, cost in steps.items()}
    return {}


def leaves_the_workspace(machine, start, end):
    """Whether the tip leaves the region of goals on the way, by more than at both ends."""
    area = machine.config.workspace
    way = start + np.linspace(0, 1, 200)[:, None] * (end - start)
    tips, _ = tip_and_torque(machine.arrays, way)
    radius = np.hypot(*tips.T)
    outside = np.maximum(area.min_x - tips[:, 0], area.min_radius - radius)
    outside = np.maximum(outside, radius - area.max_radius)
    return outside.max() > max(0.0, outside[0], outside[-1]) + 1e-5


def valves_and_speeds(machine):
    """K [m³/(s √Pa)] and V_max [m/s] of each actuator, from the machine file's own numbers."""
    valve, k, v_max = machine.config.hydraulics.valve, [], []
    for joint in machine.config.joints:
        own = joint.actuator
        drop = own.rated_pressure_drop_per_land or valve.rated_pressure_drop_per_land
        k.append((own.rated_flow or valve.rated_flow) / math.sqrt(drop))
        common = machine.config.motion.max_piston_speed
        v_max.append(min(common, own.max_piston_speed or common))
    return np.array(k), np.array(v_max)


def _step_by_the_book(machine, start, end, pattern):
    if leaves_the_workspace(machine, start, end):
        return ("left",)
    oil, valve = machine.config.hydraulics, machine.config.hydraulics.valve
    k, v_max = valves_and_speeds(machine)
    tank, supply = oil.tank_pressure, oil.main_pump.pressure
    n = machine.joint_count
    bore = np.array([joint.cylinder.bore for joint in machine.config.joints])
    rod = np.array([joint.cylinder.rod for joint in machine.config.joints])
    cap, ring = np.pi / 4 * bore**2, np.pi / 4 * (bore**2 - rod**2)
    delta = machine.cylinder_lengths(end) - machine.cylinder_lengths(start)
    extends = delta > 0
    inlet, outlet = np.where(extends, cap, ring), np.where(extends, ring, cap)
    modules = np.array([oil.modules.per_mode[mode] for mode in pattern])
    boosted = modules > 0
    fastest = v_max.copy()
    pumped = modules * oil.servo_pump.max_flow / inlet
    fastest[boosted] = np.minimum(fastest, pumped)[boosted]
    held = np.abs(delta) <= 1e-6
    half_way = 0.5 * (start + end)
    load = np.where(extends, 1, -1) * machine.gravity_torque(half_way)
    load = load / machine.moment_arms(half_way)
    drop = v_max**2 * (cap**3 + ring**3) / (k**2 * inlet)
    line = (load + outlet * tank) / inlet + drop + oil.boost_margin
    line = np.clip(line, supply, oil.servo_pump.max_boost_pressure)
    line = np.where(boosted & ~held, line, supply)
    line[(pattern == 2) & ~held] = max([supply, *line[pattern == 2]])
    ratio = (line - tank) / (supply - tank)
    lands = valve.land_leakage
    leaks = valve.leakage_flow * ((1 - lands) * np.sqrt(ratio) + lands * ratio)
    shared = oil.main_pump.max_flow - leaks.sum()
    if shared <= 0:
        return ("no flow",)
    duration = max(np.max(np.abs(delta) / fastest), np.sum(inlet * np.abs(delta)) / shared)

    speed = np.abs(delta) / duration
    reserve = speed**2 * (cap**3 + ring**3) / (k**2 * inlet) + oil.boost_margin
    need = np.zeros(n, dtype=bool)
    for at in (0.0, 0.5, 1.0):
        q = start + at * (end - start)
        against = np.where(extends, 1, -1) * machine.gravity_torque(q) / machine.moment_arms(q)
        load_pressure = (against + outlet * tank) / inlet
        if at == 0.5:
            middle = load_pressure
        opposed = (against > 0) & ~held
        if np.any(opposed & (load_pressure + reserve > oil.servo_pump.max_boost_pressure)):
            return ("too heavy",)
        need |= opposed & (load_pressure + reserve > supply)
    if np.any(need & ~boosted):
        return ("needs boost",)

    rail = max([0.0, *(middle + reserve)[(pattern == 2) & ~held]])
    energy = np.zeros(2)
    for j in range(n):
        price = np.array([supply, supply])
        if boosted[j] and not held[j]:
            p_supply = rail if pattern[j] == 2 else middle[j] + reserve[j]
            price[0] = max(supply, middle[j] / oil.servo_pump.efficiency)
            rise = max(0.0, p_supply - supply)
            price[1] = supply + rise / oil.servo_pump.efficiency
            slip = oil.modules.per_mode[pattern[j]] * oil.servo_pump.slip_flow / 1e7 * rise
            energy[1] += slip * rise / oil.servo_pump.efficiency * duration
        leaked = np.array([valve.leakage_flow, leaks[j]]) * duration
        energy += price * (inlet[j] * abs(delta[j]) + leaked)
    word = "without need" if np.any(boosted & ~need) else "consistent"
    return (word, duration, *energy)


@pytest.fixture(scope="session")
def walk(machine: Machine) -> Callable[..., DiscretePath]:
    """Function (random, steps, start=None, leap=0.2) that makes a discrete path of that length.

    It wanders over neighbouring nodes, in the posture next to the last one or, in a share `leap`
    of the steps, in any; every step is admissible and stays within the node set.
    """

    def stays_inside(start: np.ndarray, end: np.ndarray) -> bool:
        line = start + np.linspace(0, 1, 33)[:, None] * (end - start)
        tips, _ = tip_and_torque(machine.arrays, line)
        radius = np.hypot(*tips.T)
        return bool(tips[:, 0].min() >= 0 and radius.min() >= 0.25 and radius.max() <= 1.029)

    def next_step(random: np.random.Generator, q: np.ndarray, heading: int, leap: float):
        x, z = machine.tip_position(q)
        turn = heading * np.pi / 4
        x, z = x + 0.05 * np.round(np.cos(turn)), z + 0.05 * np.round(np.sin(turn))
        choice = machine.postures(x, z, random.uniform(-np.pi, np.pi, 60))
        if len(choice) == 0:
            return None
        near = np.argmin(np.abs(choice - q).max(axis=1))
        posture = choice[random.integers(len(choice)) if random.random() < leap else near]
        costs = compute_step_costs(machine, q, posture)
        if not costs.admissible.any() or not stays_inside(q, posture):
            return None
        return posture, int(np.nanargmin(costs.energy)), costs

    def make(
        random: np.random.Generator,
        steps: int,
        start: np.ndarray | None = None,
        leap: float = 0.2,
    ) -> DiscretePath:
        while start is None:
            x, z = random.uniform(0.1, 0.95), random.uniform(-0.9, 0.9)
            if 0.3 < np.hypot(x, z) < 1.0:
                start = next(iter(machine.postures(x, z, random.uniform(-3, 3, 40))), None)
        postures, taken = [start], []
        heading = int(random.integers(8))
        for _ in range(100 * steps):
            found = next_step(random, postures[-1], heading, leap)
            if found is None or random.random() < 0.2:
                heading = int(random.integers(8))
            if found is not None:
                postures.append(found[0])
                taken.append(found[1:])
            if len(taken) == steps:
                break
        assert taken, "no step leads away from the start"
        return DiscretePath(
            tip=np.array([machine.tip_position(q) for q in postures]),
            posture=np.array(postures),
            modes=np.array([machine.patterns[p] for p, _ in taken]),
            duration=np.array([costs.duration[p] for p, costs in taken]),
            energy=np.array([costs.energy[p] for p, costs in taken]),
            energy_series=np.array([costs.energy_series[p] for p, costs in taken]),
            cost=0.0,
            start_modes=np.zeros(3, dtype=np.uint8),
            statistics=SearchStatistics(0, 0, 0.0),
        )

    return make


def tip_and_torque(m, q):
    """Tips [m], and torques [N m], of joints that slide forces [N], that hold arm and payload, in
    postures q[times, n]."""
    out = np.where(m.slides, q, 0.0)
    direction = np.cumsum(q - out, axis=1)
    across = (m.link_length + out) * np.cos(direction)
    up = (m.link_length + out) * np.sin(direction)
    end, center = np.cumsum(across, axis=1), (m.link_center + out) * np.cos(direction)
    joint = end - across
    torque = np.empty_like(q)
    for j in range(q.shape[1]):
        links = (joint + center - joint[:, [j]])[:, j:] @ m.link_mass[j:]
        torque[:, j] = m.gravity * (links + m.payload * (end[:, -1] - joint[:, j]))
        if m.slides[j]:
            carried = m.payload + m.link_mass[j:].sum()
            torque[:, j] = m.gravity * carried * np.sin(direction[:, j])
    return np.column_stack([end[:, -1], up.sum(axis=1)]), torque


@pytest.fixture(scope="session")
def worst(machine: Machine) -> Callable[..., dict[str, float]]:
    """Function (trajectory, schedule, machine=…) that measures a motion every millisecond.

    An oracle in plain NumPy. Entries are excesses, at most 0 where a limit holds: `joint` rad,
    `tip` m, `main_pump`, `servo_pump`, `valve` as shares of what these can give, `pressure` as
    share of the pressure that the mode gives, `modules`, `speed` as share of each piston's V_max
    where `v_max` asks for it.
    """

    def measure(
        trajectory, schedule, machine: Machine = machine, v_max: bool = False
    ) -> dict[str, float]:
        m, stamp = machine.arrays, trajectory.stamp_ns
        at = stamp + np.arange(0, trajectory.duration_ns + 1, 1_000_000)
        q, qd, _ = trajectory.sample_many(at)
        modes = schedule.modes_at_many(at)
        arms = [[moment_arm(row, each) for each in q[:, j]] for j, row in enumerate(m.linkage)]
        arms = np.column_stack(arms)
        tip, torque = tip_and_torque(machine.planar_arm.arrays, q[:, machine.slews :])
        if machine.slews:  # gravity asks nothing of it
            torque = np.column_stack([np.zeros(len(q)), torque])
        force, speed = torque / arms, arms * qd
        extends = speed > 0
        inlet = np.where(extends, m.cap_area, m.rod_area)
        outlet = np.where(extends, m.rod_area, m.cap_area)
        towards = np.where(extends, force, -force)
        flow = inlet * np.abs(speed)
        valve, fastest = valves_and_speeds(machine)
        drop = (speed / valve) ** 2 * (m.cap_area**3 + m.rod_area**3) / inlet
        load = (towards + outlet * m.tank_pressure) / inlet
        boosted = modes > 0
        against = towards > 0
        moving = np.abs(speed) > 2e-4
        supply = np.where(boosted, m.max_boost_pressure, m.supply_pressure)
        needed = np.where(against, load + drop + m.boost_margin, load + drop)
        supply = np.where(against, supply, m.supply_pressure)
        filling = valve * np.sqrt(m.supply_pressure)
        pumped = m.modules_per_mode[modes] * m.servo_pump_flow
        radius = np.hypot(*tip.T)
        outside = [m.min_x - tip[:, 0], m.min_radius - radius, radius - m.max_radius]
        lifted = (force + m.rod_area * m.tank_pressure) / m.cap_area
        drawn = (m.cap_area * m.tank_pressure - force) / m.rod_area
        held = np.where(force > 0, lifted, drawn)
        line = np.maximum(held, np.where(moving, load + drop, held)) + m.boost_margin
        line = np.where(boosted, np.clip(line, m.supply_pressure, m.max_boost_pressure), 0.0)
        rail = np.max(line, axis=1, where=modes == 2, initial=m.supply_pressure)
        line = np.where(modes == 2, rail[:, None], np.maximum(line, m.supply_pressure))
        rated = m.supply_pressure - m.tank_pressure
        leakage = m.leakage_flow * np.sqrt((line - m.tank_pressure) / rated).sum(axis=1)
        found = {"speed": float((np.abs(speed) / fastest).max() - 1)} if v_max else {}
        return found | {
            "joint": float(np.max(np.maximum(m.joint_min - q, q - m.joint_max))),
            "tip": float(np.max(outside)),
            "main_pump": float((flow.sum(axis=1) / (m.main_pump_flow - leakage)).max() - 1),
            "servo_pump": float(np.max(np.where(boosted, flow / np.maximum(pumped, 1e-9), 0)) - 1),
            "valve": float(np.max(np.where(against, 0, flow / filling)) - 1),
            "pressure": float(np.max(np.where(moving, needed / supply, 0)) - 1),
            "modules": float(m.modules_per_mode[modes].sum(axis=1).max() - m.module_count),
        }

    return measure
