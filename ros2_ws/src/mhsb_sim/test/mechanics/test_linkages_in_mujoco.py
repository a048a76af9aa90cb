"""Analytic lengths and moment arms against mechanisms that MuJoCo moves body by body.

A tendon between two sites is a cylinder: its length and its speed are MuJoCo's own. Of a four-bar,
rocker and coupler are bodies of their own and the loop is closed by Newton's method on the gap
that MuJoCo sees, with MuJoCo's Jacobians.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from mhsb_model.linkages import four_bar, linkage
from mhsb_model.machine import Machine
from mhsb_model.schema import FourBar, Pin, SliderCrank
from mhsb_model.types import FloatArray


class Mechanism:
    """One joint's linkage on a fixed parent link: coordinates are the joint, rocker, coupler."""

    def __init__(self, bars: SliderCrank | FourBar, row: FloatArray, lower: float) -> None:
        spec = mujoco.MjSpec()
        child = _hinged(spec.worldbody, (0.0, 0.0), "child")
        spec.worldbody.add_site(name="parent_pin", pos=_place(bars.parent_pin))
        child.add_site(name="child_pin", pos=_place(bars.child_pin))
        rod_end = "child_pin"
        if isinstance(bars, FourBar):
            rod_end = "rocker_tip"
            pivot = _place(bars.rocker_pivot)
            rocker = _hinged(spec.worldbody, (pivot[0], pivot[2]), "rocker")
            rocker.add_site(name=rod_end, pos=(bars.rocker_length, 0.0, 0.0))
            coupler = _hinged(rocker, (bars.rocker_length, 0.0), "coupler")
            coupler.add_site(name="coupler_end", pos=(bars.coupler_length, 0.0, 0.0))
        tendon = spec.add_tendon(name="cylinder")
        tendon.wrap_site("parent_pin")
        tendon.wrap_site(rod_end)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.has_loop = isinstance(bars, FourBar)
        self.data.qpos[0] = lower
        if isinstance(bars, FourBar):  # assembled as the machine says, then followed
            x, z, *_ = four_bar.evaluate_four_bar(row, math.cos(lower), math.sin(lower))
            tip = np.array([pivot[0] + x, pivot[2] + z])
            pin = _place(bars.child_pin, lower)
            angle = math.atan2(z, x)
            self.data.qpos[1] = angle
            self.data.qpos[2] = math.atan2(pin[2] - tip[1], pin[0] - tip[0]) - angle

    def cylinder(self, q: float) -> tuple[float, float]:
        """Length and speed per joint speed at the joint angle q, near the last one asked for."""
        model, data = self.model, self.data
        data.qpos[0] = q
        for _ in range(8):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            if not self.has_loop:
                break
            data.qpos[1:] -= np.linalg.solve(self._jacobian()[:, 1:], self._gap())
        data.qvel[0] = 1.0
        if self.has_loop:
            assert np.abs(self._gap()).max() < 1e-12
            jacobian = self._jacobian()
            data.qvel[1:] = -np.linalg.solve(jacobian[:, 1:], jacobian[:, 0])
        mujoco.mj_forward(model, data)
        return float(data.ten_length[0]), float(data.ten_velocity[0])

    def _gap(self) -> FloatArray:
        gap = self.data.site("coupler_end").xpos - self.data.site("child_pin").xpos
        return gap[[0, 2]]

    def _jacobian(self) -> FloatArray:
        """Of the gap in the coordinates, float64[2, 3]."""
        total = np.zeros((2, self.model.nv))
        for name, sign in (("coupler_end", 1.0), ("child_pin", -1.0)):
            part = np.zeros((3, self.model.nv))
            mujoco.mj_jacSite(self.model, self.data, part, None, self.model.site(name).id)
            total += sign * part[[0, 2]]
        return total


def _hinged(parent: mujoco.MjsBody, at: tuple[float, float], name: str) -> mujoco.MjsBody:
    body = parent.add_body(
        name=name,
        pos=(at[0], 0.0, at[1]),
        explicitinertial=True,
        mass=1.0,
        ipos=(0.0, 0.0, 0.0),
        inertia=(1.0, 1.0, 1.0),
    )
    body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, -1.0, 0.0))
    return body


def _place(pin: Pin, turned: float = 0.0) -> tuple[float, float, float]:
    angle = pin.angle + turned
    return (pin.radius * math.cos(angle), 0.0, pin.radius * math.sin(angle))


@pytest.mark.parametrize("arm", ["machine", "four_bar_machine"])
@pytest.mark.parametrize("j", range(3))
def test_length_and_moment_arm_are_those_of_the_moved_mechanism(
    arm: str, j: int, request: pytest.FixtureRequest
) -> None:
    machine: Machine = request.getfixturevalue(arm)
    row = machine.arrays.linkage[j]
    lower, upper = machine.arrays.joint_min[j], machine.arrays.joint_max[j]
    mechanism = Mechanism(machine.config.joints[j].linkage, row, lower)
    for q in np.linspace(lower, upper, 400):
        length, arm_seen = mechanism.cylinder(q)
        assert linkage.cylinder_length(row, q) == pytest.approx(length, rel=1e-10)
        assert linkage.moment_arm(row, q) == pytest.approx(arm_seen, rel=1e-8)
