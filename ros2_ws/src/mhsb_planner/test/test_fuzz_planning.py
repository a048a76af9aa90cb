"""Whatever is asked: a plan that is well formed, or one sentence why there is none."""

from __future__ import annotations

import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mhsb_model.braking import brake_from
from mhsb_model.errors import MhsbError
from mhsb_model.obstacles.zones import Zones
from mhsb_model.trajectory import MotionState
from mhsb_planner.deadline import NO_DEADLINE, Deadline
from mhsb_planner.planner import Planner, PlanOptions, warm_up
from mhsb_planner.search.s2_search import Weights

SEEDS = st.integers(0, 2**64 - 1)
NUMBERS = (0.0, 5e-324, 1e-12, 1e-3, 0.25, 1.029, 1.0290000001, 3.0, -1e9, 1e300, np.nan, np.inf)


@pytest.fixture(scope="module")
def planner(machine, table):
    planner = Planner(machine, table)
    warm_up(planner)
    return planner


def number(source, low, high):
    """Mostly one within bounds."""
    return source.choice(NUMBERS) if source.random() < 0.15 else source.uniform(low, high)


def strange_machine(machine, source):
    """The machine with zones anywhere, and other loads and limits."""
    zones = Zones(
        boxes=tuple(
            tuple(number(source, -1.0, 1.0) for _ in range(4)) for _ in range(source.randrange(3))
        ),
        tip_circles=tuple(
            (number(source, -1.0, 1.0), number(source, -1.0, 1.0), number(source, 0.0, 0.3))
            for _ in range(source.randrange(3))
        ),
    )
    payload, pressure = number(source, 0.0, 30.0), number(source, 1e6, 1e7)
    return machine.changed(
        payload=payload if source.random() < 0.3 else None,
        supply_pressure=pressure if source.random() < 0.3 else None,
        max_piston_speed=number(source, 1e-3, 0.05) if source.random() < 0.3 else None,
        zones=zones if source.random() < 0.3 else None,
    )


def ask(planner, source):
    """Plan something strange."""
    machine = planner.machine
    limits, n = machine.arrays, machine.joint_count
    q = np.array([source.uniform(limits.joint_min[j], limits.joint_max[j]) for j in range(n)])
    if source.random() < 0.2:
        q += source.choice((1e-9, 5e-3, 0.3))
    moving = source.random() < 0.4
    speed = np.array([source.uniform(-0.3, 0.3) * moving for _ in range(n)])
    start = MotionState(q, speed, 0 * speed)
    options = PlanOptions(
        weights=Weights(number(source, 0.0, 2.0), number(source, 0.0, 20.0), number(source, 0, 9)),
        energy_reading=source.choice(("paper", "series")),
        goal_psi=source.uniform(-4.0, 4.0) if source.random() < 0.1 else None,
        planner=source.choice(("integrated", "integrated", "table", "fixed")),
    )
    return planner.plan(
        (number(source, 0.0, 1.0), number(source, -1.0, 1.0)),
        start,
        brake=brake_from(machine, start, 0) if moving else None,
        options=options,
        deadline=Deadline.after(source.choice((0.0, 0.005, 0.05, 0.3))),
    )


def try_one(planner, machine, seed):
    source, sentence = random.Random(seed), "a sentence"
    try:
        planner.change_machine(strange_machine(machine, source))
        plan = ask(planner, source)
    except MhsbError as error:
        sentence = str(error)
    else:
        motion = plan.motion.trajectory
        assert np.all(np.isfinite(motion.position))
        assert not motion.velocity[-1].any()
        assert plan.energy.paper >= 0.0
    finally:
        planner.change_machine(machine)
    assert len(sentence) >= 10


@settings(max_examples=60, derandomize=False)
@given(seed=SEEDS)
def test_strange_requests_are_planned_or_refused_with_a_sentence(planner, machine, seed):
    try_one(planner, machine, seed)


@pytest.mark.slow
@pytest.mark.timeout(1800)
@settings(max_examples=4000, derandomize=False)
@given(seed=SEEDS)
def test_thousands_of_strange_requests_are_planned_or_refused(planner, machine, seed):
    try_one(planner, machine, seed)


def test_after_all_that_an_ordinary_goal_is_planned(planner, machine):
    start = np.array(machine.config.simulation.start_posture)
    plan = planner.plan((0.55, 0.3), MotionState.at_rest(start), deadline=NO_DEADLINE)
    assert plan.energy.paper > 0.0
