"""Random zones ahead of arms that move, over real DDS: what is said is what is measured."""

import os
import re

import numpy as np
import pytest
from tests.support.zones_ahead import random_zone, read_distance

from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_model.trajectory import SECOND_NS
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import topics, trajectory
from mhsb_planner.cases.moves import draw_random_position

FILES = ("mhsb_arm3", "mhsb_arm4", "telescope_arm", "excavator", "forestry_crane")
ZONES = int(os.environ.get("MHSB_ZONES_AHEAD", "8"))
"""Zones that are set ahead of each arm."""

FOLLOWS = {"forestry_crane": 6e-3}
"""How near to its reference an arm is that sways far out [m]."""

NEAR = 2e-3
"""How near to its reference any other arm is [m]."""


class ZoneTrials:
    """Sends goals, sets a zone ahead on the way, and keeps what is said and what is measured."""

    def __init__(self, arm, random):
        self.arm, self.random = arm, random
        self.kept = {}
        topic = topics.JOINT_TRAJECTORY
        arm.create_subscription(topic.message, topic.name, self._keep, topic.qos)

    def _keep(self, message):
        plan = trajectory.decode(message, self.arm.machine.joint_names)
        self.kept[plan.stamp_ns] = plan

    def run(self):
        """One trial: what was said, the least clearance, that at rest; None without a contact."""
        arm, random = self.arm, self.random
        verdict = arm.request_verdict(*draw_random_position(arm.machine, random))
        if verdict.code is not Verdict.OK or verdict.plan.continued:
            return None
        arm.until_in_force(verdict)
        arm.until(lambda: arm.in_force_ns in self.kept)
        plan = self.kept[arm.in_force_ns]
        arm.serve(random.uniform(0.0, 0.85) * plan.duration_ns / SECOND_NS)
        zones = random_zone(arm.machine, plan, arm.references[-1].stamp_ns, random)
        if zones is None:
            arm.ending_of(verdict)
            return None
        [(field, (zone,))] = [(name, each) for name, each in vars(zones).items() if each]
        name = f"tip_zone_{field[4:]}" if field.startswith("tip_") else f"zone_{field}"
        arm.measured.clear()
        taken, reason = arm.set_parameter("mhsb_planner", name, zone)
        assert taken, reason
        ending = arm.ending_of(verdict)
        arm.until(lambda: not arm.references[-1].state.velocity.any())
        arm.serve(0.5)
        crowded = arm.machine.changed(zones=zones)
        clearances = [crowded.clearance(each.position)[0] for each in arm.measured]
        arm.set_parameters_back()
        if ending.outcome is not Outcome.STOPPED:
            return None
        return ending.sentence, min(clearances), clearances[-1]


def is_true(sentence, deepest, rest, near):
    """Whether the sentence of an execution report says what was measured, to `near` m."""
    if sentence.endswith("the arm stops before it"):
        return deepest > 0.0
    if found := re.search(r"its reference rests ([\d.]+ m?m) before it", sentence):
        return abs(rest - read_distance(found[1])) < near
    if found := re.search(r"comes to rest ([\d.]+ m?m) deep in it", sentence):
        return abs(rest + read_distance(found[1])) < near
    return "comes to rest beyond it" in sentence and rest > -near


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_of_zones_ahead_nothing_is_said_that_the_measured_arm_does_not_do(
    observer, start_simulator, start_planner, fresh_seed, name
):
    file = find_config_file(f"{name}.yaml")
    observer.machine = load_machine(file)
    for start in (start_simulator, start_planner):
        start("--ros-args", "-p", f"machine:={file}")
    observer.until(lambda: observer.is_matched and len(observer.references) > 2)
    trials, found = ZoneTrials(observer, np.random.default_rng(fresh_seed)), []
    for _ in range(4 * ZONES):
        trial = trials.run()
        if trial is not None:
            found.append(trial)
            assert is_true(*trial, FOLLOWS.get(name, NEAR)), (fresh_seed, len(found), trial)
        if len(found) == ZONES:
            break
    before = sum("stops before it" in sentence for sentence, _, _ in found)
    print(f"{name}: {before} of {len(found)} before the zone; nearest {min(t[1] for t in found)} m")
    assert len(found) == ZONES
