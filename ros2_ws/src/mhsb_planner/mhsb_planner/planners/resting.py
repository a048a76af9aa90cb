"""Rests on a path's way: a motion, whose ramps round corners, then gets to where it rests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mhsb_model.machine import Machine
from mhsb_model.types import IntArray
from mhsb_planner.motion.s3_ramps import shortest_ramp
from mhsb_planner.search.discrete_path import DiscretePath
from mhsb_planner.search.s2_search import Weights


def with_rests(
    machine: Machine, path: DiscretePath, before: IntArray, weights: Weights
) -> DiscretePath:
    """The same path with a rest as long as the shortest ramp before each of these steps, in the
    modes of that step.

    A rest takes P_S n q_leak T [J].
    """
    m, seconds = machine.arrays, shortest_ramp(machine).duration
    energy = m.supply_pressure * machine.joint_count * m.leakage_flow * seconds
    dearer = len(before) * (weights.energy * energy + weights.time * seconds)
    return replace(
        path,
        tip=np.insert(path.tip, before, path.tip[before], axis=0),
        posture=np.insert(path.posture, before, path.posture[before], axis=0),
        modes=np.insert(path.modes, before, path.modes[before], axis=0),
        duration=np.insert(path.duration, before, seconds),
        energy=np.insert(path.energy, before, energy),
        energy_series=np.insert(path.energy_series, before, energy),
        cost=path.cost + dearer,
    )
