"""Wrong values of a page are refused in one sentence, and the next right ones are used."""

import asyncio
import math

import pytest
from viser._messages import GuiUpdateMessage

from mhsb_model.machine import load_machine
from mhsb_tools.viewer.panel import Panel, make_initial_goal
from mhsb_tools.viewer.server import open_server

WRONG = (
    None, "x" * 300, math.nan, math.inf, -1e300, 10**400, [], {}, {"a": 1}, [[1.0]],
    [1.0, None, 2.0], b"bytes", [1.0] * 2, ["a", "b", "c"],
)  # fmt: skip


class Kept:
    """What the controls ask for, kept."""

    def __init__(self):
        self.goals, self.settings = [], []

    def go(self, *place):
        self.goals.append(place)

    def stop(self):
        pass

    def set_planner(self, changes):
        self.settings.append(changes)

    def show_abilities(self, velocities, regions):
        pass


@pytest.fixture
def page():
    """A server with its controls, and what it has refused."""
    server = open_server("127.0.0.1", 0)
    panel = Panel(server, ("table", "integrated"), Kept(), make_initial_goal(load_machine()))
    yield server, panel
    server.stop()


def send(server, handle, updates):
    message = GuiUpdateMessage(handle._impl.uuid, updates)
    asyncio.run(server._websock_server._handle_incoming_message(0, message))


@pytest.mark.parametrize("value", WRONG, ids=lambda value: str(value)[:12])
def test_a_wrong_value_of_any_field_is_no_traceback_and_the_next_right_one_is_used(
    page, value, capfd
):
    server, panel = page
    fields = [*panel._numbers.values(), panel._payload, panel._weights]
    for field in fields:
        before = field.value
        send(server, field, {"value": value})
        assert field.value == before or all(map(math.isfinite, field.value))
    send(server, panel._payload, {"value": 3})
    assert panel._payload.value == 3.0
    said = capfd.readouterr()
    assert "Traceback" not in said.out + said.err
    if not isinstance(value, list):
        assert "what the page has sent is not used" in panel._sentence_list._text.content


@pytest.mark.parametrize("updates", [{"update_cb": 5}, {"removed": True, "value": 1.0}, {7: 1.0}])
def test_nothing_but_a_value_can_be_changed_from_a_page(page, updates):
    server, panel = page
    send(server, panel._payload, updates)
    assert "is no value" in panel._sentence_list._text.content
    send(server, panel._payload, {"value": 4.0})
    assert panel._payload.value == 4.0
