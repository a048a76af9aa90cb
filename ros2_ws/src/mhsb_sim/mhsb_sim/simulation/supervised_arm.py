"""The simulated arm as its node runs it: it takes plans, is watched, can be stopped and reset."""

from __future__ import annotations

import numpy as np

from mhsb_model.arm_reports import HandOverReason, HandOverReport
from mhsb_model.holding import HoldingError
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.trajectory import SECOND_NS, Trajectory
from mhsb_sim.errors import SimulationDivergedError
from mhsb_sim.simulation.plan_receiver import PlanReceiver
from mhsb_sim.simulation.sample import WATCH_PERIOD_NS
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.simulation.supervision import Phase, Supervision
from mhsb_sim.simulation.symptoms import SupervisionLimits

UNLOADING_TIME, SLOWEST_UNLOADING = 1.5, 30.0
"""A lighter payload is approached with this time constant [s], at least this fast [kg/s]. Oil that
a load has compressed would throw the arm up if the load vanished at once."""


class SupervisedArm:
    """A simulator with a receiver of plans and supervision.

    halted        whether the simulation has diverged and cannot go on
    last_stop_ns  when `stop` was last called since the start or a reset [ns]; 0 never
    """

    def __init__(self, simulator: Simulator, limits: SupervisionLimits) -> None:
        self.simulator = simulator
        self.supervision = Supervision(simulator, limits)
        self._receiver = PlanReceiver(simulator.machine, simulator)
        self._reports: list[HandOverReport] = []
        self._payload = self._payload_wanted = simulator.payload
        self._begin()

    def _begin(self) -> None:
        self.halted = False
        self.last_stop_ns = 0
        self._fault = ""
        self._clearing = False
        self._next_watch_ns = self.simulator.time_ns
        self.supervision.restart()
        self._receiver.open()

    # --- What it tells ---------------------------------------------------------------------------

    @property
    def fault(self) -> str:
        """Why the arm is stopped and takes no plans, empty where it does."""
        phase = self.supervision.phase
        if self.halted or phase is Phase.WATCHING:
            return self._fault
        after = "it is cleared when the arm rests" if self._clearing else "call ~/clear_faults"
        return f"{self._fault}: {phase.value}; {after}"

    @property
    def warning(self) -> str:
        """What may stop the arm, empty where nothing does."""
        return self.supervision.warning

    @property
    def intervention(self) -> str:
        """What the guard does against the plan, empty where it does nothing."""
        return "" if self.halted else self.simulator.guard.sentence

    @property
    def plan_stamp_ns(self) -> int:
        """Stamp of the plan in force [ns], 0 where there is none."""
        return 0 if self.halted else self.simulator.plan_stamp_ns

    def take_reports(self) -> list[HandOverReport]:
        """What has become of plans since the last call."""
        reports, self._reports = self._reports, []
        return reports

    # --- Time ------------------------------------------------------------------------------------

    def step(self, wall: float) -> None:
        """Advance by one step; take a plan that is due, watch. `wall` is the time [s] it is."""
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
        """Take a plan that is due; drop half a plan that has waited too long."""
        self.simulator.catch_up()
        self._reports += self._receiver.update(wall)

    # --- Plans -----------------------------------------------------------------------------------

    def add_trajectory(self, trajectory: Trajectory, wall: float) -> None:
        """Receive a plan's trajectory."""
        self.simulator.catch_up()
        self._reports += self._receiver.add_trajectory(trajectory, wall)
        self.hand_over(wall)

    def add_schedule(self, schedule: ModeSchedule, wall: float) -> None:
        """Receive a plan's mode schedule."""
        self.simulator.catch_up()
        self._reports += self._receiver.add_schedule(schedule, wall)
        self.hand_over(wall)

    def add_unusable(self, stamp_ns: int, problem: str, wall: float) -> None:
        """Receive half a plan that cannot be read."""
        self._reports += self._receiver.add_unusable(stamp_ns, problem, wall)

    # --- Orders ----------------------------------------------------------------------------------

    def stop(self) -> bool:
        """Decelerate along the path and hold; no plan made before takes effect.

        Whether the reference was on its way. No order has an effect on a simulation that has
        diverged.
        """
        moving = bool(self.simulator.reference.velocity.any())
        if not self.halted:
            self._reports += self._receiver.void("the arm was stopped")
            self.simulator.stop()
            self.last_stop_ns = self.simulator.time_ns
        return moving

    def reset(self, time_ns: int) -> None:
        """To rest in the start posture at `time_ns`; forget plans and faults."""
        self._reports += self._receiver.void("the arm was reset", HandOverReason.RESET)
        self.simulator.set_payload(self._payload_wanted)
        self._payload = self._payload_wanted
        self.simulator.reset(time_ns)
        self._receiver.forget()
        self._begin()

    def clear_fault(self, time_ns: int) -> str:
        """Let a stopped arm go on from where it stands, at rest; what becomes of the fault.

        A simulation that has diverged is started anew there, at `time_ns`.
        """
        if self.halted:
            self._restart_where_it_is(time_ns)
            return "the fault is cleared and the simulation starts anew from where the arm was"
        if self.supervision.phase is Phase.WATCHING:
            failed = self.supervision.trust_servo_pumps()
            return f"{failed}: used again" if failed else "there is no fault"
        self._clearing = True
        self._go_on_clearing()
        return "the fault is cleared as soon as the arm rests with its payload"

    def set_payload(self, mass: float) -> None:
        """Hang another payload [kg] on the tip: a heavier one at once, a lighter one gradually."""
        self._payload_wanted = mass
        if mass > self._payload:
            self._payload = mass
            self.simulator.set_payload(mass)

    # --- Inside ----------------------------------------------------------------------------------

    def _watch(self) -> None:
        self._unload()
        before = self.supervision.phase
        self.supervision.watch()
        phase = self.supervision.phase
        if before is Phase.WATCHING and phase is not Phase.WATCHING:
            self._fault = self.supervision.fault
            self._reports += self._receiver.close(self._fault)
        elif before is not Phase.WATCHING and phase is Phase.WATCHING:
            self._fault, self._clearing = "", False
            self._receiver.open()
        self._go_on_clearing()

    def _go_on_clearing(self) -> None:
        if self._clearing and self._payload == self._payload_wanted and self.supervision.rests:
            self.supervision.release()

    def _unload(self) -> None:
        surplus = self._payload - self._payload_wanted
        if surplus > 0.0:
            rate = max(surplus / UNLOADING_TIME, SLOWEST_UNLOADING)
            self._payload -= min(surplus, rate * WATCH_PERIOD_NS / SECOND_NS)
            if self._payload - self._payload_wanted < 1e-9:
                self._payload = self._payload_wanted
            self.simulator.set_payload(self._payload)

    def _restart_where_it_is(self, time_ns: int) -> None:
        simulator = self.simulator
        self._reports += self._receiver.void("the arm was reset", HandOverReason.RESET)
        posture = simulator.joint_state.position
        try:
            simulator.reset(time_ns, posture if np.all(np.isfinite(posture)) else None)
        except HoldingError:
            simulator.reset(time_ns)
        simulator.close_valves()
        self._begin()
