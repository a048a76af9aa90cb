"""Flow commands of the servo pumps in coordinated control.

The pumps deliver the flow that the valves are about to take, corrected a little by the pressure
error. Each pump's flow is limited so that the pump can be stopped before its oil overfills the
line. The reference ahead shows how much oil the line will take. There are two limits:

- The limit for the flow that is drawn assumes the estimated lag of the pumps, and a leakage that is
  reduced by its uncertainty.
- The limit for the drawn flow plus the flow that charges a line assumes a slower pump with a longer
  delay, and a stiffer line.

Commands act with a delay. So all limits use the flow and the oil at the instant when the command
begins to act. On the rail, pumps that are no longer needed count until they have come to rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from mhsb_control.cascade import ControlAxis, ServoArguments
from mhsb_control.coasting import COASTING_SAMPLES, compute_coasting_limit, compute_coasting_volumes
from mhsb_control.controller import REFERENCE_POINTS, ServoSignals
from mhsb_control.delay_line import build_delay_lines, delay_value
from mhsb_control.draw_estimate import (
    DrawObserver,
    DrawSettings,
    MeasuredLine,
    build_draw_observers,
    compute_draw_shortfall,
    update_draw_observer,
)
from mhsb_control.line_estimate import LineEstimates, LineSettings, build_line_estimates
from mhsb_control.pump_estimate import (
    DriveEstimates,
    DriveSettings,
    build_drive_estimates,
    update_drive_estimates,
)
from mhsb_control.reference import PREVIEW_POINT
from mhsb_model.circuit.elements import compute_orifice_flow
from mhsb_model.circuit.quantities import CylinderConstants, ModuleState
from mhsb_model.hydraulics import compute_pressure_without_margin, inlet_area
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.modes import BOOSTED_MODES
from mhsb_model.records import Record, Records, create_record, create_records
from mhsb_model.schema import DEFAULT_PREVIEW, Gain, NonNegative, Preview, Section
from mhsb_model.types import FloatArray, IntArray


@dataclass(frozen=True)
class PumpSettings(Record):
    """Tuned numbers of the servo pumps' control, and of the estimates that it uses."""

    min_charge_share: float = 0.15
    """Share of a line's missing oil that is charged however uncertain line and pump are, 0 … 1.

    Origin: chosen; without it a line whose pump is unknown would never be charged.

    30 % smaller and larger, N = 5: RMS error −4.4 and −3.8 % (mhsb_arm3; overshoot −0.06 and
    −0.03 MPa), +0.8 and −1.9 % (excavator; overshoot −1.29 and −0.46 MPa)."""
    caution_sigmas: float = 1.5
    """Number of standard deviations by which charging assumes unfavourable values, 0 … 5.

    Less leakage, stiffer oil and slower pumps are unfavourable. Origin: chosen; 93 % of lines are
    then not overfilled.

    30 % smaller and larger, N = 5: RMS error −1.2 and −4.3 % (mhsb_arm3), +2.3 and +2.2 %
    (excavator; overshoot −1.91 and −0.16 MPa)."""
    max_gain_delay: float = 0.4
    """Largest pressure gain times the delay of commands [-], above 0 … 10.

    Origin: derivation; an integrator with a delay is stable up to π/2, and 0.4 leaves 12 dB.

    30 % smaller and larger: not measured."""
    min_manifold_pressure_share: float = 0.94
    """Share of P_S down to which the oil stored in the manifold may charge lines, 0 … 1.

    Origin: chosen; droop and check valves take 1 % of P_S.

    Distance to 1 30 % smaller and larger, N = 5: RMS error +0.1 and 0 % (mhsb_arm3), −3.3 and
    −1.5 % (excavator; overshoot −0.46 and −0.46 MPa)."""
    lines: LineSettings = field(default_factory=LineSettings)
    """Tuned numbers of the estimates of oil compressibility and leakage."""
    drives: DriveSettings = field(default_factory=DriveSettings)
    """Tuned numbers of the estimates of the pumps' lag and delay."""
    draws: DrawSettings = field(default_factory=DrawSettings)
    """Tuned numbers of the observers of drawn flow."""


class PumpParameters(Record):
    """Gains and limits of the servo pumps' control in SI units."""

    preview: float
    """Time to point PREVIEW_POINT of the reference [s]."""
    bandwidth: float
    """Desired bandwidth λ/τ of a pump [1/s]."""
    pressure_gain: float
    """Gain k of the pressure error [1/s]."""
    pump_rise: float
    """Share of the flow's rise to the next point that is commanded in advance."""
    allowed_rise: float
    """Pressure rise above the target that is allowed while a pump coasts [Pa]."""
    fed_below: float
    """Line pressure below which the manifold may also feed the line [Pa]."""
    settings: PumpSettings
    """Tuned numbers."""


class PumpGains(Section):
    """Gains by which servo pumps are driven.

    Attributes:
        search_ranges: Range in which `tune` searches each gain, as in `CascadeGains`.
    """

    search_ranges: ClassVar[dict[str, tuple[float, float]]] = {
        "pressure_gain": (0.3, 4.0),
        "pump_response": (0.2, 3.0),
        "preview": (0.06, 0.2),
        "allowed_rise": (1e4, 1e6),
    }

    pressure_gain: float = Field(
        default=3.37,
        ge=1e-4,
        le=1e8,
        description="of the servo pumps' pressure loop, per lag of the pumps [-]",
    )
    preview: Preview = DEFAULT_PREVIEW
    allowed_rise: NonNegative = Field(
        default=4.03e4,
        le=1e9,
        description="above the needed pressure while a servo pump coasts [Pa]",
    )
    pump_response: Gain = Field(
        default=0.337,
        description="time constant to which a servo pump with a longer lag is driven, in times "
        "that it takes to full flow at its slew [-]",
    )


class PumpState(NamedTuple):
    """State of the servo pumps' control, in addition to that of the cascade."""

    gains: Records[PumpParameters]  # [1]
    rail_target: FloatArray  # [2] Pa, pressure targets of the rail, now and at the preview point
    rail_before: FloatArray  # [1] Pa, rail pressure before the last line began to leave
    targets: FloatArray  # [n + 1] Pa, pressure targets of the last step; last: rail
    volume: FloatArray  # [n + 1, REFERENCE_POINTS] m³, see `predict_line_volumes`; last row: rail
    coasting: (
        FloatArray  # [COASTING_SAMPLES + REFERENCE_POINTS − 1] s, see `compute_coasting_limit`
    )
    cautious_coasting: FloatArray  # as `coasting`, of pumps that stop later than estimated
    charging_flow_left: FloatArray  # [1] m³/s, flow that is left for charging lines in this step
    lines: LineEstimates  # estimates of oil compressibility and leakage
    leakage_uncertainty: (
        FloatArray  # [n + 1] m³/s, uncertainty of the leakage; the last one is the rail's
    )
    drives: DriveEstimates  # estimates of pump lag and command delay
    draws: Records[DrawObserver]  # [n + 1]; the last row is the rail's
    # [n + 1, d + 1] m³/s, commanded flows of the last steps, see `build_delay_lines`
    commanded_flows: FloatArray
    coasting_times: FloatArray  # [COASTING_SAMPLES + REFERENCE_POINTS − 1] s, times of `coasting`


def build_pump_state(
    machine: Machine, signals: ServoSignals, gains: PumpGains, settings: PumpSettings
) -> PumpState:
    """Build the state of a machine's servo pumps, at rest.

    Args:
        machine: The machine as declared in its file (the real one may differ).
        signals: Signals of the controller. The present rail pressure becomes the first target of
            the rail.
        gains: Gains of the controller, from its section of the machine file.
        settings: Tuned numbers.

    Returns:
        The state, with the pump lag, the leakage and the delay of commands of the machine file.
    """
    oil, n = machine.config.circuit, machine.joint_count
    lag, preview = oil.servo_pump_lag, gains.preview
    own = create_records(PumpParameters, 1)
    own["preview"] = preview
    spin_up = signals.circuit.constants["servo_pump_flow"] / oil.servo_pump_slew
    own["bandwidth"] = 1.0 / (gains.pump_response * spin_up)
    own["pump_rise"] = np.minimum(
        1.0, PREVIEW_POINT / (np.maximum(1.0 / lag, own["bandwidth"]) * preview)
    )
    own["pressure_gain"] = gains.pressure_gain / lag
    own["allowed_rise"] = gains.allowed_rise
    supply = signals.circuit.constants["supply_pressure"]
    own["fed_below"] = supply + settings.lines.check_valve_margin
    own["settings"] = create_record(settings)
    points = np.concatenate(
        [np.arange(COASTING_SAMPLES) / COASTING_SAMPLES, np.arange(1, REFERENCE_POINTS)]
    )
    full_flow = float(signals.circuit.constants["servo_pump_flow"][0])
    step, count = machine.config.simulation.step, len(signals.circuit.modules)
    pumps = PumpState(
        gains=own,
        rail_target=np.full(2, signals.rail_pressure[0]),
        rail_before=np.full(1, signals.rail_pressure[0]),
        targets=np.zeros(n + 1),
        volume=np.zeros((n + 1, REFERENCE_POINTS)),
        coasting=np.zeros(len(points)),
        cautious_coasting=np.zeros(len(points)),
        charging_flow_left=np.zeros(1),
        lines=build_line_estimates(n, settings.lines),
        leakage_uncertainty=np.zeros(n + 1),
        drives=build_drive_estimates(
            lag,
            step,
            full_flow,
            oil.servo_pump_slew,
            count,
            settings.drives,
            machine.config.imperfections.computing_delay,
        ),
        draws=build_draw_observers(n),
        commanded_flows=build_delay_lines(n + 1, step),
        coasting_times=points * preview / PREVIEW_POINT,
    )
    predict_coasting(pumps)
    return pumps


@kernel(borrows=True)
def predict_coasting(p: PumpState) -> None:
    """Compute the oil that a pump still delivers after a stop command, per unit of its flow.

    `coasting_times` are counted from the command, which begins to act after the pump's delay. Oil
    that flows before it acts does not count. `coasting` follows from the estimated lag and delay.
    `cautious_coasting` follows from a lag that is `caution_sigmas` standard deviations longer, and
    from full flow up to the longest plausible delay (`compute_coasting_volumes`).

    Args:
        p: State of the pumps. Writes `coasting` and `cautious_coasting` in place: oil [m³] per flow
            [m³/s], so in s.
    """
    own, sigmas = p.drives.record[0], p.gains[0].settings.caution_sigmas
    delay, later = own.delay * own.step, (own.max_plausible_delay - own.delay) * own.step
    compute_coasting_volumes(own.lag, delay, 0.0, p.coasting_times, p.coasting)
    compute_coasting_volumes(
        (1.0 + sigmas * own.deviation) * own.lag,
        delay,
        later,
        p.coasting_times,
        p.cautious_coasting,
    )


@kernel(borrows=True)
def is_served(j: int, serves: IntArray) -> bool:
    """Return whether any booster module serves actuator j.

    Args:
        j: Index of the actuator.
        serves: Actuator that each module serves, int64[m]; −1 if idle.

    Returns:
        True if at least one module serves it.
    """
    found = False
    for user in serves:
        found = found or user == j
    return found


@kernel(inline="always")
def predict_line_volumes(s: ServoArguments, p: PumpState) -> None:
    """Predict the flow that is drawn next from each boosted line, and the oil up to later times.

    The flow has three parts. The first is the flow that the piston is commanded to take
    (`compute_commanded_flow`). If the valve is slower than the pumps, this flow is delayed by a
    lag, the difference of their time constants. The second is leakage and slip. The third is the
    share `pump_rise` of the increase of the reference's flow up to the next point. The oil up to
    each point ahead is

        V(t) = ∫ (A_dir |v| + leakage + slip) dt + A_dir ΔF/k_h

    The integral is computed by the trapezoidal rule. v is the reference's piston speed, A_dir the
    piston area that the supply fills, and k_h the stiffness of the oil [N/m]. ΔF is the change of
    the cylinder force up to the preview point, positive in the direction of motion [N]. The term
    with ΔF is the oil that compresses the chamber. Of the points up to the preview point, each at
    which the piston moves gets an equal part of it. v is computed with moment arms that are linear
    in the joint position about the preview point. A line gets zeros if it is not joined to the rail
    and no module serves its actuator.

    Args:
        s: Signals, circuit, axes and estimates of the servo. Writes `line_flow` and
            `commanded_flow` of all axes [m³/s] in place.
        p: State of the pumps. Writes in place `volume` [m³] and `leakage_uncertainty` [m³/s] of all
            lines, but not of the rail. Column 0 of `volume` is the oil that the present flow would
            draw up to point 1; column k is V at point k. The uncertainty is `caution_sigmas`
            standard deviations of the leakage.
    """
    reference, cylinders, axes = s.reference, s.cylinders, s.axes
    volume, g = p.volume, p.gains[0]
    spacing = g.preview / PREVIEW_POINT
    for j in range(len(axes)):
        axis, cylinder = axes[j], cylinders[j]
        if axis.joined == 0.0 and not is_served(j, s.serves):
            axis.line_flow = axis.commanded_flow = 0.0
            volume[j] = 0.0
            continue
        leakage = p.lines.estimate[1 + j] * axis.leakage
        p.leakage_uncertainty[j] = (
            g.settings.caution_sigmas * math.sqrt(p.lines.covariance[1 + j, 1 + j]) * axis.leakage
        )
        cap, rod = cylinder.cap_area, cylinder.rod_area
        pressed = (axis.force_ahead - axis.force) / axis.stiffness
        pressed *= cap if axis.speed_ahead > 0.0 else -rod
        lost = leakage + p.lines.fed[j, 2]
        flow, step = compute_commanded_flow(axis, cylinder), s.gains[0].step
        late = max(s.gains[0].valve_lag - 1.0 / g.bandwidth, 0.0)
        axis.commanded_flow += step / (late + step) * (flow - axis.commanded_flow)
        axis.line_flow = axis.commanded_flow + lost
        before, moving = 0.0, 0
        for k in range(1, PREVIEW_POINT + 1):
            moving += 1 if reference[k, 1, j] != 0.0 else 0
        for k in range(len(reference)):
            if k == 0:
                speed = axis.speed
            elif k == PREVIEW_POINT:
                speed = axis.speed_ahead
            else:
                way = reference[k, 0, j] - reference[PREVIEW_POINT, 0, j]
                speed = (axis.arm_ahead + axis.arm_slope_ahead * way) * reference[k, 1, j]
            flow = lost + abs(speed) * inlet_area(cap, rod, speed)
            if k == 0:
                volume[j, k] = spacing * flow
            else:
                drawn = volume[j, k - 1] if k > 1 else 0.0
                volume[j, k] = drawn + 0.5 * spacing * (before + flow)
                moves = k <= PREVIEW_POINT and reference[k, 1, j] != 0.0
                volume[j, k] += pressed / moving if moves else 0.0
            if k == 1:
                axis.line_flow += max(0.0, flow - before) * g.pump_rise
            before = flow


@kernel(inline="always")
def observe_line_draws(s: ServoArguments, p: PumpState) -> None:
    """Observe the flow that lines really draw, and correct the expected flow of boosted lines.

    If pumps alone feed a line, its `line_flow` is reduced by the observed shortfall, but not by
    more than its `commanded_flow`. Pumps alone feed a boosted line if its join valve is shut and
    its pressure is above `fed_below`, so that its check valve is closed. The rail and all lines
    joined to it count as one line, the last record of `draws`. Pumps alone feed the rail if its
    pressure is above `fed_below` and each line is either joined or shut off. `compute_rail_demand`
    subtracts the shortfall of the rail.

    Args:
        s: Signals, circuit, axes and estimates of the servo. Reduces `line_flow` of axes [m³/s] in
            place.
        p: State of the pumps. Updates `draws` and `commanded_flows` in place.
    """
    axes, draws, lines, own, rail = s.axes, p.draws, p.lines, p.drives.record[0], s.rail_pressure[0]
    c, g, squeeze, n = s.constants[0], p.gains[0], lines.estimate[0], len(s.axes)
    lag = s.gains[0].valve_lag
    settings, shut_opening = g.settings.draws, g.settings.lines.shut_opening
    supplied = lines.fed[n, 0] - c.bleed_conductance * (rail - c.tank_pressure)
    joined_flow, capacity, alone = 0.0, squeeze * c.rail_capacity, rail > g.fed_below
    line_capacity = squeeze * c.line_capacity
    for j in range(n):
        axis, line, shut = axes[j], s.sensors[j].line_pressure, s.actuators[j].join < shut_opening
        commanded_flow = compute_commanded_flow(axis, s.cylinders[j])
        own_supply = lines.fed[j, 0] - lines.estimate[1 + j] * axis.leakage
        if axis.joined > 0.0:
            supplied += own_supply
            joined_flow += commanded_flow
            capacity += line_capacity
        alone = alone and (shut or axis.joined > 0.0)
        own_alone = shut and line > g.fed_below and axis.line_flow > 0.0
        measured = MeasuredLine(line, own_supply, own_alone)
        delayed = delay_value(p.commanded_flows[j], commanded_flow, own.delay)
        update_draw_observer(draws[j], measured, delayed, line_capacity, lag, own.step, settings)
        if own_alone:
            shortfall = compute_draw_shortfall(draws[j], axis.supply_target, settings)
            axis.line_flow -= min(shortfall, axis.commanded_flow)
    measured = MeasuredLine(rail, supplied, alone)
    delayed = delay_value(p.commanded_flows[n], joined_flow, own.delay)
    update_draw_observer(draws[n], measured, delayed, capacity, lag, own.step, settings)


@kernel
def compute_commanded_flow(axis: ControlAxis, cylinder: CylinderConstants) -> float:
    """Compute the flow that a piston is commanded to take from its line.

    u is the demanded piston speed. The flow is 0 if u is opposite to the reference's motion at the
    preview point, a fixed time ahead (`speed_ahead`). If the reference rests at that point, its
    present motion counts.

    Args:
        axis: State of the cylinder's control axis, with demand and speeds.
        cylinder: Areas of the cylinder.

    Returns:
        A_dir |u| [m³/s]: the piston area that the supply fills times the speed.
    """
    motion = axis.speed_ahead if axis.speed_ahead != 0.0 else axis.speed
    if axis.demand * motion < 0.0:
        return 0.0
    return inlet_area(cylinder.cap_area, cylinder.rod_area, axis.demand) * abs(axis.demand)


@kernel(inline="always")
def compute_pump_demand(
    line: int,
    drawn: float,
    pressure: float,
    targets: tuple[float, float],
    capacity: float,
    pending: float,
    p: PumpState,
) -> float:
    """Compute the flow that a pump is to feed into a line or into the rail.

    The result is the drawn flow plus a charging flow C (k (p_ref − p) + min(ṗ_ref, 0)). p is the
    pressure predicted for the instant when the command begins to act, and p_ref its target. k is
    the gain `pressure_gain`, but at most `max_gain_delay` divided by the delay of commands. Three
    limits apply:

    - The sum of both flows is at most the limit of `compute_coasting_limit` for the estimated pump.
    - The charging flow is at most `charging_flow_left`.
    - The sum is at most the coasting limit of a slower pump on a stiffer line, both by
      `caution_sigmas` standard deviations. In any case, at least the share `min_charge_share` of
      the charging flow is allowed.

    The first limit is less strict if the line is below its target pressure and the manifold may
    also feed it. Such a line gets the drawn flow and `min_charge_share` of the charging flow if the
    coasting limit without leakage uncertainty allows it.

    Args:
        line: Index of the line; n for the rail.
        drawn: Flow that is about to be drawn from the line [m³/s].
        pressure: Measured pressure of the line [Pa].
        targets: p_ref, target of the pressure at present, and target from the preview point on, a
            fixed time ahead [Pa].
        capacity: C, capacity of the line with the estimated compressibility [m³/Pa].
        pending: Oil that earlier commands still bring [m³].
        p: State of the pumps. Reads `volume`, `leakage_uncertainty` and `targets` of the line.
            Reduces `charging_flow_left` by the charging flow in place.

    Returns:
        Flow [m³/s], not limited to the pump's range.
    """
    g = p.gains[0]
    target, volume, flow_uncertainty = targets[0], p.volume[line], p.leakage_uncertainty[line]
    rises = (g.allowed_rise + target - pressure, g.allowed_rise + targets[1] - pressure)
    spacing = g.preview / PREVIEW_POINT
    limit = compute_coasting_limit(
        volume, p.coasting, capacity, rises, pending, flow_uncertainty, spacing
    )
    squeeze = p.lines.estimate[0]
    stiff = capacity * max(
        1.0 - g.settings.caution_sigmas * math.sqrt(p.lines.covariance[0, 0]) / squeeze,
        1.0 / (g.settings.lines.max_factor * squeeze),
    )
    cautious = compute_coasting_limit(
        volume, p.cautious_coasting, stiff, rises, pending, flow_uncertainty, spacing
    )
    own = p.drives.record[0]
    filled = pending - drawn * own.delay * own.step
    gain = min(g.pressure_gain, g.settings.max_gain_delay / max(own.delay * own.step, own.step))
    lacking = gain * (capacity * (target - pressure) - filled)
    lacking += capacity * min(target - p.targets[line], 0.0) / own.step
    charge = min(lacking, p.charging_flow_left[0])
    least = g.settings.min_charge_share * charge
    if pressure < min(target, g.fed_below):
        sure = compute_coasting_limit(volume, p.coasting, capacity, rises, pending, 0.0, spacing)
        limit = max(limit, min(drawn + least, sure))
    charge = min(charge, max(cautious - drawn, least))
    p.charging_flow_left[0] -= max(charge, 0.0)
    return min(drawn + charge, limit)


@kernel(borrows=True)
def compute_charging_flow_limit(s: ServoArguments, p: PumpState) -> float:
    """Compute the largest flow that may charge lines while other actuators still get enough oil.

    The flow has two parts, each at least 0. The first part is the flow that the main pump has left:
    Q_MP − Σ (A_dir |v_ref| + leakage) over all actuators. The second part comes from the oil stored
    in the manifold: k C (p − p_kept).

    C is the capacity and k the gain `pressure_gain`. p is the lowest line pressure. p_kept is the
    greater of two pressures:

    - `min_manifold_pressure_share` P_S
    - min(p_N + `inertia_margin`, P_S). p_N is the highest pressure that an actuator moving in mode
      N needs. The margin is for friction, and keeps the reference governor from acting.

    Args:
        s: Signals, circuit, axes and estimates of the servo.
        p: State of the pumps. Reads `gains` and the leakage estimates in `lines`.

    Returns:
        Charging flow of all lines together [m³/s]; 0 if no pump is in use.
    """
    in_use = False
    for user in s.serves:
        in_use = in_use or user >= 0
    if not in_use:
        return 0.0
    c, g = s.constants[0], p.gains[0]
    left, lowest = c.main_pump_flow, np.inf
    kept = g.settings.min_manifold_pressure_share * c.supply_pressure
    for j in range(len(s.axes)):
        axis, cylinder, line = s.axes[j], s.cylinders[j], s.sensors[j].line_pressure
        area = inlet_area(cylinder.cap_area, cylinder.rod_area, axis.speed)
        left -= area * abs(axis.speed) + p.lines.estimate[1 + j] * axis.leakage
        lowest = min(lowest, line)
        if not BOOSTED_MODES[s.modes[j]] and axis.speed != 0.0:
            force = axis.force + axis.bias
            needed = compute_pressure_without_margin(
                cylinder.valve_coefficient, cylinder.cap_area, cylinder.rod_area, c.tank_pressure,
                force, axis.speed,
            )  # fmt: skip
            kept = max(kept, min(needed + s.gains[0].inertia_margin, c.supply_pressure))
    pent_up = c.manifold_capacity * (lowest - kept)
    return max(0.0, left) + max(0.0, g.pressure_gain * pent_up)


@kernel(borrows=True)
def feeds_rail(
    module: ModuleState,
    home: int,
    user: int,
    axes: Records[ControlAxis],
    open_opening: float,
) -> bool:
    """Return whether a module in use feeds the shared rail.

    A module that serves the actuator of its own line feeds the rail if this line is joined to the
    rail. A module that is spare or serves another actuator feeds the rail once its diverter counts
    as open.

    Args:
        module: ModuleState of the circuit's module.
        home: Actuator to whose line the module belongs; −1 for a spare.
        user: Actuator that the module serves; not negative.
        axes: ControlAxis[n].
        open_opening: Opening above which a diverter counts as open, 0 … 1.

    Returns:
        True if it feeds the rail.
    """
    if home == user:
        return axes[user].joined > 0.0
    return module.to_rail > open_opening


@kernel(inline="always")
def compute_rail_demand(s: ServoArguments, p: PumpState, pending: float) -> float:
    """Compute the flow that all pumps on the rail together are to feed into the rail.

    The result is the drawn flow plus a flow that brings the rail to its target pressure, the
    charging flow (`compute_pump_demand`). The drawn flow is the sum of the flows into joined lines,
    the flows through closing or throttled join valves, and the pumps' slip. If pistons have drawn
    less than commanded, the observed shortfall is subtracted.

    Args:
        s: Signals, circuit, axes and estimates of the servo.
        p: State of the pumps. Changed in place: the rail's entries (at the end) of `volume` and
            `leakage_uncertainty` are written, and `charging_flow_left` is reduced by the charging
            flow.
        pending: Oil that earlier commands still bring into the rail [m³]; it limits the result.

    Returns:
        Total flow of the pumps on the rail [m³/s], not limited to their range.
    """
    axes, volume, rail_pressure = s.axes, p.volume, s.rail_pressure[0]
    c = s.constants[0]
    drawn, capacity = p.lines.fed[len(axes), 2], c.rail_capacity
    rail_volume = volume[len(axes)]
    for k in range(len(rail_volume)):
        rail_volume[k] = max(k, 1) * p.gains[0].preview / PREVIEW_POINT * drawn
    p.leakage_uncertainty[len(axes)] = 0.0
    for j in range(len(axes)):
        axis = axes[j]
        if axis.joined > 0.0:
            drawn += axis.line_flow
            rail_volume += volume[j]
            p.leakage_uncertainty[len(axes)] += p.leakage_uncertainty[j]
            capacity += c.line_capacity
        else:
            through, _ = compute_orifice_flow(
                c.switching_coefficient * s.actuators[j].join,
                rail_pressure - s.sensors[j].line_pressure,
                c.laminar_pressure,
            )
            drawn += through
    targets = (p.rail_target[0], p.rail_target[1])
    shortfall = compute_draw_shortfall(p.draws[len(axes)], targets[0], p.gains[0].settings.draws)
    drawn -= min(shortfall, drawn)
    return compute_pump_demand(
        len(axes),
        drawn,
        rail_pressure,
        targets,
        p.lines.estimate[0] * capacity,
        pending,
        p,
    )


@kernel(inline="always")
def command_pumps(s: ServoArguments, p: PumpState) -> None:
    """Compute the flow command of every servo pump, with lead compensation of the pump's lag.

        Q_cmd = Q + λ (Q_ref − Q)                pump alone on its line
        Q_cmd = Q̄ + λ (Q_ref − ΣQ)/n             each of n pumps that feed the rail

    λ = max(1, bandwidth × estimated lag). Q_ref is the flow that `compute_pump_demand` or
    `compute_rail_demand` returns. Q is the predicted flow at the instant when the command acts. Q̄
    is the mean flow of the n pumps. ΣQ is the whole flow into the rail, including the flow of idle
    pumps that still run. All pumps on the rail get the same command. So their flows become equal as
    fast as the pumps' lag allows, while the sum follows Q_ref.

    Commands are limited to 0 … Q_max. The command is 0 for idle modules, and for lent modules that
    do not feed the rail yet. A module is lent if it serves an actuator other than its own.

    Args:
        s: Signals, circuit, axes and estimates of the servo. Writes `flow_command` [m³/s] and
            `to_rail_command` (1: switch the module to the rail, 0: to its own line) of all modules
            in place.
        p: State of the pumps. Updates `drives`, `targets` and `charging_flow_left`, and the rail's
            entries of `volume` and `leakage_uncertainty`, in place. If lag and delay were estimated
            anew, it also writes `coasting` and `cautious_coasting`.
    """
    axes, modules, serves, module_home = s.axes, s.modules, s.serves, s.module_home
    c, g, drives = s.constants[0], p.gains[0], p.drives
    diverted = g.settings.lines.open_opening
    if update_drive_estimates(drives, modules, g.settings.drives):
        predict_coasting(p)
    lag_factor = max(1.0, g.bandwidth * drives.record[0].lag)
    sharing, shared, reaching, pending = 0, 0.0, 0.0, 0.0
    for k in range(len(modules)):
        module = modules[k]
        user: int = serves[k]
        if user < 0:
            reaching += drives.flow[k] * module.to_rail
            pending += drives.pending[k] * module.to_rail
        elif feeds_rail(module, module_home[k], user, axes, diverted):
            sharing += 1
            shared += drives.flow[k]
            pending += drives.pending[k]
    rail_command = 0.0
    if sharing > 0:
        demand = compute_rail_demand(s, p, pending)
        rail_command = (shared + lag_factor * (demand - shared - reaching)) / sharing
    for k in range(len(modules)):
        module, user = modules[k], serves[k]
        module.to_rail_command = 1.0 if user >= 0 and module_home[k] != user else 0.0
        command = 0.0
        if user >= 0 and feeds_rail(module, module_home[k], user, axes, diverted):
            command = rail_command
        elif user >= 0 and module.to_rail_command == 0.0:
            axis = axes[user]
            demand = compute_pump_demand(
                user,
                axis.line_flow,
                s.sensors[user].line_pressure,
                (axis.supply_target, axis.target_ahead),
                p.lines.estimate[0] * c.line_capacity,
                drives.pending[k],
                p,
            )
            command = drives.flow[k] + lag_factor * (demand - drives.flow[k])
        module.flow_command = min(max(command, 0.0), c.servo_pump_flow)
    for j in range(len(axes)):
        p.targets[j] = axes[j].supply_target
    p.targets[len(axes)] = p.rail_target[0]
