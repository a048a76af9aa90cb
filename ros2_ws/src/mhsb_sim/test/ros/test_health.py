"""Which changes of the simulator's health are logged."""

from __future__ import annotations

from types import SimpleNamespace

from mhsb_model.trajectory import SECOND_NS
from mhsb_sim.ros.health import Health
from mhsb_sim.ros.pacing import Pacer


def build_health() -> tuple[Health, SimpleNamespace]:
    """The health of an arm whose state a test sets."""
    simulator = SimpleNamespace(time_ns=0, valves_closed=False, lost_modules=0)
    arm = SimpleNamespace(
        simulator=simulator,
        supervision=SimpleNamespace(phase=None),
        fault="",
        warning="",
        intervention="",
        halted=False,
        last_stop_ns=0,
    )
    faults = SimpleNamespace(get_recent_fault=lambda: "")
    return Health(arm, Pacer(1.0), own_clock=True, faults=faults), arm


def test_a_warning_that_comes_and_goes_many_times_a_second_is_logged_once() -> None:
    health, arm = build_health()
    changes = 0
    for k in range(2500):  # 25 s
        arm.simulator.time_ns = k * SECOND_NS // 100
        arm.warning = "joint_1 is off" if k % 2 else ""
        arm.intervention = "the plan is slowed" if k % 3 == 2 else ""
        changes += health.has_changed()
    assert changes == 2  # each of the two warnings begins


def test_a_warning_ends_two_seconds_after_it_was_last_seen_and_may_begin_again() -> None:
    health, arm = build_health()
    changed = []
    for k in range(100):  # 10 s
        arm.simulator.time_ns = k * SECOND_NS // 10
        arm.warning = "joint_1 is off" if 10 <= k < 20 or k >= 80 else ""
        if health.has_changed():
            changed.append(k)
    assert changed == [10, 39, 80]
