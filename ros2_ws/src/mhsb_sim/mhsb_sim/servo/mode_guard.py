"""The guard as a simulator has it: its kernel, the modes that come of it, and what it tells."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.modes import modules_in_use, pattern_name
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import ModeArray
from mhsb_sim.bound_kernel import bind
from mhsb_sim.servo.controller import ServoSignals
from mhsb_sim.servo.guard import RELEASE_ABOVE, guard_of, watch
from mhsb_sim.servo.guarded_modes import guarded_modes
from mhsb_sim.servo.reference import Reference


@dataclass(frozen=True)
class Interventions:
    """What the guard has done since the start.

    boosts      times that the modes began to differ from the schedule's
    slowings    times that a plan began to be slowed
    slowed      for how long plans were slowed [s]
    """

    boosts: int
    slowings: int
    slowed: float

    @property
    def count(self) -> int:
        """Of both."""
        return self.boosts + self.slowings


class ModeGuard:
    """Watches a servo's signals in each step, see `servo/guard`.

    watch  one step; whether it now asks for other modes
    """

    def __init__(
        self, machine: Machine, signals: ServoSignals, reference: Reference, usual_error: float
    ) -> None:
        modules = machine.config.hydraulics.modules
        self._per_mode = modules.per_mode
        self._names = machine.actuator_names
        self._state = guard_of(machine, signals, reference, usual_error)
        self._boosts = 0
        self._told = ""
        self.watch = bind(watch, self._state)

    def forget(self) -> None:
        """Begin anew, asking for nothing: what was before says nothing of now."""
        self._state.overall["awake"] = 0.0
        self._state.actuators["wanted"] = 0
        self._state.actuators["lasting"] = 0.0
        self._state.overall["held"] = 0.0
        self._state.pace["rate"] = 1.0
        self._state.pace["change"] = 0.0

    def modes(self, scheduled: ModeArray, modules: int) -> ModeArray:
        """What is in force where these are scheduled and so many modules work, uint8[n]."""
        actuators, per_mode = self._state.actuators, self._per_mode
        asked = actuators["wanted"].astype(np.uint8)
        if not asked.any() and modules_in_use(scheduled, per_mode) <= modules:
            return scheduled
        reserve = actuators["unboosted"]
        return guarded_modes(scheduled, asked, reserve, RELEASE_ABOVE, modules, per_mode)

    def note(self, scheduled: ModeArray, prepared: ModeArray, in_force: ModeArray) -> None:
        """Keep in mind what the plan has now or prepares, and what is in force, to tell it."""
        self._state.scheduled[:] = prepared
        before, self._told = self._told, ""
        if np.array_equal(scheduled, in_force):
            return
        self._told = (
            f"the modes are {pattern_name(in_force)} where the plan has {pattern_name(scheduled)}, "
            "whose pressure does not suffice"
        )
        self._boosts += not before

    @property
    def interventions(self) -> Interventions:
        """What it has done so far."""
        overall = self._state.overall[0]
        return Interventions(self._boosts, int(overall["slowings"]), float(overall["slowed"]))

    @property
    def held(self) -> float:
        """For how long it has held the plan [s]; 0 while that goes on."""
        return float(self._state.overall["held"][0])

    @property
    def sentence(self) -> str:
        """What it is doing now and why, for a person; empty where it does nothing."""
        overall, pace = self._state.overall[0], self._state.pace[0]
        sentences = [self._told] if self._told else []
        if pace["rate"] < 1.0:
            lacking = int(np.argmin(self._state.actuators["share"]))
            why = f"the tip is {1e3 * overall['error']:.0f} mm off its reference"
            if self._state.actuators["share"][lacking] < 1.0:
                left = self._state.actuators["reserve"][lacking] / 1e6
                why = f"{self._names[lacking]} has {left:.2f} MPa in reserve"
            sentences.append(f"the plan runs at {pace['rate']:.2f} of its pace: {why}")
        if pace["delay"] > 0.0:
            late = pace["delay"] / SECOND_NS
            sentences.append(f"the arm is {late:.2f} s later than planned")
        return "; ".join(sentences)
