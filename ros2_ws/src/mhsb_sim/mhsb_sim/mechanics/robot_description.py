"""The arm as a URDF, for RViz, Foxglove, robot_state_publisher and whatever else reads one.

Frames: `base_link` at joint 1 (x forward, y to the left, z up), `link_1` … at the joints with x
along the link, `tip` at the end, `work_plane` at the base with the arm's plane laid flat (x
forward, y up). A positive angle raises the link, so that joints turn about −y; telescopes slide
along x, from the tip of the link before. Where joint 1 slews, it turns about z, `base_link` lies
on its axis at the height of joint 2, and `work_plane` turns with it.
"""

from __future__ import annotations

import math
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from mhsb_model.machine import Machine

THICKNESS = 0.06
"""Of a link as it is drawn, its share of the length."""

ALONG = 0.01
"""Inertia of a link about its own length, which the plane has no use for, over that across it."""

SMALLEST_INERTIA = 1e-9
"""Readers refuse bodies without any [kg m²]."""

BETWEEN_GRID = 1.0 + 1e-6
"""Factor on the largest moment arm of a grid of 0.1°, between whose points it may be a little
longer: by r h²/8, 4e-7 r."""


def robot_description(machine: Machine) -> str:
    """URDF of an arm: links with mass and inertia, limits, payload; the cylinders are left out.

    A joint's effort limit is what its cylinder holds at the supply pressure with its longest arm.
    Its velocity limit is the speed at which its piston keeps its V_max wherever the joint is:

        q̇ = V_max / max |r(q)|    [rad/s, m/s of telescopes]
    """
    robot = Element("robot", name=machine.name)
    SubElement(robot, "link", name="base_link")
    parent, at = "base_link", 0.0
    for index, joint in enumerate(machine.config.joints):
        child = f"link_{index + 1}"
        stroke = joint.limits.upper if machine.arrays.slides[index] else 0.0
        _add_link(robot, child, joint.link.length, stroke, _inertial_of(machine, index))
        _add_joint(robot, machine, index, parent, child, at)
        parent, at = child, joint.link.length
    SubElement(robot, "link", name="tip").append(_payload(machine))
    _add_fixed(robot, "tip_mount", parent, "tip", f"{at:.9g} 0 0", "0 0 0")
    SubElement(robot, "link", name="work_plane")
    plane, at = ("link_1", machine.arrays.slew_offset) if machine.slews else ("base_link", 0.0)
    flat = f"{math.pi / 2} 0 0"
    _add_fixed(robot, "work_plane_mount", plane, "work_plane", f"{at:.9g} 0 0", flat)
    indent(robot)
    return tostring(robot, encoding="unicode", xml_declaration=True)


def _inertial_of(machine: Machine, index: int) -> Element:
    link = machine.config.joints[index].link
    across = max(link.inertia, SMALLEST_INERTIA)
    return _inertial(link.mass, link.center_of_mass, ALONG * across, across)


def _payload(machine: Machine) -> Element:
    return _inertial(machine.config.payload.mass, 0.0, SMALLEST_INERTIA, SMALLEST_INERTIA)


def _inertial(mass: float, center: float, along: float, across: float) -> Element:
    inertial = Element("inertial")
    SubElement(inertial, "origin", xyz=f"{center:.9g} 0 0", rpy="0 0 0")
    SubElement(inertial, "mass", value=f"{mass:.9g}")
    moments = {"ixx": along, "iyy": across, "izz": across, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
    SubElement(inertial, "inertia", {name: f"{value:.9g}" for name, value in moments.items()})
    return inertial


def _add_link(
    robot: Element, name: str, length: float, stroke: float, inertial: Element
) -> None:
    """A link from its joint to its tip, and as far back as its stroke makes it show."""
    link = SubElement(robot, "link", name=name)
    link.append(inertial)
    visual = SubElement(link, "visual")
    SubElement(visual, "origin", xyz=f"{(length - stroke) / 2:.9g} 0 0", rpy="0 0 0")
    length += stroke
    thick = f"{THICKNESS * length:.9g}"
    SubElement(SubElement(visual, "geometry"), "box", size=f"{length:.9g} {thick} {thick}")


def _add_joint(
    robot: Element, machine: Machine, index: int, parent: str, child: str, at: float
) -> None:
    a, own = machine.arrays, machine.config.joints[index].kind
    kind = "prismatic" if own == "prismatic" else "revolute"
    axis = {"revolute": "0 -1 0", "prismatic": "1 0 0", "slew": "0 0 1"}[own]
    joint = SubElement(robot, "joint", name=machine.joint_names[index], type=kind)
    SubElement(joint, "origin", xyz=f"{at:.9g} 0 0", rpy="0 0 0")
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "axis", xyz=axis)
    area = max(a.cap_area[index], a.rod_area[index])
    limits = {
        "lower": a.joint_min[index],
        "upper": a.joint_max[index],
        "effort": a.supply_pressure * area * machine.longest_moment_arms[index],
        "velocity": a.max_piston_speed[index] / (BETWEEN_GRID * machine.longest_moment_arms[index]),
    }
    SubElement(joint, "limit", {name: f"{value:.9g}" for name, value in limits.items()})


def _add_fixed(
    robot: Element, name: str, parent: str, child: str, position: str, angles: str
) -> None:
    joint = SubElement(robot, "joint", name=name, type="fixed")
    SubElement(joint, "origin", xyz=position, rpy=angles)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
