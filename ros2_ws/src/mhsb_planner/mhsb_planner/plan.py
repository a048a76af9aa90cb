"""A plan: a motion, its cost, and a record of how it was made."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np

from mhsb_model.feasibility.cavitation import Cavitation
from mhsb_model.goal import format_position
from mhsb_model.machine import Machine
from mhsb_model.modes import Mode
from mhsb_model.trajectory import SECOND_NS
from mhsb_planner.motion.energy import Energy
from mhsb_planner.motion.fitted_motion import FittedMotion
from mhsb_planner.motion.motion_table import (
    MODE_MEANINGS,
    format_mode_intervals,
    format_switches,
    iterate_rows,
    list_columns,
)
from mhsb_planner.plan_log import PlanLog
from mhsb_planner.planners.options import PlanOptions
from mhsb_planner.result_files import write_rows
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_step import EnergyReading

COST_ROUNDING = 1e-9
"""Largest relative difference of two costs that count as equal [-]."""

NOTICEABLE_EXCESS = 0.005
"""Least excess of a piston's speed over V_max that a summary states, as a share of V_max [-]."""


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """A motion, its cost, and a record of how it was made.

    `print(plan)` shows a summary.

    Attributes:
        path: Discrete path (S2) that the motion follows. It has no steps if the motion only brakes
            or is the remaining part of a plan.
        motion: Trajectory (S3) and mode schedule (S4), both with stamp 0.
        energy: Energy of the motion in both energy readings.
        machine: Machine for which the plan was made.
        energy_reading: Energy reading in which the plan was made, `paper` or `series`.
        seconds: Planning times [s] by stage: `search`, `fit`, `energy`, and `comparison` for paths
            of other planners. `first_motion` is the time from the request to the first motion.
        area_shortfall: Manipulability loss of the motion (`manipulability_loss`) [m]. It is 0 if
            its weight is 0.
        lower_bound: Lower bound on the energy of every plan from the start to the goal or its
            region [J]. It holds for any planner and any posture at the end. It is 0 if the motion
            only brakes.
        cavitations: Actuators whose load drives them faster than oil fills the inlet, with the
            times.
        start_problems: Clause on joints beyond their limits, and on an obstacle that the arm
            touches at the start; empty if there is no such problem.
        log: Log of the proposed paths and of their outcomes (`plan_log`). `print(plan.log)` shows
            it.
    """

    path: DiscretePath
    motion: FittedMotion
    energy: Energy
    machine: Machine
    energy_reading: EnergyReading = "paper"
    seconds: MappingProxyType[str, float] = field(default_factory=lambda: MappingProxyType({}))
    area_shortfall: float = 0.0
    lower_bound: float = 0.0
    cavitations: tuple[Cavitation, ...] = ()
    start_problems: str = ""
    log: PlanLog = field(default_factory=PlanLog)

    def __repr__(self) -> str:
        """Return one line with duration, energy and number of mode switches."""
        return (
            f"<Plan: {self.duration:.2f} s, {self.energy.paper:.1f} J, "
            f"{format_switches(self.motion.schedule.switch_count)}>"
        )

    def __str__(self) -> str:
        """Return a summary of several lines.

        It states the tip's positions at start and end, duration, energy, modes of each actuator
        over time, warnings and planning time. The lower bound is stated if it is above 0, the speed
        excess if it is above NOTICEABLE_EXCESS.
        """
        motion, names = self.motion, self.machine.actuator_names
        ends = self.machine.tip_in_base(motion.trajectory.position[[0, -1]])
        begin, end = (format_position(tip, ".3f") for tip in ends.tolist())
        used = [mode for mode in Mode if (motion.schedule.modes == mode).any()]
        bound = (
            f"          {100 * self.gap:.0f} % above the lower bound of {self.lower_bound:.1f} J, "
            "which leaves out payload, boost and zones"
        )
        excess = f"speed:    pistons exceed V_max by up to {100 * motion.speed_excess:.0f} %"
        return "\n".join([
            f"motion:   from {begin} to {end} in {self.duration:.2f} s",
            f"energy:   {self.energy_text}",
            *([bound] if self.lower_bound > 0.0 else []),
            f"modes:    {'; '.join(f'{mode.name}: {MODE_MEANINGS[mode]}' for mode in used)}",
            *(
                f"          {name}: {format_mode_intervals(motion.schedule, self.duration, j)}"
                for j, name in enumerate(names)
            ),
            *([excess] if motion.speed_excess > NOTICEABLE_EXCESS else []),
            *(f"warning:  {warning}" for warning in self.warnings),
            f"planning: {1e3 * self.planning_time:.0f} ms",
        ])  # fmt: skip

    def to_csv(self, file: str | Path) -> Path:
        """Write the motion over time as a CSV file, with a line for each point of the trajectory.

        The columns are: time [s]; position [rad or m], velocity [rad/s or m/s] and acceleration
        [rad/s² or m/s²] of each joint; mode of each actuator (N, DB or SB); planned pressure in the
        supply line of each actuator [Pa]; position of the tip in `base_link` [m].

        Args:
            file: The file. It is written completely or not at all. Missing folders are created.

        Returns:
            Path of the file.
        """
        rows = iterate_rows(self.machine, self.motion.trajectory, self.motion.schedule)
        return write_rows(Path(file), list_columns(self.machine), rows)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings, one sentence each: problems of the start, overloads and cavitation."""
        start = (self.start_problems,) if self.start_problems else ()
        return (*start, *map(str, (*self.motion.overloads, *self.cavitations)))

    @property
    def energy_text(self) -> str:
        """Text with the energy of the motion [J], in both energy readings if they differ."""
        paper, series = f"{self.energy.paper:.1f} J", f"{self.energy.series:.1f} J"
        both = f"{paper} by the paper's formula, {series} with the pumps in series"
        return paper if paper == series else both

    @property
    def gap(self) -> float:
        """Relative excess of the motion's energy E over the lower bound: E / bound − 1 [-].

        E is the energy in the reading in which the plan was made. The value is 0 if the bound is 0.
        """
        energy = self.energy.paper if self.energy_reading == "paper" else self.energy.series
        return energy / self.lower_bound - 1.0 if self.lower_bound > 0.0 else 0.0

    @property
    def planning_time(self) -> float:
        """Sum of the stages' times in `seconds`, without `first_motion` [s]."""
        return sum(value for name, value in self.seconds.items() if name != "first_motion")

    @property
    def duration(self) -> float:
        """Duration of the motion [s]."""
        return self.motion.trajectory.duration_ns / SECOND_NS

    @property
    def joint_travel(self) -> float:
        """Sum of the absolute changes of all joint positions along the trajectory [rad and m]."""
        return float(np.abs(np.diff(self.motion.trajectory.position, axis=0)).sum())

    def chosen_energy(self, options: PlanOptions) -> float:
        """Return the energy of the motion in the energy reading of given options.

        Args:
            options: Options. Only `energy_reading` is read.

        Returns:
            Energy [J].
        """
        return self.energy.paper if options.energy_reading == "paper" else self.energy.series

    def cost(self, options: PlanOptions) -> float:
        """Compute the cost of the motion, w₁ E + w₂ T + w₃ S + w₄ M.

        E is the energy in the reading that the options choose [J], T the duration [s], and S the
        number of mode switches. M is the manipulability loss [m]: the lost share of the velocity
        polytope's area, integrated along the tip's path (`search.manipulability_loss`).

        Args:
            options: Options that give the weights w₁ to w₄ and the energy reading.

        Returns:
            The cost [-].
        """
        weights = options.weights
        cost = weights.energy * self.chosen_energy(options) + weights.time * self.duration
        cost += weights.switches * self.motion.scheduled.switch_count
        return cost + options.area_weight * self.area_shortfall

    def is_cheaper_than(self, other: Plan, options: PlanOptions) -> bool:
        """Return whether this plan costs less than another plan.

        Costs with a relative difference of at most COST_ROUNDING count as equal. If the costs are
        equal, energy, duration and joint travel decide, in this order and with the same rounding.

        Args:
            other: The other plan.
            options: Options that give weights and energy reading.

        Returns:
            True if this plan has the smaller value of the first measure that differs. False if no
            measure differs.
        """
        for measure in (
            lambda each: each.cost(options),
            lambda each: each.chosen_energy(options),
            lambda each: each.duration,
            lambda each: each.joint_travel,
        ):
            new, known = measure(self), measure(other)
            if abs(new - known) > COST_ROUNDING * known:
                return bool(new < known)
        return False
