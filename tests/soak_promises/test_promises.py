"""The whole list of promises, on a minute that keeps them all."""

from __future__ import annotations

import pytest
from tests.soak.promises import PROMISES
from tests.soak.soak_command import as_text, summary


@pytest.mark.parametrize("name", PROMISES)
def test_a_quiet_minute_keeps_every_promise(events, name):
    kept = PROMISES[name](events)
    assert kept.is_kept, kept.violations


def test_most_of_them_are_put_to_the_test_by_it(events):
    untested = {name for name, look in PROMISES.items() if look(events).tested == 0}
    assert untested == {"what memory is kept stays within 5 MB after four minutes"}


def test_the_summary_says_of_each_whether_it_held(spoilt):
    broken = spoilt(recording={"reports": ()})
    kept = {name: look(broken) for name, look in PROMISES.items()}
    told = summary(broken, kept, 1.0, 0)
    assert told["held"] is False
    held = {each["promise"]: each["held"] for each in told["promises"]}
    assert held["every goal gets exactly one verdict"] is False
    assert held["joint limits are kept"] is True
    assert told["deeds"]["goal planner"] == 2
    text = "\n".join(as_text(kept))
    assert "every goal gets exactly one verdict: BROKEN (2 cases)" in text
    assert "four minutes: not put to the test" in text
