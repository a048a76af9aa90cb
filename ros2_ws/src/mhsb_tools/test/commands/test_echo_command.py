"""JSON that `mhsb echo` and `mhsb param` print."""

import json

from mhsb_tools.commands.echo_command import format_json


def test_numbers_that_json_does_not_have_are_null():
    nan, infinite = float("nan"), float("inf")
    content = {"goal_psi_min": nan, "weights": [1.0, -infinite, [nan]], "name": "NaN", "count": 3}

    def refuse(name):
        raise AssertionError(name)

    assert json.loads(format_json(content), parse_constant=refuse) == {
        "goal_psi_min": None,
        "weights": [1.0, None, [None]],
        "name": "NaN",
        "count": 3,
    }
