"""What the arm learns, over real DDS: published, and planned with."""

import pytest

from mhsb_model.arm_reports import Estimate
from mhsb_model.verdict import Verdict
from mhsb_msgs_py import estimates, topics

UP = (0.55, 0.60)


@pytest.fixture
def arm(observer, start_simulator, start_planner):
    """Nodes of which none has learnt anything yet."""
    start_simulator()
    start_planner()
    observer.until(lambda: observer.is_matched and len(observer.references) > 2)
    return observer


def test_what_the_arm_has_learnt_is_told_and_planned_with_once_it_is_known_well(arm):
    heard, payloads = [], []
    topic, health = topics.ESTIMATES, topics.DIAGNOSTICS
    arm.create_subscription(topic.message, topic.name, heard.append, topic.qos)

    def keep_payload(message):
        for status in message.status:
            values = {each.key: each.value for each in status.values}
            if "payload_kg" in values:
                payloads.append(float(values["payload_kg"]))

    arm.create_subscription(health.message, health.name, keep_payload, health.qos)

    # At rest the simulator says what there is to learn, and that it is not known.
    arm.until(lambda: heard)
    told = estimates.decode(heard[-1])
    assert {"payload", "friction", "leakage", "overlap", "valve_gain", "bulk_modulus"} <= {
        each.quantity for each in told
    }
    payload = next(each for each in told if each.quantity == "payload")
    assert payload.value == arm.machine.arrays.payload
    assert not payload.known

    # A wide interval is not planned with, a narrow one is, where the parameter asks for it.
    publisher = arm.create_publisher(topic.message, topic.name, topic.qos)

    def learn(deviation):
        arm.until(lambda: publisher.get_subscription_count() >= 2)
        learnt = [Estimate("payload", "", 8.0, deviation, True)]
        publisher.publish(estimates.encode(learnt, 0))

    assert not arm.set_parameter("mhsb_planner", "payload_from", "guess")[0]
    learn(deviation=0.6)
    taken, reason = arm.set_parameter("mhsb_planner", "payload_from", "estimate")
    assert taken, reason
    payloads.clear()
    arm.until(lambda: payloads)
    assert payloads[-1] == arm.machine.arrays.payload
    learn(deviation=0.2)
    arm.until(lambda: payloads[-1] == 8.0)
    verdict = arm.request_verdict(*UP)
    assert verdict.code is Verdict.OK, verdict.sentence

    # The parameter's own again.
    assert arm.set_parameter("mhsb_planner", "payload_from", "file")[0]
    arm.until(lambda: payloads[-1] == arm.machine.arrays.payload)
