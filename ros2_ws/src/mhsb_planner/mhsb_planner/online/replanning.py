"""Planning online: from the command in force to the command that takes over.

A new command repeats the old one until its lead is over, and leaves it there with its position,
velocity and acceleration. A motion that has to be left is first braked along its path.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from mhsb_model.braking import brake_along, rest_of
from mhsb_model.command import Command
from mhsb_model.errors import MhsbError
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_model.types import Position
from mhsb_planner.deadline import NEVER, Deadline
from mhsb_planner.motion.s3_trajectory import fit_braking
from mhsb_planner.motion.s4_mode_schedule import StartModes
from mhsb_planner.online.hand_over import ChangeOver, change_over, hand_over
from mhsb_planner.online.lead import OFFLINE_LEAD
from mhsb_planner.planner import PLANNER_KINDS, Plan, Planner, PlanOptions, warm_up
from mhsb_planner.posture.s1_posture_table import PostureTable


@dataclass(frozen=True, eq=False)
class Replan:
    """A command that takes over from another one.

    command    what to publish
    departure  the other one
    plan       where it comes from
    change_ns  absolute time at which it leaves the old command
    from_rest  whether the old command stands still: the new one may as well begin later
    improving  time spent on more than its first feasible motion [s]
    via        points on the way that it still has to pass, from the change on
    """

    command: Command
    departure: Command
    plan: Plan
    change_ns: int
    from_rest: bool = False
    improving: float = 0.0
    via: tuple[Position, ...] = ()

    def may_begin(self, now_ns: int) -> bool:
        """Whether the plan may as well begin now: the old command stands still by then."""
        return self.from_rest and self.departure.trajectory.end_ns <= now_ns

    def stamped(self, now_ns: int, lead: float) -> Replan:
        """The same plan, begun `lead` s after now; only where it may begin then."""
        if not self.may_begin(now_ns):
            raise ValueError("a plan that leaves a moving command cannot begin at another time")
        times = change_over(self.departure, now_ns, round(lead * SECOND_NS))
        command = hand_over(self.departure, times, _new_part(self.plan))
        return replace(self, command=command, change_ns=times.change_ns)


class Replanner:
    """Makes commands that continue other commands.

    lead [s] is the time from a command's stamp to where it leaves the one before.
    """

    def __init__(self, machine: Machine, table: PostureTable) -> None:
        self._planner = Planner(machine, table)

    def warm_up(self, kinds: Iterable[str] = PLANNER_KINDS) -> Command:
        """Compile and run everything that a plan runs through; an example of what comes out.

        kinds  planners that plans will be asked of
        """
        warm_up(self._planner, kinds)
        return self._rehearse(kinds)

    def change(self, machine: Machine) -> None:
        """Plan for another payload, supply pressure or V_max from now on."""
        self._planner.change(machine)

    def replan(
        self,
        in_force: Command,
        now_ns: int,
        goal: Position,
        lead: float,
        options: PlanOptions,
        deadline: Deadline = NEVER,
    ) -> Replan | None:
        """Command to the goal in `base_link` [m], or None where the arm is at rest there already.

        Raises what `Planner.plan` raises.
        """
        times = change_over(in_force, now_ns, round(lead * SECOND_NS))
        start = in_force.trajectory.sample(times.change_ns)
        moving = bool(start.velocity.any() or start.acceleration.any())
        if not moving and options.is_met(self._planner.machine, goal, start.position):
            return None
        plan = self._planner.plan(
            goal,
            start,
            StartModes.during(in_force.schedule, times.change_ns),
            self._brake(in_force, times) if moving else None,
            options,
            deadline,
            rest_of(in_force.trajectory, times.change_ns) if moving else None,
        )
        command = hand_over(in_force, times, _new_part(plan))
        from_rest = in_force.trajectory.end_ns <= times.stamp_ns
        return Replan(
            command, in_force, plan, times.change_ns, from_rest, via=options.via
        )

    def stop(self, in_force: Command, now_ns: int, lead: float) -> tuple[Command, int]:
        """Command that brakes along the path of the one in force and holds, and its change [ns]."""
        times = change_over(in_force, now_ns, round(lead * SECOND_NS))
        modes = StartModes.during(in_force.schedule, times.change_ns)
        motion = fit_braking(self._planner.machine, self._brake(in_force, times), modes)
        new = Command(motion.trajectory, motion.schedule)
        return hand_over(in_force, times, new), times.change_ns

    def _brake(self, in_force: Command, times: ChangeOver) -> Trajectory:
        return brake_along(self._planner.machine, in_force.trajectory, times.change_ns)

    def _rehearse(self, kinds: Iterable[str]) -> Command:
        """A move between two neighbours on the grid, changed on its way: first calls are slow."""
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
        goal = tuple(machine.in_base(place, slew).tolist())
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


def _new_part(plan: Plan) -> Command:
    return Command(plan.motion.trajectory, plan.motion.schedule)
