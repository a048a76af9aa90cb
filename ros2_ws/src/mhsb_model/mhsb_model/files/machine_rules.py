"""Rules of a machine file that concern several values.

Each function checks the rules of one part of the file. All rules are checked before anything is
reported. A broken rule is one string, `path: sentence`, with the path of the value in the file.
"""

from collections.abc import Iterator
from itertools import pairwise

from mhsb_model.errors import suggest_unit_of_number
from mhsb_model.schema import (
    JOINT_KINDS,
    MAX_SUPPLY_PRESSURE,
    AnyJoint,
    MachineConfig,
    Section,
    unit_of,
)


def check_machine_rules(config: MachineConfig) -> list[str]:
    """Check all rules that concern several fields of a machine file.

    Args:
        config: Content of a machine file that the schema has accepted.

    Returns:
        One string `path: sentence` for each broken rule; empty if none is broken.
    """
    return [
        *_check_workspace(config),
        *_check_hydraulics(config),
        *_check_start_posture(config),
        *_check_keep_out(config),
        *_check_zones(config),
        *_check_joint_kinds(config),
        *_check_valve_curves(config),
        *_check_kept_joints(config),
        *_check_telescopes(config),
        *_check_slew(config),
        *(
            problem
            for index, joint in enumerate(config.joints)
            for problem in _check_joint(f"joints.{index}", joint)
        ),
    ]


def check_actuator_speed_limits(config: MachineConfig) -> list[str]:
    """Check that no actuator's own speed limit exceeds the common limit V_max.

    The rule applies only to machine files. A program may lower V_max of a machine below an
    actuator's own limit; the new V_max then limits this actuator.

    Args:
        config: Content of a machine file.

    Returns:
        One string `path: sentence` for each actuator whose own limit is too large; empty if there
        is none.
    """
    most = config.motion.max_piston_speed
    return [
        f"joints.{j}.actuator.max_piston_speed: {own:g} m/s is above motion.max_piston_speed "
        f"{most:g} m/s, which no actuator exceeds; raise that, and give the slower ones their own"
        for j, own in enumerate(joint.actuator.max_piston_speed for joint in config.joints)
        if own is not None and own > most
    ]


def check_boost_pressure(config: MachineConfig) -> list[str]:
    """Check that booster modules can raise the pressure above that of the main pump.

    The rule applies only to machine files. A program may raise the main pump's pressure beyond the
    highest boost pressure, for instance to compare supplies.

    Args:
        config: Content of a machine file.

    Returns:
        One string `path: sentence`, or an empty list. A machine without modules has no problem.
    """
    highest, supply = (
        config.hydraulics.servo_pump.max_boost_pressure,
        config.hydraulics.main_pump.pressure,
    )
    if config.hydraulics.modules.count == 0 or highest > supply:
        return []
    hint = suggest_unit_of_number(highest, "Pa", supply, MAX_SUPPLY_PRESSURE)
    return [
        f"hydraulics.servo_pump.max_boost_pressure: {highest:g} Pa must be above the main pump's "
        f"{supply:g} Pa{hint or '; raise it, or set modules.count to 0'}"
    ]


def _check_workspace(config: MachineConfig) -> Iterator[str]:
    """Check that the workspace's radii are in order and within the arm's reach.

    The least radius must be below the greatest. The greatest must not exceed the reach: the sum of
    the link lengths in the arm's plane and of the telescopes' largest extensions.

    Args:
        config: Content of a machine file.

    Yields:
        One string `path: sentence` for each broken rule.
    """
    area = config.workspace
    reach = sum(joint.link.length for joint in config.joints if joint.kind != "slew")
    reach += sum(joint.limits.upper for joint in config.joints if joint.kind == "prismatic")
    if area.min_radius >= area.max_radius:
        yield (
            f"workspace.min_radius: {area.min_radius:g} m must be below "
            f"max_radius {area.max_radius:g} m"
        )
    if area.max_radius > reach * (1 + 1e-9):
        yield (f"workspace.max_radius: {area.max_radius:g} m is beyond the reach {reach:g} m")


def _check_joint_kinds(config: MachineConfig) -> list[str]:
    """Check that files of schema version 2 and later name the kind of each joint.

    In files of version 1 all joints are revolute, and the kind may be left out.

    Args:
        config: Content of a machine file.

    Returns:
        One string `path: sentence` for each joint without a kind.
    """
    return [
        f"joints.{index}.kind: is missing; in schema_version 2 a joint has one: "
        f"{' or '.join(JOINT_KINDS)}"
        for index, joint in enumerate(config.joints)
        if config.schema_version > 1 and "kind" not in joint.model_fields_set
    ]


def _check_valve_curves(config: MachineConfig) -> Iterator[str]:
    """Check that the curves of the valves rise from (0, 0) to (1, 1).

    From each point to the next, both the share of the stroke and the share of the opening must
    increase. The curve then has an inverse.

    Args:
        config: Content of a machine file.

    Yields:
        One string `path: sentence` for each curve that breaks a rule. It states the first two
        points between which the curve does not rise, or otherwise the curve's ends.
    """
    for name in ("valve_curve", "valve_curve_retracting"):
        curve = getattr(config.imperfections, name)
        if curve is None:
            continue
        steps = enumerate(pairwise(curve))
        flat = next((k for k, (a, b) in steps if a[0] >= b[0] or a[1] >= b[1]), None)
        if flat is not None:
            what = f"{list(curve[flat + 1])} does not lie above {list(curve[flat])} in both"
        elif curve[0] != (0.0, 0.0) or curve[-1] != (1.0, 1.0):
            what = f"it goes from {list(curve[0])} to {list(curve[-1])}"
        else:
            continue
        yield (
            f"imperfections.{name}: pairs [stroke beyond the overlap, opening] must rise from "
            f"[0, 0] to [1, 1], and {what}; give both as shares, in rising order"
        )


def _check_kept_joints(config: MachineConfig) -> list[str]:
    """Check that `motion.kept_joints` leaves two joints to reach a tip position.

    The list has the joints that the `fixed` planner does not move, counted from 1. All must be
    different joints of the arm's plane. A slew (joint 1) does not belong to the plane. The list
    is either empty, or it has all joints of the plane except two.

    Args:
        config: Content of a machine file.

    Returns:
        One string `path: sentence`, or an empty list.
    """
    kept, joints = config.motion.kept_joints, len(config.joints)
    first = 2 if config.joints[0].kind == "slew" else 1
    distinct, needed = set(kept) & set(range(first, joints + 1)), joints - first - 1
    if not kept or (len(kept) == len(distinct) == needed):
        return []
    return [
        f"motion.kept_joints: {list(kept)} must be {needed} different ones of the joints {first} "
        f"to {joints}, so that two are left to reach the tip position"
    ]


def _check_slew(config: MachineConfig) -> Iterator[str]:
    """Check that only joint 1 slews, and only in files of schema version 2 or later.

    Args:
        config: Content of a machine file.

    Yields:
        One string `path: sentence` for each broken rule.
    """
    kinds = [joint.kind for joint in config.joints]
    yield from (
        f"joints.{index}.kind: joint 1 alone can slew; all others move in the plane that it turns"
        for index, kind in enumerate(kinds)
        if kind == "slew" and index > 0
    )
    if kinds[0] == "slew" and config.schema_version < 2:
        yield "schema_version: slew joints need version 2"


def _check_zones(config: MachineConfig) -> list[str]:
    """Check that keep-out zones have the form that the machine needs.

    An arm that slews has zones in space: boxes with y limits, upright cylinders and spheres. Any
    other arm moves in a plane and has boxes without y limits and circles.

    Args:
        config: Content of a machine file.

    Returns:
        One string `path: sentence` for each box that does not fit, and one for each list of other
        zones (`circles`, `cylinders`, `spheres`) that this arm must not have.
    """
    keep_out, slews = config.keep_out, config.joints[0].kind == "slew"
    where = "joint 1 slews, and zones are in space" if slews else "this arm moves in x and z alone"
    rule = "give y_min and y_max, too" if slews else "leave out y_min and y_max"
    instead = {"circles": "cylinders or spheres"}
    if not slews:
        instead = {"cylinders": "circles", "spheres": "circles"}
    problems = [
        f"keep_out.boxes.{i}: {where}; {rule}"
        for i, box in enumerate(keep_out.boxes)
        if slews == (box.y_min is None) or slews == (box.y_max is None)
    ]
    return problems + [
        f"keep_out.{name}: {where}; give {others}"
        for name, others in instead.items()
        if getattr(keep_out, name)
    ]


def _check_telescopes(config: MachineConfig) -> Iterator[str]:
    """Check the rules for prismatic joints (telescopes).

    A telescope slides along the link of the joint before. So the first joint in the plane must be
    revolute, two telescopes must not be neighbours, and at least two joints must be revolute.
    Prismatic joints need schema version 2.

    Args:
        config: Content of a machine file.

    Yields:
        One string `path: sentence` for each broken rule; empty if no joint is prismatic.
    """
    kinds = [joint.kind for joint in config.joints]
    if "prismatic" not in kinds:
        return
    first = 1 if kinds[0] == "slew" else 0
    if kinds[first : first + 1] == ["prismatic"]:
        yield (
            f"joints.{first}.kind: joint {first + 1} must be revolute, a telescope needs a link "
            "before"
        )
    yield from (
        f"joints.{index}.kind: two prismatic joints in succession slide along one line; give one "
        "the stroke of both"
        for index in range(1, len(kinds))
        if kinds[index - 1] == kinds[index] == "prismatic"
    )
    if (turning := kinds.count("revolute")) < 2:
        yield (f"joints: {turning} of them are revolute, a chain with a telescope needs at least 2")
    if config.schema_version < 2:
        yield "schema_version: prismatic joints need version 2"


def _check_hydraulics(config: MachineConfig) -> Iterator[str]:
    """Check tank pressure, booster modules of each mode, and leakage.

    The tank pressure must be below the supply pressure. Mode N must use no booster module, DB and
    SB at least one. The leakage of all valves together must be below the main pump's largest flow.

    Args:
        config: Content of a machine file.

    Yields:
        One string `path: sentence` for each broken rule.
    """
    oil = config.hydraulics
    if oil.tank_pressure >= oil.main_pump.pressure:
        yield (
            f"hydraulics.tank_pressure: {oil.tank_pressure:g} Pa must be below the supply "
            f"pressure {oil.main_pump.pressure:g} Pa"
        )
    normal, *boosted = oil.modules.per_mode
    if normal != 0 or min(boosted) < 1:
        yield (
            f"hydraulics.modules.per_mode: {oil.modules.per_mode} must be 0 for N "
            "and at least 1 for DB and SB, which are boosted"
        )
    leakage = len(config.joints) * oil.valve.leakage_flow
    if leakage >= oil.main_pump.max_flow:
        yield (
            f"hydraulics.valve.leakage_flow: all valves leak {leakage:g} m³/s, the main pump "
            f"gives {oil.main_pump.max_flow:g} m³/s"
        )


def _check_start_posture(config: MachineConfig) -> list[str]:
    """Check that the start posture has a position for each joint, within the joint's limits.

    Args:
        config: Content of a machine file.

    Returns:
        One string `path: sentence` for each position beyond its limits. Joints whose lower limit is
        not below the upper one are skipped. If the number of positions is wrong, a single string
        says so.
    """
    start = config.simulation.start_posture
    if len(start) != len(config.joints):
        return [
            f"simulation.start_posture: has {len(start)} angles, "
            f"the machine has {len(config.joints)} joints"
        ]
    return [
        f"simulation.start_posture.{j}: {q:g} {unit_of(joint)} is outside the joint's limits "
        f"[{joint.limits.lower:g}, {joint.limits.upper:g}] {unit_of(joint)}"
        + suggest_unit_of_number(q, unit_of(joint), joint.limits.lower, joint.limits.upper)
        for j, (q, joint) in enumerate(zip(start, config.joints, strict=True))
        if not joint.limits.lower <= q <= joint.limits.upper
        and joint.limits.lower < joint.limits.upper  # else `_check_joint` says so
    ]


def _check_keep_out(config: MachineConfig) -> Iterator[str]:
    """Check the number of link radii, and that zones and the base have a positive extent.

    The file must have no link radius, or one for each link in the arm's plane. In each box,
    cylinder and the base, each lower limit must be below its upper limit.

    Args:
        config: Content of a machine file.

    Yields:
        One string `path: sentence` for each broken rule.
    """
    keep_out = config.keep_out
    links = sum(joint.kind != "slew" for joint in config.joints)
    if len(keep_out.link_radii) not in (0, links):
        yield (
            f"keep_out.link_radii: has {len(keep_out.link_radii)} radii, the machine has "
            f"{links} links in its plane"
        )
    ends: list[tuple[str, Section]] = [
        *((f"keep_out.boxes.{i}", box) for i, box in enumerate(keep_out.boxes)),
        *((f"keep_out.cylinders.{i}", each) for i, each in enumerate(keep_out.cylinders)),
        *([("keep_out.base", keep_out.base)] if keep_out.base else []),
    ]
    for path, zone in ends:
        for axis in ("x", "y", "z"):
            low, high = (getattr(zone, f"{axis}_{end}", None) for end in ("min", "max"))
            if low is not None and high is not None and low >= high:
                yield (
                    f"{path}.{axis}_min: {low:g} m must be below {axis}_max {high:g} m"
                    + _ask_if_swapped(low, high)
                )


def _ask_if_swapped(low: float, high: float) -> str:
    """Return "; swapped?" if a lower limit is above its upper limit; empty if they are equal."""
    return "; swapped?" if low > high else ""


def _check_joint(path: str, joint: AnyJoint) -> Iterator[str]:
    """Check limits, cylinder and link of one joint.

    The lower limit must be below the upper one, the rod thinner than the bore, and the centre of
    mass on the link. Only the limits are checked for a slew.

    Args:
        path: Path of the joint in the file, such as `joints.0`.
        joint: Joint section of the file.

    Yields:
        One string `path: sentence` for each broken rule.
    """
    unit = unit_of(joint)
    if joint.limits.lower >= joint.limits.upper:
        yield (
            f"{path}.limits.lower: {joint.limits.lower:g} {unit} must be below "
            f"upper {joint.limits.upper:g} {unit}"
            + _ask_if_swapped(joint.limits.lower, joint.limits.upper)
        )
    if joint.kind == "slew":
        return
    if joint.cylinder.rod >= joint.cylinder.bore:
        yield (
            f"{path}.cylinder.rod: {joint.cylinder.rod:g} m must be below "
            f"bore {joint.cylinder.bore:g} m"
        )
    if joint.link.center_of_mass > joint.link.length:
        yield (
            f"{path}.link.center_of_mass: {joint.link.center_of_mass:g} m is beyond the "
            f"link's length {joint.link.length:g} m"
        )
