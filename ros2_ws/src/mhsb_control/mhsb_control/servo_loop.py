"""The servo of an arm: a controller with its reference, its mode guard and its booster modules.

The servo knows neither simulator nor ROS. The caller writes sensor readings into the signals, and
takes the commands from the signals.
"""

from collections.abc import Mapping
from functools import partial

import numpy as np

from mhsb_control.controller import Controller, ServoSignals
from mhsb_control.estimates_file import ActuatorResponse
from mhsb_control.governor.mode_guard import ModeGuard
from mhsb_control.reference import ReferencePreview
from mhsb_control.registry import make_controller
from mhsb_control.spools.assumed_valves import update_assumed_valves
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import RAIL_MODES, Mode, assign_modules, choose_stronger_modes, count_modules
from mhsb_model.trajectory import Trajectory
from mhsb_model.types import ModeArray


class ServoLoop:
    """Servo of an arm that follows trajectories with their mode schedules.

    Attributes:
        signals: Arrays that the servo reads and writes in each step.
        controller: The controller; a new one after `restart`.
        reference: The reference that is followed.
        guard: Mode guard, which boosts actuators beyond the plan and slows the plan.
        modes: Modes in force, uint8[n]; available after `follow`.
        lost_modules: Indices, from 0, of booster modules that have failed and are not used.
    """

    controller: Controller
    modes: ModeArray

    def __init__(
        self,
        controller: str,
        machine: Machine,
        signals: ServoSignals,
        learnt: Mapping[str, ActuatorResponse] | None = None,
    ) -> None:
        """Make the controller, the reference and the mode guard; call `follow` before `step`.

        Args:
            controller: Name of a registered controller, such as "coordinated".
            machine: The machine as declared in its file (the real one may differ).
            signals: Signals with the present sensor readings; they are shared with the caller.
            learnt: Learnt response of each actuator by its name; the controller's first estimate.
                None to begin with the values of the machine file.

        Raises:
            ArgumentError: `learnt` is given, but the controller does not learn.
            UnknownControllerError: No controller has this name.
            MachineFileError: The controller's gains in the machine's file are wrong.
            PressureSensorsError: The controller reads pressures that the machine does not measure.
        """
        self.signals = signals
        self.lost_modules: tuple[int, ...] = ()
        self._modules = machine.config.hydraulics.modules
        self._make_controller = partial(make_controller, controller, machine, signals)
        self.restart(learnt)
        self.reference = ReferencePreview(
            signals.reference,
            self.controller.preview,
            signals.command_reference,
            signals.command_times,
        )
        self.guard = ModeGuard(machine, signals, self.reference, self.controller.usual_error)
        self._watch = self.guard.watch

    def restart(self, learnt: Mapping[str, ActuatorResponse] | None = None) -> None:
        """Replace the controller by a new one.

        `signals.command_times` become 0. Reference, mode guard and modes are not changed.

        Args:
            learnt: Learnt response of each actuator by its name; the new controller's first
                estimate. None to begin with the values of the machine file.

        Raises:
            ArgumentError: `learnt` is given, but the controller does not learn.
        """
        self.signals.command_times[:] = 0.0
        self.controller = self._make_controller(learnt)
        self._control = self.controller.update

    def follow(
        self, time_ns: int, trajectory: Trajectory, schedule: ModeSchedule, *, planned: bool = True
    ) -> None:
        """Follow a trajectory with its mode schedule from now on.

        The reference and the modes are updated at once. Whether the trajectory continues the
        present reference is not checked.

        Args:
            time_ns: Present time of the servo [ns].
            trajectory: The trajectory.
            schedule: Its mode schedule.
            planned: True for a plan, False for a stop or a hold that the arm makes itself.
        """
        self.reference.follow(trajectory, schedule, planned=planned)
        self.update_reference(time_ns)

    def update_reference(self, time_ns: int) -> None:
        """Evaluate the reference now and ahead, and update the modes if necessary.

        Modes and booster modules are set anew if the row of the mode schedule has changed, for now
        or for the preview point.

        Args:
            time_ns: Present time of the servo [ns].
        """
        if self.reference.update(time_ns):
            self.prepare_modes()

    def step(self) -> None:
        """Run the mode guard and the controller for the present sensor readings.

        The mode guard may slow the plan or request boost. If the guard's requests have changed,
        modes and modules are set again. Then the controller writes its commands into `signals`.
        """
        if self._watch():
            self.prepare_modes()
        self._control()

    def run_period(self, time_ns: int) -> None:
        """Run one control period: update reference and commands, and the assumed valve positions.

        Join valves and diverters have no sensors. The servo computes how the new commands move them
        within the period.

        Args:
            time_ns: Time of the sensor readings [ns].
        """
        self.update_reference(time_ns)
        self.step()
        update_assumed_valves(self.signals.circuit)

    def prepare_modes(self) -> None:
        """Set the modes in force and the prepared modes, and assign the booster modules.

        The modes in force come from the schedule; the mode guard changes them if needed. The
        prepared modes also contain boost that begins within `preview`, so that the controller
        charges lines in time. If not enough modules are free, the boost ahead is left out.

        There is one exception. While an actuator is about to leave the shared rail, no other
        actuator joins the rail early. Otherwise the leaving actuator would get the pressure that
        the joining actuator needs. The joining actuator is prepared in DB instead, so that its own
        pump charges its line.

        Writes `self.modes` (modes in force), and three arrays of `signals` in place: `modes`
        (prepared modes), `modes_ahead` (modes at the end of `preview`) and `serves`. The guard gets
        the plan's modes (`record_modes`).
        """
        modules, lost, signals = self._modules, self.lost_modules, self.signals
        planned, planned_ahead = self.reference.modes, self.reference.modes_ahead
        count = modules.count - len(lost)
        now, ahead = (self.guard.select_modes(each, count) for each in (planned, planned_ahead))
        self.guard.record_modes(planned, choose_stronger_modes(planned, planned_ahead), now)
        self.modes = now
        prepared = choose_stronger_modes(now, ahead)
        if np.any(RAIL_MODES[now] & ~RAIL_MODES[ahead]):
            prepared[~RAIL_MODES[now] & RAIL_MODES[ahead]] = Mode.DB
        if count_modules(prepared, modules.per_mode) > count:
            prepared = now
        signals.modes[:] = prepared
        signals.modes_ahead[:] = ahead
        signals.serves[:] = assign_modules(prepared, modules.count, modules.per_mode, lost)
