"""SIGINT and SIGTERM at any moment of a node's life: code 0, and not a word of a traceback.

What starts a node blocks both signals until the node can answer them; only within the first
milliseconds, before `env` has blocked them, do they end it in the system's own way.
"""

import random
import signal
import time

import pytest

from mhsb_model.verdict import Verdict

NODES = [("mhsb_sim", "sim_node"), ("mhsb_planner", "planner_node"), ("mhsb_sim", "record")]
FIRST, LAST = 0.05, 3.0
"""When signals come [s]: from just after the start to well after the node serves."""


@pytest.fixture
def trouble_at(start, tmp_path):
    """Function (node, moment [s], signal, folder of kernels): how a node ends that is started and
    sent a signal, where not with code 0 and without a traceback; else nothing."""

    def run(node, moment, signal_number, kernels=None):
        arguments = ("--output", tmp_path / f"bag_{moment}") if node[1] == "record" else ()
        chosen = {} if kernels is None else {"NUMBA_CACHE_DIR": str(kernels)}
        child = start(*node, *arguments, environment=chosen)
        time.sleep(moment)
        code = child.stop(signal_number)
        clean = code == 0 and "Traceback" not in child.output
        return "" if clean else f"code {code} after {moment:.2f} s:\n{child.output}"

    return run


def moments(count: int, seed: int, last: float = LAST) -> list[float]:
    """One random moment in each of so many equal parts of the time; seeded [s]."""
    rng = random.Random(seed)
    part = (last - FIRST) / count
    return [FIRST + (index + rng.random()) * part for index in range(count)]


@pytest.mark.parametrize("node", NODES, ids=lambda node: node[1])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda each: each.name)
def test_a_signal_at_any_moment_ends_a_node_with_code_0(trouble_at, node, number):
    for moment in moments(2, seed=number):
        assert trouble_at(node, moment, number) == ""


@pytest.mark.parametrize("node", NODES[:2], ids=lambda node: node[1])
def test_a_signal_while_kernels_are_compiled_ends_a_node_with_code_0(trouble_at, node, tmp_path):
    for moment in moments(2, seed=3, last=5.0):
        assert trouble_at(node, moment, signal.SIGINT, tmp_path / "kernels") == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda each: each.name)
def test_a_signal_while_a_plan_is_made_ends_both_nodes_with_code_0(
    observer, start_planner, start_simulator, number
):
    simulator, planner = start_simulator(), start_planner()
    observer.until(lambda: observer.matched and len(observer.references) > 0)
    assert observer.ask(0.55, 0.60).code is Verdict.OK
    observer.send(0.55, -0.60)
    observer.serve(0.02)
    for child in (planner, simulator):
        child.process.send_signal(number)
        assert child.stop(number) == 0, child.output  # the second one changes nothing
        assert "Traceback" not in child.output


@pytest.mark.slow
@pytest.mark.parametrize("node", NODES, ids=lambda node: node[1])
@pytest.mark.parametrize("cold", [False, True], ids=["warm", "cold"])
def test_fifty_signals_over_the_first_eight_seconds(trouble_at, node, cold, tmp_path):
    for index, moment in enumerate(moments(50, seed=8, last=8.0)):
        number = (signal.SIGINT, signal.SIGTERM)[index % 2]
        kernels = tmp_path / str(index) if cold else None
        assert trouble_at(node, moment, number, kernels) == ""
