"""Benchmark of a mobile machine on curves that were recorded at a real one.

    python benchmarks/recorded_curves.py run FOLDER out/curves.json
    python benchmarks/recorded_curves.py report out/curves.json

FOLDER has CSV files with the columns `t_s`, `wanted_x_m`, `wanted_y_m`, `wanted_z_m` and the same
for `measured`. A slewing machine made the curves; here the arm moves in its plane, to hypot(x, y)
and z. Planner, hand-over and servo are the nodes' own code, in lock-step; simulated time passes as
long as planning takes. The servo first learns its valves on moves between the demo's goals.

    streamed   the wanted tip is sent as a goal ten times a second: distance of the tip from it at
               the same instant
    via        the curve is planned at once, through corners of it: distance of the tip from the
               curve
    recorded   distance of the recorded machine's tip from its wanted position at the same instant

Curves in the file are not run again.
"""

from __future__ import annotations

import csv
import itertools
import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from benchmarks.lock_step import LockStepWorld, SimulatedArm
from tqdm import tqdm

from mhsb_control import load_machine
from mhsb_model.arm_reports import HandOverReason
from mhsb_model.circuit.dead_time import compute_dead_time
from mhsb_model.command import Command
from mhsb_model.files.config_files import find_config_file, find_machine_config_file
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_model.types import FloatArray, Position
from mhsb_model.verdict import GoalVerdict, Verdict
from mhsb_planner.online.arm_state import NO_PLAN
from mhsb_planner.online.commit_horizon import OFFLINE_LEAD
from mhsb_planner.online.replanning import Replanner
from mhsb_planner.online.settings import Settings
from mhsb_planner.planner import PlanOptions
from mhsb_planner.posture.posture_table_cache import load_or_build_table
from mhsb_planner.result_files import write_json
from mhsb_sim.simulation.simulator import Simulator
from mhsb_tools.commands.demo_command import read_goals

Positional = Annotated[Path, tyro.conf.Positional]
MACHINE = "excavator_1to14"
LEARNING = 60.0
"""Time before errors count [s]."""
RATE = 10.0
"""Goals per second [Hz]."""
STEP = 0.01
"""Time step of the world [s]."""
LONGEST_MOVE = 60.0
"""Time within which a move between goals must end [s]."""
REST = 5.0
"""Time after the end of a stream before the arm goes back [s]."""
CORNER_TOLERANCE = 0.003
"""Largest distance of a curve from the straight lines between its corners [m]."""
ANSWERED = (Verdict.OK, Verdict.AT_GOAL, Verdict.SUPERSEDED)
"""Verdicts on goals that count as answered."""
MILLI = 1e3


@dataclass(frozen=True)
class Curve:
    """Wanted positions of the tip over time.

    Attributes:
        time: Times from 0, float64[k], [s].
        tip: Wanted positions (x, z), float64[k, 2], [m].
        recorded: Distance of the recorded machine's tip from the wanted position, float64[k], [m].
    """

    time: FloatArray
    tip: FloatArray
    recorded: FloatArray

    def tip_at(self, time: float) -> FloatArray:
        """Return the wanted position (x, z) [m] at a time since the start [s]."""
        return np.array([np.interp(time, self.time, column) for column in self.tip.T])

    def corners(self) -> FloatArray:
        """Return positions between which straight lines follow the curve within CORNER_TOLERANCE.

        This is the method of Ramer, Douglas and Peucker.
        """
        kept, open_parts = {0, len(self.tip) - 1}, [(0, len(self.tip) - 1)]
        while open_parts:
            first, last = open_parts.pop()
            between = self.tip[first + 1 : last]
            if len(between) == 0:
                continue
            off = distances_from_line(between, self.tip[first], self.tip[last])
            farthest = first + 1 + int(np.argmax(off))
            if off.max() > CORNER_TOLERANCE:
                kept.add(farthest)
                open_parts += [(first, farthest), (farthest, last)]
        return self.tip[sorted(kept)]

    def distance_of(self, place: FloatArray) -> float:
        """Return the distance of a position (x, z) from the curve [m]."""
        pairs = zip(self.tip[:-1], self.tip[1:], strict=True)
        return min(float(distances_from_line(place[None], *ends)[0]) for ends in pairs)


def distances_from_line(places: FloatArray, begin: FloatArray, end: FloatArray) -> FloatArray:
    """Return the distances of places, float64[k, 2], from a straight line between two ends [m]."""
    way = end - begin
    share = np.clip((places - begin) @ way / max(float(way @ way), 1e-18), 0.0, 1.0)
    return np.asarray(np.linalg.norm(places - begin - share[:, None] * way, axis=1))


def read_curve(file: Path) -> Curve:
    """Read a recorded curve and turn it into the plane of an arm that does not slew."""
    with file.open(newline="", encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    time = np.array([float(row["t_s"]) for row in rows])
    wanted, measured = (
        np.array([[float(row[f"{what}_{axis}_m"]) for axis in "xyz"] for row in rows])
        for what in ("wanted", "measured")
    )
    tip = np.column_stack([np.hypot(wanted[:, 0], wanted[:, 1]), wanted[:, 2]])
    return Curve(time - time[0], tip, np.linalg.norm(measured - wanted, axis=1))


@dataclass
class ServoArm(SimulatedArm):
    """Arm of the lock-step world that a simulator with its servo moves."""

    simulator: Simulator = field(kw_only=True)

    @classmethod
    def at_rest(cls, machine: Machine) -> ServoArm:
        """Return an arm at rest in its start posture, with a servo that has learnt nothing yet."""
        simulator = Simulator(machine, start_ns=SECOND_NS)
        position = simulator.reference.position
        hold = Command.hold(simulator.time_ns, position, simulator.modes)
        return cls(machine, hold, time_ns=simulator.time_ns, simulator=simulator)

    @property
    def clock_ns(self) -> int:
        """Time of the arm's clock [ns]."""
        return self.simulator.time_ns

    @property
    def reference(self) -> MotionState:
        """Present reference of the servo."""
        return self.simulator.reference

    @property
    def joint_state(self) -> MotionState:
        """Position and velocity of the simulated joints."""
        return self.simulator.joint_state

    @property
    def tip(self) -> FloatArray:
        """True position of the tip (x, z) [m]."""
        return self.machine.tip_in_base(self.joint_state.position)

    def pass_time(self, seconds: float) -> None:
        """Simulate for some time [s], and read clock and plan in force."""
        self.simulator.advance(seconds)
        self.simulator.catch_up()
        self.time_ns, self.delay_ns = self.simulator.plan_time_ns, self.simulator.plan_delay_ns
        self.in_force_ns = self.simulator.plan_stamp_ns or NO_PLAN

    def accept(self, command: Command) -> HandOverReason:
        """Take a command if it continues the reference, and let the servo follow it."""
        reason = super().accept(command)
        if reason is HandOverReason.NONE:
            self.simulator.set_plan(command.trajectory, command.schedule)
        return reason


def make_world(machine: Machine, replanner: Replanner) -> tuple[LockStepWorld, ServoArm]:
    """Make a world and its arm, which has moved between the demo's goals for LEARNING and rests."""
    arm = ServoArm.at_rest(machine)
    world = LockStepWorld(machine, replanner, Settings(machine, PlanOptions()), step=STEP, arm=arm)
    world.planning_time = None
    began, goals = world.now, find_machine_config_file("demo_goals.yaml", machine.name)
    for goal in itertools.cycle(read_goals(goals)):
        if world.now - began > LEARNING:
            break
        go_to(world, goal.position)
    return world, arm


def go_to(world: LockStepWorld, place: Position) -> None:
    """Send a goal and let the arm come to rest there.

    Raises:
        TimeoutError: The arm does not come to rest within LONGEST_MOVE.
    """
    stamp = world.send_goal(*place)
    if world.verdict(stamp).code is Verdict.OK:
        world.pass_time_until(lambda: bool(world.execution_reports(stamp)), LONGEST_MOVE)


def stream(world: LockStepWorld, arm: ServoArm, curve: Curve) -> list[float]:
    """Go to the beginning of a curve and stream it.

    Returns:
        Distance of the tip from the wanted position at the same instant, for each time step [m].
    """
    go_to(world, tuple(curve.tip[0].tolist()))
    began, sent, errors = world.now, 0, []
    while (passed := world.now - began) < curve.time[-1]:
        if passed * RATE >= sent:
            world.send_goal(*curve.tip_at(passed).tolist())
            sent += 1
        world.pass_time(STEP)
        errors.append(math.dist(arm.tip, curve.tip_at(world.now - began)))
    return errors


def follow_corners(world: LockStepWorld, arm: ServoArm, curve: Curve) -> list[float]:
    """Follow a curve that is planned at once, after it has been streamed.

    Returns:
        Distance of the tip from the curve for each time step of the motion [m].
    """
    world.pass_time(REST)
    go_to(world, tuple(curve.tip[0].tolist()))
    _, *corners, last = map(tuple, curve.corners().tolist())
    options = PlanOptions(via=tuple(corners), via_tolerance=CORNER_TOLERANCE)
    horizon = OFFLINE_LEAD + compute_dead_time(world.machine)
    made = world.replanner.replan(arm.command, arm.time_ns, last, horizon, options)
    assert made is not None
    command, errors = made.command, []
    world.send(command)
    world.pass_time_until(lambda: arm.in_force_ns == command.stamp_ns)
    while arm.in_force_ns == command.stamp_ns:
        world.pass_time(STEP)
        errors.append(curve.distance_of(arm.tip))
    return errors


def run(folder: Positional, file: Positional) -> None:
    """Follow every curve of a folder, unless a file has the result.

    Args:
        folder: Folder of CSV files.
        file: JSON file, read and extended.
    """
    machine = load_machine(find_config_file(f"{MACHINE}.yaml"))
    replanner = Replanner(machine, load_or_build_table(machine))
    replanner.warm_up()  # simulated time would pass while kernels are compiled
    found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    for recorded in tqdm(sorted(folder.glob("*.csv")), unit="curve"):
        if recorded.stem in found:
            continue
        curve, (world, arm) = read_curve(recorded), make_world(machine, replanner)
        errors = {
            "streamed": stream(world, arm, curve),
            "via": follow_corners(world, arm, curve),
            "recorded": curve.recorded.tolist(),
        }
        verdicts = [each for each in world.reports if isinstance(each, GoalVerdict)]
        found[recorded.stem] = {way: summarise(each) for way, each in errors.items()}
        found[recorded.stem]["refused"] = sum(each.code not in ANSWERED for each in verdicts)
        write_json(file, found)


def summarise(errors: list[float]) -> dict[str, float]:
    """Return the root mean square and the largest of errors in mm."""
    values = MILLI * np.array(errors)
    return {"rms": float(np.sqrt(np.mean(values**2))), "max": float(values.max())}


def report(file: Positional) -> None:
    """Print median, 95 % quantile and largest RMS error of each way, and the refused goals."""
    found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    for way in ("streamed", "via", "recorded"):
        median, high, largest = np.quantile(
            [row[way]["rms"] for row in found.values()], (0.5, 0.95, 1.0)
        )
        print(f"{way:9s} RMS median {median:4.1f}, p95 {high:4.1f}, largest {largest:4.1f} mm")
    refused = sum(row["refused"] for row in found.values())
    print(f"{len(found)} curves, {refused} goals refused")


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({"run": run, "report": report})
