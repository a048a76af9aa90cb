"""Publishers that are best effort or volatile are heard all the same, once, and named."""

import pytest
from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import UInt8MultiArray

from mhsb_model.goal import Goal
from mhsb_model.trajectory import MotionState
from mhsb_model.verdict import Verdict
from mhsb_msgs_py import goal_pose, joint_state, qos, reference, topics
from mhsb_msgs_py.joint_state import JointSample
from mhsb_msgs_py.matching import MatchingSubscriptions
from mhsb_msgs_py.node_process import run_ros, serve_node, spin_until
from mhsb_msgs_py.reference import Reference

UP = 0.55, 0.40
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
VOLATILE = QoSProfile(depth=10, durability=DurabilityPolicy.VOLATILE)


class MicroArm:
    """A resting arm as a micro controller publishes it, and no hydraulics."""

    def __init__(self, observer):
        self.observer = observer
        topics_of_arm = topics.REFERENCE, topics.JOINT_STATES, topics.MODES, topics.PLAN_IN_FORCE
        profiles = BEST_EFFORT, BEST_EFFORT, VOLATILE, VOLATILE
        self.publishers = [
            observer.create_publisher(topic.message, topic.name, profile)
            for topic, profile in zip(topics_of_arm, profiles, strict=True)
        ]
        self.posture = observer.machine.config.simulation.start_posture
        observer.create_timer(0.02, self.publish)

    def publish(self):
        machine, stamp_ns = self.observer.machine, self.observer.get_clock().now().nanoseconds
        state = MotionState.at_rest(self.posture)
        messages = (
            reference.encode(Reference(stamp_ns, state), machine.joint_names),
            joint_state.encode(
                JointSample(stamp_ns, state.position, state.velocity, None), machine.joint_names
            ),
            UInt8MultiArray(data=[0, 0, 0]),
            Time(),
        )
        for publisher, message in zip(self.publishers, messages, strict=True):
            publisher.publish(message)


def test_an_arm_that_publishes_best_effort_and_volatile_is_planned_for(observer, start_planner):
    planner = start_planner()
    MicroArm(observer)
    observer.until(lambda: observer.is_matched)
    verdict = observer.request_verdict(*UP)
    assert verdict.code is not Verdict.NO_STATE, verdict.sentence
    planner.wait_for("reference of .* is best effort, not reliable")
    planner.wait_for("modes of .* is volatile, not transient local")


def test_a_goal_of_a_best_effort_publisher_gets_its_one_verdict(arm):
    publisher = arm.create_publisher(topics.GOAL_POSE.message, topics.GOAL_POSE.name, BEST_EFFORT)
    arm.until(lambda: publisher.get_subscription_count() >= 1)
    stamp_ns = arm.get_clock().now().nanoseconds
    publisher.publish(goal_pose.encode(Goal(stamp_ns, *UP)))
    arm.until(lambda: stamp_ns in arm.verdicts)
    assert arm.verdicts[stamp_ns].code is Verdict.OK
    verdict = arm.request_verdict(0.6, 0.2)
    assert verdict.code is Verdict.OK, verdict.sentence


class Listener(Node):
    """Hears goals as the planner does."""

    def __init__(self):
        super().__init__("listener")
        self.heard = []
        self.matching = MatchingSubscriptions(self)
        self.matching.add(
            topics.GOAL_POSE, lambda message, info: self.heard.append(message), at_once=True
        )


@pytest.mark.parametrize("first", [BEST_EFFORT, qos.DEFAULT])
def test_of_a_reliable_and_a_best_effort_publisher_each_message_is_heard_once(ros_domain, first):
    topic = topics.GOAL_POSE
    second = qos.DEFAULT if first is BEST_EFFORT else BEST_EFFORT
    with run_ros([]), serve_node(Listener) as (executor, node):
        publishers = [node.create_publisher(topic.message, topic.name, p) for p in (first, second)]
        assert spin_until(executor, lambda: bool(node.matching.problem), 10.0)
        assert spin_until(
            executor, lambda: all(each.get_subscription_count() for each in publishers), 10.0
        )
        spin_until(executor, lambda: False, 0.5)
        for k in range(20):
            for number, publisher in enumerate(publishers):
                publisher.publish(goal_pose.encode(Goal(0, k + 0.25, number)))
                spin_until(executor, lambda: False, 0.01)
        assert spin_until(executor, lambda: len(node.heard) >= 40, 5.0)
        spin_until(executor, lambda: False, 0.3)
        places = [(each.pose.position.x, each.pose.position.z) for each in node.heard]
        assert len(places) == len(set(places)) == 40
        for publisher in publishers:
            node.destroy_publisher(publisher)
        spin_until(executor, lambda: False, 0.5)
        node.matching.update()
        assert node.matching.problem == ""
