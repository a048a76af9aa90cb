"""Which steps and motions have loads that empty inlet chambers."""

import numpy as np
import pytest

from mhsb_model.trajectory import SECOND_NS, MotionState
from mhsb_planner.motion.cavitation import find_cavitating_steps, find_cavitations
from mhsb_planner.planner import Planner, PlanOptions


def emptied(machine, posture, velocity):
    """By the formula of the two limits, for one state; bool of each actuator."""
    m = machine.arrays
    force = machine.piston_forces(posture)
    speed = machine.moment_arms(posture) * velocity
    cap, rod, supply, tank = m.cap_area, m.rod_area, m.supply_pressure, m.tank_pressure
    pulled = force < -(rod**3) * supply / cap**2 - rod * tank
    pushed = force > cap**3 * supply / rod**2 + cap * tank
    return (speed > 2e-4) & pulled | (speed < -2e-4) & pushed


def test_a_plan_tells_of_the_steps_and_times_at_which_inlets_empty(machine, table):
    loaded = machine.changed(payload=16.0)
    start = MotionState.at_rest(np.array([0.411, -1.537, 0.7]))
    options = PlanOptions(planner="integrated")
    plan = Planner(loaded, table).plan((0.65, -0.55), start, options=options)
    motion = plan.motion.trajectory
    expected = np.array(
        [emptied(loaded, q, qd) for q, qd in zip(motion.position, motion.velocity, strict=True)]
    )
    assert expected.any()
    found = {each.actuator: each for each in find_cavitations(loaded, motion)}
    span = np.append(np.diff(motion.offset_ns), 0) / SECOND_NS
    for j, name in enumerate(loaded.actuator_names):
        assert expected[:, j].any() == (name in found)
        if name in found:
            assert found[name].duration == pytest.approx(span[expected[:, j]].sum())
            first = motion.offset_ns[np.argmax(expected[:, j])] / SECOND_NS
            assert found[name].begin == first
    assert plan.cavitations == tuple(found.values())
    assert all(str(each) in plan.warnings for each in plan.cavitations)

    steps = find_cavitating_steps(loaded, plan.path)
    for k in range(plan.path.steps):
        start, end = plan.path.posture[k : k + 2]
        velocity = (end - start) / plan.path.duration[k]
        at = [emptied(loaded, start + u * (end - start), velocity) for u in (0.0, 0.5, 1.0)]
        assert steps[k].tolist() == np.any(at, axis=0).tolist()


def test_a_motion_that_lifts_its_loads_has_none(machine, table):
    folded = np.array(machine.config.simulation.start_posture)
    plan = Planner(machine, table).plan(
        (0.45, 0.3), MotionState.at_rest(folded), options=PlanOptions(planner="table")
    )
    assert not any(
        emptied(machine, q, qd).any()
        for q, qd in zip(
            plan.motion.trajectory.position, plan.motion.trajectory.velocity, strict=True
        )
    )
    assert plan.cavitations == ()
