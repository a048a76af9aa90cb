"""The arm as a URDF, for RViz, Foxglove, robot_state_publisher and other readers.

Frames:

- `base_link` at joint 1 (x forward, y to the left, z up),
- `link_1` … at the joints, with x along the link,
- `tip` at the end,
- `work_plane` at the base, with the arm's plane as its x-y plane (x forward, y up).

A positive angle raises the link, so that joints turn about −y. Telescopes slide along x, from the
tip of the link before. If joint 1 slews, it turns about z. `base_link` then lies on its axis at the
height of joint 2, and `work_plane` turns with it.
"""

import math
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from mhsb_model.machine import Machine

THICKNESS_RATIO = 0.06
"""Thickness of a drawn link, as a share of its length."""

AXIAL_INERTIA_RATIO = 0.01
"""Ratio of a link's inertia about its own axis, which the plane does not use, to that across it."""

SMALLEST_INERTIA = 1e-9
"""Smallest inertia of a body [kg m²], since readers refuse bodies without inertia."""

BETWEEN_GRID = 1.0 + 1e-6
"""Factor on the largest moment arm of a grid of 0.1°.

Between grid points the moment arm may be longer by r h²/8, that is 4e-7 r."""


def build_robot_description(machine: Machine) -> str:
    """Build the URDF of an arm: links with mass and inertia, joint limits and payload.

    Cylinders are not part of the URDF. The effort limit of a joint is the torque of its cylinder at
    supply pressure P_S. The larger piston area A and the longest moment arm r are taken:

        τ = P_S A max |r(q)|    [N m, or N for telescopes]

    The velocity limit is the largest joint speed at which the piston keeps V_max, its allowed
    speed, in every posture:

        q̇ = V_max / max |r(q)|    [rad/s, or m/s for telescopes]

    The frames `tip` (with the payload) and `work_plane` are added as links on fixed joints.

    Args:
        machine: The machine.

    Returns:
        The URDF as XML text.
    """
    robot = Element("robot", name=machine.name)
    SubElement(robot, "link", name="base_link")
    parent, at = "base_link", 0.0
    for index, joint in enumerate(machine.config.joints):
        child = f"link_{index + 1}"
        stroke = joint.limits.upper if machine.arrays.slides[index] else 0.0
        _add_link(robot, child, joint.link.length, stroke, _build_link_inertial(machine, index))
        _add_joint(robot, machine, index, parent, child, at)
        parent, at = child, joint.link.length
    mass, point = machine.config.payload.mass, SMALLEST_INERTIA
    SubElement(robot, "link", name="tip").append(_build_inertial(mass, 0.0, point, point))
    _connect_links(robot, "tip_mount", "fixed", parent, "tip", at)
    SubElement(robot, "link", name="work_plane")
    plane, at = ("link_1", machine.arrays.slew_offset) if machine.slews else ("base_link", 0.0)
    flat = f"{math.pi / 2} 0 0"
    _connect_links(robot, "work_plane_mount", "fixed", plane, "work_plane", at, flat)
    indent(robot)
    return tostring(robot, encoding="unicode", xml_declaration=True)


def _build_link_inertial(machine: Machine, index: int) -> Element:
    """Build the inertial element of a link.

    Args:
        machine: The machine.
        index: Index of the link, from 0.

    Returns:
        The element, with mass [kg], centre of mass [m] and inertia [kg m²] of the machine file. The
        inertia across the link is at least SMALLEST_INERTIA.
    """
    link = machine.config.joints[index].link
    across = max(link.inertia, SMALLEST_INERTIA)
    return _build_inertial(link.mass, link.center_of_mass, AXIAL_INERTIA_RATIO * across, across)


def _build_inertial(mass: float, center: float, along: float, across: float) -> Element:
    """Build an inertial element for a body that is slender along its x axis.

    Args:
        mass: Mass [kg].
        center: Position of the centre of mass on the x axis [m].
        along: Moment of inertia about x [kg m²].
        across: Moment of inertia about y and z [kg m²].

    Returns:
        The element.
    """
    inertial = Element("inertial")
    SubElement(inertial, "origin", xyz=f"{center:.9g} 0 0", rpy="0 0 0")
    SubElement(inertial, "mass", value=f"{mass:.9g}")
    moments = {"ixx": along, "iyy": across, "izz": across, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
    SubElement(inertial, "inertia", {name: f"{value:.9g}" for name, value in moments.items()})
    return inertial


def _add_link(robot: Element, name: str, length: float, stroke: float, inertial: Element) -> None:
    """Add a link, drawn as a box that reaches back from its tip.

    The box is as long as length plus stroke, so that a telescope overlaps the link before it. The
    tip is at x = `length` in the link's frame.

    Args:
        robot: Root element, changed in place.
        name: Name of the link.
        length: Length of the link [m].
        stroke: Stroke of a telescope [m]; 0 for other joints.
        inertial: Inertial element of the link.
    """
    link = SubElement(robot, "link", name=name)
    link.append(inertial)
    visual = SubElement(link, "visual")
    SubElement(visual, "origin", xyz=f"{(length - stroke) / 2:.9g} 0 0", rpy="0 0 0")
    length += stroke
    thick = f"{THICKNESS_RATIO * length:.9g}"
    SubElement(SubElement(visual, "geometry"), "box", size=f"{length:.9g} {thick} {thick}")


def _add_joint(
    robot: Element, machine: Machine, index: int, parent: str, child: str, offset: float
) -> None:
    """Add the joint between two links, with its axis and limits.

    There are limits of position, effort and velocity. The effort limit is the torque at supply
    pressure. At the velocity limit, the piston keeps V_max, its allowed speed.

    Args:
        robot: Root element, changed in place.
        machine: The machine.
        index: Index of the joint, from 0.
        parent: Name of the link before.
        child: Name of the link after.
        offset: Distance of the joint along the parent's x axis [m].
    """
    a, own = machine.arrays, machine.config.joints[index].kind
    kind = "prismatic" if own == "prismatic" else "revolute"
    axis = {"revolute": "0 -1 0", "prismatic": "1 0 0", "slew": "0 0 1"}[own]
    joint = _connect_links(robot, machine.joint_names[index], kind, parent, child, offset)
    SubElement(joint, "axis", xyz=axis)
    area = max(a.cap_area[index], a.rod_area[index])
    limits = {
        "lower": a.joint_min[index],
        "upper": a.joint_max[index],
        "effort": a.supply_pressure * area * machine.longest_moment_arms[index],
        "velocity": a.max_piston_speed[index] / (BETWEEN_GRID * machine.longest_moment_arms[index]),
    }
    SubElement(joint, "limit", {name: f"{value:.9g}" for name, value in limits.items()})


def _connect_links(
    robot: Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    offset: float,
    angles: str = "0 0 0",
) -> Element:
    """Add a joint between two links.

    Args:
        robot: Root element, changed in place.
        name: Name of the joint.
        kind: Type of the joint in URDF.
        parent: Name of the parent link.
        child: Name of the child link.
        offset: Distance of the joint along the parent's x axis [m].
        angles: Orientation "roll pitch yaw" in the parent [rad].

    Returns:
        Element of the joint, without axis and limits.
    """
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "origin", xyz=f"{offset:.9g} 0 0", rpy=angles)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    return joint
