"""Elements of the hydraulic circuit: one small function per component.

Resistive elements return (Q, dQ/dΔp): the flow [m³/s] from the side where the pressure drop Δp
[Pa] is counted from, and its slope [m³/(s Pa)], never negative. Dynamic elements return their
state after dt [s], exactly for an input that is constant meanwhile. Sources: H. E. Merritt,
Hydraulic Control Systems (orifices, chambers, servo valves, leakage); paper, Section 1
(the module's servo pump, check valve and switching valve).
"""

from __future__ import annotations

import math

from mhsb_model.kernels.kernel import kernel


@kernel(inline="always")
def orifice(k: float, drop: float, laminar: float) -> tuple[float, float]:
    """Q = k Δp / (Δp² + Δp_c²)^¼: k √Δp for Δp ≫ Δp_c, laminar below, smooth through zero.

    k: flow coefficient [m³/(s √Pa)]; laminar: Δp_c [Pa].
    """
    square = drop * drop + laminar * laminar
    root = math.sqrt(math.sqrt(square))
    flow = k * drop / root
    slope = k * (0.5 * drop * drop + laminar * laminar) / (square * root)
    return flow, slope


@kernel(inline="always")
def check_valve(k: float, drop: float, laminar: float) -> tuple[float, float]:
    """Q = orifice(k, Δp) for Δp > 0, else 0: opens forwards, tight backwards.

    The slope is that of the chord, Q/Δp: an implicit step then ends with a flow that has the sign
    of its Δp. The tangent is less steep, so that a step would go past Δp = 0 and let oil back.
    """
    if drop <= 0.0:
        return 0.0, 0.0
    flow, _ = orifice(k, drop, laminar)
    return flow, flow / drop


@kernel(inline="always")
def relief_valve(gain: float, drop: float, setting: float) -> tuple[float, float]:
    """Q = gain · max(0, Δp − setting): relief and, set at 0, anti-cavitation valves.

    gain [m³/(s Pa)], setting [Pa].
    """
    if drop <= setting:
        return 0.0, 0.0
    return gain * (drop - setting), gain


@kernel(inline="always")
def constant_pressure_pump(
    max_flow: float, setting: float, droop: float, pressure: float
) -> tuple[float, float]:
    """Q = Q_max · (p_set − p)/droop within 0 … Q_max: the main pump with its regulator.

    Returns the flow into the manifold at `pressure` and −dQ/dp.
    """
    share = (setting - pressure) / droop
    if share <= 0.0:
        return 0.0, 0.0
    if share >= 1.0:
        return max_flow, 0.0
    return max_flow * share, max_flow / droop


@kernel(inline="always")
def servo_pump_flow(
    flow: float, command: float, largest: float, decay: float, largest_change: float
) -> float:
    """τ dQ/dt = Q_cmd − Q, |dQ/dt| ≤ slew, 0 ≤ Q_cmd ≤ largest: a speed-controlled fixed pump.

    decay: e^(−dt/τ); largest_change: slew · dt [m³/s].
    """
    goal = min(max(command, 0.0), largest)
    change = (goal - flow) * (1.0 - decay)
    return flow + min(max(change, -largest_change), largest_change)


@kernel(inline="always")
def first_order_lag(value: float, command: float, decay: float) -> float:
    """τ dx/dt = u − x: switching valves; decay = e^(−dt/τ)."""
    return command + (value - command) * decay


@kernel(inline="always")
def chamber_capacity(dead_volume: float, area: float, stroke: float, bulk_modulus: float) -> float:
    """C = (V₀ + A s)/β [m³/Pa]: dp/dt = (ΣQ − A ds/dt)/C of the chamber with stroke s [m]."""
    return (dead_volume + area * stroke) / bulk_modulus


@kernel(inline="always")
def friction_force(coulomb: float, viscous: float, speed_scale: float, speed: float) -> float:
    """F = F_c tanh(v/v_s) + b v [N], against the motion: seals of a cylinder."""
    return coulomb * math.tanh(speed / speed_scale) + viscous * speed


def spool_transition(
    frequency: float, damping: float, dt: float
) -> tuple[float, float, float, float]:
    """Transition matrix over dt of ẍ + 2 ζ ω ẋ + ω² (x − u) = 0, in (x − u, ẋ), row by row.

    frequency: ω/2π [Hz]; any damping ratio ζ > 0. Source: matrix exponential in closed form,
    Φ = e^(−ζωdt) [c I + s (S + ζω I)], with S the system matrix.
    """
    omega = 2.0 * math.pi * frequency
    rate = damping * omega
    discriminant = omega * omega * (1.0 - damping * damping)
    root = math.sqrt(abs(discriminant))
    if root * dt < 1e-9:
        c, s = 1.0, dt
    elif discriminant > 0.0:
        c, s = math.cos(root * dt), math.sin(root * dt) / root
    else:
        c, s = math.cosh(root * dt), math.sinh(root * dt) / root
    decay = math.exp(-rate * dt)
    return (
        decay * (c + s * rate),
        decay * s,
        -decay * s * omega * omega,
        decay * (c - s * rate),
    )
