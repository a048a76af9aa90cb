"""Statics and dynamics of chains in which some joints slide; of all others in `statics`."""

from __future__ import annotations

import numpy as np

from mhsb_model.statics import Chain
from mhsb_model.telescopes import telescope_kinematics as telescopes
from mhsb_model.types import FloatArray


def torques(
    c: Chain, slides: telescopes.Slides, q: FloatArray, qd: FloatArray, qdd: FloatArray
) -> FloatArray:
    """τ = M(q) q̈ + C(q, q̇) q̇ + g(q), float64[n]: [N m], of a joint that slides [N].

    Outwards, for the point on each link that is now where its centre or its tip is, at d from the
    tip p of the link before, along e = (cos θ, sin θ), with n = (−sin θ, cos θ):

        p̈ + d (ω̇ n − ω² e)                          of a joint that turns,
        p̈ + d (ω̇ n − ω² e) + 2 ω q̇ n + q̈ e          of one that slides (Coriolis),

    inwards, the force f and the moment about p that all masses beyond take; τ is that moment, or
    e · f. Gravity is an acceleration of the base upwards. Source: recursive Newton–Euler, R.
    Featherstone, Rigid Body Dynamics Algorithms, 5.3. Oracles: energies of point masses, MuJoCo.
    """
    heading = np.cumsum(telescopes.turned(slides, q))
    along = np.stack((np.cos(heading), np.sin(heading)), axis=-1)
    across = np.stack((-along[:, 1], along[:, 0]), axis=-1)
    length, center = (telescopes.extended(slides, rest, q) for rest in (c.length, c.center))
    omega, alpha = (np.cumsum(telescopes.turned(slides, rate)) for rate in (qd, qdd))
    forces, base = np.empty((len(q), 2)), np.array([0.0, c.gravity])
    for j in range(len(q)):
        turning = alpha[j] * across[j] - omega[j] ** 2 * along[j]
        sliding = np.zeros(2)
        if slides[j]:
            sliding = 2.0 * omega[j] * qd[j] * across[j] + qdd[j] * along[j]
        forces[j] = c.mass[j] * (base + center[j] * turning + sliding)
        base = base + length[j] * turning + sliding
    result, moment, beyond = np.empty(len(q)), 0.0, c.payload * base
    for j in range(len(q) - 1, -1, -1):
        moment += c.inertia[j] * alpha[j] + length[j] * float(across[j] @ beyond)
        moment += center[j] * float(across[j] @ forces[j])
        beyond = beyond + forces[j]
        result[j] = along[j] @ beyond if slides[j] else moment
    return result


def mass_matrix(c: Chain, slides: telescopes.Slides, q: FloatArray) -> FloatArray:
    """M(q), float64[n, n]: column by column, `torques` of a unit acceleration without gravity."""
    weightless, rest = c._replace(gravity=0.0), np.zeros(len(q))
    columns = [torques(weightless, slides, q, rest, unit) for unit in np.eye(len(q))]
    return np.stack(columns, axis=-1)
