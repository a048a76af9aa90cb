"""Playback of a recording in the browser, with a slider for its time."""

import time
from typing import Any

import numpy as np
from viser import ViserServer

from mhsb_model import process
from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_msgs_py import names
from mhsb_planner.ros import views
from mhsb_tools.recording.recording import Recording, check_order
from mhsb_tools.viewer.ability_scene import PolytopeScene
from mhsb_tools.viewer.arm_scene import FRAME_PERIOD, ArmScene
from mhsb_tools.viewer.energy_flow import compute_powers, integrate_power
from mhsb_tools.viewer.marker_scene import MarkerScene
from mhsb_tools.viewer.panel import SentenceList, describe_report
from mhsb_tools.viewer.plots import NO_NUMBERS, PLOT_SPAN, Plots, Snapshots

PLOT_PERIOD = 0.25  # s
"""Change of the shown time after which plots are drawn again [s]."""

PLOT_STEP = 0.1
"""Time between two points of a plot [s]."""


def play_recording(server: ViserServer, machine: Machine, recording: Recording) -> int:
    """Play a recording in the browser until a signal ends this process.

    The recording starts again at its end. It stands still while no browser is connected, and while
    the user has switched playing off.

    Args:
        server: Web server of the page.
        machine: The recorded arm.
        recording: The recording.

    Returns:
        The exit code, 0.

    Raises:
        BagError: The ROS time in the recording decreases.
    """
    check_order(recording)
    playback = Playback(server, machine, recording)
    before = time.monotonic()
    while not process.signalled():
        time.sleep(FRAME_PERIOD)
        now = time.monotonic()
        playback.go_on(now - before)
        before = now
    return 0


class Playback:
    """A recording with a slider for its time and a button that lets it run.

    Attributes:
        duration: Time from the first to the last joint state [s].
    """

    def __init__(self, server: ViserServer, machine: Machine, recording: Recording) -> None:
        """Add the time slider, a checkbox for playing, plots and the arm to the page.

        Energies are computed here for the whole recording.

        Args:
            server: Web server of the page.
            machine: The recorded arm.
            recording: The recording; it must have joint states.
        """
        self._server = server
        self._machine = machine
        self._recording = recording
        self._began_ns, end_ns = recording.joint_states.time_ns[[0, -1]].tolist()
        self.duration = (end_ns - self._began_ns) / SECOND_NS
        self._arm = ArmScene(server.scene, machine)
        self._markers = MarkerScene(server.scene, names.BASE_FRAME)
        self._slider: Any = server.gui.add_slider(
            "time [s]", min=0.0, max=round(self.duration, 2), step=0.01, initial_value=0.0
        )
        self._running: Any = server.gui.add_checkbox("play", initial_value=True)
        self._sentences = SentenceList(server.gui)
        self._plots = Plots(server.gui, machine)
        self._polytope = PolytopeScene(server.scene, machine)
        self._used_ns, self._used = _integrate_recorded_power(recording)
        self._plan_ns: int | None = None
        self._shown = self._plotted = -1.0
        self._commands = _commands(recording)

    def go_on(self, elapsed: float) -> None:
        """Advance the slider, and show the time of the slider.

        The slider advances only if playing is switched on and a browser is connected. Beyond the
        end of the recording, it goes back to 0. The page is updated only if the slider's time
        differs from the time that the page shows.

        Args:
            elapsed: Time since the previous call [s].
        """
        if self._running.value and self._server.get_clients():
            ahead = float(self._slider.value) + elapsed
            self._slider.value = 0.0 if ahead > self.duration else round(ahead, 2)
        at = float(self._slider.value)
        if at != self._shown:
            self._shown = at
            self.show(at)

    def show(self, at: float) -> None:
        """Show the recorded state at one instant.

        It consists of arm, velocity polytope, plan in force, all verdicts and execution reports up
        to then, and plots. The plots are updated only if `at` differs by at least PLOT_PERIOD from
        their last update.

        Args:
            at: Time since the recording's first joint state [s].
        """
        recording, now_ns = self._recording, self._began_ns + round(at * SECOND_NS)
        states = recording.joint_states
        posture = states.position[_find_rows(states.time_ns, now_ns)]
        with self._server.atomic():
            modes = self._modes_at(np.array([now_ns]))[0]
            self._arm.show(posture, modes)
            self._polytope.show(posture, modes)
        self._show_plan(now_ns)
        reports = [each for each in recording.reports if each.time_ns <= now_ns]
        self._sentences.show([describe_report(each.value) for each in reports])
        if abs(at - self._plotted) >= PLOT_PERIOD:
            self._plotted = at
            self._plots.show(self.get_columns(at))

    def get_columns(self, at: float) -> Snapshots:
        """Return the states that the plots show at one instant.

        Args:
            at: Time since the recording's first joint state [s].

        Returns:
            A state every PLOT_STEP, from PLOT_SPAN before `at` (or 0 if that is later) to `at`. The
            last state may lie up to PLOT_STEP after `at`. Pressures and energies that were not
            recorded are nan. If no modes were recorded, all are N (code 0).
        """
        seconds = np.arange(max(0.0, at - PLOT_SPAN), at + PLOT_STEP, PLOT_STEP)
        times_ns = self._began_ns + np.round(seconds * SECOND_NS).astype(np.int64)
        actuators = self._recording.actuators
        pressure = np.full((len(seconds), self._machine.joint_count), np.nan)
        if len(actuators.time_ns):
            rows = _find_rows(actuators.time_ns, times_ns)
            pressure = actuators.quantity["supply_pressure"][rows]
        return Snapshots(seconds, pressure, self._modes_at(times_ns), self._energy_at(times_ns))

    def _modes_at(self, times_ns: IntArray) -> ModeArray:
        """Return the modes in force at given times.

        Args:
            times_ns: ROS times, int64 (k,) [ns].

        Returns:
            Mode codes, uint8 (k, n). For times before the first recorded modes, the first recorded
            modes are returned. If no modes were recorded, all codes are 0 (mode N).
        """
        recording = self._recording
        if len(recording.mode_time_ns) == 0:
            return np.zeros((len(times_ns), self._machine.joint_count), dtype=np.uint8)
        return recording.modes[_find_rows(recording.mode_time_ns, times_ns)]

    def _energy_at(self, times_ns: IntArray) -> FloatArray:
        """Return the energies at given times, counted from the simulator's first report.

        Args:
            times_ns: ROS times, int64 (k,) [ns].

        Returns:
            Energies of main pump, servo pumps, oil at the valve inlets, and pistons, shape (k, 4)
            [J]; nan if they were not recorded. Each is the last known value at or before its time;
            for times before the first record, the first value.
        """
        reports = self._recording.simulator_reports
        if not reports:
            return np.tile(NO_NUMBERS, (len(times_ns), 1))
        reported_ns = np.array([each.time_ns for each in reports], dtype=np.int64)
        pumps = np.array([(each.value.main_pump_j, each.value.servo_pumps_j) for each in reports])
        pumps = (pumps - pumps[0])[_find_rows(reported_ns, times_ns)]
        return np.concatenate([pumps, self._used[_find_rows(self._used_ns, times_ns)]], axis=1)

    def _show_plan(self, now_ns: int) -> None:
        """Show the plan in force at a time: path, goal and obstacles.

        If this plan is shown already, nothing changes. If no plan is in force, or its trajectory or
        mode schedule was not recorded, only obstacles are shown.

        Args:
            now_ns: ROS time [ns].
        """
        in_force = [each for each in self._recording.plans_in_force if each.time_ns <= now_ns]
        stamp_ns = int(in_force[-1].value) if in_force else 0
        if stamp_ns != self._plan_ns:
            self._plan_ns = stamp_ns
            command = self._commands.get(stamp_ns)
            self._markers.show(views.make_markers(self._machine, command, "", stamp_ns))


def _integrate_recorded_power(recording: Recording) -> tuple[IntArray, FloatArray]:
    """Compute the energy of the oil at the valve inlets, and of the pistons, in a recording.

    Args:
        recording: The recording.

    Returns:
        ROS times of the hydraulic states, int64 (k,) [ns], and energies up to these times, shape
        (k, 2) [J]. Column 0 is for the oil at the valve inlets, column 1 for the pistons. The
        energies count from the simulator's first report and are negative before it. If hydraulic
        states or reports are missing, there is one row with time 0 and nan.
    """
    actuators, reports = recording.actuators, recording.simulator_reports
    if len(actuators.time_ns) == 0 or not reports:
        return np.zeros(1, dtype=np.int64), np.full((1, 2), np.nan)
    quantity = actuators.quantity
    power = compute_powers(
        quantity["supply_pressure"],
        quantity["supply_flow"],
        quantity["force"],
        quantity["piston_speed"],
    )
    time_ns = actuators.time_ns
    energy = integrate_power((time_ns - time_ns[0]) / SECOND_NS, power)
    return time_ns, energy - energy[_find_rows(time_ns, reports[0].time_ns)]


def _commands(recording: Recording) -> dict[int, Command]:
    """Return the plans whose trajectory and mode schedule were both recorded.

    Args:
        recording: The recording.

    Returns:
        The plans by their stamp [ns].
    """
    schedules = {each.stamp_ns: each for each in recording.schedules}
    return {
        each.stamp_ns: Command(each, schedules[each.stamp_ns])
        for each in recording.trajectories
        if each.stamp_ns in schedules
    }


def _find_rows(times_ns: IntArray, wanted_ns: IntArray | int) -> IntArray:
    """Find the rows in force at one or several times.

    Args:
        times_ns: Times of the rows, in order, int64 (m,) [ns].
        wanted_ns: One wanted time, or an array of them, int64 (k,) [ns].

    Returns:
        Index of the last row at or before each wanted time; 0 before the first row. For one time
        it has no dimension.
    """
    return np.maximum(np.searchsorted(times_ns, wanted_ns, side="right") - 1, 0)
