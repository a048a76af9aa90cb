"""What a run of a draw shows beside its errors: payload learnt, rest, flow, how much later."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mhsb_model.command import Command
from mhsb_model.machine import Machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.types import FloatArray
from mhsb_sim.simulation.simulator import Simulator
from mhsb_sim.study.needed_pressure import needed_pressure
from mhsb_sim.study.replay import Replay

LIFTING = 2
"""Joints, the first ones, whose motion tells of the payload."""

LEARNING, EACH_WAY = 5.0, 0.5
"""Time [s] in which these joints move until the payload is looked at, and that one of them has to
have moved each way by then."""

CERTAIN = 1.96
"""Standard deviations of a 95 % interval."""

SETTLING, RESTING = 1.0, 1.0
"""Time without noise [s]: before the spools are looked at, and for which they are."""

LAST = 1.0
"""Time at a run's end [s] in which the arm is at rest."""

SAMPLED = 0.01
"""Step in which plans are looked at [s]."""


@dataclass(frozen=True)
class ToldPayload:
    """Payload that a servo has learnt, and half of its 95 % interval [kg]; by how much it is off
    the true one [%], and whether the interval holds that."""

    value: float
    half_interval: float
    error_percent: float
    holds: bool


def told_payload(plant: Machine, run: Replay) -> ToldPayload | None:
    """What the servo says after `LEARNING` of motion both ways; None where it says nothing then."""
    row = when_moved_both_ways(run.reference[:, 1, :LIFTING], run.step)
    if row is None or not len(run.payload):
        return None
    after = np.flatnonzero(run.payload[:, 0] >= run.time[row])
    if not len(after):
        return None
    _, value, deviation = run.payload[after[0]]
    half, off = CERTAIN * deviation, abs(value - plant.arrays.payload)
    return ToldPayload(value, half, 100.0 * off / plant.arrays.payload, bool(off <= half))


def when_moved_both_ways(velocity: FloatArray, step: float) -> int | None:
    """Row by which the joints have moved for `LEARNING`, one of them `EACH_WAY`; None where never.

    velocity: float64[k, joints], rad/s.
    """
    moving = step * np.cumsum(np.any(velocity != 0.0, axis=1))
    up, down = (step * np.cumsum(sign * velocity > 0.0, axis=0) for sign in (1.0, -1.0))
    both = np.any((up >= EACH_WAY) & (down >= EACH_WAY), axis=1)
    rows = np.flatnonzero((moving >= LEARNING) & both)
    return int(rows[0]) if len(rows) else None


def spool_deviation(simulator: Simulator) -> float:
    """Largest standard deviation of a spool at rest, in % of its stroke, without noise.

    The run goes on for 2 s, with sensors that keep their resolution and offset and lose their
    noise; the last second counts: what is left are swings that keep themselves up.
    """
    simulator.silence_noise()
    simulator.advance(SETTLING)
    rows = round(RESTING * SECOND_NS / simulator.step_ns)
    spools = np.empty((rows, simulator.machine.joint_count))
    for row in spools:
        simulator.step()
        row[:] = simulator.spools
    return float(100.0 * spools.std(axis=0).max())


def rest_error(error: FloatArray, step: float) -> float:
    """95 % of the last second's distances from the goal are below this, in the unit of error[k]."""
    return float(np.quantile(error[-round(LAST / step) :], 0.95))


def flow_suffices(machine: Machine, plant: Machine, commands: Sequence[Command]) -> bool:
    """Whether the main pump delivers what the plans take from the plant, at every moment.

    Σ (A_dir |v| + leakage at the pressure that is needed) ≤ Q_MP, each plan until the next begins.
    """
    ends = [command.stamp_ns for command in commands[1:]] + [2**62]
    m, most = plant.arrays, plant.arrays.main_pump_flow
    for command, end in zip(commands, ends, strict=True):
        last = min(end, command.trajectory.end_ns)
        times = np.arange(command.stamp_ns, last, round(SAMPLED * SECOND_NS))
        if not len(times):
            continue
        states = [command.trajectory.sample(int(time)) for time in times]
        path = np.array([(each.position, each.velocity, each.acceleration) for each in states])
        rows = np.searchsorted(command.schedule.offset_ns, times - command.stamp_ns, "right") - 1
        pressure = needed_pressure(plant, path, command.schedule.modes[np.maximum(rows, 0)])
        arms = np.array([machine.moment_arms(q) for q in path[:, 0]])
        speed = arms * path[:, 1]
        strokes = np.where(speed > 0.0, m.cap_area, m.rod_area) * np.abs(speed)
        leakage = m.leakage_flow * np.sqrt(pressure / m.supply_pressure)
        if np.any((strokes + leakage).sum(axis=1) > most):
            return False
    return True


def planned_time(commands: Sequence[Command]) -> float:
    """From the first plan's beginning to the last one's end [s]."""
    if not commands:
        return 0.0
    return (commands[-1].trajectory.end_ns - commands[0].stamp_ns) / SECOND_NS
