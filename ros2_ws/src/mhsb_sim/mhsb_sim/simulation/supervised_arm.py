"""The simulated arm as its node runs it, with plan receiver, supervision, stop and reset."""

import numpy as np

from mhsb_model.arm_reports import HandOverReason, HandOverReport
from mhsb_model.holding import HoldingError
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.errors import SimulationDivergedError
from mhsb_sim.simulation.fault_detection import SupervisionLimits
from mhsb_sim.simulation.plan_receiver import PlanReceiver
from mhsb_sim.simulation.sample import WATCH_PERIOD_NS
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervision import Phase, Supervision

UNLOADING_TIME, SLOWEST_UNLOADING = 1.5, 30.0
"""Time constant [s] and smallest rate [kg/s] at which the payload falls to a lighter one.

Oil that a load has compressed would throw the arm up if the load vanished at once."""


class SupervisedArm:
    """A simulator with a plan receiver and supervision.

    Attributes:
        simulator: The simulator.
        supervision: Its supervision.
        halted: Whether the simulation has diverged and cannot go on.
        last_stop_ns: Simulated time of the last `stop` since the start or a reset [ns]; 0 if never.
    """

    def __init__(self, simulator: Simulator, limits: SupervisionLimits | None = None) -> None:
        """Put a simulator under supervision, and begin to receive plans.

        Args:
            simulator: The simulator, at rest.
            limits: Limits of the symptoms of faults, such as pressure or following error. Each is a
                pair: the value at which supervision warns, and the value at which it stops the arm.
                None takes the limits that suit the simulator's controller.
        """
        self.simulator = simulator
        limits = limits or SupervisionLimits.for_controller(simulator.controller_name)
        self.supervision = Supervision(simulator, limits)
        self._receiver = PlanReceiver(simulator.machine, simulator)
        self._reports: list[HandOverReport] = []
        self._payload = self._payload_wanted = simulator.payload
        self._begin()

    def _begin(self) -> None:
        """Start supervision anew without a fault, and take plans again.

        The arm is no longer `halted`, `last_stop_ns` becomes 0, and all servo pumps are used again.
        The plan receiver keeps its waiting plan and the stamps that it has seen. Plans with stamps
        up to the present time are refused.
        """
        self.halted = False
        self.last_stop_ns = 0
        self._fault = ""
        self._clearing = False
        self._next_watch_ns = self.simulator.time_ns
        self.supervision.restart()
        self._receiver.open()

    # --- State and reports -----------------------------------------------------------------------

    @property
    def fault(self) -> str:
        """Sentence that says why the arm is stopped and takes no plans; empty if it is not stopped.

        It names the fault, the phase of the stop, and what ends the stop. If the simulation has
        diverged (`halted`), it names the fault alone.
        """
        phase = self.supervision.phase
        if self.halted or phase is Phase.WATCHING:
            return self._fault
        after = "it is cleared when the arm rests" if self._clearing else "call ~/clear_faults"
        return f"{self._fault}: {phase.value}; {after}"

    @property
    def warning(self) -> str:
        """Warning of failed servo pumps and of a symptom that may stop the arm; empty if none."""
        return self.supervision.warning

    @property
    def intervention(self) -> str:
        """Sentence that says how the mode guard changes the plan; empty if it does not change it.

        The mode guard boosts actuators, or slows the plan, if the plan alone would let the arm sag.
        """
        return "" if self.halted else self.simulator.guard.sentence

    @property
    def plan_stamp_ns(self) -> int:
        """Stamp of the plan in force [ns]; 0 if there is none."""
        return 0 if self.halted else self.simulator.plan_stamp_ns

    def take_reports(self) -> list[HandOverReport]:
        """Return the hand-over reports (one on each plan) since the previous call, and forget them.

        Returns:
            The reports in time order.
        """
        reports, self._reports = self._reports, []
        return reports

    # --- Time ------------------------------------------------------------------------------------

    def step(self, wall: float) -> None:
        """Advance by one step, hand over a plan that is due, and run supervision if it is due.

        If the simulation diverges, the arm is halted and all plans are refused. A halted arm does
        nothing.

        Args:
            wall: Present time of the steady clock [s]. It serves to drop a plan whose second
                message (trajectory or mode schedule) is overdue.
        """
        if self.halted:
            return
        simulator = self.simulator
        try:
            simulator.step()
        except SimulationDivergedError as error:
            self.halted, self._fault = True, str(error)
            self._reports += self._receiver.close(self._fault)
            return
        if simulator.time_ns >= self._receiver.due_ns:
            self.hand_over(wall)
        if simulator.time_ns >= self._next_watch_ns:
            self._next_watch_ns += WATCH_PERIOD_NS
            self._watch()

    def hand_over(self, wall: float) -> None:
        """Hand over the waiting plan if it is due, or drop it if its second message is overdue.

        If the last plan has ended, the delay that speed scaling has caused is first set to 0. The
        report on the waiting plan is stored for `take_reports`.

        Args:
            wall: Present time of the steady clock [s].
        """
        self.simulator.catch_up()
        self._reports += self._receiver.update(wall)

    # --- Plans -----------------------------------------------------------------------------------

    @property
    def awaits_message(self) -> bool:
        """True if only one of the two messages of a plan has come."""
        return self._receiver.awaits_message

    def add_trajectory(self, trajectory: Trajectory, wall: float) -> None:
        """Receive the trajectory of a plan, and hand the plan over if it is complete and due.

        If the last plan has ended, the delay that speed scaling has caused becomes 0 first.

        Reports on plans are stored for `take_reports`.

        Args:
            trajectory: The trajectory with its stamp.
            wall: Present time of the steady clock [s].
        """
        self.simulator.catch_up()
        self._reports += self._receiver.add_trajectory(trajectory, wall)
        self.hand_over(wall)

    def add_schedule(self, schedule: ModeSchedule, wall: float) -> None:
        """Receive the mode schedule of a plan, and hand the plan over if it is complete and due.

        If the last plan has ended, the delay that speed scaling has caused becomes 0 first.

        Reports on plans are stored for `take_reports`.

        Args:
            schedule: The mode schedule with its stamp.
            wall: Present time of the steady clock [s].
        """
        self.simulator.catch_up()
        self._reports += self._receiver.add_schedule(schedule, wall)
        self.hand_over(wall)

    def add_unusable(self, stamp_ns: int, problem: str, wall: float) -> None:
        """Refuse a plan because one of its two messages cannot be read.

        Args:
            stamp_ns: Stamp of the plan [ns].
            problem: Clause that says why it cannot be read.
            wall: Present time of the steady clock [s].
        """
        self._reports += self._receiver.add_unusable(stamp_ns, problem, wall)

    # --- Commands --------------------------------------------------------------------------------

    def stop(self) -> bool:
        """Decelerate along the path of the plan in force, then hold.

        Plans with stamps up to the present time are refused, even if they arrive later. If the
        simulation has diverged, nothing is done.

        Returns:
            True if the reference was moving.
        """
        moving = bool(self.simulator.reference.velocity.any())
        if not self.halted:
            self._reports += self._receiver.invalidate_plans("the arm was stopped")
            self.simulator.stop()
            self.last_stop_ns = self.simulator.time_ns
        return moving

    def reset(self, time_ns: int) -> None:
        """Put the arm at rest into its start posture, and forget plans and faults.

        Injected faults end, too. If a lighter payload was set and is not reached yet, it is reached
        at once.

        Args:
            time_ns: New simulated time [ns].

        Raises:
            HoldingError: The arm cannot be held in the start posture with its payload.
        """
        self._reports += self._receiver.invalidate_plans("the arm was reset", HandOverReason.RESET)
        self.simulator.set_payload(self._payload_wanted)
        self._payload = self._payload_wanted
        self.simulator.reset(time_ns)
        self._receiver.reset()
        self._begin()

    def clear_fault(self, time_ns: int) -> str:
        """Let an arm that a fault has stopped go on from its present posture, at rest.

        Three cases exist:

        - The simulation has diverged: it starts again in the present posture.
        - Supervision has stopped the arm: the arm is released as soon as it rests and its payload
          has the set value. This may happen after the call.
        - The arm is not stopped: servo pumps that were found to fail are used again.

        In the last two cases the servo starts again if the reference rests. It may have learnt from
        a part that failed, for instance an overlap from a stuck valve. It would then open the
        healed valve too far.

        Args:
            time_ns: Simulated time at which a diverged simulation starts again [ns].

        Returns:
            Sentence that says what happens to the fault.
        """
        if self.halted:
            self._restart_in_place(time_ns)
            return "the fault is cleared and the simulation starts anew from where the arm was"
        if not self.simulator.reference.velocity.any():
            self.simulator.restart_servo()
        if self.supervision.phase is Phase.WATCHING:
            failed = self.supervision.restore_servo_pumps()
            return f"{failed}: used again" if failed else "there is no fault"
        self._clearing = True
        self._release_if_cleared()
        return "the fault is cleared as soon as the arm rests with its payload"

    def set_payload(self, mass: float) -> None:
        """Change the payload at the tip: a heavier one at once, a lighter one gradually.

        A lighter payload is reached within some seconds. A sudden change would let compressed oil
        throw the arm up.

        Args:
            mass: Payload [kg].
        """
        self._payload_wanted = mass
        if mass > self._payload:
            self._payload = mass
            self.simulator.set_payload(mass)

    # --- Internals -------------------------------------------------------------------------------

    def _watch(self) -> None:
        """Run supervision for one watch period, and adapt payload and plan receiver.

        If a lighter payload was set, the simulated payload first decreases for one period. If
        supervision stops the arm in this call, the receiver refuses plans from now on. If
        supervision releases the arm, the receiver takes plans again. A release begins if the user
        has cleared the fault, the arm rests, and the payload has its set value.
        """
        self._reduce_payload()
        before = self.supervision.phase
        self.supervision.watch()
        phase = self.supervision.phase
        if before is Phase.WATCHING and phase is not Phase.WATCHING:
            self._fault = self.supervision.fault
            self._reports += self._receiver.close(self._fault)
        elif before is not Phase.WATCHING and phase is Phase.WATCHING:
            self._fault, self._clearing = "", False
            self._receiver.open()
        self._release_if_cleared()

    def _release_if_cleared(self) -> None:
        """Begin to release the arm if the user has cleared the fault and the arm rests.

        The payload must also have its set value.
        """
        if self._clearing and self._payload == self._payload_wanted and self.supervision.rests:
            self.supervision.release()

    def _reduce_payload(self) -> None:
        """Reduce the payload for one watch period, if a lighter one was set.

        The rate is the surplus divided by UNLOADING_TIME, but at least SLOWEST_UNLOADING [kg/s]. A
        sudden change would let compressed oil throw the arm up.
        """
        surplus = self._payload - self._payload_wanted
        if surplus > 0.0:
            rate = max(surplus / UNLOADING_TIME, SLOWEST_UNLOADING)
            self._payload -= min(surplus, rate * WATCH_PERIOD_NS / SECOND_NS)
            if self._payload - self._payload_wanted < 1e-9:
                self._payload = self._payload_wanted
            self.simulator.set_payload(self._payload)

    def _restart_in_place(self, time_ns: int) -> None:
        """Restart a diverged simulation in the arm's last posture, with closed valves.

        If that posture is not finite or cannot be held, the simulation starts in the start posture.
        Supervision starts from its initial state, and plans stamped up to now are refused.

        Args:
            time_ns: New simulated time [ns].
        """
        simulator = self.simulator
        self._reports += self._receiver.invalidate_plans("the arm was reset", HandOverReason.RESET)
        posture = simulator.joint_state.position
        try:
            simulator.reset(time_ns, posture if np.all(np.isfinite(posture)) else None)
        except HoldingError:
            simulator.reset(time_ns)
        simulator.close_valves()
        self._begin()
