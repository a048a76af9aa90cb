"""Elements of the hydraulic circuit, one small function for each component.

Resistive elements return (Q, dQ/dΔp): the flow [m³/s] through the element and its slope [m³/(s
Pa)]. The flow and the pressure drop Δp [Pa] have the same positive direction. The slope is never
negative. Dynamic elements return their state after dt [s], which is exact if the input is constant
during dt.

Sources: H. E. Merritt, Hydraulic Control Systems (orifices, chambers, servo valves, leakage);
paper, Section 1 (servo pump, check valve and switching valve of a booster module).
"""

import math

from mhsb_model.circuit.quantities import CircuitConstants, CylinderConstants
from mhsb_model.kernels.kernel import kernel
from mhsb_model.types import FloatArray


@kernel(inline="always")
def compute_orifice_flow(k: float, drop: float, laminar: float) -> tuple[float, float]:
    """Compute the flow through an orifice, turbulent at large and laminar at small drops.

        Q = k Δp / (Δp² + Δp_c²)^¼

    The flow tends to k √|Δp| with the sign of Δp if |Δp| ≫ Δp_c. The function is smooth at Δp = 0.

    Args:
        k: Flow coefficient [m³/(s √Pa)].
        drop: Pressure drop Δp, of either sign [Pa].
        laminar: Pressure drop Δp_c below which the flow is laminar [Pa].

    Returns:
        Flow Q [m³/s] and slope dQ/dΔp [m³/(s Pa)].
    """
    square = drop * drop + laminar * laminar
    root = math.sqrt(math.sqrt(square))
    flow = k * drop / root
    slope = k * (0.5 * drop * drop + laminar * laminar) / (square * root)
    return flow, slope


@kernel(inline="always")
def compute_land_conductance(conductance: float, overlap: float, length: float) -> float:
    """Compute the laminar leakage of a spool's land per pressure drop.

        G = G₀ ℓ/(ℓ + max(0, λ))

    The flow through the gap between land and sleeve is inversely proportional to the length of the
    gap. The rounded edges leave a length ℓ at zero overlap. An open land (λ < 0) leaks like one
    without overlap. The flow through its open metering edge is not included.

    Args:
        conductance: Leakage G₀ at zero overlap [m³/(s Pa)].
        overlap: Present overlap λ, as a share of the spool's stroke; negative if the land is open.
        length: Length ℓ of the gap at zero overlap, as a share of the stroke.

    Returns:
        Conductance G = Q/Δp [m³/(s Pa)].

    Source:
        H. E. Merritt, Hydraulic Control Systems (laminar flow through the gaps of a closed spool);
        B. Eryilmaz, B. H. Wilson, Combining leakage and orifice flows in a hydraulic servovalve
        model (2000), for the decrease with the overlap.
    """
    return conductance * length / (length + max(0.0, overlap))


@kernel(inline="always")
def compute_null_leakage(c: CircuitConstants, drop: float) -> float:
    """Compute the leakage of a closed servo valve from its line to the tank.

        Q = orifice(k_leak, Δp) + G Δp

    The first term is the flow through an orifice (`compute_orifice_flow`) with the coefficient
    k_leak. The second term is the laminar flow past the lands of both work ports A and B. G is the
    conductance of a land at the mean overlap of both directions. The second term is exact if p_A +
    p_B = p_line + p_tank, with the pressures of both chambers, the line and the tank.

    Args:
        c: Constants of the circuit.
        drop: Pressure drop Δp from the line to the tank [Pa].

    Returns:
        Leakage [m³/s].
    """
    flow, _ = compute_orifice_flow(c.leakage_coefficient, drop, c.laminar_pressure)
    overlap = 0.5 * (c.valve_overlap + c.valve_overlap_retracting)
    return flow + compute_land_conductance(c.land_conductance, overlap, c.land_length) * drop


@kernel(inline="always")
def compute_check_valve_flow(k: float, drop: float, laminar: float) -> tuple[float, float]:
    """Compute the flow through a check valve, which opens forwards and is tight backwards.

        Q = k Δp / (Δp² + Δp_c²)^¼ if Δp > 0, else 0

    The open valve is an orifice, laminar below Δp_c. The returned slope is the chord Q/Δp, which is
    steeper than the tangent dQ/dΔp. With the tangent, an implicit integration step may pass Δp = 0
    and let oil flow back.

    Args:
        k: Flow coefficient [m³/(s √Pa)].
        drop: Pressure drop Δp in the direction of flow [Pa].
        laminar: Pressure drop Δp_c below which the flow is laminar [Pa].

    Returns:
        Flow Q [m³/s] and slope Q/Δp [m³/(s Pa)]; both are 0 if the valve is shut.
    """
    if drop <= 0.0:
        return 0.0, 0.0
    flow, _ = compute_orifice_flow(k, drop, laminar)
    return flow, flow / drop


@kernel(inline="always")
def compute_relief_valve_flow(gain: float, drop: float, setting: float) -> tuple[float, float]:
    """Compute the flow through a relief valve with a linear characteristic.

        Q = gain · max(0, Δp − setting)

    With setting = 0, the valve is an anti-cavitation valve.

    Args:
        gain: Flow per pressure above the setting [m³/(s Pa)].
        drop: Pressure drop Δp across the valve [Pa].
        setting: Pressure drop at which the valve opens [Pa].

    Returns:
        Flow Q [m³/s] and slope dQ/dΔp [m³/(s Pa)]; both are 0 if the valve is shut.
    """
    if drop <= setting:
        return 0.0, 0.0
    return gain * (drop - setting), gain


@kernel(inline="always")
def compute_main_pump_flow(
    max_flow: float, setting: float, droop: float, pressure: float
) -> tuple[float, float]:
    """Compute the flow that the main pump's pressure regulator demands.

        Q = Q_max (p_set − p)/droop, limited to 0 … Q_max

    The lag with which the swash plate follows is not included.

    Args:
        max_flow: Largest flow Q_max [m³/s].
        setting: Pressure p_set at which the regulator has reduced the flow to 0 [Pa].
        droop: Range of pressures below p_set in which the flow rises from 0 to Q_max [Pa].
        pressure: Pressure p in the manifold behind the pump [Pa].

    Returns:
        Flow [m³/s] and its slope −dQ/dp ≥ 0 [m³/(s Pa)]; the slope is 0 if the flow is limited.

    Source:
        M. Jelali, A. Kroll, Hydraulic Servo-systems (pressure-controlled variable pump).
    """
    share = (setting - pressure) / droop
    if share <= 0.0:
        return 0.0, 0.0
    if share >= 1.0:
        return max_flow, 0.0
    return max_flow * share, max_flow / droop


@kernel(inline="always")
def advance_servo_pump_flow(
    flow: float, command: float, largest: float, decay: float, largest_change: float
) -> float:
    """Compute the flow of a speed-controlled servo pump after one step.

        τ dQ/dt = Q_cmd − Q,   0 ≤ Q_cmd ≤ largest

    The flow is a first-order lag of the command, and its change per step is limited.

    Args:
        flow: Flow Q at the start of the step [m³/s].
        command: Commanded flow Q_cmd; values outside 0 … `largest` are limited to that range
            [m³/s].
        largest: Largest flow that the pump can give at present [m³/s].
        decay: Decay e^(−dt/τ) of the pump's lag τ over the step dt.
        largest_change: Largest change of the flow in the step, up or down [m³/s].

    Returns:
        Flow at the end of the step [m³/s].
    """
    goal = min(max(command, 0.0), largest)
    change = (goal - flow) * (1.0 - decay)
    return flow + min(max(change, -largest_change), largest_change)


@kernel(inline="always")
def compute_pump_filling(pressure: float, vapour: float, filling: float) -> tuple[float, float]:
    """Compute the share of a pump's displacement that fills with oil at the inlet.

    The share is (p − p_v)/Δp_f, limited to 0 … 1.

    Args:
        pressure: Pressure p at the inlet [Pa].
        vapour: Vapour pressure p_v [Pa].
        filling: Pressure Δp_f above the vapour pressure at which the pump is filled completely
            [Pa].

    Returns:
        Filled share, 0 … 1, and its slope dshare/dp [1/Pa].

    Source:
        J. Ivantysyn, M. Ivantysynova, Hydrostatic Pumps and Motors (cavitation at the inlet).
    """
    above = pressure - vapour
    if above >= filling:
        return 1.0, 0.0
    if above <= 0.0:
        return 0.0, 0.0
    return above / filling, 1.0 / filling


@kernel(inline="always")
def compute_shaft_power(
    hydraulic: float, speed: float, efficiency: float, drag_power: float
) -> float:
    """Compute the power at the shaft of a pump.

        P = max(0, Δp Q)/η + P_d n

    The drag power P_d does not depend on the pressure, so the overall efficiency Δp Q/P is lower at
    small loads.

    Args:
        hydraulic: Hydraulic power Δp Q [W]; negative values count as 0.
        speed: Pump speed n, as a share of full speed.
        efficiency: Efficiency η without drag.
        drag_power: Power P_d that drag takes at full speed [W].

    Returns:
        Shaft power P [W].

    Source:
        W. E. Wilson, Rotary Pumps and Fluid Motors (torque proportional to pressure, plus drag).
    """
    return max(0.0, hydraulic) / efficiency + drag_power * speed


@kernel(inline="always")
def advance_pressure_and_cavity(
    pressure: float, cavity: float, capacity: float, vapour: float, inflow: float
) -> tuple[float, float]:
    """Compute pressure and vapour volume of a node after oil has flowed into it.

        e = C (p − p_v) − V_v + inflow
        e ≥ 0:  pressure p_v + e/C,  no vapour
        e < 0:  pressure p_v,  vapour volume −e

    e is the volume of oil after the step minus the volume that just fills the node at the vapour
    pressure p_v.

    Args:
        pressure: Pressure p before the step [Pa].
        cavity: Vapour volume V_v before the step [m³].
        capacity: Capacity C = V/β of the node [m³/Pa].
        vapour: Vapour pressure p_v [Pa].
        inflow: Net volume of oil that has flowed in during the step [m³].

    Returns:
        Pressure [Pa] and vapour volume [m³] after the step.

    Source:
        E. B. Wylie, V. L. Streeter, Fluid Transients in Systems (discrete vapour cavities).
    """
    content = capacity * (pressure - vapour) - cavity + inflow
    if content < 0.0:
        return vapour, -content
    return vapour + content / capacity, 0.0


@kernel(inline="always")
def follow_with_backlash(follower: float, leader: float, width: float) -> float:
    """Compute the position of a follower that a leader moves through backlash.

    The follower rests while the leader is within ±width/2 of it. Otherwise the leader moves the
    follower along at a distance of width/2. If either position is nan, the result is the leader's
    position.

    Args:
        follower: Position of the follower before the step.
        leader: Present position of the leader.
        width: Total width of the backlash, in the same unit.

    Returns:
        New position of the follower.

    Source:
        A. Visintin, Differential Models of Hysteresis (the play operator).
    """
    lag = leader - follower
    if lag > 0.5 * width:
        return leader - 0.5 * width
    if lag < -0.5 * width:
        return leader + 0.5 * width
    return leader if math.isnan(lag) else follower


@kernel(inline="always")
def compute_valve_opening(spool: float, overlap: float, exponent: float = 1.0) -> float:
    """Compute the opening of a servo valve's edges at a spool position.

        sign(x) (max(0, |x| − o)/(1 − o))^n

    Args:
        spool: Spool position x, −1 … 1 of the stroke; positive extends.
        overlap: Overlap o of the edges, as a share of the stroke; the valve is closed within ±o.
        exponent: Exponent n; 1 for a linear valve, larger for a valve with metering notches.

    Returns:
        Signed opening. At full stroke it is ±1, which stands for the valve's rated flow.

    Source:
        H. E. Merritt, Hydraulic Control Systems (spool valves with overlap).
    """
    if abs(spool) < overlap:
        return 0.0
    opening = (spool - math.copysign(overlap, spool)) / (1.0 - overlap)
    if exponent != 1.0:
        opening = math.copysign(abs(opening) ** exponent, opening)
    return opening


@kernel(inline="always")
def apply_valve_curve(opening: float, curve: FloatArray) -> float:
    """Map the opening of a valve through the curve that its machine file declares.

    The curve is piecewise linear. With points (ξ_i, y_i) and ξ_i ≤ |ξ| ≤ ξ_(i+1):

        sign(ξ) (y_i + (|ξ| − ξ_i) (y_(i+1) − y_i)/(ξ_(i+1) − ξ_i))

    |ξ| beyond 1 counts as 1.

    Args:
        opening: Opening ξ of a valve with a straight curve, −1 … 1 (`compute_valve_opening`).
        curve: Shares ξ_i of the stroke beyond the overlap in row 0, shares y_i of the full opening
            in row 1, float64[2, k]. Both rise from 0 to 1.

    Returns:
        Signed opening, −1 … 1.
    """
    size, last = abs(opening), curve.shape[1] - 1
    i = 0
    while i < last - 1 and curve[0, i + 1] < size:
        i += 1
    left, right, low, high = curve[0, i], curve[0, i + 1], curve[1, i], curve[1, i + 1]
    share = min((size - left) / (right - left), 1.0)
    return math.copysign(low + share * (high - low), opening)


@kernel(inline="always")
def compute_metering_flow(
    k: float, drop: float, laminar: float, compensated: float
) -> tuple[float, float]:
    """Compute the flow through a metering edge with a pressure compensator.

        Q = k S(min(Δp, Δp_k)),   S(Δp) = Δp/(Δp² + Δp_c²)^¼

    A compensator in series with the edge keeps the drop over the edge at Δp_k and takes the rest of
    Δp. The flow then depends on the opening alone. If Δp is below Δp_k, the compensator is fully
    open and has no drop.

    Args:
        k: Flow coefficient of the edge at its present opening [m³/(s √Pa)].
        drop: Pressure drop Δp over edge and compensator, of either sign [Pa].
        laminar: Pressure drop Δp_c below which the flow is laminar [Pa].
        compensated: Drop Δp_k that the compensator keeps [Pa]; inf without a compensator.

    Returns:
        Flow Q [m³/s] and slope dQ/dΔp [m³/(s Pa)], which is 0 while the compensator throttles.

    Source:
        HAWE D 7700-5 (load-sensing directional spool valves); Hopsan, PressureCompensatingValve.
    """
    if drop > compensated:
        flow, _ = compute_orifice_flow(k, compensated, laminar)
        return flow, 0.0
    return compute_orifice_flow(k, drop, laminar)


@kernel(inline="always")
def compute_accumulator_capacity(
    pressure: float, volume: float, precharge: float, exponent: float
) -> float:
    """Compute the hydraulic capacity of a gas accumulator.

    With p V^n = p₀ V₀^n:

        C = −dV/dp = [V₀/(n p)] (p₀/p)^(1/n)

    Args:
        pressure: Oil pressure p [Pa].
        volume: Gas volume V₀ at the precharge pressure [m³].
        precharge: Precharge pressure p₀ [Pa].
        exponent: Polytropic exponent n of the gas.

    Returns:
        Capacity C [m³/Pa]; 0 up to the precharge pressure.

    Source:
        H. E. Merritt, Hydraulic Control Systems (accumulators).
    """
    if pressure <= precharge:
        return 0.0
    return volume / (exponent * pressure) * (precharge / pressure) ** (1.0 / exponent)


ATMOSPHERIC_PRESSURE = 1.013e5
"""Absolute pressure at which the share of free air is stated [Pa]."""

AIR_EXPONENT = 1.4
"""Polytropic exponent of air bubbles, which have no time to exchange heat [-]."""


@kernel(inline="always")
def compute_air_factor(bulk_modulus: float, air: float, pressure: float) -> float:
    """Compute the factor by which free air raises the compressibility of the oil.

        β/β_e = (1 + r β/(n p)) / (1 + r),   r = [α/(1 − α)] (p₀/p)^(1/n)

    β_e is the effective bulk modulus, and r the ratio of the air's volume to the oil's. The air
    follows p V^n = constant with n = AIR_EXPONENT. It does not dissolve. The compression of the oil
    itself is neglected in r.

    Args:
        bulk_modulus: Bulk modulus β of the oil without air [Pa].
        air: Share α of the volume that is air at the atmospheric pressure p₀.
        pressure: Absolute pressure p [Pa].

    Returns:
        Factor on the capacity V/β of a volume [-], at least 1 for p < β/n.

    Source:
        M. Jelali, A. Kroll, Hydraulic Servo-systems (effective bulk modulus); H. E. Merritt,
        Hydraulic Control Systems (entrapped air).
    """
    ratio = air / (1.0 - air) * (ATMOSPHERIC_PRESSURE / pressure) ** (1.0 / AIR_EXPONENT)
    return (1.0 + ratio * bulk_modulus / (AIR_EXPONENT * pressure)) / (1.0 + ratio)


@kernel(inline="always")
def compute_sliding_friction(
    coulomb: float, breakaway: float, stribeck_speed: float, speed: float
) -> float:
    """Compute the steady friction at a speed without its viscous part (Stribeck curve).

        g(v) = F_c (1 + (b − 1) e^(−(v/v_s)²))

    Args:
        coulomb: Coulomb friction F_c [N].
        breakaway: Ratio b of static to Coulomb friction.
        stribeck_speed: Speed v_s of the Stribeck effect [m/s].
        speed: Piston speed v [m/s].

    Returns:
        Magnitude of the friction g [N].
    """
    ratio = speed / stribeck_speed
    return coulomb * (1.0 + (breakaway - 1.0) * math.exp(-ratio * ratio))


@kernel(inline="always")
def advance_bristle_deflection(
    deflection: float, speed: float, steady_friction: float, stiffness: float, dt: float
) -> float:
    """Advance the bristle deflection of the LuGre friction model by one step.

        dz/dt = v − σ₀ |v| z / g

    The solution is exact for a constant speed.

    Args:
        deflection: Deflection z at the start of the step [m].
        speed: Piston speed v [m/s].
        steady_friction: Friction g in steady motion at that speed, without its viscous part; it
            must be positive [N].
        stiffness: Bristle stiffness σ₀ [N/m].
        dt: Duration of the step [s].

    Returns:
        Deflection at the end of the step [m].

    Source:
        C. Canudas de Wit, H. Olsson, K. J. Åström, P. Lischinsky, A new model for control of
        systems with friction (1995).
    """
    rate = stiffness * abs(speed) / steady_friction * dt
    if rate < 1e-9:
        return deflection + speed * dt * (1.0 - 0.5 * rate)
    decay = math.exp(-rate)
    steady = steady_friction / stiffness if speed > 0.0 else -steady_friction / stiffness
    return steady + (deflection - steady) * decay


@kernel(inline="always")
def advance_first_order_lag(value: float, command: float, decay: float) -> float:
    """Advance a first-order lag, such as a switching valve, by one step.

        τ dx/dt = u − x

    Args:
        value: State x at the start of the step.
        command: Input u, constant during the step.
        decay: e^(−dt/τ) for the duration dt of the step.

    Returns:
        State at the end of the step.
    """
    return command + (value - command) * decay


@kernel(inline="always")
def compute_chamber_volumes(cylinder: CylinderConstants, length: float) -> tuple[float, float]:
    """Compute the oil volumes on the cap side and on the rod side of a cylinder.

        V_A = V₀ + A (L − L_min),   V_B = V₀ + a (L_max − L)

    V_A and V_B are the volumes on the cap side and the rod side, A and a the piston areas of these
    sides. V₀ is the dead volume. L_min and L_max are the lengths at the ends of the stroke. For a
    rotary motor both volumes are V₀.

    Args:
        cylinder: Constants of the cylinder.
        length: Cylinder length L between its pins [m].

    Returns:
        Volume on the cap side and on the rod side [m³].
    """
    extended, left = length - cylinder.min_length, cylinder.max_length - length
    cap, rod = (
        cylinder.swept_volume_factor * cylinder.cap_area,
        cylinder.swept_volume_factor * cylinder.rod_area,
    )
    return cylinder.dead_volume + cap * extended, cylinder.dead_volume + rod * left


@kernel(inline="always")
def compute_friction_force(
    coulomb: float, viscous: float, speed_scale: float, speed: float
) -> float:
    """Compute Coulomb and viscous friction of a cylinder, smooth through zero speed.

        F = F_c tanh(v/v_s) + b v

    Args:
        coulomb: Coulomb friction F_c [N].
        viscous: Viscous coefficient b [N s/m].
        speed_scale: Speed v_s that smooths the change of sign [m/s]; at v_s the Coulomb friction is
            76 % of F_c.
        speed: Piston speed v [m/s].

    Returns:
        Friction, with the sign of the speed; it acts against the motion [N].
    """
    return coulomb * math.tanh(speed / speed_scale) + viscous * speed


def compute_spool_transition(
    frequency: float, damping: float, dt: float
) -> tuple[float, float, float, float]:
    """Compute the transition matrix of a valve spool, a second-order system, over one step.

    With ω = 2π · frequency, ζ = damping and a constant command u, the spool position x obeys

        ẍ + 2ζω ẋ + ω²(x − u) = 0

    The state is (x − u, ẋ). With the system matrix S = [[0, 1], [−ω², −2ζω]] and the identity I,
    the transition matrix is

        Φ = e^(S dt) = e^(−ζω dt) [c I + s (S + ζω I)]
        c = cos(ω_d dt),   s = sin(ω_d dt)/ω_d,   ω_d = ω √|1 − ζ²|

    If ζ > 1, cosh and sinh replace cos and sin. If ζ = 1, c = 1 and s = dt.

    Args:
        frequency: Natural frequency ω/2π [Hz].
        damping: Damping ratio ζ > 0.
        dt: Duration of the step [s].

    Returns:
        Elements Φ₀₀, Φ₀₁ [s], Φ₁₀ [1/s], Φ₁₁.
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
