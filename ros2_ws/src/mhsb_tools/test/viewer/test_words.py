from mhsb_model.goal import Goal
from mhsb_model.verdict import ExecutionReport, GoalVerdict, Outcome, PlanSummary, Verdict
from mhsb_tools.viewer.panel import describe_report

PLAN = PlanSummary(7, 332.4, 400.0, 4.2, 1, 64.3, 300.0)


def test_an_accepted_goal_is_told_with_what_it_costs():
    words = describe_report(GoalVerdict(Verdict.OK, "the tip goes there", Goal(1, 0.6, 0.3), PLAN))
    assert words == (
        "OK (0.600, 0.300) m: the tip goes there; 332 J, 1 mode switches, planned in 64 ms"
    )


def test_a_refusal_and_an_end_are_told_in_their_sentences():
    refusal = GoalVerdict(Verdict.ZONE, "it is in a zone", Goal(1, 0.6, 0.3))
    assert describe_report(refusal) == "ZONE (0.600, 0.300) m: it is in a zone"
    end = ExecutionReport(Outcome.STOPPED, "the arm was stopped", 1, 2)
    assert describe_report(end) == "stopped: the arm was stopped"
