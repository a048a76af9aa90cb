"""Keep-out zones over real DDS, and the example of their documentation."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from visualization_msgs.msg import Marker

from mhsb_model.files.config_files import find_config_file
from mhsb_model.files.machine_files import MACHINE_FILE
from mhsb_model.machine import Machine
from mhsb_model.obstacles.zones import Zones
from mhsb_model.schema import MachineConfig
from mhsb_model.verdict import Outcome, Verdict
from mhsb_msgs_py import topics, trajectory

UP, AWAY = (0.55, 0.60), (0.45, -0.35)
BOX = (0.65, 0.10, 0.95, 0.30)


class ZoneSetter:
    """Sets zones of the planner in one go, and hears what it plans and shows."""

    def __init__(self, observer):
        self.observer = observer
        self.plans, self.markers = [], []
        for topic, kept in (
            (topics.JOINT_TRAJECTORY, self.plans),
            (topics.MARKERS, self.markers),
        ):
            observer.create_subscription(topic.message, topic.name, kept.append, topic.qos)

    def set(self, **arrays):
        """Set parameters together; whether they were taken, and the reason where not."""
        parameters = [
            Parameter(
                name=name,
                value=ParameterValue(
                    type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=list(values)
                ),
            )
            for name, values in arrays.items()
        ]
        request = SetParametersAtomically.Request(parameters=parameters)
        found = self._call(SetParametersAtomically, "set_parameters_atomically", request).result
        return found.successful, found.reason

    def boxes(self):
        """The planner's `zone_boxes` as they are now."""
        request = GetParameters.Request(names=["zone_boxes"])
        return self._call(GetParameters, "get_parameters", request).values[0].double_array_value

    def shown(self):
        """Boxes and circles in the latest markers, of one frame."""
        latest = self.markers[-1].markers
        return [marker.type for marker in latest if marker.ns == "obstacles_base_link"]

    def plan_of(self, verdict):
        """The trajectory that an accepted goal's verdict names."""
        stamp_ns, names = verdict.plan.plan_stamp_ns, self.observer.machine.joint_names

        def found():
            decoded = (trajectory.decode(message, names) for message in self.plans)
            return [plan for plan in decoded if plan.stamp_ns == stamp_ns]

        self.observer.until(found)
        return found()[0]

    def _call(self, kind, service, request):
        client = self.observer.create_client(kind, f"mhsb_planner/{service}")
        self.observer.until(client.service_is_ready)
        future = client.call_async(request)
        self.observer.until(future.done)
        self.observer.destroy_client(client)
        return future.result()


@pytest.fixture
def setter(arm):
    yield (setter := ZoneSetter(arm))
    assert setter.set(zone_boxes=(), tip_zone_circles=(), tip_zone_boxes=())[0]


def clearance_of(machine, postures):
    return min(machine.clearance(q)[0] for q in postures)


def test_zones_are_set_together_kept_clear_of_and_stopped_at(arm, setter):
    # Both or neither.
    taken, reason = setter.set(zone_boxes=BOX, zone_circles=(0.5, 0.8, -0.1))
    assert not taken
    assert "radius: must be at least 0.0001 m" in reason
    assert list(setter.boxes()) == []
    taken, reason = setter.set(zone_boxes=BOX, tip_zone_circles=(0.30, -0.80, 0.05))
    assert taken, reason
    assert tuple(setter.boxes()) == BOX
    arm.until(lambda: setter.markers and setter.shown() == [Marker.CUBE, Marker.CYLINDER])

    # A goal inside is refused, and the arm stays where it is.
    before = arm.in_force_ns
    refused = arm.request_verdict(0.80, 0.20)
    assert refused.code is Verdict.ZONE
    assert "deep in the keep-out box (0.65, 0.1)" in refused.sentence
    assert arm.in_force_ns == before

    # Beyond it, the motion goes around.
    crowded = arm.machine.changed(zones=Zones(boxes=(BOX,)))
    arm.references.clear()
    verdict = arm.request_verdict(*UP)
    assert verdict.code is Verdict.OK, verdict.sentence
    assert arm.ending_of(verdict).outcome is Outcome.REACHED
    assert clearance_of(crowded, [each.state.position for each in arm.references]) > 0.0

    # A zone set across the way stops the arm before it.
    verdict = arm.request_verdict(*AWAY)
    assert verdict.code is Verdict.OK, verdict.sentence
    arm.until_in_force(verdict)
    plan = setter.plan_of(verdict)
    later = plan.sample(plan.stamp_ns + int(0.8 * plan.duration_ns))
    x, z = arm.machine.tip_position(later.position)
    arm.references.clear()
    taken, reason = setter.set(zone_boxes=(), tip_zone_circles=(x, z, 0.04))
    assert taken, reason
    ending = arm.ending_of(verdict)
    assert ending.outcome is Outcome.STOPPED
    assert "circle of 0.04 m around" in ending.sentence
    assert "was set across the way; the arm stops before it" in ending.sentence
    arm.until(lambda: arm.references and not arm.references[-1].state.velocity.any())
    across = arm.machine.changed(zones=Zones(tip_circles=((x, z, 0.04),)))
    assert clearance_of(across, [each.state.position for each in arm.references]) > 0.0
    assert arm.largest_reference_step() < 1e-3

    # Without zones the goal is reached after all.
    assert setter.set(tip_zone_circles=())[0]
    arm.until(lambda: setter.shown() == [])
    verdict = arm.request_verdict(*AWAY)
    assert verdict.code is Verdict.OK, verdict.sentence
    assert arm.ending_of(verdict).outcome is Outcome.REACHED
    arm.until(lambda: not arm.references[-1].state.velocity.any())
    tip = arm.machine.tip_position(arm.references[-1].state.position)
    assert np.hypot(*(tip - AWAY)) < 1e-4

    # A zone set over the arm is told by name when it leaves it.
    x, z = tip
    taken, reason = setter.set(tip_zone_boxes=(x - 0.05, z - 0.05, x + 0.05, z + 0.05))
    assert taken, reason
    verdict = arm.request_verdict(*UP)
    assert verdict.code is Verdict.OK, verdict.sentence
    assert re.search(r"the arm starts [45]\d(\.\d)? mm deep in the keep-out box", verdict.sentence)
    assert arm.ending_of(verdict).outcome is Outcome.REACHED


@pytest.mark.parametrize(
    ("example", "file", "obstacles"), [(0, MACHINE_FILE, 6), (1, "excavator.yaml", 4)]
)
def test_examples_of_the_documentation_are_sections_that_machine_files_may_have(
    example, file, obstacles
):
    text = (Path(__file__).parents[1] / "docs" / "zones.md").read_text(encoding="utf-8")
    section = yaml.safe_load(re.findall(r"```yaml\n(.*?)```", text, re.DOTALL)[example])
    content = yaml.safe_load(find_config_file(file).read_text(encoding="utf-8")) | section
    machine = Machine.from_config(MachineConfig.model_validate(content))
    assert len(machine.obstacles.names) == obstacles
