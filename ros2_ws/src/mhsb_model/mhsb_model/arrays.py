"""The machine's numbers as flat arrays, the form that numba kernels take."""

from operator import attrgetter
from typing import NamedTuple

import numpy as np

from mhsb_model.linkages.linkage import build_linkage_row
from mhsb_model.schema import COMMON_PATHS, MachineConfig
from mhsb_model.types import BoolArray, FloatArray, IntArray, frozen

RATED_SLIP_PRESSURE = 1e7
"""Pressure rise at which the machine file states the slip of a servo pump [Pa]."""

MAX_CHAMBER_PRESSURE_SHARE = 0.85
"""Share of the setting of its relief valves above which supervision warns of a chamber's pressure
[-]. Plans brake with at most this share, or with the maximum boost pressure if that is higher."""


class MachineArrays(NamedTuple):
    """Numbers of a machine with n joints, in SI units.

    For a sliding joint, q is in [m] and the torque is a force [N]. If joint 1 slews, all other
    joints move in a plane that turns with it. Positions in that plane have their origin at joint 2.
    Link 1, the platform, has neither length nor mass in the plane.
    """

    turns: BoolArray
    """Whether each joint turns its link in the plane, shape (n,)."""
    slides: BoolArray
    """Whether each joint is prismatic, shape (n,)."""
    slews: bool
    """Whether joint 1 turns the plane about the vertical."""
    slew_offset: float
    """Distance of joint 2 ahead of the slew's axis [m]; 0 if the arm does not slew."""
    slew_inertia: float
    """Moment of inertia of the platform about the slew's axis [kg m²]; 0 if the arm does not
    slew."""
    link_length: FloatArray
    """Length of each link with its joint at q = 0, shape (n,) [m]."""
    link_mass: FloatArray
    """Mass of each link, shape (n,) [kg]."""
    link_center: FloatArray
    """Distance of each link's centre of mass from its joint at q = 0, shape (n,) [m]."""
    link_inertia: FloatArray
    """Moment of inertia of each link about its centre of mass, shape (n,) [kg m²]."""
    joint_min: FloatArray
    """Lower limit of each joint, shape (n,) [rad or m]."""
    joint_max: FloatArray
    """Upper limit of each joint, shape (n,) [rad or m]."""
    linkage: FloatArray
    """Row of each joint's linkage, shape (n, LINKAGE_WIDTH); see `linkages.linkage`."""
    cap_area: FloatArray
    """Cap-side area A of each cylinder, shape (n,) [m²]."""
    rod_area: FloatArray
    """Rod-side (annulus) area a of each cylinder, shape (n,) [m²]."""
    modules_per_mode: IntArray
    """Booster modules that each mode occupies, shape (modes,); 0 if the mode is not boosted."""
    module_count: int
    """Number of booster modules fitted."""
    payload: float
    """Mass at the tip [kg]."""
    gravity: float
    """Gravitational acceleration [m/s²]."""
    min_x: float
    """Smallest x of the workspace in the arm's plane [m]."""
    min_radius: float
    """Smallest distance of the workspace from the plane's origin [m]."""
    max_radius: float
    """Largest distance of the workspace from the plane's origin [m]."""
    supply_pressure: float
    """Main pump's pressure P_S [Pa]."""
    tank_pressure: float
    """Tank pressure p_T [Pa]."""
    max_boost_pressure: float
    """Highest boosted supply pressure [Pa]."""
    boost_margin: float
    """Pressure kept in reserve beyond load pressure and valve drop [Pa]."""
    main_pump_flow: float
    """Largest flow Q_MP of the main pump [m³/s]."""
    servo_pump_flow: float
    """Largest flow Q_SP of one servo pump [m³/s]."""
    servo_pump_efficiency: float
    """Efficiency of a servo pump without slip: hydraulic power divided by shaft power [-]."""
    servo_pump_slip: float
    """Slip c of a servo pump per pressure rise [m³/(s Pa)]."""
    valve_coefficient: FloatArray
    """Flow coefficient K of one metering edge of each valve, Q = K √Δp, shape (n,) [m³/(s √Pa)]."""
    leakage_flow: float
    """Leakage q_leak of one closed valve, with its overlap, at the main pump's pressure [m³/s]."""
    land_leakage: float
    """Share of `leakage_flow` that flows past the lands of the spool [-]."""
    external_leakage: float
    """Total leakage, at the main pump's pressure, of valves that do not belong to the n joints
    [m³/s]."""
    max_piston_speed: FloatArray
    """V_max of each actuator, shape (n,) [m/s]."""
    max_chamber_pressure: FloatArray
    """Highest pressure with which the chambers of each actuator brake, shape (n,) [Pa]:
    `MAX_CHAMBER_PRESSURE_SHARE` of the relief valves' setting, or the maximum boost pressure, with
    which loads are lifted, if that is higher."""
    max_piston_acceleration: float
    """Largest planned piston acceleration [m/s²]."""
    max_piston_jerk: float
    """Largest planned piston jerk [m/s³]."""


def collect_actuator_values(config: MachineConfig, name: str) -> FloatArray:
    """Collect one quantity of all actuators from a machine file.

    An actuator without a value of its own gets the common value.

    Args:
        config: Content of the machine file.
        name: Name of the quantity, a key of `COMMON_PATHS`.

    Returns:
        Values in SI units, shape (n,).
    """
    own = [getattr(joint.actuator, name) for joint in config.joints]
    usual = attrgetter(COMMON_PATHS[name])(config)
    return np.array([usual if each is None else each for each in own])


def _compute_closed_valve_leakage(config: MachineConfig) -> tuple[float, float]:
    """Compute the leakage of a closed servo valve with the overlap that the machine file declares.

        q = q_leak (1 − s + s κ),   κ = ℓ/(ℓ + o)

    q_leak is the leakage without overlap. Its share s flows past the lands of the spool, and an
    overlap multiplies this part by κ. o is the mean overlap of both directions, and ℓ is
    `circuit.land_length`; both are shares of the spool's stroke.

    Args:
        config: Content of the machine file.

    Returns:
        Leakage q at the main pump's pressure [m³/s], and the share of q that flows past the lands,
        s κ q_leak/q [-].
    """
    valve, real, length = config.hydraulics.valve, config.imperfections, config.circuit.land_length
    share = valve.land_leakage
    kept = share * (length / (length + 0.5 * sum(real.overlaps)))
    passed = 1.0 - (share - kept)
    return valve.leakage_flow * passed, kept / passed


def make_machine_arrays(config: MachineConfig) -> MachineArrays:
    """Convert a configuration into the flat arrays that kernels take.

    If joint 1 slews, its link is the platform. In the plane, the platform has length, mass, centre
    of mass and inertia 0. The leakage of closed valves includes the effect of their overlap. Each
    actuator's V_max is the smallest of its own limit, the common limit, and K √Δp_k / A. The third
    is the speed at full opening with pressure compensators. K is the valve coefficient, Δp_k the
    compensators' pressure drop (inf without compensators) and A the cap-side area.

    Args:
        config: Content of the machine file.

    Returns:
        Read-only arrays. `external_leakage` is 0.
    """
    joints, first = config.joints, config.joints[0]
    oil, (leakage, land_leakage) = config.hydraulics, _compute_closed_valve_leakage(config)
    area = np.array([joint.areas for joint in joints])
    slews = first.kind == "slew"
    rated_flow, drop = (
        collect_actuator_values(config, name)
        for name in ("rated_flow", "rated_pressure_drop_per_land")
    )
    fastest = np.minimum(
        np.minimum(
            collect_actuator_values(config, "max_piston_speed"), config.motion.max_piston_speed
        ),
        rated_flow * np.sqrt(oil.valve.largest_drop / drop) / area[:, 0],
    )

    def collect_link_values(name: str) -> FloatArray:
        """Return one property of every link, such as its mass; 0 for a slewing platform.

        Args:
            name: Name of the property in section `link` of a joint.
        """
        values = [getattr(joint.link, name) for joint in joints]
        return frozen(np.array([0.0, *values[1:]] if slews else values))

    return MachineArrays(
        turns=frozen(np.array([joint.kind == "revolute" for joint in joints])),
        slides=frozen(np.array([joint.kind == "prismatic" for joint in joints])),
        slews=slews,
        slew_offset=first.link.length if first.kind == "slew" else 0.0,
        slew_inertia=first.link.slew_inertia if first.kind == "slew" else 0.0,
        link_length=collect_link_values("length"),
        link_mass=collect_link_values("mass"),
        link_center=collect_link_values("center_of_mass"),
        link_inertia=collect_link_values("inertia"),
        joint_min=frozen(np.array([joint.limits.lower for joint in joints])),
        joint_max=frozen(np.array([joint.limits.upper for joint in joints])),
        linkage=frozen(
            np.array([build_linkage_row(joint.linkage, joint.limits.lower) for joint in joints])
        ),
        cap_area=frozen(area[:, 0]),
        rod_area=frozen(area[:, 1]),
        modules_per_mode=frozen(np.array(oil.modules.per_mode, dtype=np.int64)),
        module_count=oil.modules.count,
        payload=config.payload.mass,
        gravity=config.gravity,
        min_x=config.workspace.min_x,
        min_radius=config.workspace.min_radius,
        max_radius=config.workspace.max_radius,
        supply_pressure=oil.main_pump.pressure,
        tank_pressure=oil.tank_pressure,
        max_boost_pressure=oil.servo_pump.max_boost_pressure,
        boost_margin=oil.boost_margin,
        main_pump_flow=oil.main_pump.max_flow,
        servo_pump_flow=oil.servo_pump.max_flow,
        servo_pump_efficiency=oil.servo_pump.efficiency,
        servo_pump_slip=oil.servo_pump.slip_flow / RATED_SLIP_PRESSURE,
        valve_coefficient=frozen(rated_flow / np.sqrt(drop)),
        leakage_flow=leakage,
        land_leakage=land_leakage,
        external_leakage=0.0,
        max_piston_speed=frozen(fastest),
        max_chamber_pressure=frozen(
            np.maximum(
                MAX_CHAMBER_PRESSURE_SHARE * collect_actuator_values(config, "relief_pressure"),
                oil.servo_pump.max_boost_pressure,
            )
        ),
        max_piston_acceleration=config.motion.max_piston_acceleration,
        max_piston_jerk=config.motion.max_piston_jerk,
    )
