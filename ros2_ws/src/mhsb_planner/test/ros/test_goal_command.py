"""The command `goal` waits for an arm that starts later than the planner."""

from __future__ import annotations

import pytest

from mhsb_model.goal import Goal
from mhsb_model.verdict import GoalVerdict, PlanSummary, Verdict
from mhsb_planner.ros import goal_command

PLAN = PlanSummary(77, 100.0, 90.0, 4.0, 2, 40.0, 50.0)


class Executor:
    def spin_once(self, timeout_sec: float) -> None:
        """Nothing happens."""


class Sender:
    """A planner that does not know where the arm is until it has been asked `unknown` times."""

    def __init__(self, unknown: int) -> None:
        self.unknown, self.asked = unknown, 0

    def wait_for_planner(self, executor, timeout):
        return True

    def request_verdict(self, executor, place, timeout):
        assert timeout > 0.0
        self.asked += 1
        goal = Goal.at(self.asked, place)
        if self.asked <= self.unknown:
            return GoalVerdict(Verdict.NO_STATE, "no arm was heard", goal)
        return GoalVerdict(Verdict.OK, "planned", goal, PLAN)


def send(sender, timeout):
    said = []
    result = goal_command._send_and_wait(
        sender, Executor(), (0.55, 0.6), {}, wait=False, timeout=timeout, say=said.append
    )
    return result, said


@pytest.fixture(autouse=True)
def short_wait(monkeypatch):
    monkeypatch.setattr(goal_command, "SEND_AGAIN_AFTER_NO_STATE", 0.02)


def test_a_goal_is_sent_again_until_the_arm_is_there(capfd):
    sender = Sender(unknown=3)
    result, said = send(sender, timeout=20.0)
    assert (result.exit_code, sender.asked) == (goal_command.EXIT_ACCEPTED, 4)
    assert len(said) == 1
    assert said[0].startswith("OK: planned")
    [line] = capfd.readouterr().err.splitlines()
    assert line.startswith("NO_STATE: no arm was heard; the goal is sent again")


def test_without_an_arm_the_sentence_comes_at_the_timeout():
    sender = Sender(unknown=10**6)
    result, said = send(sender, timeout=0.2)
    assert result.exit_code == goal_command.EXIT_REFUSED
    assert said == ["NO_STATE: no arm was heard"]
    assert sender.asked > 1
