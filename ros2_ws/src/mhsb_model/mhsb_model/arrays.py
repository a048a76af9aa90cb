"""The machine's numbers as flat arrays, the form that numba kernels take."""

from __future__ import annotations

from typing import NamedTuple

from mhsb_model.types import BoolArray, FloatArray, IntArray


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
    """Largest flow of the main pump Q_MP [m³/s]."""
    servo_pump_flow: float
    """Largest flow of one servo pump Q_SP [m³/s]."""
    servo_pump_efficiency: float
    """Hydraulic power out of a servo pump over power into it, slip apart [-]."""
    servo_pump_slip: float
    """Slip of a servo pump per pressure rise c [m³/(s Pa)]."""
    valve_coefficient: FloatArray
    """Flow coefficient K of one metering edge of each valve, Q = K √Δp, shape (n,) [m³/(s √Pa)]."""
    leakage_flow: float
    """Leakage of one closed valve, with its overlap, at the main pump's pressure q_leak [m³/s]."""
    land_leakage: float
    """Share of that leakage which flows over the lands of the spool [-]."""
    external_leakage: float
    """Total leakage, at the main pump's pressure, of valves that do not belong to the n joints
    [m³/s]."""
    max_piston_speed: FloatArray
    """V_max of each actuator, shape (n,) [m/s]."""
    max_piston_acceleration: float
    """Largest planned piston acceleration [m/s²]."""
    max_piston_jerk: float
    """Largest planned piston jerk [m/s³]."""
