"""The machine: a validated, frozen description with its kinematics, statics and limits."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from mhsb_model import kinematics, slewing, statics
from mhsb_model.arrays import MachineArrays
from mhsb_model.errors import MachineFileError, OutOfWorkspaceError
from mhsb_model.files.config_files import config_file
from mhsb_model.files.machine_rules import own_speed_problems, problems_across
from mhsb_model.files.schema_problems import problems_of
from mhsb_model.files.value_paths import set_value, value_at
from mhsb_model.files.yaml_files import YamlFileError, read_yaml
from mhsb_model.inverse_kinematics import tip_postures
from mhsb_model.inverse_kinematics.telescope_postures import telescope_postures
from mhsb_model.inverse_kinematics.tip_postures import LEAST_JOINTS
from mhsb_model.linkages import linkage
from mhsb_model.linkages.linkage_rules import linkage_problems
from mhsb_model.modes import mode_patterns
from mhsb_model.obstacles import clearance
from mhsb_model.obstacles.shadows import shadows_between
from mhsb_model.obstacles.zones import (
    KIND,
    LINK,
    NO_OBSTACLES,
    PART,
    RADIUS,
    Obstacles,
    Zones,
    obstacles_of,
)
from mhsb_model.schema import COMMON, MachineConfig
from mhsb_model.types import FloatArray, ModeArray, Position, as_frozen, frozen

MACHINE_FILE = "mhsb_arm3.yaml"
PAPER_SPACING = 0.05  # m
SECTIONS = tuple(name for name, part in MachineConfig.model_fields.items() if part.is_required())

WITHOUT_TABLE: dict[str, Any] = {
    "joints": {"__all__": {"kind": True, "actuator": {"friction", "relief_pressure"}}},
    "circuit": True,
    "servo": True,
    "simulation": True,
    "imperfections": True,
    "keep_out": True,
    "motion": {"max_piston_acceleration", "max_piston_jerk", "kept_joints"},
    "workspace": {"spacing"},
}
"""What does not concern a posture table and so leaves it valid."""


@dataclass(frozen=True, eq=False)
class Machine:
    """A manipulator with n joints, each driven by one actuator.

    Vectors over joints are float64[n]: angles in rad, torques in N m, forces in N, lengths in m.
    Where a joint slides, its q is in m and its torque a force in N. Where joint 1 slews, (x, z) are
    positions in the plane that it turns, seen from joint 2 (`slewing`).
    """

    config: MachineConfig
    arrays: MachineArrays = field(repr=False)
    shadows: Obstacles = field(repr=False, default=NO_OBSTACLES)
    """Of zones in space, in the arm's plane; they stand beside the file's obstacles."""

    @classmethod
    def from_config(cls, config: MachineConfig, source: str = "(in memory)") -> Machine:
        """Machine of a configuration; raises MachineFileError with every broken rule."""
        problems = problems_across(config)
        if not problems:
            problems = linkage_problems(config)
        if problems:
            raise MachineFileError(source, problems)
        machine = cls(config, _arrays(config))
        if in_the_way := machine._obstacles_at_joint_1():
            raise MachineFileError(source, in_the_way)
        return machine

    def __reduce__(self) -> tuple[Any, ...]:
        """Another process makes it of its configuration: pickled arrays could be written to there,
        which kernels are not compiled for."""
        return _restored, (self.config, self.arrays.idle_leakage, self.shadows)

    @property
    def name(self) -> str:
        """Name given in the machine file."""
        return self.config.name

    @property
    def joint_count(self) -> int:
        """Number of joints n, and of actuators."""
        return len(self.config.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """`joint_1` … in the order of the machine file."""
        return tuple(f"joint_{i + 1}" for i in range(self.joint_count))

    @property
    def actuator_names(self) -> tuple[str, ...]:
        """`actuator_1` … in the order of the machine file."""
        return tuple(f"actuator_{i + 1}" for i in range(self.joint_count))

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Unit of each joint's q: rad, or m where it slides."""
        return tuple("m" if slides else "rad" for slides in self.arrays.slides)

    @cached_property
    def radians(self) -> FloatArray:
        """What counts as a radian of each joint, float64[n] rad or m: `kinematics.radians`."""
        return frozen(kinematics.radians(self.arrays))

    @property
    def slews(self) -> bool:
        """Whether joint 1 turns the plane of all others about the vertical."""
        return self.arrays.slews

    @cached_property
    def plane(self) -> Machine:
        """The arm in its plane, for which postures are chosen; the machine itself, if it does not
        slew. The slew's valve leaks its part of the main pump's flow.
        """
        if not self.slews:
            return self
        content, leakage = self.config.model_dump(), self.arrays.leakage_flow
        content["joints"] = content["joints"][1:]
        content["hydraulics"]["main_pump"]["max_flow"] -= leakage
        kept = content["motion"]["kept_joints"]
        content["motion"]["kept_joints"] = [joint - 1 for joint in kept]
        content["simulation"]["start_posture"] = content["simulation"]["start_posture"][1:]
        content["keep_out"] |= Zones().content()
        plane = _validated(content, f"{self.name} in its plane")
        return replace(plane, arrays=plane.arrays._replace(idle_leakage=leakage))

    def plane_among(self, began: float, ended: float) -> Machine:
        """The arm in its plane, clear of what stands in space where this plane gets to, between
        two angles of the slew [rad]: what keeps clear of these shadows there is clear of zones."""
        shadows = shadows_between(self.obstacles, self.arrays.slew_offset, began, ended)
        return replace(self.plane, shadows=shadows)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of a position's numbers in `base_link`."""
        return ("x", "y", "z") if self.slews else ("x", "z")

    @property
    def chamber_reliefs(self) -> FloatArray:
        """Settings of the relief valves of each actuator's chambers, float64[n] Pa."""
        return _of_actuators(self.config, "relief_pressure")

    @property
    def frictions(self) -> FloatArray:
        """Friction of each actuator over what `circuit` says, float64[n]."""
        return np.array([joint.actuator.friction for joint in self.config.joints])

    @property
    def has_telescope(self) -> bool:
        """Whether a joint is prismatic."""
        return bool(self.arrays.slides.any())

    @property
    def is_3r(self) -> bool:
        """Whether three joints turn in the plane, and nothing else moves."""
        return self.joint_count == LEAST_JOINTS and bool(self.arrays.turns.all())

    @property
    def spacing(self) -> float:
        """Of the tip positions for which postures are chosen beforehand [m]."""
        return self.config.workspace.spacing

    @property
    def scale(self) -> float:
        """Its size over that of the paper's arm, by these spacings: what searches' strides go
        by."""
        return self.spacing / PAPER_SPACING

    @cached_property
    def kept_joints(self) -> tuple[int, ...]:
        """Joints that the conventional method keeps, counted from 0: all but two."""
        named = self.config.motion.kept_joints or range(3, self.joint_count + 1)
        return tuple(sorted(joint - 1 for joint in named))

    @cached_property
    def patterns(self) -> ModeArray:
        """All mode patterns within the module budget, uint8[patterns, n]."""
        modules = self.config.hydraulics.modules
        return mode_patterns(self.joint_count, modules.count, modules.per_mode)

    @cached_property
    def hash(self) -> str:
        """SHA-256 over everything that a posture table depends on."""
        content = self.config.model_dump(mode="json", exclude=WITHOUT_TABLE)
        for joint in content["joints"]:  # what is left out leaves no trace
            own = joint.pop("actuator")
            joint |= {name: value for name, value in own.items() if value is not None}
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def changed(
        self,
        *,
        payload: float | None = None,
        supply_pressure: float | None = None,
        max_piston_speed: float | None = None,
        zones: Zones | None = None,
        module_count: int | None = None,
    ) -> Machine:
        """The same machine with another payload [kg], supply pressure [Pa], V_max [m/s], zones or
        number of booster modules.

        V_max is of all actuators but those whose own is lower. Raises MachineFileError where a
        value is out of its range.
        """
        content = self.config.model_dump()
        if payload is not None:
            content["payload"]["mass"] = payload
        if supply_pressure is not None:
            content["hydraulics"]["main_pump"]["pressure"] = supply_pressure
        if max_piston_speed is not None:
            content["motion"]["max_piston_speed"] = max_piston_speed
        if zones is not None:
            content["keep_out"] |= zones.content()
        if module_count is not None:
            content["hydraulics"]["modules"]["count"] = module_count
        return _validated(content, f"{self.name} with changes")

    def with_values(self, values: Mapping[str, Any]) -> Machine:
        """The same machine with other values, by their paths in the machine file.

        Raises ValuePathError and MachineFileError.
        """
        content = self.config.model_dump(mode="json")
        for path, value in values.items():
            set_value(content, path, value)
        return _validated(content, f"{self.name} with changes")

    def value(self, path: str) -> Any:
        """The value of a path in the machine file; raises ValuePathError."""
        return value_at(self.config.model_dump(mode="json"), path)

    def paths_with_own(self, path: str) -> list[str]:
        """A path in the machine file, and those of what actuators have of their own instead."""
        return [path, *(
            f"joints.{j}.actuator.{own}"
            for own, common in COMMON.items()
            for j, joint in enumerate(self.config.joints)
            if common == path and getattr(joint.actuator, own) is not None
        )]  # fmt: skip

    def without_obstacles(self) -> Machine:
        """The same machine with nothing to keep clear of."""
        return _validated(self.config.model_dump(exclude={"keep_out"}), self.name)

    def tip_position(self, q: FloatArray) -> FloatArray:
        """Tip (x, z) at the joint angles q, float64[2]."""
        return np.array(kinematics.tip_position(self.arrays, q))

    def tip_in_base(self, q: FloatArray) -> FloatArray:
        """Tip in `base_link` at q, float64[2] (x, z), or float64[3] (x, y, z) where joint 1 slews;
        of postures float64[k, n] in each of them."""
        tips = self.tip_positions(np.atleast_2d(q)).reshape(*np.shape(q)[:-1], 2)
        return slewing.in_base(self.arrays, tips, np.asarray(q)[..., 0])

    def in_plane(self, position: Position, near: float) -> slewing.InPlane:
        """`slewing.in_plane` of a position in `base_link`; raises OutOfWorkspaceError."""
        return slewing.in_plane(self.arrays, position, near)

    def in_base(self, tip: FloatArray, slew: FloatArray | float) -> FloatArray:
        """`slewing.in_base` of positions in the plane."""
        return slewing.in_base(self.arrays, tip, np.asarray(slew))

    def from_the_side(self, place: Position | FloatArray) -> FloatArray:
        """`slewing.from_the_side` of positions in `base_link`."""
        return slewing.from_the_side(self.arrays, np.asarray(place))

    def tip_positions(self, postures: FloatArray) -> FloatArray:
        """Tips (x, z) in the postures float64[k, n], float64[k, 2]."""
        return np.asarray(kinematics.tip_positions(self.arrays, as_frozen(postures)))

    def joint_positions(self, q: FloatArray) -> FloatArray:
        """(x, z) of all joints and of the tip, float64[n + 1, 2]."""
        return np.asarray(kinematics.joint_positions(self.arrays, as_frozen(np.asarray(q))))

    def link_angles(self, q: FloatArray) -> FloatArray:
        """Angle of each link [rad], float64[n], or of postures float64[k, n] in each of them."""
        return np.cumsum(np.where(self.arrays.turns, q, 0.0), axis=-1)

    def end_link_angle(self, q: FloatArray) -> float:
        """ψ, the angle of the last link in the plane [rad]: the sum of all that turns in it."""
        return float(kinematics.end_link_angle(self.arrays, q))

    def jacobian(self, q: FloatArray) -> FloatArray:
        """∂(x, z)/∂q, float64[2, n]."""
        return kinematics.tip_jacobian(self.arrays, q)

    def postures(self, x: float, z: float, psi: FloatArray) -> FloatArray:
        """Postures within limits at (x, z) for the end-link angles psi, float64[found, n].

        All with three joints, of more those of `tip_postures.postures` and `telescope_postures`.
        """
        if self.has_telescope:
            angles = np.asarray(psi, dtype=float)
            return telescope_postures(self.arrays, x, z, angles)
        return tip_postures.postures(self.arrays, x, z, np.asarray(psi, dtype=float))

    def gravity_torque(self, q: FloatArray) -> FloatArray:
        """Torques that hold the arm and its payload."""
        torque = np.empty(self.joint_count)
        statics.gravity_torque(self.arrays, q, torque)
        return torque

    def inverse_dynamics(self, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        """Torques that move the arm and its payload, gravity included; q̇ [rad/s], q̈ [rad/s²]."""
        weight, torque = np.empty(self.joint_count), np.empty(self.joint_count)
        work = np.empty((statics.MOTION_WORK, self.joint_count))
        state = (np.array(values, dtype=np.float64) for values in (q, qd, qdd))
        statics.moving_torques(statics.chain_of(self.arrays), *state, work, weight, torque)
        return torque

    def piston_forces(self, q: FloatArray) -> FloatArray:
        """Cylinder forces that hold the arm and its payload, positive resists extension."""
        force = np.empty(self.joint_count)
        statics.piston_forces(self.arrays, np.array(q), force)  # a copy: one type for the kernel
        return force

    def piston_forces_in(self, postures: FloatArray) -> FloatArray:
        """The same in each of the postures float64[k, n], float64[k, n]."""
        force = np.empty(postures.shape)
        statics.piston_forces_in(self.arrays, postures, force)
        return force

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Mass matrix of links and payload, float64[n, n] kg m²."""
        return statics.mass_matrix(self.arrays, q)

    def moment_arms(self, q: FloatArray) -> FloatArray:
        """Signed moment arms r = dL/dq; 1 where a joint slides."""
        rows = self.arrays.linkage
        return np.array([linkage.moment_arm(rows[j], q[j]) for j in range(self.joint_count)])

    @property
    def fastest_joints(self) -> FloatArray:
        """Joint speeds that the main pump's whole flow can never exceed: Q / (min A · min |r|)."""
        a = self.arrays
        return a.main_pump_flow / (np.minimum(a.cap_area, a.rod_area) * self._moment_arm_ends[0])

    @property
    def longest_moment_arms(self) -> FloatArray:
        """Largest |r| of each joint within its limits."""
        return self._moment_arm_ends[1]

    @cached_property
    def _moment_arm_ends(self) -> tuple[FloatArray, FloatArray]:
        a = self.arrays
        ranges = map(linkage.moment_arm_range, a.linkage, a.joint_min, a.joint_max)
        ends = np.abs(np.array(list(ranges)))
        return ends.min(axis=1), ends.max(axis=1)

    def cylinder_lengths(self, q: FloatArray) -> FloatArray:
        """Distances between each cylinder's pins."""
        rows = self.arrays.linkage
        return np.array([linkage.cylinder_length(rows[j], q[j]) for j in range(self.joint_count)])

    @property
    def zones(self) -> Zones:
        """The keep-out zones."""
        return Zones.of(self.config.keep_out)

    @cached_property
    def obstacles(self) -> Obstacles:
        """Everything that the arm keeps clear of."""
        own = obstacles_of(self.config.keep_out, self.joint_count, int(self.slews))
        return own.and_also(self.shadows) if self.shadows.names else own

    def clearance(self, q: FloatArray) -> tuple[float, str]:
        """Distance [m] to the nearest obstacle, negative inside, and its name; inf, "" without."""
        posture = np.asarray(q, dtype=np.float64)[None, :]
        distance, row = clearance.clearances(self.arrays, self.obstacles.rows, frozen(posture))
        return float(distance[0]), self.obstacles.name(row[0])

    def _obstacles_at_joint_1(self) -> list[str]:
        """The arm cannot keep clear of what is where its first link begins."""
        rows, problems = self.obstacles.path_rows, []
        for k in range(len(rows)):
            if rows[k, KIND] == LINK or rows[k, PART] != 0:
                continue
            beyond, needed = clearance.point_clearance(rows, k, 0.0, 0.0), rows[k, RADIUS]
            if beyond < 0.0:
                problems.append(
                    f"keep_out: {self.obstacles.name(k)} is {beyond + needed:.4g} m from joint 1, "
                    f"where link 1 always is; it must be at least {needed:.4g} m away, the link's "
                    "radius and the margin"
                )
        return problems

    def check_in_workspace(self, position: Position) -> None:
        """Raise OutOfWorkspaceError where the tip may not be asked to go to a position in
        `base_link`."""
        area, rounding = self.config.workspace, 1e-9
        x, z = self.in_plane(position, 0.0).tip
        radius, least = math.hypot(x, z), area.min_x + self.arrays.slew_offset
        if x < area.min_x - rounding:
            what = "its distance from the slew's axis" if self.slews else "x"
            raise OutOfWorkspaceError(position, f"{what} must be at least {least:g} m")
        if radius < area.min_radius - rounding or radius > area.max_radius + rounding:
            raise OutOfWorkspaceError(
                position,
                f"its distance {radius:.4g} m from {'joint 2' if self.slews else 'the base'} must "
                f"be within {area.min_radius:g} … {area.max_radius:g} m",
            )


def load_machine(path: str | Path | None = None) -> Machine:
    """Machine of a YAML file, or the suite's own; raises MachineFileError with all problems."""
    file = Path(path) if path else config_file(MACHINE_FILE)
    try:
        content = read_yaml(file)
    except YamlFileError as error:
        raise MachineFileError(str(file), [error.reason]) from None
    missing = [name for name in SECTIONS if not (isinstance(content, dict) and name in content)]
    if len(missing) > len(SECTIONS) / 2:  # nothing of another file's content is repeated
        reason = f"is not a machine file: it lacks {', '.join(missing)}; copy config/{MACHINE_FILE}"
        raise MachineFileError(str(file), [reason])
    machine = _validated(content, str(file))
    least, tip = (LEAST_JOINTS + 1, "three") if machine.slews else (LEAST_JOINTS, "two")
    if machine.joint_count < least:
        problem = (
            f"joints: the machine has {machine.joint_count}, plans are made for {least} or "
            f"more: the tip takes {tip}, what is chosen is the rest"
        )
        raise MachineFileError(str(file), [problem])
    if too_fast := own_speed_problems(machine.config):
        raise MachineFileError(str(file), too_fast)
    return machine


def _restored(config: MachineConfig, idle_leakage: float, shadows: Obstacles) -> Machine:
    machine = Machine.from_config(config)
    if idle_leakage == 0.0 and not shadows.names:
        return machine
    arrays = machine.arrays._replace(idle_leakage=idle_leakage)
    return replace(machine, arrays=arrays, shadows=shadows)


def _validated(content: Any, source: str) -> Machine:
    try:
        config = MachineConfig.model_validate(content)
    except ValidationError as error:
        raise MachineFileError(source, problems_of(error, MachineConfig)) from error
    return Machine.from_config(config, source)


def _of_actuators(config: MachineConfig, name: str) -> FloatArray:
    """Of each actuator its own value, or the one that is common to all, float64[n]."""
    own = [getattr(joint.actuator, name) for joint in config.joints]
    usual = attrgetter(COMMON[name])(config)
    return np.array([usual if each is None else each for each in own])


def _arrays(config: MachineConfig) -> MachineArrays:
    joints, first = config.joints, config.joints[0]
    oil = config.hydraulics
    area = np.array([joint.areas for joint in joints])
    slews = first.kind == "slew"
    rated_flow, drop = (
        _of_actuators(config, name) for name in ("rated_flow", "rated_pressure_drop_per_land")
    )
    fastest = _of_actuators(config, "max_piston_speed")

    def of_links(name: str) -> FloatArray:
        """Of each link in the plane; the platform is none."""
        values = [getattr(joint.link, name) for joint in joints]
        return frozen(np.array([0.0, *values[1:]] if slews else values))

    return MachineArrays(
        turns=frozen(np.array([joint.kind == "revolute" for joint in joints])),
        slides=frozen(np.array([joint.kind == "prismatic" for joint in joints])),
        slews=slews,
        slew_offset=first.link.length if first.kind == "slew" else 0.0,
        slew_inertia=first.link.slew_inertia if first.kind == "slew" else 0.0,
        link_length=of_links("length"),
        link_mass=of_links("mass"),
        link_center=of_links("center_of_mass"),
        link_inertia=of_links("inertia"),
        joint_min=frozen(np.array([joint.limits.lower for joint in joints])),
        joint_max=frozen(np.array([joint.limits.upper for joint in joints])),
        linkage=frozen(
            np.array([linkage.linkage_row(joint.linkage, joint.limits.lower) for joint in joints])
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
        valve_coefficient=frozen(rated_flow / np.sqrt(drop)),
        leakage_flow=oil.valve.leakage_flow,
        idle_leakage=0.0,
        max_piston_speed=frozen(np.minimum(fastest, config.motion.max_piston_speed)),
        max_piston_acceleration=config.motion.max_piston_acceleration,
        max_piston_jerk=config.motion.max_piston_jerk,
    )
