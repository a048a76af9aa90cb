"""The machine's numbers as flat arrays, the form in which numba kernels take them."""

from __future__ import annotations

from typing import NamedTuple

from mhsb_model.types import BoolArray, FloatArray, IntArray


class MachineArrays(NamedTuple):
    """Numbers of a machine with n joints; SI units.

    Where a joint slides, its q is in m, and its torque a force. Where joint 1 slews, all others
    move in a plane that turns with it: positions in that plane are seen from joint 2, and link 1,
    the platform, has neither length nor mass in it.
    """

    turns: BoolArray  # [n] whether a joint turns its link in the plane
    slides: BoolArray  # [n] whether it is prismatic
    slews: bool  # whether joint 1 turns the plane about the vertical
    slew_offset: float  # m, of joint 2 ahead of the slew's axis
    slew_inertia: float  # kg m², of the platform about that axis
    link_length: FloatArray  # [n] m, retracted
    link_mass: FloatArray  # [n] kg
    link_center: FloatArray  # [n] m, centre of mass from the link's joint, retracted
    link_inertia: FloatArray  # [n] kg m², about the centre of mass
    joint_min: FloatArray  # [n] rad or m
    joint_max: FloatArray  # [n] rad or m
    linkage: FloatArray  # [n, LINKAGE_WIDTH]
    cap_area: FloatArray  # [n] m²
    rod_area: FloatArray  # [n] m², annulus on the rod side
    modules_per_mode: IntArray  # [modes], 0 where not boosted
    module_count: int
    payload: float  # kg
    gravity: float  # m/s²
    min_x: float  # m
    min_radius: float  # m
    max_radius: float  # m
    supply_pressure: float  # Pa
    tank_pressure: float  # Pa
    max_boost_pressure: float  # Pa
    boost_margin: float  # Pa
    main_pump_flow: float  # m³/s
    servo_pump_flow: float  # m³/s
    servo_pump_efficiency: float
    valve_coefficient: FloatArray  # [n] m³/(s √Pa), one edge of each actuator's valve
    leakage_flow: float  # m³/s, one valve at the supply pressure
    idle_leakage: float  # m³/s, likewise, of valves whose actuators are not among the n
    max_piston_speed: FloatArray  # [n] m/s
    max_piston_acceleration: float  # m/s²
    max_piston_jerk: float  # m/s³
