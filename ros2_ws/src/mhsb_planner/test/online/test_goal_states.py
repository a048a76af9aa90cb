"""The table of states and events is what the lifecycle does, in every cell."""

import pytest

from mhsb_model.arm_reports import HandOverReason
from mhsb_model.goal import Goal
from mhsb_model.obstacles.zones import Zones
from mhsb_model.verdict import GoalVerdict
from mhsb_planner.errors import DeadlineError, NoPathError
from mhsb_planner.online.arm_state import NO_PLAN
from mhsb_planner.online.goal_states import GOAL_TRANSITIONS, GoalState
from mhsb_planner.online.pending_goal import keep_settings
from mhsb_planner.online.settings import Settings

UP, DOWN = (0.55, 0.60), (0.55, -0.60)


class Case:
    """A world with one goal, which is brought into a state."""

    def __init__(self, world, state):
        self.world, self.life = world, world.life
        world.reachable = state is not GoalState.WAITING
        world.planning_time = 0.5 if state is GoalState.PLANNING else 0.02
        world.lost = 99 * (state in (GoalState.UNCONFIRMED, GoalState.REVOKED))
        self.goal = self.add_goal(1, UP)
        if state in (GoalState.EXECUTING, GoalState.STOPPING):
            world.pass_time_until(lambda: world.arm.is_moving)
            world.pass_time(1.0)
        elif world.lost:
            world.pass_time_until(lambda: bool(world.sent))
        if state in (GoalState.REVOKED, GoalState.STOPPING):
            self.stop()
        assert self.state is state
        self.before = state

    @property
    def state(self):
        """The first state that applies; several may, since several plans may be made for a goal."""
        state = self.life.state
        if self.goal.has_ended:
            return GoalState.ENDED
        if state.executes(self.goal):
            return GoalState.STOPPING if self.life.is_stopping else GoalState.EXECUTING
        if state.request is not None and state.request.pending_goal is self.goal:
            return GoalState.PLANNING
        if state.waiting is self.goal:
            return GoalState.WAITING
        sent = state.unconfirmed
        return GoalState.REVOKED if sent is None or sent.is_void else GoalState.UNCONFIRMED

    def add_goal(self, stamp, place):
        return self.life.add_goal(Goal.at(stamp, place))

    def stop(self):
        self.life.stop(lambda success, sentence: None)

    def answer(self, answer):
        """Answer the request that was made for the goal, or one that nobody waits for."""
        requests = self.world.planned
        trial = self.life.planning.build_trial_request
        request = requests[-1] if requests else trial(self.goal.goal, keep_settings)
        self.life.handle_plan_answer(request, answer(request) if callable(answer) else answer)

    def wait(self, *states):
        """Let time pass until the goal has left its state, if it is one of these."""
        if self.before in states:
            self.world.pass_time_until(lambda: self.state is not self.before)

    def refuse(self, reason):
        self.life.handle_plan_refusal(self.goal.plan_stamp_ns, reason, str(reason))

    # --- Events that take more than one call -----------------------------------------------------

    def become_reachable(self):
        self.world.reachable = True
        self.life.tick()

    def freeze(self):
        if self.before is GoalState.WAITING:
            self.world.arm.frozen = True
            self.wait(GoalState.WAITING)

    def miss_last_deadline(self):
        self.goal.horizon_factor, self.goal.late_plans_at_longest_horizon = 1e3, 2
        self.answer(DeadlineError("nothing was found"))

    def execute_newer_goal(self):
        if self.before is GoalState.EXECUTING:
            self.add_goal(2, DOWN)
            self.wait(GoalState.EXECUTING)

    def drop_plan(self):
        self.world.report_delay = 9.0
        if self.before is GoalState.EXECUTING:
            self.world.arm.stop_at_once()
            self.wait(GoalState.EXECUTING)

    def set_zone(self):
        motion = self.world.arm.command.trajectory
        x, z = self.world.machine.tip_position(motion.position[-1])
        zones = Zones(tip_circles=((float(x), float(z), 0.03),))
        settings = self.life.state.settings
        changed = Settings(settings.machine.changed(zones=zones), settings.options)
        if self.world.arm.is_moving:
            self.life.change_settings(changed)

    def change_payload(self):
        settings = self.life.state.settings
        self.life.change_settings(Settings(settings.machine.changed(payload=5.0), settings.options))

    def stay_in_motion(self):
        self.world.stop_arm = lambda on_answer: False
        self.world.arm.frozen = self.before in (GoalState.REVOKED, GoalState.STOPPING)
        self.wait(GoalState.REVOKED, GoalState.STOPPING)

    def stop_by_somebody(self):
        self.world.arm.stop_at_once()
        self.life.handle_plan_in_force(NO_PLAN)
        self.life.handle_arm_stop(self.world.arm.clock_ns)


EVENTS = {
    "nothing is in the way of planning": Case.become_reachable,
    "no state of the arm is received for 2 s": Case.freeze,
    "a newer goal comes": lambda case: case.add_goal(2, DOWN),
    "the plan is ready": lambda case: case.answer(
        lambda request: request.make_plan(case.world.replanner)
    ),
    "planning finds that the arm is there": lambda case: case.answer(None),
    "planning finds nothing in time": lambda case: case.answer(DeadlineError("too late")),
    "the third time at the longest commit horizon": Case.miss_last_deadline,
    "planning finds that there is no motion": lambda case: case.answer(NoPathError(UP, DOWN)),
    "planning fails": lambda case: case.answer(ValueError("a fault")),
    "the arm confirms the plan": lambda case: case.life.handle_plan_in_force(
        case.goal.plan_stamp_ns
    ),
    "the arm refuses the plan as late": lambda case: case.refuse(HandOverReason.LATE),
    "the arm refuses the plan since it is elsewhere": lambda case: case.refuse(HandOverReason.JUMP),
    "the arm refuses the plan as invalid": lambda case: case.refuse(HandOverReason.INVALID),
    "the arm refuses the plan since it was stopped": lambda case: case.refuse(
        HandOverReason.STOPPED
    ),
    "the plan has ended at the goal": lambda case: case.wait(GoalState.EXECUTING),
    "a plan for a newer goal is confirmed": Case.execute_newer_goal,
    "the arm follows a foreign plan": lambda case: case.life.handle_plan_in_force(77),
    "the arm has dropped the plan for 1 s": Case.drop_plan,
    "the planner is asked to stop": Case.stop,
    "the goal is cancelled": lambda case: case.life.cancel(case.goal),
    "a zone is set across the motion": Case.set_zone,
    "the arm has come to rest": lambda case: case.wait(GoalState.REVOKED, GoalState.STOPPING),
    "the arm does not stop": Case.stay_in_motion,
    "somebody stops the arm": Case.stop_by_somebody,
    "the arm took the plan after somebody stopped it": lambda case: (
        case.before is GoalState.EXECUTING and case.life.handle_arm_stop(case.world.arm.clock_ns)
    ),
    "the arm reports a fault": lambda case: case.life.handle_arm_fault("a pump failed"),
    "the clock jumps": lambda case: case.life.handle_clock_jump("the clock went back"),
    "settings change": lambda case: case.life.change_settings(
        Settings(
            case.life.state.settings.machine.changed(payload=5.0), case.life.state.settings.options
        )
    ),
}


def test_every_event_of_the_table_is_tried():
    assert list(EVENTS) == list(GOAL_TRANSITIONS)


@pytest.mark.parametrize("state", [each for each in GoalState if each is not GoalState.ENDED])
@pytest.mark.parametrize("event", GOAL_TRANSITIONS)
def test_an_event_does_to_a_goal_what_the_table_says(world, event, state):
    case = Case(world, state)
    told = len(world.reports)
    EVENTS[event](case)
    reports = [each for each in world.reports[told:] if each.goal_stamp_ns == 1]
    codes = [each.code if isinstance(each, GoalVerdict) else each.outcome for each in reports]
    transition = GOAL_TRANSITIONS[event].get(state)
    wanted = (
        (state, [])
        if transition is None
        else (transition.next_state, [] if transition.report is None else [transition.report])
    )
    assert (case.state, codes) == wanted


def test_a_goal_that_has_ended_gets_no_further_report_whatever_happens(world):
    case = Case(world, GoalState.EXECUTING)
    world.pass_time_until(lambda: case.state is GoalState.ENDED)
    case.before, told = GoalState.ENDED, len(world.reports)
    for event in EVENTS.values():
        event(case)
        assert case.state is GoalState.ENDED
    assert [each for each in world.reports[told:] if each.goal_stamp_ns == 1] == []
