"""Estimates of payload and seal friction, from the forces of steady motion.

F is the measured force of a cylinder, and r its moment arm. While the actuator moves steadily,

    r F − τ(m̂) − r φ̂ f(v) = Y δm + r f(v) δφ,        Y = g (x_tip − x_joint)

τ is the torque for the estimated payload m̂. f(v) is the friction from the machine file at the
piston speed v, and φ̂ the estimated factor on it. δm and δφ are the errors of these estimates.
x_tip and x_joint are the x coordinates of the tip and of the joint, and g is gravity. Each actuator
gives information about δm and about its own δφ. A Kalman filter processes the means of short
windows. m and φ follow slow random walks. A parameter without data keeps its standard deviation.

Source: J. Swevers et al., Optimal robot excitation and identification, IEEE Trans. Robotics and
Automation 13, 1997 (linear in the load's parameters).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Record
from mhsb_model.types import FloatArray


@dataclass(frozen=True)
class LoadSettings(Record):
    """Tuned numbers of the estimates of payload and friction."""

    window_steps: int = 20
    """Number of steps over which a mean is taken, 1 … 500.

    Origin: chosen; it averages the hydro-mechanical modes above 50 Hz.

    30 % smaller and larger, N = 5: RMS error −5.6 and −9.2 % (mhsb_arm3), −4.5 and +3.5 %
    (excavator; overshoot −2.17 and −0.34 MPa)."""
    min_moving_speed: float = 1.0 / 12.0
    """Piston speed of the reference above which an actuator counts as moving [V_max], 0 … 1.

    It applies to the speeds now and at the preview point. Origin: the friction of a slower piston
    differs from that of steady motion.

    30 % smaller and larger, N = 5: RMS error −3.9 and +2.2 % (mhsb_arm3), +2.2 and +1.4 %
    (excavator; overshoot −2.49 and +0.01 MPa)."""
    max_inertia_share: float = 0.1
    """Largest inertia torque in steady motion, as a share of the weight's torque, 0 … 1.

    Origin: chosen; an error of the mass matrix then counts for a tenth at most.

    30 % smaller and larger, N = 5: RMS error −0.3 and −11.6 % (mhsb_arm3), +5.3 and +4.6 %
    (excavator; overshoot −0.66 and −1.74 MPa)."""
    payload_deviation: float = 0.2
    """Initial standard deviation of the payload, as a share of itself, above 0 … 10.

    Origin: config/variations.yaml, a payload of 0.7 … 1.3 evenly has 0.17.

    30 % smaller and larger, N = 5: RMS error −10.2 and −5.1 % (mhsb_arm3), −0.4 and +1.7 %
    (excavator; overshoot −1.65 and −0.70 MPa)."""
    friction_deviation: float = 0.5
    """Initial standard deviation of φ [-], above 0 … 10.

    Origin: config/variations.yaml, a friction of 0.5 … 2 evenly has 0.43.

    30 % smaller and larger, N = 5: RMS error −3.7 and −12.1 % (mhsb_arm3), −4.1 and +2.3 %
    (excavator; overshoot −2.54 and −1.81 MPa)."""
    payload_drift: float = 1e-3
    """Standard deviation of the payload's random walk in one window, as a share, 0 … 0.1.

    Origin: chosen; 0.7 % in a second of motion.

    30 % smaller and larger, N = 5: RMS error −4.9 and −2.8 % (mhsb_arm3), −0.5 and +0.8 %
    (excavator; overshoot −1.89 and −0.10 MPa)."""
    friction_drift: float = 5e-3
    """Standard deviation of the random walk of φ in one window [-], 0 … 1.

    Origin: chosen; 3.5 % in a second of motion.

    30 % smaller and larger, N = 5: RMS error −10.7 and −3.6 % (mhsb_arm3), +1.4 and +2.6 %
    (excavator; overshoot −0.92 and −1.87 MPa)."""
    torque_deviation: float = 0.0625
    """Standard deviation of a window's torque [supply torques of the joint], above 0 … 1.

    The supply torque is the largest torque at the main pump's pressure (`compute_supply_torques`).
    The deviation is 5.5 N m at the first joint of the suite's own arm. It covers oscillations,
    sensors and moment arms. Origin: chosen; `mhsb_tools.study.draw_limits` asks that the 95 %
    interval of the payload contains the true one in 92 … 98 % of draws.

    30 % smaller and larger, N = 5: RMS error +0.1 and −2.7 % (mhsb_arm3), −6.6 and −5.6 %
    (excavator; overshoot −0.32 and +0.13 MPa)."""
    max_ratio: float = 3.0
    """Largest estimates of payload and friction, in multiples of the machine file's, 1 … 100.

    Origin: plausibility; config/variations.yaml has a payload of 1.3 and a friction of 2.

    30 % smaller and larger, N = 5: no effect on mhsb_arm3 and excavator."""


class LoadEstimate(NamedTuple):
    """Estimates of payload and friction for n actuators; a covariance of 0 switches them off."""

    estimate: FloatArray  # [1 + n] payload [kg], then the friction factor φ of each actuator
    covariance: FloatArray  # [1 + n, 1 + n] covariance of these
    weight: FloatArray  # [n] m²/s², Y
    torque: FloatArray  # [n] N m, sum over the present window
    friction: FloatArray  # [n] N m, r f(v), sum over the present window
    steps: FloatArray  # [n] number of steps in the present window
    file_payload: FloatArray  # [1] kg, payload of the machine file
    torque_deviation: FloatArray  # [n] N m, standard deviation of a window's torque
    gain_work: FloatArray  # [1 + n] working memory


def build_load_estimate(
    payload: float,
    supply_torque: FloatArray,
    *,
    is_estimated: bool,
    settings: LoadSettings = LoadSettings(),
) -> LoadEstimate:
    """Return the initial estimates of the load: the payload of the file, and friction factors 1.

    A friction factor is the ratio of an actuator's friction to that of the machine file.

    Args:
        payload: Payload of the machine file [kg].
        supply_torque: Largest torque of each cylinder at the main pump's pressure, float64[n], [N
            m]. It scales the assumed noise of measured torques.
        is_estimated: Whether the load is to be estimated. If not, the covariance is 0, so that the
            initial values stay.
        settings: Tuned numbers.

    Returns:
        The estimates, in new arrays.
    """
    count = len(supply_torque)
    deviation = np.full(1 + count, settings.friction_deviation)
    deviation[0] = settings.payload_deviation * payload
    estimate = np.ones(1 + count)
    estimate[0] = payload
    return LoadEstimate(
        estimate=estimate,
        covariance=np.diag(deviation**2) * is_estimated,
        weight=np.zeros(count),
        torque=np.zeros(count),
        friction=np.zeros(count),
        steps=np.zeros(count),
        file_payload=np.array([payload]),
        torque_deviation=settings.torque_deviation * supply_torque,
        gain_work=np.zeros(1 + count),
    )


@kernel(borrows=True)
def accumulate_load_window(
    load: LoadEstimate,
    j: int,
    steady: bool,
    torque: float,
    friction: float,
    settings: LoadSettings,
) -> bool:
    """Add one step of an actuator to its window, and update the load estimates from a full window.

    A window has `window_steps` successive steps of steady motion. The estimates of payload and
    friction are updated from the means of `torque` and `friction` over the window.

    Args:
        load: Estimates and windows, updated in place.
        j: Index of the actuator.
        steady: Whether the motion is steady. If not, the window is discarded.
        torque: Measured torque minus the torque that the present estimates of payload and friction
            give [N m].
        friction: Friction torque of the machine file [N m].
        settings: Tuned numbers.

    Returns:
        True if the window was full and the estimates were updated.
    """
    if not steady:
        load.steps[j] = 0.0
        return False
    if load.steps[j] == 0.0:
        load.torque[j] = load.friction[j] = 0.0
    load.torque[j] += torque
    load.friction[j] += friction
    load.steps[j] += 1.0
    count = settings.window_steps
    if load.steps[j] < count:
        return False
    load.steps[j] = 0.0
    update_load_filter(load, j, load.torque[j] / count, load.friction[j] / count, settings)
    return True


@kernel(borrows=True)
def update_load_filter(
    load: LoadEstimate, j: int, torque: float, friction: float, settings: LoadSettings
) -> None:
    """Update payload and friction from the mean torques of an actuator (Kalman filter).

        torque = Y δm + friction δφ_j + noise

    Y is the torque per kilogram of payload [m²/s²]. δm [kg] and δφ_j are the errors of two present
    estimates: the payload m, and the factor φ_j on the file's friction of actuator j. The noise has
    the standard deviation `torque_deviation`. Before the update, the variances of m and φ_j grow by
    the variances of their random walks (`payload_drift`, `friction_drift`). After the update, m is
    limited to 0 … `max_ratio` times the payload of the machine file, and all φ to 0 … `max_ratio`.

    Args:
        load: Estimates. Reads `weight` (Y); writes `estimate`, `covariance` and `gain_work` in
            place.
        j: Index of the actuator.
        torque: Mean of the measured torque minus the torque that the present estimates give [N m].
        friction: Mean of the friction torque of the machine file [N m].
        settings: Tuned numbers.
    """
    covariance, carried, estimate = load.covariance, load.gain_work, load.estimate
    n, y = len(estimate), load.weight[j]
    wander = settings.payload_drift * load.file_payload[0]
    covariance[0, 0] += wander * wander
    covariance[1 + j, 1 + j] += settings.friction_drift * settings.friction_drift
    for i in range(n):
        carried[i] = covariance[i, 0] * y + covariance[i, 1 + j] * friction
    noise = load.torque_deviation[j] * load.torque_deviation[j]
    spread = noise + y * carried[0] + friction * carried[1 + j]
    for i in range(n):
        estimate[i] += carried[i] / spread * torque
        for k in range(n):
            covariance[i, k] -= carried[i] * carried[k] / spread
    estimate[0] = min(max(estimate[0], 0.0), settings.max_ratio * load.file_payload[0])
    for i in range(1, n):
        estimate[i] = min(max(estimate[i], 0.0), settings.max_ratio)
