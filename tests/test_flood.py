"""A thousand goals a second: the newest one is executed, each gets one verdict, memory stays."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path

import pytest

from mhsb_model.verdict import GoalVerdict, Outcome, Verdict
from mhsb_msgs_py import plan_status, topics

FLOODED = 4.0  # s
RATE = 1000  # 1/s
LARGEST_GROWTH = 5_000_000  # bytes a flood, on average over two
LARGEST_LATE_GROWTH = 1_000_000  # bytes over the last four of twelve floods


@pytest.fixture
def verdicts(observer):
    """How many verdicts each goal was given."""
    given = Counter()

    def count(message):
        reports = plan_status.decode(message)
        given.update(each.goal_stamp_ns for each in reports if isinstance(each, GoalVerdict))

    topic = topics.PLAN_STATUS
    observer.create_subscription(topic.message, topic.name, count, topic.qos)
    return given


def flood(observer, z):
    """Goals at RATE for a while, on the way down to z [m]; stamps of all, the newest last."""
    sent, began = [], time.monotonic()
    while (elapsed := time.monotonic() - began) < FLOODED:
        while len(sent) < RATE * elapsed:
            sent.append(observer.send(0.6, z + 0.2 * (1.0 - elapsed / FLOODED)))
        observer.serve(0.0005)
    sent.append(observer.send(0.6, z))
    return sent


def memory(child) -> int:
    """Resident bytes of a process."""
    pages = Path(f"/proc/{child.process.pid}/statm").read_text().split()[1]
    return int(pages) * 4096


def flood_and_measure(observer, verdicts, planner, heights) -> list[int]:
    """Check a flood to each of the heights [m]; the planner's memory [bytes] after each."""
    sizes = []
    for z in heights:
        sent = flood(observer, z)
        observer.until(lambda newest=sent[-1]: newest in observer.verdicts, 20.0)
        newest = observer.verdicts[sent[-1]]
        assert newest.code is Verdict.OK, newest.sentence
        assert observer.ending_of(newest).outcome is Outcome.REACHED
        assert max(verdicts.values()) == 1
        codes = Counter(observer.verdicts[s].code for s in sent if s in observer.verdicts)
        assert set(codes) <= {Verdict.OK, Verdict.SUPERSEDED}
        sizes.append(memory(planner))
    return sizes


@pytest.fixture
def flooded_planner(observer, start_simulator, start_planner):
    """A planner with default settings beside an arm that reports its reference."""
    start_simulator()
    planner = start_planner("--ros-args")
    observer.until(lambda: observer.is_matched and len(observer.references) > 0)
    return planner


def test_in_a_flood_the_newest_goal_is_executed_and_memory_stays(
    observer, verdicts, flooded_planner
):
    sizes = flood_and_measure(observer, verdicts, flooded_planner, (0.2, -0.1, 0.1))
    assert sizes[2] - sizes[0] < 2 * LARGEST_GROWTH
    assert observer.largest_reference_step() < 1e-3
    applied = [each for each in observer.hand_overs if each.outcome == "applied"]
    assert max(each.position_jump for each in applied) <= 1e-6


@pytest.mark.slow
def test_memory_no_longer_grows_after_eight_floods(observer, verdicts, flooded_planner):
    sizes = flood_and_measure(observer, verdicts, flooded_planner, (0.2, -0.1, 0.1) * 4)
    assert sizes[11] - sizes[7] < LARGEST_LATE_GROWTH, sizes
