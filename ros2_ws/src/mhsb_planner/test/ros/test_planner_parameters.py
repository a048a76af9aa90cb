"""The planner node's parameters: what they ask for, and what is refused."""

import math
import re
from collections.abc import Iterator

import pytest
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from mhsb_model.command_line import UsageError
from mhsb_model.files.config_files import find_config_file
from mhsb_model.machine import load_machine
from mhsb_model.obstacles.zones import Zones
from mhsb_planner.goal_region import BoxRegion, Disc, Segment
from mhsb_planner.planner import PLANNER_KINDS
from mhsb_planner.ros import planner_parameters


@pytest.fixture
def node(ros_context: Context, machine) -> Iterator[Node]:
    node = Node("parameters", context=ros_context)
    planner_parameters.declare_changeable(node, machine)
    yield node
    node.destroy_node()


@pytest.fixture(scope="module")
def excavator():
    return load_machine(find_config_file("excavator.yaml"))


def test_left_alone_they_ask_for_the_machine_s_own_values(node, machine):
    found = planner_parameters.read_settings(node, machine)
    assert node.get_parameter("planner").value == found.options.planner == "integrated"
    assert found.machine.table_hash == machine.table_hash


@pytest.mark.parametrize("kind", PLANNER_KINDS)
def test_the_planner_can_be_chosen(node, machine, kind):
    change = Parameter("planner", value=kind)
    assert planner_parameters.find_refusal(node, machine, [change]) is None
    node.set_parameters([change])
    assert planner_parameters.read_settings(node, machine).options.planner == kind


def test_a_planner_that_is_not_there_is_refused_with_those_that_are(node, machine):
    reason = planner_parameters.find_refusal(node, machine, [Parameter("planner", value="guess")])
    names = ", ".join(PLANNER_KINDS)
    assert reason == f"planner 'guess' is not there; give one of: {names}"


def test_the_area_is_weighed_by_the_integrated_planner_alone(node, machine):
    node.set_parameters([Parameter("planner", value="table")])
    weight = Parameter("area_weight", value=300.0)
    reason = planner_parameters.find_refusal(node, machine, [weight])
    assert reason == (
        "area_weight 300 needs planner 'integrated' (is 'table'); "
        "set it to 0 or choose that planner"
    )
    together = [weight, Parameter("planner", value="integrated")]
    assert planner_parameters.find_refusal(node, machine, together) is None
    node.set_parameters(together)
    assert planner_parameters.read_settings(node, machine).options.area_weight == 300.0


def test_parameters_that_clash_from_the_start_are_refused(ros_context, machine):
    overrides = [Parameter("area_weight", value=300.0), Parameter("planner", value="fixed")]
    node = Node("clashing", context=ros_context, parameter_overrides=overrides)
    with pytest.raises(UsageError, match="area_weight 300 needs planner 'integrated'"):
        planner_parameters.declare_changeable(node, machine)
    node.destroy_node()


def set_zones(node, machine, **values):
    node.set_parameters_atomically([Parameter(name, value=value) for name, value in values.items()])
    return planner_parameters.read_settings(node, machine)


def test_zones_are_flat_arrays_of_numbers_and_replace_those_of_the_file(node, machine):
    assert planner_parameters.read_settings(node, machine).machine.zones == machine.zones == Zones()
    found = set_zones(
        node,
        machine,
        zone_boxes=[0.9, 0.3, 0.7, 0.1, 0.0, 0.9, 0.2, 1.0],
        tip_zone_circles=[1, 0, 1],  # whole numbers will do
    )
    assert found.machine.zones == Zones(
        boxes=((0.7, 0.1, 0.9, 0.3), (0.0, 0.9, 0.2, 1.0)), tip_circles=((1.0, 0.0, 1.0),)
    )
    assert len(found.machine.obstacles.names) == 3
    assert set_zones(node, machine, zone_boxes=[], tip_zone_circles=[]).machine.zones == Zones()


def test_an_arm_that_slews_has_zones_in_space(ros_context, excavator):
    node = Node("slewing", context=ros_context)
    zones = Zones(boxes=((1.8, 0.6, -1.0, 2.2, 1.0, 0.5),), tip_spheres=((2.0, -1.0, 0.3, 0.2),))
    crowded = excavator.changed(zones=zones)
    planner_parameters.declare_changeable(node, crowded)
    assert planner_parameters.read_settings(node, crowded).machine.zones == zones
    found = set_zones(
        node,
        crowded,
        zone_boxes=[1.8, -1.0, -1.0, 2.2, -0.6, 0.5, 1.8, 0.6, -1.0, 2.2, 1.0, 0.5],
        tip_zone_cylinders=[2.0, 1.0, 0.0, 1.0, 0.5],
        tip_zone_spheres=[],
    )
    assert found.machine.zones == Zones(
        boxes=((1.8, -1.0, -1.0, 2.2, -0.6, 0.5), (1.8, 0.6, -1.0, 2.2, 1.0, 0.5)),
        tip_cylinders=((2.0, 1.0, 0.0, 1.0, 0.5),),
    )
    assert len(found.machine.obstacles.names) == 3
    node.destroy_node()


def test_the_machine_file_s_zones_are_there_until_they_are_changed(ros_context, machine):
    zones = Zones(boxes=((0.7, 0.1, 0.9, 0.3),), circles=((0.5, 0.8, 0.1),))
    node = Node("with_zones", context=ros_context)
    planner_parameters.declare_changeable(node, machine.changed(zones=zones))
    assert planner_parameters.read_settings(node, machine).machine.zones == zones
    node.destroy_node()


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("zone_boxes", [0.7, 0.1, 0.9], r"zone_boxes takes 4 for each, x z x z .*3 numbers"),
        ("tip_zone_circles", [0.7, 0.1], r"takes 3 for each, x z \[m\] of the centre, radius"),
        ("zone_circles", [0.7, 0.1, -0.1], r"radius: must be at least 0\.0001 m \(is -0\.1\);"),
        ("zone_boxes", [0.7, 0.1, 0.7, 0.3], r"x_min: 0\.7 m must be below x_max 0\.7 m"),
        ("zone_boxes", [-0.1, -0.1, 0.1, 0.1], r"-0\.1 m from joint 1, where link 1 always is"),
        ("zone_boxes", [0.7, 0.1, float("nan"), 0.3], r"x_.*finite number"),
        ("zone_boxes", ["a", "b", "c", "d"], r"must hold nothing but numbers"),
        ("zone_boxes", "0.7", r"must be an array of numbers"),
        ("zone_circles", 0.7, r"must be an array of numbers"),
        ("zone_spheres", 0.7, r"must be an array of numbers"),
        (
            "tip_zone_cylinders",
            [0.7, 0.1, 0.0, 1.0, 0.1],
            r"^tip_zone_cylinders must be empty: this arm moves in x and z; give tip_zone_boxes or "
            r"tip_zone_circles \(is \[0\.7, 0\.1, 0\.0, 1\.0, 0\.1\]\)$",
        ),
        (
            "zone_boxes",
            [0.7, 0.1, 0.0, 0.9, 0.2, 0.5],
            r"^zone_boxes takes 4 for each, x z x z \[m\] of .* corners \(is 6 numbers\)$",
        ),
    ],
)
def test_what_is_no_zone_is_refused_with_its_sentence(node, machine, name, value, reason):
    said = planner_parameters.find_refusal(node, machine, [Parameter(name, value=value)])
    assert re.search(reason, said), said
    assert "\n" not in said


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        (
            "zone_boxes",
            [0.7, 0.1, 0.9, 0.3],
            r"^zone_boxes takes 6 for each, x y z x y z \[m\] of .* corners \(is 4 numbers\)$",
        ),
        ("zone_cylinders", [2, 1, 0, 1], r"takes 5 for each, x y \[m\] of the upright axis, z z"),
        ("tip_zone_spheres", [2, 1, 0], r"takes 4 for each, x y z \[m\] of the centre, radius"),
        (
            "zone_circles",
            [0.5, 0.8, 0.1],
            r"^zone_circles must be empty: joint 1 slews, its zones are in space; give zone_boxes "
            r"or zone_cylinders or zone_spheres \(is \[0\.5, 0\.8, 0\.1\]\)$",
        ),
        ("zone_spheres", [2.0, 1.0, 0.0, -0.1], r"radius: must be at least 0\.0001 m \(is -0\.1\)"),
        ("zone_cylinders", [2.0, 1.0, 0.5, 0.5, 0.1], r"z_min: 0\.5 m must be below z_max 0\.5 m"),
        ("zone_boxes", [2.0, 1.0, math.nan, 3.0, 2.0, 1.0], r"z_.*finite number"),
    ],
)
def test_what_is_no_zone_of_an_arm_that_slews_is_refused(
    ros_context, excavator, name, value, reason
):
    node = Node("slewing", context=ros_context)
    planner_parameters.declare_changeable(node, excavator)
    said = planner_parameters.find_refusal(node, excavator, [Parameter(name, value=value)])
    node.destroy_node()
    assert re.search(reason, said), said
    assert "\n" not in said


def test_a_zone_that_the_arm_cannot_have_is_refused_from_the_start(ros_context, excavator):
    given = [Parameter("zone_circles", value=[0.5, 0.8, 0.1])]
    node = Node("unfit", context=ros_context, parameter_overrides=given)
    with pytest.raises(UsageError, match=r"zone_circles must be empty: joint 1 slews"):
        planner_parameters.declare_changeable(node, excavator)
    node.destroy_node()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (
            {"lead_min": 0.5, "lead_max": 0.2},
            "lead_min 0.5 s must not be above lead_max 0.2 s; change both in one go",
        ),
        (
            {"planning_budget": 0.005},
            "planning_budget 0.005 s is too short for a hand-over; give at least 0.01 s, or 0 to "
            "let it adapt",
        ),
        ({"payload": math.nan}, "payload is nan; it must be a number"),
        ({"v_max": math.nan}, "v_max is nan; it must be a number"),
    ],
)
def test_what_makes_no_sense_is_refused_with_its_sentence(node, machine, changes, sentence):
    parameters = [Parameter(name, value=value) for name, value in changes.items()]
    assert planner_parameters.find_refusal(node, machine, parameters) == sentence


def test_the_lead_adapts_unless_a_budget_is_set(node, machine):
    assert planner_parameters.read_settings(node, machine).planning_budget == 0.0
    node.set_parameters([Parameter("planning_budget", value=0.2)])
    assert planner_parameters.read_settings(node, machine).planning_budget == 0.2


def test_what_will_do_at_the_goal_can_be_set(node, machine):
    found = planner_parameters.read_settings(node, machine).options
    assert (found.goal_psi, found.goal_region) == (None, None)
    node.set_parameters([Parameter("goal_tolerance", value=0.02)])
    assert planner_parameters.read_settings(node, machine).options.goal_region == Disc(0.02)
    node.set_parameters([Parameter("goal_tolerance", value=0.0)])
    node.set_parameters([Parameter("goal_segment", value=[0.1, -0.05])])
    assert planner_parameters.read_settings(node, machine).options.goal_region == Segment(
        0.1, -0.05
    )
    node.set_parameters([Parameter("goal_segment", value=[0.0, 0.0])])
    node.set_parameters([Parameter("goal_box", value=[0.1, 0.05])])
    assert planner_parameters.read_settings(node, machine).options.goal_region == BoxRegion(
        0.1, 0.05
    )
    node.set_parameters_atomically(
        [Parameter("goal_psi_min", value=-0.5), Parameter("goal_psi_max", value=0.25)]
    )
    assert planner_parameters.read_settings(node, machine).options.goal_psi == (-0.5, 0.25)


def test_points_on_the_way_are_a_flat_array_of_numbers(node, machine):
    found = planner_parameters.read_settings(node, machine).options
    assert (found.via, found.via_tolerance) == ((), 0.01)
    points = Parameter("goal_via", value=[0.6, -0.05, 0.7, 0.2])
    near = Parameter("goal_via_tolerance", value=0.02)
    assert planner_parameters.find_refusal(node, machine, [points, near]) is None
    node.set_parameters_atomically([points, near])
    found = planner_parameters.read_settings(node, machine).options
    assert (found.via, found.via_tolerance) == (((0.6, -0.05), (0.7, 0.2)), 0.02)
    node.set_parameters([Parameter("goal_via", Parameter.Type.DOUBLE_ARRAY, [])])
    assert planner_parameters.read_settings(node, machine).options.via == ()


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"goal_via": [0.6, -0.05, 0.7]}, "goal_via takes 2 for each, x z [m] of a point"),
        ({"goal_via": ["a", "b"]}, "must hold nothing but numbers"),
        ({"goal_via": "0.6 0.1"}, "must be an array of numbers"),
        ({"goal_via": 0.6}, "must be an array of numbers"),
        ({"goal_via": [0.6, math.nan]}, "must be finite numbers"),
        ({"goal_via": [0.6, 0.1, -0.3, 0.4]}, "goal_via cannot be passed: the tip position (-0.3"),
        ({"goal_via": [0.1, 0.1]}, "outside the workspace"),
        ({"goal_via_tolerance": math.nan}, "goal_via_tolerance is nan"),
    ],
)
def test_what_makes_no_sense_on_the_way_is_refused(node, machine, changes, reason):
    parameters = [Parameter(name, value=value) for name, value in changes.items()]
    said = planner_parameters.find_refusal(node, machine, parameters)
    assert reason in said
    assert "\n" not in said


def test_a_point_cannot_be_passed_at_less_than_no_distance(node):
    [result] = node.set_parameters([Parameter("goal_via_tolerance", value=-0.1)])
    assert not result.successful
    assert "goal_via_tolerance" in result.reason


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"goal_tolerance": 0.02, "goal_box": [0.1, 0.1]}, "must be one of tolerance, segment"),
        ({"goal_box": [0.1, -0.1]}, "half_z must be above 0 m"),
        ({"goal_box": [0.1, 0.0]}, "half_z must be above 0 m"),
        ({"goal_segment": [0.1]}, "must be two numbers, x z"),
        ({"goal_segment": [0.1, math.nan]}, "z must be finite"),
        ({"goal_psi_min": 0.1}, "must be given both or not at all, and not with goal_psi"),
        ({"goal_psi": 0.1, "goal_psi_min": 0.1, "goal_psi_max": 0.2}, "not with goal_psi"),
        ({"goal_psi_min": 0.3, "goal_psi_max": 0.2}, "the least first"),
        ({"goal_psi": 90.0}, "in degrees? 90 degrees are 1.571 rad"),
        ({"goal_psi_max": math.inf}, "goal_psi_max must be an angle in rad"),
    ],
)
def test_what_makes_no_sense_at_the_goal_is_refused(node, machine, changes, reason):
    parameters = [Parameter(name, value=value) for name, value in changes.items()]
    said = planner_parameters.find_refusal(node, machine, parameters)
    assert reason in said
    assert "\n" not in said


def test_weights_that_are_all_zero_are_refused_with_the_reason(node, machine):
    assert planner_parameters.find_refusal(
        node, machine, [Parameter("weights", value=[0.0, 0.0, 0.0])]
    ) == (
        "weights must not all be 0: any motion would be as good as any other; raise one of them "
        "(is 0 0 0)"
    )


def test_every_number_has_a_range_and_is_refused_beyond_it(node, machine):
    """Of what can be changed: rclpy refuses single numbers, the planner all others."""
    tried = 0
    for name in planner_parameters.CHANGEABLE_PARAMETERS:
        descriptor, value = node.describe_parameter(name), node.get_parameter(name).value
        if isinstance(value, str):
            continue
        own = planner_parameters.OWN_RANGES.get(name)
        ranges = [(r.from_value, r.to_value) for r in descriptor.floating_point_range]
        assert own or ranges, name
        assert all(math.isfinite(end) for pair in (own or ranges[0],) for end in pair), name
        for beyond in (1e308, -1e308):
            change = beyond
            if isinstance(value, list) or value is None:
                change = [beyond] * (30 if "zone" in name or name == "goal_via" else 3)
                change = change[:2] if name in ("goal_segment", "goal_box") else change
            parameter = Parameter(name, value=change)
            by_rclpy = not isinstance(change, list) and bool(ranges)
            reason = planner_parameters.find_refusal(node, machine, [parameter])
            if by_rclpy:
                reason = node.set_parameters([parameter])[0].reason
            assert name in (reason or ""), name
            assert "\n" not in reason
            tried += 1
    assert tried > 40


def test_weights_beyond_what_costs_can_be_summed_with_are_refused(node, machine):
    change = [Parameter("weights", value=[1e308, 0.0, 0.0])]
    reason = planner_parameters.find_refusal(node, machine, change)
    assert reason == "weights must be from 0 to 1e+06 (is 1e+308)"
