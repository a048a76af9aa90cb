"""Energy of a trajectory with its mode schedule, in both energy readings, and its losses.

    E = Σ_j ∫ price_j (A_dir |v_j| + q_leak) dt

v_j is the piston speed of actuator j [m/s]. A_dir is the area of the chamber that fills [m²], and
q_leak the leakage of a valve [m³/s]. The price is the energy per volume of oil [Pa]:

- Mode N: the main pump's pressure P_S for any load.
- Boost in the reading `paper`: p_L/η, at least P_S. p_L is the load pressure and η the efficiency
  of the servo pump.
- Boost in the reading `series`, with main pump and servo pump in series: P_S + (p_supply − P_S)/η.
  p_supply is the result of `hydraulics.compute_boosted_supply`; in mode SB it is the rail's
  pressure.

A cylinder up to the speed MAX_HELD_SPEED counts as held; p_L is then taken in the direction against
its load.

Four effects count in the reading `series` only, since the flows of the reading `paper` depend on
neither pressure nor time.

- The leakage of a valve depends on p_supply (`hydraulics.compute_valve_leakage`).
- Oil slips back through a servo pump, which must then raise the pressure of this oil again
  (`hydraulics.compute_slip_flow`).
- A boosted cylinder that accelerates its load gets at least the pressure
  p_L(F + inertia) + m(v) + margin/2. F is the force of gravity, m(v) the pressure drop over the
  valve and `margin` the boost margin.
- A line is charged from P_S to its supply pressure p before its boost begins.

A line reaches p some time before its cylinder needs this pressure, because pumps take time and may
be slower than expected. To charge the line, its servo pump needs the energy

    E = [½ (V/β) (p − P_S)² + (A_dir |v| + leakage + slip) (p − P_S) T] / η

    T = CHARGED_AHEAD · preview

V is the volume of the line and β the bulk modulus of the oil. The first term compresses the oil.
The second is the flow that cylinder, valve and the gaps of the pump take during T. If the rail was
not in use before, the actuators that join it also charge its volume, in equal parts.
"""

from dataclasses import dataclass, fields

import numpy as np

from mhsb_model.arrays import MachineArrays
from mhsb_model.holding import MAX_HELD_SPEED
from mhsb_model.hydraulics import (
    compute_boosted_supply,
    compute_inertia_margin,
    compute_pressure_with_margin,
    compute_slip_flow,
    compute_valve_leakage,
    get_shared_hydraulics,
    inlet_area,
    load_pressure,
    rail_pressure,
    select_supply_pressure,
)
from mhsb_model.kernels.kernel import kernel
from mhsb_model.machine import Machine
from mhsb_model.mode_schedule import ModeSchedule
from mhsb_model.modes import BOOSTED_MODES, RAIL_MODES
from mhsb_model.trajectory import MAX_POINT_SPACING_NS, SECOND_NS, Trajectory
from mhsb_model.types import FloatArray, IntArray, ModeArray
from mhsb_planner.motion.motion_profile import MotionProfile, compute_motion_profile
from mhsb_planner.motion.s3_limits import repeats_previous_row

CHARGED_AHEAD = 0.4
"""Share of the servo's preview for which a line already has its boosted pressure [-].

The preview is the time before a boost at which the servo begins to charge the line
(`Machine.servo_preview`). Measured: 0.40 on 22 boosts of the simulated arm."""


@dataclass(frozen=True)
class Energy:
    """Energy of a motion in both readings, and its parts [J].

    All fields but `paper` belong to the reading `series`: main pump and servo pump in series.

    Attributes:
        paper: Energy in the reading `paper`, the published model.
        main_pump: Energy that the main pump delivers.
        servo_pumps: Shaft work of the servo pumps.
        servo_pump_losses: Part of the shaft work that is lost by the pumps' efficiency and slip.
        leakage: Energy of the oil that leaks through the valves to the tank.
        piston_work: Work of the pistons against gravity; negative if loads are lowered.
        return_oil: Energy left in the oil that flows to the tank.
    """

    paper: float
    main_pump: float
    servo_pumps: float
    servo_pump_losses: float
    leakage: float
    piston_work: float
    return_oil: float

    @property
    def series(self) -> float:
        """Energy in the reading `series`: main pump plus servo pumps [J]."""
        return self.main_pump + self.servo_pumps

    @property
    def servo_valves(self) -> float:
        """Energy lost in the metering edges of the servo valves: `series` minus its parts [J]."""
        used = self.servo_pump_losses + self.leakage + self.piston_work + self.return_oil
        return self.series - used


ENERGY_FIELD_COUNT = len(fields(Energy))
ZERO_ENERGY = Energy(*[0.0] * ENERGY_FIELD_COUNT)


def compute_motion_energy(
    machine: Machine,
    trajectory: Trajectory,
    schedule: ModeSchedule,
) -> Energy:
    """Compute the energy of a trajectory with its mode schedule, leakage included.

    The trajectory is divided into intervals at its points and at the mode switches. The power of
    each half of an interval is integrated by the trapezoidal rule.

    Args:
        machine: Machine with its payload and hydraulics.
        trajectory: Joint trajectory.
        schedule: Modes over time. A mode may change between two points of the trajectory.

    Returns:
        Energy of the motion [J]. The field `paper` follows the published model. All other fields
        count main pump and servo pumps in series, and include the charging of lines before boosts.
        All fields are 0 if the trajectory has only one point.
    """
    edges = _find_interval_limits(trajectory, schedule)
    if len(edges) < 2:
        return ZERO_ENERGY
    points, middles = (
        compute_motion_profile(machine, *trajectory.sample_offsets(at))
        for at in (edges, (edges[1:] + edges[:-1]) // 2)
    )
    modes = schedule.modes_at_many(trajectory.stamp_ns + edges[:-1])
    return compute_energy_of_profiles(machine, edges, points, middles, modes)


def compute_energy_of_profiles(
    machine: Machine,
    edges: IntArray,
    points: MotionProfile,
    middles: MotionProfile,
    modes: ModeArray,
) -> Energy:
    """Compute the energy of a motion from its profiles (piston speeds and forces).

    Args:
        machine: Machine with its hydraulics.
        edges: Limits of intervals in ascending order, shape (k,) [ns]. Within an interval the
            motion is smooth and the modes are constant.
        points: Profile at the limits of the intervals, k rows.
        middles: Profile at the middles of the intervals, k - 1 rows.
        modes: Mode codes of the intervals, shape (k - 1, n).

    Returns:
        Energy of the motion [J]. The field `paper` follows the published model. All other fields
        count main pump and servo pumps in series, and include the charging of lines before boosts.
    """
    energy = _integrate_power(
        machine.arrays,
        (edges[1:] - edges[:-1]) / SECOND_NS,
        points.speed,
        points.force,
        points.inertia,
        middles.speed,
        middles.force,
        middles.inertia,
        modes,
    )
    return _add_charging(machine, energy, points, modes)


def _add_charging(
    machine: Machine, energy: FloatArray, profile: MotionProfile, modes: ModeArray
) -> Energy:
    """Add the energy that servo pumps take to charge their lines before boosts.

    Args:
        machine: Machine with its circuit and servo settings.
        energy: Energy without charging, in the order of the fields of `Energy`, shape (7,) [J].
        profile: Profile (piston speeds and forces). Row i is the beginning of interval i; rows
            after row k - 1 are ignored.
        modes: Mode codes of k intervals, shape (k, n).

    Returns:
        Energy with charging [J]. The shaft work of the charging is added to `servo_pumps`. The part
        that is lost by efficiency and slip is added to `servo_pump_losses`.
    """
    charging, slipped = compute_charging(machine, profile.speed, profile.force, modes)
    losses = (1.0 - machine.arrays.servo_pump_efficiency) * charging + slipped
    paper, main_pump, servo_pumps, pump_losses, *others = energy.tolist()
    return Energy(paper, main_pump, servo_pumps + charging, pump_losses + losses, *others)


def compute_charging(
    machine: Machine, speed: FloatArray, force: FloatArray, modes: ModeArray
) -> tuple[float, float]:
    """Compute the shaft work that charges supply lines before boosts, and its loss by slip.

    A boost begins in an interval in a boosted mode if the interval before was in mode N. By then
    the pressure in the actuator's line must have risen from the main pump's pressure to the boosted
    pressure. The line has the boosted pressure for some time before the boost begins. The oil that
    cylinder, valve and pump gaps take during this time counts, too. A boost that is in force in the
    first interval needs no charging.

    Args:
        machine: Machine with its circuit and servo settings.
        speed: Piston speeds at the beginning of each of k intervals, shape (k or more, n) [m/s].
            Rows after row k - 1 are ignored.
        force: Piston forces under gravity at the same instants, in the same shape [N].
        modes: Mode codes of each interval, shape (k, n).

    Returns:
        Shaft work of the servo pumps, and the hydraulic work that is lost by slip [J].
    """
    m, circuit = machine.arrays, machine.config.circuit
    ahead = CHARGED_AHEAD * machine.servo_preview
    volumes = circuit.line_volume, circuit.rail_volume
    work, slipped = _compute_charging_work(
        m, volumes, circuit.bulk_modulus, ahead, speed, force, modes
    )
    return float(work / m.servo_pump_efficiency), float(slipped)


def _find_interval_limits(trajectory: Trajectory, schedule: ModeSchedule) -> IntArray:
    """Divide a trajectory into intervals with smooth motion and constant modes.

    The limits of the intervals are the trajectory's points and the mode changes between them.
    Intervals longer than `MAX_POINT_SPACING_NS` are divided into equal parts.

    Args:
        trajectory: Joint trajectory.
        schedule: Modes over time.

    Returns:
        Limits of the intervals in ascending order, counted from the trajectory's stamp [ns]. The
        first and the last point are among them.
    """
    switched = schedule.stamp_ns + schedule.offset_ns - trajectory.stamp_ns
    switched = switched[(switched > 0) & (switched < trajectory.duration_ns)]
    edges = np.union1d(trajectory.offset_ns, switched)
    parts = np.maximum(1, -(-np.diff(edges) // MAX_POINT_SPACING_NS))
    part = np.arange(parts.sum()) - np.repeat(np.cumsum(parts) - parts, parts)
    between = part * np.repeat(np.diff(edges), parts) // np.repeat(parts, parts)
    return np.append(np.repeat(edges[:-1], parts) + between, edges[-1])


def compute_energy_of_states(
    machine: Machine,
    span: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    modes: ModeArray,
    acceleration: FloatArray | None = None,
) -> Energy:
    """Compute the energy of successive motion states.

    Each state lasts a given time, during which all powers are constant.

    Args:
        machine: Machine with its payload and hydraulics.
        span: Duration of each state, shape (k,) [s].
        position: Joint positions, shape (k, n) [rad or m].
        velocity: Joint velocities, shape (k, n) [rad/s or m/s].
        modes: Mode codes (N, DB, SB), shape (k, n).
        acceleration: Joint accelerations, shape (k, n) [rad/s² or m/s²]. None makes the inertia
            forces 0.

    Returns:
        Energy of all states together [J]. The field `paper` follows the published model. All other
        fields count main pump and servo pumps in series, and include the charging of lines before
        boosts.
    """
    profile = compute_motion_profile(machine, position, velocity, acceleration)
    energy = _sum_state_energies(
        machine.arrays, span, profile.speed, profile.force, profile.inertia, modes
    )
    return _add_charging(machine, energy, profile, modes)


@kernel
def _sum_state_energies(
    m: MachineArrays,
    span: FloatArray,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    modes: ModeArray,
) -> FloatArray:
    """Compute the energy of successive motion states, without the charging of lines.

    Each state lasts a given time, during which all powers are constant.

    Args:
        m: Arrays of the machine.
        span: Duration of each state, shape (k,) [s].
        speed: Piston speeds, shape (k, n) [m/s].
        force: Piston forces under gravity, shape (k, n) [N].
        inertia: Piston forces from inertia, to be added to the gravity forces, shape (k, n) [N].
        modes: Mode codes (N, DB, SB), shape (k, n).

    Returns:
        Energies in the order of the fields of `Energy`, shape (7,) [J]. Index 0: total by the
        published model (`paper`). 1: main pump. 2: shafts of the servo pumps. 3: losses of the
        servo pumps. 4: leakage through valves. 5: work of the pistons against gravity. 6: oil that
        flows to the tank.
    """
    energy, power, own = (
        np.zeros(ENERGY_FIELD_COUNT),
        np.empty(ENERGY_FIELD_COUNT),
        np.empty(speed.shape[1]),
    )
    for k in range(len(span)):
        _compute_powers(m, speed[k], force[k], inertia[k], modes[k], own, power)
        for i in range(ENERGY_FIELD_COUNT):
            energy[i] += span[k] * power[i]
    return energy


@kernel  # records would cost 15 %, for numba takes 1 µs to recognize one at a call
def _integrate_power(
    m: MachineArrays,
    span: FloatArray,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    middle_speed: FloatArray,
    middle_force: FloatArray,
    middle_inertia: FloatArray,
    modes: ModeArray,
) -> FloatArray:
    """Integrate the powers of pumps, losses and loads over k intervals of a motion.

    Each half of an interval is integrated by the trapezoidal rule.

    Args:
        m: Arrays of the machine.
        span: Duration of each interval, shape (k,) [s].
        speed: Piston speeds at the limits of the intervals, shape (k + 1, n) [m/s].
        force: Piston forces under gravity at the limits, shape (k + 1, n) [N].
        inertia: Piston forces from inertia at the limits, shape (k + 1, n) [N].
        middle_speed: Piston speeds at the middles of the intervals, shape (k, n) [m/s].
        middle_force: Piston forces under gravity at the middles, shape (k, n) [N].
        middle_inertia: Piston forces from inertia at the middles, shape (k, n) [N].
        modes: Mode codes of each interval, shape (k, n).

    Returns:
        Energies in the order of the fields of `Energy`, shape (7,) [J]. Index 0: total by the
        published model (`paper`). 1: main pump. 2: shafts of the servo pumps. 3: losses of the
        servo pumps. 4: leakage through valves. 5: work of the pistons against gravity. 6: oil that
        flows to the tank. The charging of lines is not included.
    """
    energy, own = np.zeros(ENERGY_FIELD_COUNT), np.empty(speed.shape[1])
    begin, middle, end = (
        np.empty(ENERGY_FIELD_COUNT),
        np.empty(ENERGY_FIELD_COUNT),
        np.empty(ENERGY_FIELD_COUNT),
    )
    for k in range(len(span)):
        if repeats_previous_row(modes, k):
            for i in range(ENERGY_FIELD_COUNT):
                begin[i] = end[i]
        else:
            _compute_powers(m, speed[k], force[k], inertia[k], modes[k], own, begin)
        _compute_powers(
            m, middle_speed[k], middle_force[k], middle_inertia[k], modes[k], own, middle
        )
        _compute_powers(m, speed[k + 1], force[k + 1], inertia[k + 1], modes[k], own, end)
        for i in range(ENERGY_FIELD_COUNT):
            energy[i] += 0.25 * span[k] * (begin[i] + 2.0 * middle[i] + end[i])
    return energy


@kernel(borrows=True, forceinline=True)
def _compute_powers(
    m: MachineArrays,
    speed: FloatArray,
    force: FloatArray,
    inertia: FloatArray,
    modes: ModeArray,
    own: FloatArray,
    power: FloatArray,
) -> None:
    """Compute the powers of pumps, losses and loads in one motion state.

    The module's equations give the prices and flows. A boosted actuator has the pressure that its
    load under gravity and inertia needs. In mode SB it has the highest pressure of all actuators on
    the rail.

    Tested against a calculation by hand.

    Args:
        m: Arrays of the machine.
        speed: Piston speeds, shape (n,) [m/s].
        force: Piston forces under gravity, shape (n,) [N].
        inertia: Piston forces from inertia, to be added to the gravity forces, shape (n,) [N].
        modes: Mode codes (N, DB, SB), shape (n,).
        own: Working memory, shape (n,), overwritten: boosted supply pressure of each actuator [Pa].
        power: Powers in the order of the fields of `Energy`, shape (7,) [W], written in place.
            Index 0: total by the published model (`paper`). 1: main pump. 2: shafts of the servo
            pumps. 3: losses of the servo pumps. 4: leakage through valves. 5: work of the pistons
            against gravity. 6: oil that flows to the tank.
    """
    oil, efficiency = get_shared_hydraulics(m), m.servo_pump_efficiency
    valve, cap, rod = m.valve_coefficient, m.cap_area, m.rod_area
    normal, tank = oil.supply_pressure, oil.tank_pressure
    at_paper = main_pump = shafts = slipped = leaked = work = returned = 0.0
    for j in range(len(own)):
        if BOOSTED_MODES[modes[j]]:
            f, v = force[j], speed[j]
            own[j] = compute_boosted_supply(oil, valve[j], cap[j], rod[j], f, v)
            if inertia[j] != 0.0:
                load = f + inertia[j]
                pushed = compute_pressure_with_margin(oil, valve[j], cap[j], rod[j], load, v)
                pushed = min(pushed - compute_inertia_margin(oil), oil.max_boost_pressure)
                own[j] = max(own[j], pushed)
    rail = rail_pressure(oil, own, modes)
    for j in range(len(own)):
        v, f = speed[j], force[j]
        stroke = inlet_area(cap[j], rod[j], v) * abs(v)
        paper, supply, leaks, shaft = normal, normal, oil.leakage_flow, 0.0
        if BOOSTED_MODES[modes[j]]:
            direction = v if abs(v) > MAX_HELD_SPEED else f
            paper = max(paper, load_pressure(cap[j], rod[j], tank, f, direction) / efficiency)
            supply = select_supply_pressure(oil, modes[j], own[j], rail)
            leaks = compute_valve_leakage(oil, supply)
            rise, pumps = supply - normal, m.modules_per_mode[modes[j]]
            slip = compute_slip_flow(oil.servo_pump_slip, pumps, rise)
            shaft = rise / efficiency * (stroke + leaks + slip)
            slipped += rise * slip
        at_paper += paper * (stroke + oil.leakage_flow)
        main_pump += normal * (stroke + leaks)
        shafts += shaft
        leaked += (supply - tank) * leaks
        work += f * v
        returned += tank * (inlet_area(cap[j], rod[j], -v) * abs(v) + leaks)
    power[0], power[1], power[2] = at_paper, main_pump, shafts
    power[3], power[4] = (1.0 - efficiency) * shafts + slipped, leaked
    power[5], power[6] = work, returned


@kernel(borrows=True)
def _compute_charging_work(
    m: MachineArrays,
    volumes: tuple[float, float],
    bulk_modulus: float,
    charged_time: float,
    speed: FloatArray,
    force: FloatArray,
    modes: ModeArray,
) -> tuple[float, float]:
    """Compute the hydraulic work that charges supply lines before boosts.

    A boost begins in an interval in a boosted mode if the interval before was in mode N. The
    pressure in the actuator's line of volume V then rises by Δp to the boosted pressure:

        work = V Δp²/(2β) + Q Δp T

    β is the bulk modulus. Q is the flow into the cylinder, plus valve leakage and slip of the
    pumps. T is the time at the boosted pressure before the boost begins. The efficiency of the
    pumps is not included. If no actuator was on the shared rail before, the actuators that join it
    also charge the rail's volume, in equal parts.

    Tested against sums computed by hand.

    Args:
        m: Arrays of the machine.
        volumes: Oil volume of one actuator's line, and of the shared rail [m³].
        bulk_modulus: Bulk modulus β of the oil [Pa].
        charged_time: Time T at the boosted pressure before the boost begins [s].
        speed: Piston speeds at the beginning of each of k intervals, shape (k or more, n) [m/s].
            Rows after row k - 1 are ignored.
        force: Piston forces under gravity at the same instants, in the same shape [N].
        modes: Mode codes of each interval, shape (k, n).

    Returns:
        Work of the pumps on the oil, and the part of this work that is lost by slip [J].
    """
    oil, work, slipped = get_shared_hydraulics(m), 0.0, 0.0
    line_volume, rail_volume = volumes
    for k in range(1, len(modes)):
        for j in range(modes.shape[1]):
            if not BOOSTED_MODES[modes[k, j]] or BOOSTED_MODES[modes[k - 1, j]]:
                continue
            v, cap, rod, volume = speed[k, j], m.cap_area[j], m.rod_area[j], line_volume
            if RAIL_MODES[modes[k, j]] and _count_on_rail(modes, k - 1) == 0:
                volume += rail_volume / _count_on_rail(modes, k)
            supply = compute_boosted_supply(oil, m.valve_coefficient[j], cap, rod, force[k, j], v)
            rise = supply - oil.supply_pressure
            pumps = m.modules_per_mode[modes[k, j]]
            slip = compute_slip_flow(oil.servo_pump_slip, pumps, rise)
            drawn = inlet_area(cap, rod, v) * abs(v) + compute_valve_leakage(oil, supply) + slip
            work += 0.5 * volume / bulk_modulus * rise * rise + drawn * rise * charged_time
            slipped += slip * rise * charged_time
    return work, slipped


@kernel(borrows=True)
def _count_on_rail(modes: ModeArray, k: int) -> int:
    """Count the actuators whose mode in row k connects them to the shared rail.

    Args:
        modes: Mode codes (N, DB, SB), shape (rows, n).
        k: Index of the row.

    Returns:
        Number of actuators on the rail.
    """
    count = 0
    for j in range(modes.shape[1]):
        if RAIL_MODES[modes[k, j]]:
            count += 1
    return count
