"""How the simulator is, in one sentence: its fault, or all that it warns of, or that it runs."""

from __future__ import annotations

import time
from typing import Any

from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Level
from mhsb_sim.ros.pacing import Pacer
from mhsb_sim.simulation.supervised_arm import SupervisedArm

LARGEST_OFFSET_NS = SECOND_NS // 2
"""Between the system's time and simulated time where that is meant to be the same."""


CLOSED = "running; the valves are closed until the next plan"


class Health:
    """Fault and warnings of an arm, its pace, its clock and its place on the ROS graph.

    duplicates  what is there twice, see `mhsb_msgs_py.duplicates`
    """

    def __init__(self, arm: SupervisedArm, pacer: Pacer, own_clock: bool) -> None:
        self._arm = arm
        self._pacer = pacer
        self._own_clock = own_clock
        self.duplicates = ""
        self._told: tuple[object, ...] | None = None

    @property
    def level(self) -> Level:
        """ERROR where the arm is stopped and takes no plans, WARN where something is to be told."""
        if self._arm.fault:
            return Level.ERROR
        return Level.WARN if any(self._warnings()) else Level.OK

    @property
    def sentence(self) -> str:
        """All of it for a person."""
        well = CLOSED if self._arm.simulator.valves_closed else "running"
        return self._arm.fault or "; ".join(filter(None, self._warnings())) or well

    def changed(self) -> bool:
        """Whether it is in another way than at the last call, or was stopped; numbers aside."""
        before, self._told = self._told, self._kind()
        return before not in (None, self._told)

    def log(self, logger: Any) -> None:
        """Say it in a log, each level at a place of its own, which rclpy asks for."""
        if self.level is Level.ERROR:
            logger.error(self.sentence)
        elif self.level is Level.WARN:
            logger.warning(self.sentence)
        else:
            logger.info(self.sentence)

    def _kind(self) -> tuple[object, ...]:
        arm = self._arm
        phase = arm.supervision.phase
        closed = arm.simulator.valves_closed
        *warnings, duplicates = self._warnings()  # the graph shows one after the other
        lost = arm.simulator.lost_modules
        return arm.halted, phase, arm.last_stop_ns, closed, lost, *map(bool, warnings), duplicates

    def _warnings(self) -> tuple[str, str, str, str, str]:
        arm = self._arm
        return arm.warning, arm.intervention, self._lag(), self._offset(), self.duplicates

    def _lag(self) -> str:
        if not self._pacer.lags:
            return ""
        return (
            f"the simulation is {self._pacer.lag_ns / SECOND_NS:.2f} s behind its pace: this "
            "machine was too busy for it, or it was frozen"
        )

    def _offset(self) -> str:
        offset_ns = 0 if self._own_clock else time.time_ns() - self._arm.simulator.time_ns
        if abs(offset_ns) <= LARGEST_OFFSET_NS:
            return ""
        side = "behind" if offset_ns > 0 else "ahead of"
        return (
            f"simulated time is {abs(offset_ns) / SECOND_NS:.1f} s {side} the system's clock; go "
            "by the stamps of `reference`, or call ~/reset"
        )
