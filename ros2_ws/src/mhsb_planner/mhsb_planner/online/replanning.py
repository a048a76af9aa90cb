"""Planning while the arm moves: from the command in force to the command that takes over.

A command is a joint trajectory with its mode schedule. A new command first repeats the old command
for the time of its commit horizon. At its change it leaves the old command, with equal position,
velocity and acceleration. The time of plans is the arm's clock minus the delay that speed scaling
has caused.
"""

import contextlib
import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from mhsb_model.braking import brake_along, extract_remainder
from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import Position
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.motion.s3_trajectory import fit_braking
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.online.command_joining import choose_hand_over_times, join_commands
from mhsb_planner.online.commit_horizon import OFFLINE_LEAD
from mhsb_planner.planner import PLANNER_KINDS, Plan, Planner, PlanOptions, warm_up
from mhsb_planner.posture.s1_posture_table import PostureTable


@dataclass(frozen=True, eq=False)
class Replan:
    """Command that takes over from an old command, with the plan from which it was made.

    Attributes:
        command: New command, to be sent to the arm.
        previous_command: Old command, which the new command replaces.
        plan: Plan from which the new command was made.
        change_ns: Absolute time at which the new command deviates from the old command [ns].
        improvement_time: Time spent on improving the plan after its first feasible motion was found
            [s].
        via: Via points in `base_link` that the tip passes after the change [m].
    """

    command: Command
    previous_command: Command
    plan: Plan
    change_ns: int
    improvement_time: float = 0.0
    via: tuple[Position, ...] = ()

    @property
    def starts_from_rest(self) -> bool:
        """True if the old command has ended at the stamp of the new command.

        The new command may then also begin later.
        """
        return self.previous_command.trajectory.end_ns <= self.command.stamp_ns

    def with_stamp(self, now_ns: int, commit_horizon: float) -> "Replan | None":
        """Return a copy of this plan from rest whose command begins at another time.

        Args:
            now_ns: Earliest new stamp, by the clock of the old command's stamp [ns]. The new stamp
                may be a few milliseconds later.
            commit_horizon: Time from the stamp until the plan deviates from the old command [s].

        Returns:
            The copy, with new `command` and `change_ns`. None if the old command still moves at
            `now_ns`, because the arm's clock was set back.
        """
        if self.previous_command.trajectory.end_ns > now_ns:
            return None
        times = choose_hand_over_times(
            self.previous_command, now_ns, round(commit_horizon * SECOND_NS)
        )
        command = join_commands(self.previous_command, times, _create_command(self.plan))
        return replace(self, command=command, change_ns=times.change_ns)


class Replanner:
    """Planner of commands that continue other commands."""

    def __init__(self, machine: Machine, table: PostureTable) -> None:
        """Create the planner for a machine, with the posture table of the arm's plane."""
        self._planner = Planner(machine, table)

    def warm_up(self, kinds: Iterable[str] = PLANNER_KINDS) -> Command:
        """Compile and run all code that a plan needs, by planning an example.

        Args:
            kinds: Names of the planners to prepare, such as `table`.

        Returns:
            Command of the example plan, or a command that holds the position if no planner found a
            plan.
        """
        warm_up(self._planner, kinds)
        return self._run_example(kinds)

    def change_machine(self, machine: Machine) -> None:
        """Replace the machine for which plans are made.

        Args:
            machine: The same arm with another payload, supply pressure, V_max, number of booster
                modules or other zones.
        """
        self._planner.change_machine(machine)

    def replan(
        self,
        in_force: Command,
        now_ns: int,
        goal: Position,
        commit_horizon: float,
        options: PlanOptions,
        deadline: Deadline = NO_DEADLINE,
    ) -> Replan | None:
        """Plan from the command in force to a goal.

        The new command begins at its own stamp and repeats `in_force` for the time of the commit
        horizon. From its change on, it deviates from `in_force`.

        Args:
            in_force: Command that the new command continues.
            now_ns: Earliest stamp of the new command, by the clock that stamps `in_force` [ns]. The
                new stamp may be a few milliseconds later.
            goal: Goal of the tip in `base_link`, (x, z) or (x, y, z) [m].
            commit_horizon: Commit horizon (time from the new stamp to the change) [s].
            options: Options of the plan.
            deadline: Instant by which the plan is needed.

        Returns:
            The plan with its command. None if, at the change, the arm rests at the goal with the
            end link at the angle that the options ask for.

        Raises:
            MhsbError: No plan could be made; `Planner.plan` lists the errors.
        """
        machine = self._planner.machine
        times = choose_hand_over_times(in_force, now_ns, round(commit_horizon * SECOND_NS))
        start = in_force.trajectory.sample(times.change_ns)
        moving = bool(start.velocity.any() or start.acceleration.any())
        if not moving and options.is_goal_reached(machine, goal, start.position):
            return None
        plan = self._planner.plan(
            goal,
            start,
            modes=StartModes.read_from(in_force.schedule, times.change_ns),
            brake=brake_along(machine, in_force.trajectory, times.change_ns) if moving else None,
            options=options,
            deadline=deadline,
            remainder=extract_remainder(in_force.trajectory, times.change_ns) if moving else None,
        )
        command = join_commands(in_force, times, _create_command(plan))
        return Replan(command, in_force, plan, times.change_ns, via=options.via)

    def make_braking_command(
        self, in_force: Command, now_ns: int, commit_horizon: float
    ) -> tuple[Command, int]:
        """Make a command that brings the arm to rest along the path of the command in force.

        The braking is that of `mhsb_model.braking.brake_along`. If the motion in force ends before
        the arm could brake, the result follows it to its end. In the last moments of that motion,
        each joint brakes on its own instead. At rest, a standstill is added if the actuators need
        time to switch to the modes that hold the arm. Limits are not checked.

        Args:
            in_force: Command that is braked.
            now_ns: Earliest stamp of the result, by the clock that stamps `in_force` [ns]. The
                stamp may be a few milliseconds later.
            commit_horizon: Time from the stamp to the beginning of braking [s]. The result repeats
                `in_force` during this time.

        Returns:
            The command, and the time at which it begins to brake, by the same clock [ns].

        Raises:
            ValueError: The commit horizon is shorter than `MIN_POINT_SPACING_NS`.
        """
        machine = self._planner.machine
        times = choose_hand_over_times(in_force, now_ns, round(commit_horizon * SECOND_NS))
        modes = StartModes.read_from(in_force.schedule, times.change_ns)
        brake = brake_along(machine, in_force.trajectory, times.change_ns)
        motion = fit_braking(machine, brake, modes)
        new = Command(motion.trajectory, motion.schedule)
        return join_commands(in_force, times, new), times.change_ns

    def _run_example(self, kinds: Iterable[str]) -> Command:
        """Plan a move to a neighbouring workspace node, and plan it again while the arm moves.

        This compiles all code, since the first call of each function takes long. Each planner plans
        twice, with the stamps 1 s and 1.5 s. Each plan starts from the command of the last plan
        that succeeded. Errors of planning are ignored.

        Args:
            kinds: Names of the planners to run, one after the other.

        Returns:
            Command of the last plan that succeeded. If no plan succeeded, a command that holds the
            position.
        """
        graph = self._planner.graph
        patterns = len(graph.table.patterns)
        edges = graph.edges
        leaving = int(np.argmax(edges.last - edges.first))
        node = int(edges.state[edges.first[leaving]]) // patterns
        machine, start = self._planner.machine, graph.layout.posture[leaving]
        place, slew = graph.table.nodes[node] * graph.table.spacing, 0.0
        if machine.slews:
            slew = machine.config.simulation.start_posture[0]
            start = np.append(slew, start)
        goal = tuple(machine.convert_to_base(place, slew).tolist())
        modes = np.full(len(start), Mode.N, dtype=np.uint8)
        command = Command.hold(0, start, modes)
        for kind, now_ns in itertools.product(
            [PlanOptions(planner=kind) for kind in kinds],
            (SECOND_NS, SECOND_NS + SECOND_NS // 2),
        ):
            with contextlib.suppress(MhsbError):
                replan = self.replan(command, now_ns, goal, OFFLINE_LEAD, kind)
                command = replan.command if replan is not None else command
        return command


def _create_command(plan: Plan) -> Command:
    """Return the trajectory and mode schedule of a plan as a command."""
    return Command(plan.motion.trajectory, plan.motion.schedule)
