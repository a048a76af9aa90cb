"""The mode guard of a servo: runs the reference governor, selects modes in force, and reports."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mhsb_control.controller import ServoSignals
from mhsb_control.governor.guarded_modes import combine_modes
from mhsb_control.governor.reference_governor import (
    GovernorSettings,
    build_governor_state,
    run_governor_step,
)
from mhsb_control.reference import ReferencePreview
from mhsb_model.kernels.bound_kernel import bind_kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import count_modules, format_pattern
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import ModeArray


@dataclass(frozen=True)
class Interventions:
    """Counts of what the mode guard has done since the start.

    Attributes:
        boosts: Number of times that the modes in force began to differ from the plan's modes.
        slowings: Number of times that the rate of the plan began to fall below full speed.
        slowed: Total time for which plans were slowed [s].
    """

    boosts: int
    slowings: int
    slowed: float

    @property
    def count(self) -> int:
        """Total number of boosts and slowings."""
        return self.boosts + self.slowings


class ModeGuard:
    """Guard that boosts actuators and slows the plan if pressures or the tip's error require it.

    The module `reference_governor` describes the conditions.

    Attributes:
        settings: Tuned numbers of every new guard.
        watch: Function that runs one step of the governor and returns whether the requested modes
            have changed.
    """

    settings: ClassVar[GovernorSettings] = GovernorSettings()

    def __init__(
        self,
        machine: Machine,
        signals: ServoSignals,
        reference: ReferencePreview,
        usual_error: float,
    ) -> None:
        """Build the state of the reference governor, and bind its kernel to the signals of a servo.

        Args:
            machine: The machine as declared in its file (the real one may differ).
            signals: Signals of the servo controller, which the guard reads in each step.
            reference: The reference, which the guard slows.
            usual_error: Distance of the tip from its reference that is normal for an arm of the
                paper's size [m]. The guard scales the distance with the size of the machine.
        """
        modules = machine.config.hydraulics.modules
        self._per_mode = modules.per_mode
        self._names = machine.actuator_names
        self._state = build_governor_state(machine, signals, reference, usual_error, self.settings)
        self._boosts = 0
        self._deviation_text = ""
        self.watch = bind_kernel(run_governor_step, self._state)

    def reset(self) -> None:
        """Restart the filters of measurements, end boost and holds, and set the plan to full speed.

        The filters of the supply pressure's rate, of the reserve in boost and of the valve opening
        go on. The counts of interventions and the delay of the reference behind the plan are kept.
        """
        self._state.totals["is_initialized"] = 0.0
        self._state.actuators["requested_mode"] = 0
        self._state.actuators["condition_time"] = 0.0
        self._state.totals["held"] = 0.0
        self._state.speed_scaling["rate"] = 1.0
        self._state.speed_scaling["change"] = 0.0

    def select_modes(self, scheduled: ModeArray, modules: int) -> ModeArray:
        """Select the modes in force from scheduled modes, boost requests and working modules.

        The scheduled modes stay if the guard requests no boost and the booster modules suffice.
        Otherwise `combine_modes` adds the requested boost, or lowers modes for which modules are
        missing.

        Args:
            scheduled: Modes of the schedule, uint8[n].
            modules: Number of booster modules that work.

        Returns:
            Modes, uint8[n]. It is the array `scheduled` itself if nothing changes.
        """
        actuators, per_mode = self._state.actuators, self._per_mode
        requested = actuators["requested_mode"].astype(np.uint8)
        if not requested.any() and count_modules(scheduled, per_mode) <= modules:
            return scheduled
        reserve = actuators["reserve_in_n"]
        release = self.settings.release_above
        return combine_modes(scheduled, requested, reserve, release, modules, per_mode)

    def record_modes(self, scheduled: ModeArray, prepared: ModeArray, in_force: ModeArray) -> None:
        """Give `prepared` to the governor, and count deviations of the modes from `scheduled`.

        `scheduled` is only compared; it is not stored. The number of boosts rises by 1 if the modes
        in force differ from `scheduled` now but did not differ at the last call. While they differ,
        `sentence` names both.

        Args:
            scheduled: Modes that the plan has at present, uint8[n].
            prepared: The stronger of the plan's present mode and its mode at the preview point (a
                fixed time ahead), for each actuator, uint8[n]. The governor gets a copy.
            in_force: Modes that are in force, uint8[n].
        """
        self._state.scheduled[:] = prepared
        before, self._deviation_text = self._deviation_text, ""
        if np.array_equal(scheduled, in_force):
            return
        self._deviation_text = (
            f"the modes are {format_pattern(in_force)} where the plan has "
            f"{format_pattern(scheduled)}, whose pressure does not suffice"
        )
        self._boosts += not before

    @property
    def interventions(self) -> Interventions:
        """Counts of interventions so far."""
        totals = self._state.totals
        return Interventions(self._boosts, int(totals["slowings"][0]), float(totals["slowed"][0]))

    @property
    def held(self) -> float:
        """Time for which the plan has been held without a break [s]; 0 if it is not held now.

        A plan is held while a line cannot move its actuator and the rate is below `min_rate`.
        """
        return float(self._state.totals["held"][0])

    @property
    def sentence(self) -> str:
        """Text for a person that says what the guard does now and why; empty if it does nothing.

        It has up to three parts, separated by semicolons: modes that differ from the plan, the
        reduced rate with its cause, and the delay of the arm behind the plan.
        """
        scaling = self._state.speed_scaling
        rate, delay = scaling["rate"][0], scaling["delay"][0]
        sentences = [self._deviation_text] if self._deviation_text else []
        if rate < 1.0:
            lacking = int(np.argmin(self._state.actuators["allowed_rate"]))
            why = f"the tip is {1e3 * self._state.totals['error'][0]:.0f} mm off its reference"
            if self._state.actuators["allowed_rate"][lacking] < 1.0:
                left = self._state.actuators["reserve"][lacking] / 1e6
                why = f"{self._names[lacking]} has {left:.2f} MPa in reserve"
            if self.held > 0.0:
                stalled = int(np.argmin(self._state.actuators["driving_pressure"]))
                beyond = self._state.actuators["driving_pressure"][stalled] / 1e6
                why = f"the line of {self._names[stalled]} has {beyond:.2f} MPa beyond its load"
            shown = math.floor(100.0 * rate) / 100.0  # so that it is below 1
            sentences.append(f"the plan runs at {shown:.2f} of its pace: {why}")
        if delay > 0.0:
            sentences.append(f"the arm is {delay / SECOND_NS:.2f} s later than planned")
        return "; ".join(sentences)
