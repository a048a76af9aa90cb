"""Limits of the curve of a received trajectory, derived once from a machine file.

Position and speed limits are the joint limits and `Machine.max_joint_speeds`. Acceleration and jerk
limits follow from pressures and valves:

    a_j = p A_j r_j / M_j,    j_j = a_j / t_s,    t_s = 3 / (ζ ω)

- p: highest supply pressure in the file, of the main pump or boosted [Pa].
- A_j: smaller area of the piston [m²]. A motion that ends at rest needs the force in both
  directions.
- r_j: longest moment arm of the joint within its limits [m]; 1 if it slides.
- M_j: smallest inertia M_jj(q) about the joint while all others are held [kg m²], or [kg] if it
  slides. It includes the file's payload, and is the minimum over postures with the tip in the
  workspace.
- t_s: time in which the spool of a valve settles within 5 % [s]; ω is its natural frequency
  [rad/s], ζ its damping ratio.

So a_j is the acceleration of the unloaded joint by the full supply pressure in the most favourable
posture. The jerk limit j_j lets this acceleration build up while a valve opens.

Source: force balance of a cylinder and M(q) q̈ = τ; settling time of a second-order system, Ogata,
Modern Control Engineering, Section 5.3.
"""

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.kernels.kernel import kernel
from mhsb_model.kinematics import tip_position
from mhsb_model.schema import CircuitDynamics
from mhsb_model.statics import mass_matrix
from mhsb_model.types import FloatArray, frozen

MAX_INERTIA_POSTURES = 2000
"""Largest number of postures for which inertias are evaluated. The corners of the joint ranges are
always evaluated, even if there are more of them. With ten times as many, the smallest inertias of
the suite's machines change by at most 5 %. The evaluation takes 2 ms."""

SETTLING_TIME = 3.0
"""Value of ζ ω t at which a second-order system has settled within 5 % [-]."""

PLANNED_SHARE = 0.9
"""Share of acceleration and jerk limits that plans use [-]. A braking command is the plan's curve,
slowed and sampled again. If the jerk of the plan jumps, the braking command exceeds the plan's
values by up to a few percent."""


@dataclass(frozen=True, eq=False)
class CurveLimits:
    """Limits of each joint, all of shape (n,); in m instead of rad for a sliding joint.

    Attributes:
        lower: Smallest position [rad].
        upper: Largest position [rad].
        speed: Largest speed that the main pump can give [rad/s].
        acceleration: Largest acceleration that pressures can give [rad/s²].
        jerk: Largest jerk that valves can give [rad/s³].
    """

    lower: FloatArray
    upper: FloatArray
    speed: FloatArray
    acceleration: FloatArray
    jerk: FloatArray

    @cached_property
    def rates(self) -> FloatArray:
        """Limits of speed, acceleration and jerk (rows) of each joint, shape (3, n)."""
        return np.stack([self.speed, self.acceleration, self.jerk])

    @cached_property
    def for_planning(self) -> "CurveLimits":
        """Limits for planners, a little tighter than the limits up to which an arm accepts plans.

        Acceleration and jerk are `PLANNED_SHARE` times the values of this object; the speed is the
        same. `lower` and `upper` are −inf and inf, since planners check positions themselves.
        """
        everywhere = np.full(len(self.speed), math.inf)
        return replace(
            self,
            lower=frozen(-everywhere),
            upper=frozen(everywhere),
            acceleration=frozen(PLANNED_SHARE * self.acceleration),
            jerk=frozen(PLANNED_SHARE * self.jerk),
        )


def derive_curve_limits(
    m: MachineArrays, circuit: CircuitDynamics, longest_arms: FloatArray, fastest: FloatArray
) -> CurveLimits:
    """Derive the limits of a trajectory's curve from a machine.

    Positions are limited by the joint limits, and speeds by `fastest`. Acceleration and jerk are

        a_j = p A_j r_j / M_j,    j_j = a_j / t_s,    t_s = 3 / (ζ ω)

    p is the highest supply pressure, boosted or not, and A_j the smaller area of the piston. r_j is
    the longest moment arm, and M_j the smallest inertia about the joint in the workspace. t_s is
    the settling time of a valve's spool with natural frequency ω and damping ratio ζ.

    Args:
        m: Arrays of the machine, with payload and supply pressure of its file.
        circuit: Frequency and damping of the valves.
        longest_arms: r_j, longest moment arm of each joint, shape (n,) [m]; 1 if the joint slides.
        fastest: Largest speed that the main pump can give each joint, shape (n,) [rad/s or m/s].

    Returns:
        The limits, with read-only arrays of shape (n,).
    """
    pressure = max(m.supply_pressure, m.max_boost_pressure)
    torque = pressure * np.minimum(m.cap_area, m.rod_area) * longest_arms
    acceleration = torque / find_least_inertias(m)
    natural_frequency = 2.0 * math.pi * circuit.valve_frequency
    settling = SETTLING_TIME / (circuit.valve_damping * natural_frequency)
    return CurveLimits(
        m.joint_min,
        m.joint_max,
        frozen(fastest),
        frozen(acceleration),
        frozen(acceleration / settling),
    )


def find_least_inertias(m: MachineArrays) -> FloatArray:
    """Find the smallest inertia M_jj about each joint over the workspace.

    M_jj is a diagonal element of the mass matrix. It is evaluated on a grid of about
    MAX_INERTIA_POSTURES postures over the joint ranges. The first joint stays at its lower limit,
    since M_jj does not depend on it. Only postures with the tip between the workspace's least and
    greatest radius count. If there are none, all postures count.

    Args:
        m: Arrays of the machine.

    Returns:
        Smallest M_jj of each joint, shape (n,) [kg m²], or [kg] for a sliding joint.
    """
    n = len(m.joint_min)
    count = max(2, int(MAX_INERTIA_POSTURES ** (1.0 / max(1, n - 1))))
    axes = [np.linspace(m.joint_min[j], m.joint_max[j], count if j else 1) for j in range(n)]
    postures = np.array(list(itertools.product(*axes)))
    least = _least_inertias(m, postures, True)
    return least if np.isfinite(least).all() else _least_inertias(m, postures, False)


@kernel
def _least_inertias(m: MachineArrays, postures: FloatArray, in_workspace: bool) -> FloatArray:
    """Find the smallest diagonal elements M_jj of the mass matrix over given postures.

    Args:
        m: Arrays of the machine.
        postures: Joint positions, shape (k, n) [rad or m].
        in_workspace: Whether to skip postures whose tip is nearer to the origin than `m.min_radius`
            or farther than `m.max_radius`.

    Returns:
        Smallest M_jj of each joint, shape (n,) [kg m²], or [kg] for a sliding joint; inf if all
        postures are skipped.
    """
    least = np.full(postures.shape[1], math.inf)
    for k in range(len(postures)):
        x, z = tip_position(m, postures[k])
        radius = math.hypot(x, z)
        if in_workspace and not m.min_radius <= radius <= m.max_radius:
            continue
        mass = mass_matrix(m, postures[k])
        for j in range(len(least)):
            least[j] = min(least[j], mass[j, j])
    return least
