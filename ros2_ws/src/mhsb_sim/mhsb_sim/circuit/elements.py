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
from mhsb_sim.records import Record


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
def pump_filling(pressure: float, vapour: float, filling: float) -> tuple[float, float]:
    """Share of its displacement that a pump is filled by, (p − p_v)/Δp_f within 0 … 1, and slope.

    pressure: p at its inlet; vapour: p_v; filling: Δp_f [Pa], that fills it wholly. Source:
    J. Ivantysyn, M. Ivantysynova, Hydrostatic Pumps and Motors (cavitation at the inlet).
    """
    above = pressure - vapour
    if above >= filling:
        return 1.0, 0.0
    if above <= 0.0:
        return 0.0, 0.0
    return above / filling, 1.0 / filling


@kernel(inline="always")
def shaft_power(
    hydraulic: float, speed: float, efficiency: float, drag_power: float
) -> float:
    """P = Δp Q/η + P_d n: power [W] at the shaft of a pump, its efficiency map in closed form.

    The overall efficiency Δp Q/P falls with the load, as P_d [W] is spent at full speed whatever
    the pressure. hydraulic: Δp Q [W]; speed: n, share of full speed. Source: W. E. Wilson, Rotary
    Pumps and Fluid Motors (torque proportional to pressure, plus drag).
    """
    return max(0.0, hydraulic) / efficiency + drag_power * speed


@kernel(inline="always")
def pressure_and_cavity(
    pressure: float, cavity: float, capacity: float, vapour: float, inflow: float
) -> tuple[float, float]:
    """p [Pa] and vapour volume V_v [m³] of a node after `inflow` [m³] has come into it.

    The node holds C (p − p_v) − V_v of oil beyond what fills it at p_v: where that is negative
    the oil parts, p stays at p_v and vapour fills the rest. Source: E. B. Wylie, V. L. Streeter,
    Fluid Transients in Systems (discrete vapour cavities).
    """
    content = capacity * (pressure - vapour) - cavity + inflow
    if content < 0.0:
        return vapour, -content
    return vapour + content / capacity, 0.0


@kernel(inline="always")
def play(follower: float, leader: float, width: float) -> float:
    """What follows a leader with backlash: it is moved at either end of the play, width/2 off.

    Source: A. Visintin, Differential Models of Hysteresis (the play operator).
    """
    lag = leader - follower
    if lag > 0.5 * width:
        return leader - 0.5 * width
    if lag < -0.5 * width:
        return leader + 0.5 * width
    return leader if math.isnan(lag) else follower


@kernel(inline="always")
def metered_opening(spool: float, overlap: float) -> float:
    """Opening of the edges, sign(x) max(0, |x| − o)/(1 − o): none within the overlap, 1 at full
    stroke, where the valve is rated. Source: H. E. Merritt, Hydraulic Control Systems (lap).
    """
    if abs(spool) < overlap:
        return 0.0
    return (spool - math.copysign(overlap, spool)) / (1.0 - overlap)


@kernel(inline="always")
def accumulator_capacity(
    pressure: float, volume: float, precharge: float, exponent: float
) -> float:
    """C = V₀/(n p) (p₀/p)^(1/n) [m³/Pa] of a gas accumulator, none below its precharge p₀.

    From p V^n = p₀ V₀^n. Source: Merritt (accumulators).
    """
    if pressure <= precharge:
        return 0.0
    return volume / (exponent * pressure) * (precharge / pressure) ** (1.0 / exponent)


@kernel(inline="always")
def sliding_friction(
    coulomb: float, breakaway: float, stribeck_speed: float, speed: float
) -> float:
    """g(v) = F_c (1 + (b − 1) e^(−(v/v_s)²)) [N]: steady friction without its viscous part."""
    ratio = speed / stribeck_speed
    return coulomb * (1.0 + (breakaway - 1.0) * math.exp(-ratio * ratio))


@kernel(inline="always")
def bristle_bend(bend: float, speed: float, sliding: float, stiffness: float, dt: float) -> float:
    """z after dt of ż = v − σ₀ |v|/g z [m], exactly for a constant v: LuGre's bristles.

    sliding: g [N]; stiffness: σ₀ [N/m]. Source: C. Canudas de Wit, H. Olsson, K. J. Åström,
    P. Lischinsky, A new model for control of systems with friction (1995).
    """
    rate = stiffness * abs(speed) / sliding * dt
    if rate < 1e-9:
        return bend + speed * dt * (1.0 - 0.5 * rate)
    decay = math.exp(-rate)
    steady = sliding / stiffness if speed > 0.0 else -sliding / stiffness
    return steady + (bend - steady) * decay


@kernel(inline="always")
def first_order_lag(value: float, command: float, decay: float) -> float:
    """τ dx/dt = u − x: switching valves; decay = e^(−dt/τ)."""
    return command + (value - command) * decay


@kernel(inline="always")
def chamber_volumes(cylinder: Record, length: float) -> tuple[float, float]:
    """V₀ + A s on the cap side and V₀ + a (s_max − s) on the rod side [m³].

    With C = V/β: dp/dt = (ΣQ − A ds/dt)/C. cylinder: one of CYLINDER; length [m].
    """
    extended, left = length - cylinder.min_length, cylinder.max_length - length
    cap, rod = cylinder.swept * cylinder.cap_area, cylinder.swept * cylinder.rod_area
    return cylinder.dead_volume + cap * extended, cylinder.dead_volume + rod * left


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
