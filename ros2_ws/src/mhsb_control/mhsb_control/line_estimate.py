"""Estimates of oil compressibility and valve leakage, from the oil balances of boosted lines.

The manifold is the line of the main pump. A window is a short sequence of control steps. It counts
if the lines have a higher pressure than the manifold. Their check valves are then closed, and servo
pumps alone feed them. The balance of oil in a window is

    ∫ Q dt − Σ A_dir |ΔL| = c Σ C Δp + Σ λ_j ∫ q_leak(p_j) dt

Q is the flow of the pumps by their measured speed, minus their slip [m³/s]. C is the capacity of
lines, rail and the chambers behind open valves [m³/Pa]. A_dir is the piston area that the supply
fills, and q_leak the leakage of a valve. All three are computed from the machine file. c is the
file's bulk modulus divided by the true one, and is equal for all oil. λ_j is the factor on the
leakage of valve j.

Each line alone gives a balance; the rail with all lines joined to it gives another one. A Kalman
filter updates c and λ after each window. Both follow slow random walks. A parameter without data
keeps its standard deviation. If servo pumps feed lines at the manifold's pressure, the manifold may
feed the lines as well. So the lines take at least the oil of the servo pumps. Such a balance is
used only at rest, and only if it indicates more leakage.

Source: H. E. Merritt, Hydraulic Control Systems (balance of oil in a line).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mhsb_control.cascade import ControlAxis, ServoArguments
from mhsb_control.controller import ActuatorReadings
from mhsb_model.circuit.elements import compute_null_leakage
from mhsb_model.circuit.quantities import CircuitConstants, CylinderConstants
from mhsb_model.hydraulics import compute_slip_flow
from mhsb_model.kernels.kernel import kernel
from mhsb_model.records import Record, Records, create_records
from mhsb_model.types import FloatArray


@dataclass(frozen=True)
class LineSettings(Record):
    """Tuned numbers of the estimates of oil compressibility and leakage."""

    window_steps: int = 8
    """Number of steps in a window, 1 … 100.

    Origin: chosen; a boosted line is charged in 10 … 40 ms, which is 1 … 5 windows.

    30 % smaller and larger, N = 5: RMS error −18.5 and −6.2 % (mhsb_arm3; overshoot +0.01 and
    +0.22 MPa), +0.6 and −3.1 % (excavator; overshoot −0.67 and −1.43 MPa)."""
    compressibility_deviation: float = 0.3
    """Initial standard deviation of c [-], above 0 … 2.

    Origin: config/variations.yaml, a bulk modulus of 0.6 … 1.6 GPa against 1 GPa.

    30 % smaller and larger, N = 5: RMS error −2.8 and −14.2 % (mhsb_arm3; overshoot −0.04 and
    −0.06 MPa), −6.5 and −3.5 % (excavator; overshoot −0.82 and −0.87 MPa)."""
    leakage_deviation: float = 0.3
    """Initial standard deviation of each λ [-], above 0 … 10.

    Origin: config/variations.yaml, a leakage of 0.5 … 1.5 evenly has 0.29.

    30 % smaller and larger, N = 5: RMS error −16.1 and −8.3 % (mhsb_arm3), +2.0 and +0.5 %
    (excavator; overshoot −1.66 and −0.44 MPa)."""
    compressibility_drift: float = 1e-3
    """Standard deviation of the random walk of c in one window [-], 0 … 0.1.

    Origin: chosen; 0.011 in a second with boost.

    30 % smaller and larger, N = 5: RMS error −6.3 and −0.5 % (mhsb_arm3), −4.0 and +0.9 %
    (excavator; overshoot −0.74 and −1.03 MPa)."""
    leakage_drift: float = 2e-3
    """Standard deviation of the random walk of λ in one window [-], 0 … 0.1.

    Origin: chosen; 0.022 in a second with boost.

    30 % smaller and larger, N = 5: RMS error −2.1 and −9.3 % (mhsb_arm3), −5.5 and −7.7 %
    (excavator; overshoot −2.63 and −3.53 MPa)."""
    flow_deviation: float = 0.0185
    """Standard deviation of the flow that a balance neglects, in full pump flows, above 0 … 1.

    Origin: chosen on the suite's own arm.

    30 % smaller and larger, N = 5: RMS error +2.4 and −15.2 % (mhsb_arm3; overshoot −0.07 and
    +0.05 MPa), −5.6 and −0.3 % (excavator; overshoot −2.33 and −0.57 MPa)."""
    volume_deviation: float = 3.7e-4
    """Standard deviation of a window's stroke of a moving piston, in full pump flows [s], 0 … 1.

    Origin: 6 µm of stroke at the piston area of 491 mm² of the suite's own arm.

    30 % smaller and larger, N = 5: RMS error −2.9 and +0.5 % (mhsb_arm3; overshoot +0.05 and
    −0.08 MPa), −0.3 and −2.1 % (excavator; overshoot −0.26 and −2.35 MPa)."""
    compression_deviation: float = 0.1
    """Standard deviation of the compressed oil of a window, as a share of it, 0 … 1.

    Origin: chosen; it covers the lag of pressure sensors and volumes that differ from the file.

    30 % smaller and larger, N = 5: RMS error −3.9 and −13.1 % (mhsb_arm3; overshoot −0.04 and
    −0.06 MPa), −0.3 and +0.9 % (excavator; overshoot −1.95 and −2.50 MPa)."""
    max_factor: float = 2.5
    """Largest estimate of c and λ [-], 1 … 100; the smallest is 1/`max_factor`.

    Origin: plausibility; config/variations.yaml has 0.63 … 1.7 and 0.5 … 1.5.

    30 % smaller and larger, N = 5: RMS error −1.8 and 0 % (mhsb_arm3; overshoot −0.18 and 0 MPa),
    −6.8 and 0 % (excavator)."""
    shut_opening: float = 0.02
    """Opening of a join valve or diverter below which it counts as shut, 0 … 0.5.

    Origin: four time constants of the valve after its command.

    30 % smaller and larger, N = 5: RMS error 0 and 0 % (mhsb_arm3), +0.1 and +0.1 % (excavator)."""
    open_opening: float = 0.9
    """Opening of a join valve or diverter above which it counts as open, 0.5 … 1.

    A lent pump whose diverter is open counts as feeding the rail. Origin: chosen; the pressure drop
    over it is then 1.2 times that of an open valve.

    Distance to 1 30 % smaller and larger, N = 5, for join valves alone: RMS error −3.6 and −17.4 %
    (mhsb_arm3; overshoot −0.07 and +0.04 MPa), 0 and 0 % (excavator). For diverters alone: 0 and
    0 % (mhsb_arm3), +4.6 and −3.4 % (excavator; overshoot −0.43 and −2.77 MPa)."""
    check_valve_margin: float = 1e5
    """Line pressure above P_S from which the line's check valve counts as closed [Pa], 0 … 1e7.

    Origin: four times the pressure that droop of the main pump and sensor errors of 0.5 % may hide.

    30 % smaller and larger, N = 5: RMS error −4.8 and −9.6 % (mhsb_arm3), +2.3 and −3.9 %
    (excavator; overshoot −2.56 and −2.34 MPa)."""
    joined_drop: float = 1e5
    """Pressure difference up to which a line and the rail count as one volume [Pa], 0 … 1e7.

    Below it, a join valve opens fully. Origin: chosen; the error of two industrial pressure sensors
    is 0.07 MPa at most.

    30 % smaller and larger, N = 5, for estimates alone: RMS error −5.3 and −4.4 % (mhsb_arm3), +0.8
    and 0 % (excavator; overshoot −0.32 and +0.00 MPa). For join valves alone: +0.2 and −4.6 %
    (mhsb_arm3; overshoot +0.15 and +0.02 MPa), 0 and 0 % (excavator)."""


class OilBalance(Record):
    """Oil balance of one line, or of the rail with its joined lines, in the present window."""

    steps: int
    """Number of steps in the present window."""
    members: int
    """Bit j is set if line j belongs to the balance."""
    manifold_feeds: int
    """1 if the main pump may feed the lines as well, else 0."""
    supplied: float
    """Oil delivered by pumps [m³]."""
    moved: float
    """Oil taken by pistons [m³]."""
    moving: float
    """1 if any piston moved."""
    flow: float
    """Flow of the pumps in the last step [m³/s]."""
    rail: float
    """1 for the rail's balance."""


class LineEstimates(NamedTuple):
    """Estimates of oil compressibility and leakage for n lines, and the oil balances of the lines.

    Balance n is that of the rail with all lines joined to it.
    """

    estimate: FloatArray  # [1 + n] c, then λ of each valve
    covariance: FloatArray  # [1 + n, 1 + n] covariance of c and λ
    balances: Records[OilBalance]  # [n + 1]
    row: FloatArray  # [n + 1, 1 + n] m³, coefficients of c and λ in each balance
    # [n + 1, 4] line, cap and rod pressure [Pa] and length [m] in the last step; last row: rail
    before: FloatArray
    # [n + 1, 3] m³ taken in this step by compression, leakage and piston; last row: rail
    intake: FloatArray
    # [n + 1, 3] m³/s of pumps into each line alone, less slip; 1 if a pump in use feeds it;
    # m³/s of that slip; last row: rail
    fed: FloatArray
    gain_work: FloatArray  # [1 + n] working memory


def build_line_estimates(count: int, settings: LineSettings = LineSettings()) -> LineEstimates:
    """Return the initial estimates of oil compressibility and leakage, with empty oil balances.

    An estimate is a factor on the value of the machine file, and is 1 at first. The initial
    standard deviations come from the settings.

    Args:
        count: Number n of lines.
        settings: Tuned numbers.

    Returns:
        The estimates, in new arrays.
    """
    deviation = np.full(1 + count, settings.leakage_deviation)
    deviation[0] = settings.compressibility_deviation
    balances = create_records(OilBalance, count + 1)
    balances["rail"][count] = 1.0
    return LineEstimates(
        estimate=np.ones(1 + count),
        covariance=np.diag(deviation**2),
        balances=balances,
        row=np.zeros((count + 1, 1 + count)),
        before=np.zeros((count + 1, 4)),
        intake=np.zeros((count + 1, 3)),
        fed=np.zeros((count + 1, 3)),
        gain_work=np.zeros(1 + count),
    )


@kernel(inline="always")
def update_line_estimates(s: ServoArguments, lines: LineEstimates, settings: LineSettings) -> None:
    """Add one step to the oil balances of all lines, and update the estimates from full windows.

    A balance compares the oil from the pumps with the oil that lines take, over a window of
    `window_steps` steps. There are two kinds:

    - The balance of a line alone. A servo pump must feed the line, and its join valve (to the rail)
      must be shut.
    - The balance of the rail with all lines joined to it. A joined line has an open join valve, and
      its pressure differs from the rail's by less than `joined_drop`. A pump must feed the rail or
      one of these lines. There is no balance while a join valve is partly open, or open although
      its pressure difference is larger.

    A full window updates the estimates in two cases:

    - The pressure is at least `check_valve_margin` above the main pump's, so that only servo pumps
      feed the lines.
    - No piston has moved, and the pumps have delivered more oil than the present estimates explain.

    The estimates are factors on the file's compressibility of the oil and on the leakage of each
    valve.

    Args:
        s: Signals, circuit, axes and estimates of the servo. Writes `leakage` of all axes in place:
            the machine file's leakage at the present pressure [m³/s].
        lines: Estimates and balances, updated in place.
        settings: Tuned numbers.
    """
    n, c, step, rail = len(s.axes), s.constants[0], s.gains[0].step, s.rail_pressure[0]
    compute_fed_flows(s, lines.fed, settings.shut_opening)
    joined, broken = 0, False
    for j in range(n):
        join = s.actuators[j].join
        drop = s.sensors[j].line_pressure - rail
        if join > settings.open_opening and abs(drop) < settings.joined_drop:
            joined |= 1 << j
        elif join > settings.shut_opening:
            broken = True
        compute_line_intake(
            s.axes[j], s.cylinders[j], s.sensors[j], c, step, lines.before[j], lines.intake[j]
        )
    lines.intake[n, 0] = c.rail_capacity * (rail - lines.before[n, 0])
    lines.before[n, 0] = rail
    for g in range(n + 1):
        flow, feeds, pressure, members = lines.fed[g, 0], lines.fed[g, 1] > 0.0, rail, joined
        if g < n:
            pressure = s.sensors[g].line_pressure
            members = 1 << g if feeds and s.actuators[g].join < settings.shut_opening else 0
        else:
            flow -= c.bleed_conductance * (rail - c.tank_pressure)
            for j in range(n):
                if joined >> j & 1:
                    flow += lines.fed[j, 0]
                    feeds = feeds or lines.fed[j, 1] > 0.0
            if broken or not feeds:
                members = 0
        fed_too = 0 if pressure > c.supply_pressure + settings.check_valve_margin else 1
        own, row = lines.balances[g], lines.row[g]
        if accumulate_balance(lines, g, members, fed_too, flow, step, settings.window_steps):
            spread = (settings.flow_deviation * settings.window_steps * step) ** 2
            spread += own.moving * settings.volume_deviation**2
            spread *= c.servo_pump_flow**2
            spread += (settings.compression_deviation * row[0]) ** 2
            oil = own.supplied - own.moved
            if fed_too == 0 or (own.moving == 0.0 and oil > np.dot(row, lines.estimate)):
                update_line_filter(lines, row, oil, spread, settings)


@kernel(inline="always")
def compute_fed_flows(s: ServoArguments, fed: FloatArray, shut_opening: float) -> None:
    """Compute the flows of the servo pumps into each line and into the rail.

    A module's diverter divides its flow between its own line and the rail. A spare module has no
    line of its own.

    Slip is the flow that leaks back within a pump. It is proportional to the pressure rise from
    P_S, which the pump has at its inlet.

    Args:
        s: Signals and circuit of the servo: flows and diverters of the modules, the actuators that
            they serve, and measured pressures.
        fed: Written in place, float64[n + 1, 3], one row for each line and the last for the rail.
            Column 0 is the flow of all pumps, idle ones included, minus their slip [m³/s]. Column 1
            is 1 if a pump that is not idle feeds the line or rail, else 0. Column 2 is the slip
            [m³/s].
        shut_opening: A diverter counts as shut on one side (towards the line or towards the rail)
            if its opening to this side is at most `shut_opening`. Used only for column 1.
    """
    fed[:] = 0.0
    modules, module_home, serves, c = s.modules, s.module_home, s.serves, s.constants[0]
    rail = len(fed) - 1
    for k in range(len(modules)):
        home: int = module_home[k]
        to_rail = modules[k].to_rail
        slip = compute_slip_flow(c.servo_pump_slip, 1, s.rail_pressure[0] - c.supply_pressure)
        fed[rail, 2] += to_rail * slip
        fed[rail, 0] += to_rail * (modules[k].flow - slip)
        if home >= 0:
            rise = s.sensors[home].line_pressure - c.supply_pressure
            slip = compute_slip_flow(c.servo_pump_slip, 1, rise)
            fed[home, 2] += (1.0 - to_rail) * slip
            fed[home, 0] += (1.0 - to_rail) * (modules[k].flow - slip)
        if serves[k] >= 0:
            if to_rail > shut_opening:
                fed[rail, 1] = 1.0
            if home >= 0 and 1.0 - to_rail > shut_opening:
                fed[home, 1] = 1.0


@kernel(borrows=True)
def accumulate_balance(
    lines: LineEstimates,
    k: int,
    members: int,
    manifold_feeds: int,
    flow: float,
    step: float,
    window_steps: int,
) -> bool:
    """Add one step to an oil balance, and return whether its window of steps is complete.

    A new window starts if the set of lines or `manifold_feeds` has changed. The first call of a
    window only records the flow of the pumps, so a window takes `window_steps` + 1 calls. The rail
    is the line that several servo pumps feed in shared boost. The oil that the rail itself takes
    counts only in the balance of the rail.

    Args:
        lines: Estimates and balances of n lines. Reads `intake`, the oil that each line and the
            rail take in this step. Updates record k of `balances` and row k of `row` in place.
            Element 0 of row k is the oil that compression takes, the other elements are the leakage
            of each valve. Both are computed from the machine file [m³]; the filter estimates a
            factor for each element.
        k: Index of the balance: k < n for line k alone, n for the rail with its joined lines.
        members: Set of the lines in the balance, bit j for line j; 0 discards the window.
        manifold_feeds: 1 if the main pump may feed the lines as well, else 0.
        flow: Flow of the servo pumps into the lines of `members` [m³/s].
        step: Control period [s].
        window_steps: Number of steps that a window sums up.

    Returns:
        True in the last call of a window. Record k and row k then contain its balance.
    """
    oil_balance, row, taken = lines.balances[k], lines.row[k], lines.intake
    if (
        members == 0
        or oil_balance.members != members
        or oil_balance.manifold_feeds != manifold_feeds
    ):
        oil_balance.members, oil_balance.manifold_feeds, oil_balance.steps = (
            members,
            manifold_feeds,
            0,
        )
        if members == 0:
            return False
    if oil_balance.steps == 0:
        row[:] = 0.0
        oil_balance.supplied = oil_balance.moved = oil_balance.moving = 0.0
        oil_balance.steps, oil_balance.flow = 1, flow
        return False
    n = len(taken) - 1
    oil_balance.supplied += 0.5 * (oil_balance.flow + flow) * step
    oil_balance.flow = flow
    if oil_balance.rail > 0.0:
        row[0] += taken[n, 0]
    for j in range(n):
        if members >> j & 1:
            row[0] += taken[j, 0]
            row[1 + j] += taken[j, 1]
            oil_balance.moved += taken[j, 2]
            oil_balance.moving = max(oil_balance.moving, 1.0 if taken[j, 2] != 0.0 else 0.0)
    oil_balance.steps += 1
    if oil_balance.steps <= window_steps:
        return False
    oil_balance.steps = 0
    return True


@kernel(borrows=True)
def compute_line_intake(
    axis: ControlAxis,
    cylinder: CylinderConstants,
    sensor: ActuatorReadings,
    c: CircuitConstants,
    step: float,
    before: FloatArray,
    taken: FloatArray,
) -> None:
    """Compute the oil that a line takes in a step, by compression, leakage and its piston.

    Compression is the line's capacity (from the machine file) times its pressure rise. If the
    reference moves the piston, compression includes the chamber that the supply fills. This is the
    cap side if the reference extends the piston, and the rod side if it retracts it. The piston
    then takes the oil that fills its swept volume.

    Args:
        axis: State of the cylinder's control axis. Writes `leakage` in place: the machine file's
            leakage at the present line pressure [m³/s].
        cylinder: Areas of the cylinder.
        sensor: Measured length [m] and pressures [Pa] of the actuator.
        c: Constants of the circuit.
        step: Control period [s].
        before: Line, cap-side and rod-side pressure [Pa] and cylinder length [m] in the last step,
            float64[4]. Overwritten with the present values.
        taken: Overwritten with the oil that compression, leakage and piston take in this step,
            float64[3], [m³]. The piston's oil is negative if the piston moves against the
            reference, and 0 if the reference rests.
    """
    line, cap, rod = sensor.line_pressure, sensor.cap_pressure, sensor.rod_pressure
    axis.leakage = compute_null_leakage(c, line - c.tank_pressure)
    taken[0] = c.line_capacity * (line - before[0])
    taken[1] = axis.leakage * step
    taken[2] = 0.0
    if axis.speed > 0.0:
        taken[0] += (cap - before[1]) / axis.cap_stiffness
        taken[2] = cylinder.cap_area * (sensor.length - before[3])
    elif axis.speed < 0.0:
        taken[0] += (rod - before[2]) / axis.rod_stiffness
        taken[2] = cylinder.rod_area * (before[3] - sensor.length)
    before[0], before[1], before[2], before[3] = line, cap, rod, sensor.length


@kernel(borrows=True)
def update_line_filter(
    lines: LineEstimates, row: FloatArray, oil: float, spread: float, settings: LineSettings
) -> None:
    """Update the estimates of compressibility and leakage from one oil balance (Kalman filter).

        oil = row · (c, λ_1, …, λ_n) + noise

    c is a factor on the machine file's compressibility of the oil, and λ_j a factor on the leakage
    of valve j. Before the update, the variance of each parameter with a nonzero coefficient is
    increased. The increase is the square of `compressibility_drift` or `leakage_drift`. After the
    update, c and each λ are limited to 1/`max_factor` … `max_factor`.

    Args:
        lines: Estimates. Writes `estimate`, `covariance` and `gain_work` in place.
        row: Coefficients of c and λ in the balance, float64[1 + n], [m³].
        oil: Oil delivered by pumps minus oil taken by pistons [m³].
        spread: Variance of the noise [m⁶].
        settings: Tuned numbers.
    """
    estimate, covariance, carried = lines.estimate, lines.covariance, lines.gain_work
    n = len(estimate)
    for i in range(n):
        if row[i] != 0.0:
            wander = settings.compressibility_drift if i == 0 else settings.leakage_drift
            covariance[i, i] += wander * wander
    away = oil
    for i in range(n):
        carried[i] = 0.0
        for k in range(n):
            carried[i] += covariance[i, k] * row[k]
    for i in range(n):
        spread += row[i] * carried[i]
        away -= row[i] * estimate[i]
    for i in range(n):
        updated = estimate[i] + carried[i] / spread * away
        estimate[i] = min(max(updated, 1.0 / settings.max_factor), settings.max_factor)
        for k in range(n):
            covariance[i, k] -= carried[i] * carried[k] / spread
