"""The first start ever: compiling tells how far it is, and is over when a node is ready."""

import pytest

from mhsb_model.verdict import Outcome, Verdict

NODES = (("mhsb_sim", "sim_node"), ("mhsb_planner", "planner_node"))
TOLD = "compiling kernels, which happens once"
GOALS = ((0.55, 0.60), (0.55, -0.60), (0.80, 0.30))
READY_TIMEOUT = 400.0  # s


@pytest.mark.slow
def test_both_nodes_tell_how_compiling_goes_and_compile_nothing_once_they_are_ready(
    observer, start, tmp_path
):
    kernels = tmp_path / "kernels"
    children = [start(*node, environment={"NUMBA_CACHE_DIR": str(kernels)}) for node in NODES]
    for child in children:
        child.wait_for("ready", READY_TIMEOUT)
        told = [line for line in child.output.splitlines() if TOLD in line]
        assert len(told) >= 2
        assert told[0].split(TOLD)[1].startswith(": 0 of ")
    observer.until(lambda: observer.is_matched and len(observer.references) > 0)
    compiled = set(kernels.rglob("*.nbc"))
    assert compiled

    for planner in ("integrated", "table", "fixed"):
        assert observer.set_parameter("mhsb_planner", "planner", planner)[0]
        for x, z in GOALS:  # at rest, then in motion
            verdict = observer.request_verdict(x, z)
            assert verdict.code is Verdict.OK, verdict.sentence
            observer.serve(1.0)
    assert observer.set_parameter("mhsb_planner", "payload", 6.0)[0]
    assert observer.set_parameter("mhsb_planner", "zone_boxes", (0.65, 0.1, 0.95, 0.3))[0]
    observer.request_verdict(*GOALS[0])  # the arm may be in the zone by now: whatever comes of it
    assert observer.call("mhsb_planner/stop").success
    assert observer.set_parameter("mhsb_planner", "zone_boxes", ())[0]
    assert observer.set_parameter("mhsb_planner", "planner", "integrated")[0]
    verdict = observer.request_verdict(*GOALS[1])
    assert verdict.code is Verdict.OK, verdict.sentence
    assert observer.call("mhsb_sim/stop").success
    observer.ending_of(verdict)
    assert observer.call("mhsb_sim/reset").success
    verdict = observer.request_verdict(*GOALS[0])
    assert observer.ending_of(verdict).outcome is Outcome.REACHED

    assert [file.name for file in kernels.rglob("*.nbc") if file not in compiled] == []
