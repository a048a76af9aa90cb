"""What an arm carries and how its seals rub, learnt from the forces that its motion takes.

While an actuator moves steadily, with F the measured force of its cylinder and r its moment arm,

    r F − τ(m̂) − r f(v) = Y δm + r f(v) δφ,        Y = g (x_tip − x_joint)

with τ the torque by the payload m̂ believed now, f the file's friction, δm what the payload is more
and δφ the share by which there is more friction. All actuators tell of δm, each of its own δφ. A
Kalman filter with slowly wandering m, φ takes up the means of short spells. What the motion does
not tell keeps its standard deviation. Source: J. Swevers et al., Optimal robot excitation and
identification, IEEE Trans. Robotics and Automation 13, 1997 (linear in the load's parameters).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray

SPELL = 20
"""Steps over which a mean is taken."""

SLOWEST = 1e-3
"""Speed of the reference [m/s] from which on an actuator moves, now and ahead."""

MOST_INERTIA = 0.1
"""Share of the weight's torque that inertia may have in a steady motion."""

SHARE_OF_PAYLOAD, FRICTION_DEVIATION = 0.2, 0.5
"""Standard deviations before anything is learnt: of the payload, of φ."""

PAYLOAD_WANDER, FRICTION_WANDER = 1e-3, 5e-3
"""Standard deviations by which they may wander from spell to spell, of the payload as a share."""

TORQUE = 5.5
"""Standard deviation of a spell's torque [N m]: swings, sensors, moment arms."""

LARGEST_SHARE, LARGEST_FRICTION = 2.0, 3.0
"""Payload and friction that are taken for an estimate at most, in those of the file."""


class Load(NamedTuple):
    """What is known of the load of n actuators; with a covariance of 0 it is not learnt."""

    believed: FloatArray  # [1 + n] payload [kg], and friction of each actuator, in the file's
    covariance: FloatArray  # [1 + n, 1 + n]
    weight: FloatArray  # [n] m²/s², Y
    torque: FloatArray  # [n] N m, sum over the spell so far
    friction: FloatArray  # [n] N m, r f(v), likewise
    steps: FloatArray  # [n] of the spell
    file: FloatArray  # [1] kg, the payload of the machine file
    carried: FloatArray  # [1 + n] working memory


def load_of(payload: float, count: int, *, learns: bool) -> Load:
    """The load of the machine file [kg], not known well where it is to be learnt."""
    deviation = np.full(1 + count, FRICTION_DEVIATION)
    deviation[0] = SHARE_OF_PAYLOAD * payload
    believed = np.ones(1 + count)
    believed[0] = payload
    return Load(
        believed=believed,
        covariance=np.diag(deviation**2) * learns,
        weight=np.zeros(count),
        torque=np.zeros(count),
        friction=np.zeros(count),
        steps=np.zeros(count),
        file=np.array([payload]),
        carried=np.zeros(1 + count),
    )


@kernel(borrows=True)
def weigh(load: Load, j: int, steady: bool, torque: float, friction: float) -> bool:
    """Take a step of actuator j into its spell; whether the load was learnt from it.

    torque: r F − τ(m̂) − r φ f(v) [N m], friction: r f(v) [N m].
    """
    if not steady:
        load.steps[j] = 0.0
        return False
    if load.steps[j] == 0.0:
        load.torque[j] = load.friction[j] = 0.0
    load.torque[j] += torque
    load.friction[j] += friction
    load.steps[j] += 1.0
    if load.steps[j] < SPELL:
        return False
    load.steps[j] = 0.0
    update(load, j, load.torque[j] / SPELL, load.friction[j] / SPELL)
    return True


@kernel(borrows=True)
def update(load: Load, j: int, torque: float, friction: float) -> None:
    """Kalman filter: torque = Y δm + friction δφ + noise [N m]."""
    covariance, carried, believed = load.covariance, load.carried, load.believed
    n, y = len(believed), load.weight[j]
    wander = PAYLOAD_WANDER * load.file[0]
    covariance[0, 0] += wander * wander
    covariance[1 + j, 1 + j] += FRICTION_WANDER * FRICTION_WANDER
    for i in range(n):
        carried[i] = covariance[i, 0] * y + covariance[i, 1 + j] * friction
    spread = TORQUE * TORQUE + y * carried[0] + friction * carried[1 + j]
    for i in range(n):
        believed[i] += carried[i] / spread * torque
        for k in range(n):
            covariance[i, k] -= carried[i] * carried[k] / spread
    believed[0] = min(max(believed[0], 0.0), LARGEST_SHARE * load.file[0])
    for i in range(1, n):
        believed[i] = min(max(believed[i], 0.0), LARGEST_FRICTION)
