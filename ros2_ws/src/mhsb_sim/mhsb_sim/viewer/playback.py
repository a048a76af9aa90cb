"""A recording in the browser: the arm, the plan in force and what was said, at a time to slide."""

from __future__ import annotations

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
from mhsb_sim.recording.recording import Recording, Timed, check_order
from mhsb_sim.viewer.ability_scene import PolytopeScene
from mhsb_sim.viewer.arm_scene import ArmScene
from mhsb_sim.viewer.energy_flow import cumulated, powers
from mhsb_sim.viewer.marker_scene import MarkerScene
from mhsb_sim.viewer.moment import NO_NUMBERS, Lines
from mhsb_sim.viewer.panel import Said
from mhsb_sim.viewer.plots import Plots
from mhsb_sim.viewer.words import words_of

FRAME_PERIOD = 0.05  # s
PLOT_PERIOD = 0.25  # s
SPAN = 30.0
"""Time that plots look back [s]."""

PLOTTED = 0.1
"""Between two points of a plot [s]."""


def play(server: ViserServer, machine: Machine, recording: Recording) -> int:
    """Play a recording until this process is asked to end.

    Raises BagError where its time runs backwards.
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
    """A recording with a slider for its time, and a button that lets it run."""

    def __init__(self, server: ViserServer, machine: Machine, recording: Recording) -> None:
        self._server = server
        self._machine = machine
        self._recording = recording
        self._began_ns = int(recording.joint_states.time_ns[0])
        self.duration = float(self._seconds(recording.joint_states.time_ns[-1:])[0])
        self._arm = ArmScene(server.scene, machine)
        self._markers = MarkerScene(server.scene, names.BASE_FRAME)
        self._slider: Any = server.gui.add_slider(
            "time [s]", min=0.0, max=round(self.duration, 2), step=0.01, initial_value=0.0
        )
        self._running: Any = server.gui.add_checkbox("play", initial_value=True)
        self._said = Said(server.gui)
        self._plots = Plots(server.gui, machine)
        self._polytope = PolytopeScene(server.scene, machine)
        self._used_ns, self._used = _used(recording)
        self._plan_ns: int | None = None
        self._shown = self._plotted = -1.0
        self._commands = _commands(recording)

    def go_on(self, elapsed: float) -> None:
        """Show the time of the slider, which runs on by `elapsed` s if it is to."""
        if self._running.value and self._server.get_clients():
            ahead = float(self._slider.value) + elapsed
            self._slider.value = 0.0 if ahead > self.duration else round(ahead, 2)
        at = float(self._slider.value)
        if at != self._shown:
            self._shown = at
            self.show(at)

    def show(self, at: float) -> None:
        """Everything at a time since the recording's beginning [s]."""
        recording, now_ns = self._recording, self._began_ns + round(at * SECOND_NS)
        states = recording.joint_states
        posture = states.position[_index(states.time_ns, now_ns)]
        with self._server.atomic():
            modes = self._modes_at(np.array([now_ns]))[0]
            self._arm.show(posture, modes)
            self._polytope.show(posture, modes)
        self._show_plan(now_ns)
        said = [each for each in recording.reports if each.time_ns <= now_ns]
        self._said.show([words_of(each.value) for each in said])
        if abs(at - self._plotted) >= PLOT_PERIOD:
            self._plotted = at
            self._plots.show(self.lines(at))

    def lines(self, at: float) -> Lines:
        """What the plots show at a time [s]: the seconds before it."""
        seconds = np.arange(max(0.0, at - SPAN), at + PLOTTED, PLOTTED)
        times_ns = self._began_ns + np.round(seconds * SECOND_NS).astype(np.int64)
        actuators = self._recording.actuators
        pressure = np.full((len(seconds), self._machine.joint_count), np.nan)
        if len(actuators.time_ns):
            rows = _indices(actuators.time_ns, times_ns)
            pressure = actuators.quantity["supply_pressure"][rows]
        return Lines(seconds, pressure, self._modes_at(times_ns), self._energy_at(times_ns))

    def _modes_at(self, times_ns: IntArray) -> ModeArray:
        recording = self._recording
        if len(recording.mode_time_ns) == 0:
            return np.zeros((len(times_ns), self._machine.joint_count), dtype=np.uint8)
        return recording.modes[_indices(recording.mode_time_ns, times_ns)]

    def _energy_at(self, times_ns: IntArray) -> FloatArray:
        reports = self._recording.simulator_reports
        if not reports:
            return np.tile(NO_NUMBERS, (len(times_ns), 1))
        pumps = np.array([(each.value.main_pump_j, each.value.servo_pumps_j) for each in reports])
        pumps = (pumps - pumps[0])[_indices(_times(reports), times_ns)]
        return np.concatenate([pumps, self._used[_indices(self._used_ns, times_ns)]], axis=1)

    def _show_plan(self, now_ns: int) -> None:
        """The plan in force, which is drawn when another one is."""
        in_force = [each for each in self._recording.plans_in_force if each.time_ns <= now_ns]
        stamp_ns = int(in_force[-1].value) if in_force else 0
        if stamp_ns != self._plan_ns:
            self._plan_ns = stamp_ns
            command = self._commands.get(stamp_ns)
            self._markers.show(views.markers(self._machine, command, "", stamp_ns))

    def _seconds(self, times_ns: IntArray) -> FloatArray:
        return (times_ns - self._began_ns) / SECOND_NS


def _used(recording: Recording) -> tuple[IntArray, FloatArray]:
    """Times [ns], and energies into the valves and of the pistons since the first report [J]."""
    actuators, reports = recording.actuators, recording.simulator_reports
    if len(actuators.time_ns) == 0 or not reports:
        return np.zeros(1, dtype=np.int64), np.full((1, 2), np.nan)
    quantity = actuators.quantity
    power = powers(
        quantity["supply_pressure"],
        quantity["supply_flow"],
        quantity["force"],
        quantity["piston_speed"],
    )
    time_ns = actuators.time_ns
    energy = cumulated((time_ns - time_ns[0]) / SECOND_NS, power)
    return time_ns, energy - energy[_index(time_ns, reports[0].time_ns)]


def _commands(recording: Recording) -> dict[int, Command]:
    """Plans of which both halves were recorded, by their stamp."""
    schedules = {each.stamp_ns: each for each in recording.schedules}
    return {
        each.stamp_ns: Command(each, schedules[each.stamp_ns])
        for each in recording.trajectories
        if each.stamp_ns in schedules
    }


def _times(all_timed: tuple[Timed, ...]) -> IntArray:
    return np.array([each.time_ns for each in all_timed], dtype=np.int64)


def _index(times_ns: IntArray, now_ns: int) -> int:
    return int(_indices(times_ns, np.array([now_ns]))[0])


def _indices(times_ns: IntArray, wanted_ns: IntArray) -> IntArray:
    """The last at or before each of the wanted times; before the first one that."""
    return np.maximum(np.searchsorted(times_ns, wanted_ns, side="right") - 1, 0)
