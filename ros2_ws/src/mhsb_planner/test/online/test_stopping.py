"""Stopping is a state of the arm: success is answered when it rests, or brakes and will rest."""

import numpy as np
import pytest

from mhsb_model.trajectory import MotionState
from mhsb_model.verdict import Outcome
from mhsb_planner.online.arm_state import NO_PLAN
from mhsb_planner.online.rest_detector import REST_SPEED, REST_TIME, RestDetector

UP, DOWN = (0.55, 0.60), (0.55, -0.60)


class Stop:
    """A stop that a test asks for, its answer, and when it came."""

    def __init__(self, world):
        self.world, self.began, self.answers = world, world.now, []
        world.life.stop(lambda *answer: self.answers.append((*answer, world.now)))

    def result(self):
        """Success and sentence, once answered; exactly once."""
        self.world.pass_time_until(lambda: bool(self.answers))
        [(success, sentence, at)] = self.answers
        self.took = at - self.began
        return success, sentence


def under_way(world) -> int:
    stamp = world.send_goal(*UP)
    world.pass_time_until(lambda: world.arm.is_moving)
    world.pass_time(1.0)
    return stamp


def forget(world):
    """Let the planner be another one, which knows nothing of what it has sent."""
    world.life.handle_clock_jump("the planner was started anew")


def silence_stop(world):
    """Let the arm have no ~/stop of its own."""
    world.stop_arm = lambda answered: False


def test_an_own_plan_is_braked_and_the_arm_rests_within_the_stated_time(world):
    stamp = under_way(world)
    stop = Stop(world)
    success, sentence = stop.result()
    assert success
    assert world.arm.is_moving
    stated = float(sentence.removeprefix("the arm stands still in ").removesuffix(" s"))
    world.pass_time(stated)
    assert not world.arm.is_moving
    assert world.execution_report(stamp).outcome is Outcome.STOPPED
    assert world.asked_arm_to_stop == 0


def test_a_plan_of_somebody_else_is_stopped_by_the_arm_itself(world):
    under_way(world)
    forget(world)
    stop = Stop(world)
    assert stop.result() == (True, "the arm stands still")
    assert world.asked_arm_to_stop == 1
    assert not world.arm.is_moving


def test_an_arm_at_rest_is_asked_all_the_same_since_others_plans_may_be_on_their_way(world):
    for _ in range(3):
        stop = Stop(world)
        assert stop.result() == (True, "the arm stands still")
        assert stop.took < REST_TIME + 0.1
    assert world.asked_arm_to_stop == 3


def test_a_goal_after_a_stop_is_not_taken_for_one_that_the_arms_stop_has_voided(world):
    under_way(world)
    forget(world)
    Stop(world).result()
    assert world.execution_report(world.send_goal(*DOWN)).outcome is Outcome.REACHED


def test_somebody_elses_stop_counts_also_right_after_an_own_call(world):
    Stop(world).result()
    world.pass_time(0.1)
    stamp = world.send_goal(*UP)
    world.pass_time_until(lambda: world.arm.is_moving)
    world.arm.stop_at_once()
    assert world.execution_report(stamp).sentence == "the arm was asked to stop"


def test_where_the_arms_topics_have_several_publishers_the_arm_itself_is_asked(world):
    stamp = under_way(world)
    world.life.arm_state.publisher_conflict = "reference comes from 2 publishers"
    stop = Stop(world)
    assert stop.result()[0]
    assert world.asked_arm_to_stop == 1
    assert not world.arm.is_moving
    assert world.execution_report(stamp).outcome is Outcome.STOPPED


def test_an_arm_that_moves_and_cannot_be_asked_is_an_error_with_its_reason(world):
    under_way(world)
    forget(world)
    silence_stop(world)
    stop = Stop(world)
    success, sentence = stop.result()
    assert not success
    assert "~/stop is not there" in sentence
    assert "rad/s" in sentence
    assert stop.took <= 5.1


def test_a_refusal_of_the_arm_is_told(world):
    under_way(world)
    forget(world)

    def refuse(answered):
        world.schedule(0.01, lambda: answered(False, "the simulation has diverged"))
        return True

    world.stop_arm = refuse
    assert Stop(world).result() == (False, "the arm does not stop: the simulation has diverged")


def test_an_arm_without_a_stop_of_its_own_is_believed_at_rest(world):
    silence_stop(world)
    stop = Stop(world)
    assert stop.result() == (True, "the arm stands still")
    assert stop.took < 0.1


def test_a_silent_arm_is_an_error(world):
    world.arm.frozen = True
    world.pass_time(1.0)
    success, sentence = Stop(world).result()
    assert not success
    assert "not answered within 5 s" in sentence
    assert "nothing was measured" in sentence


def test_a_fault_while_the_arm_brakes_does_not_end_the_stop_before_the_arm_rests(world):
    under_way(world)
    world.arm.fault = "a pump failed"
    world.pass_time(0.01)
    stop = Stop(world)
    world.pass_time(0.02)
    assert not stop.answers or not world.arm.is_moving
    assert stop.result()[0]
    assert not world.arm.is_moving


def test_an_arm_that_is_slowed_is_answered_for_when_it_rests(world):
    under_way(world)
    world.arm.speed_scaling = 0.5
    world.pass_time(0.5)
    stop = Stop(world)
    assert stop.result() == (True, "the arm stands still")
    assert np.abs(world.arm.reference.velocity).max() < REST_SPEED
    world.pass_time(0.3)
    assert not world.arm.is_moving
    assert world.life.arm_state.plan_in_force_ns == NO_PLAN


@pytest.mark.parametrize("gap", [0.01, 0.05])
def test_rest_is_measured_for_a_while_by_everybody_who_measures(gap):
    rest, still = RestDetector(), MotionState.at_rest(np.zeros(3))
    for now in np.arange(0.0, 1.0, gap):
        rest.add_measurement(still, now)
        assert rest.is_at_rest(now) == (now >= REST_TIME - 1e-9)
    for now in np.arange(1.0, 2.0, gap):  # two arms under one name, of which one moves
        rest.add_measurement(still, now)
        rest.add_measurement(moving(np.array([0.0, -0.2, 0.0]), now), now)
        assert not rest.is_at_rest(now)
    assert not rest.is_at_rest(now + 1.0)


def test_an_arm_that_vibrates_rests_and_one_that_creeps_or_reverses_does_not():
    vibrating, creeping, reversing = RestDetector(), RestDetector(), RestDetector()
    for now in np.arange(0.0, 1.0, 0.01):
        state = MotionState(3e-5 * np.ones(3), 0.03 * np.ones(3), np.zeros(3))
        vibrating.add_measurement(state, now)
        creeping.add_measurement(moving(np.full(3, 1.1 * REST_SPEED), now), now)
        position, velocity = 0.05 * np.cos(3.0 * now), -0.15 * np.sin(3.0 * now)
        swings = MotionState(position * np.ones(3), velocity * np.ones(3), np.zeros(3))
        reversing.add_measurement(swings, now)
        assert not reversing.is_at_rest(now)
        assert not creeping.is_at_rest(now)
    assert vibrating.is_at_rest(now)


def moving(velocity, time):
    """State of joints that move with a constant velocity."""
    return MotionState(velocity * time, velocity, 0.0 * velocity)


def test_a_goal_whose_plan_was_revoked_by_a_stop_moves_nothing_after_a_clock_jump(world):
    world.lost = 1  # the plan is still unconfirmed when the clock jumps
    stamp = world.send_goal(*UP)
    world.pass_time_until(lambda: bool(world.sent))
    answers = []
    world.life.stop(lambda success, sentence: answers.append(success))
    world.life.handle_clock_jump("the clock went back")
    world.pass_time(5.0)
    assert answers == [True]
    assert world.execution_report(stamp).outcome is Outcome.STOPPED
    assert len(world.sent) == 1
    assert not world.arm.is_moving
