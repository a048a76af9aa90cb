"""The machine: a validated, frozen description with its kinematics, statics and limits."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import ValidationError

from mhsb_model import kinematics, slewing, statics
from mhsb_model.arrays import MachineArrays, collect_actuator_values, make_machine_arrays
from mhsb_model.curve_limits import CurveLimits, derive_curve_limits
from mhsb_model.errors import MachineFileError, OutOfWorkspaceError, suggest_unit
from mhsb_model.files.machine_files import find_machine_file, read_machine_file
from mhsb_model.files.machine_rules import (
    check_actuator_speed_limits,
    check_boost_pressure,
    check_machine_rules,
)
from mhsb_model.files.schema_problems import describe_validation_errors
from mhsb_model.files.value_paths import get_value, set_value
from mhsb_model.inverse_kinematics import tip_postures
from mhsb_model.inverse_kinematics.telescope_postures import find_telescope_postures
from mhsb_model.inverse_kinematics.tip_postures import LEAST_JOINTS
from mhsb_model.linkages import linkage
from mhsb_model.linkages.linkage_rules import check_linkages
from mhsb_model.modes import list_mode_patterns
from mhsb_model.obstacles import clearance
from mhsb_model.obstacles.shadows import compute_shadows
from mhsb_model.obstacles.zones import (
    KIND_COLUMN,
    LINK_COLUMN,
    LINK_KIND,
    NO_OBSTACLES,
    RADIUS_COLUMN,
    Obstacles,
    Zones,
    build_obstacles,
)
from mhsb_model.schema import COMMON_PATHS, DEFAULT_EXPECTED_DELAY, DEFAULT_PREVIEW, MachineConfig
from mhsb_model.types import FloatArray, ModeArray, Position, as_frozen, frozen

PAPER_NODE_SPACING = 0.05
"""Spacing of the workspace nodes of the paper's arm [m]."""
PLANNING_HASH_FIELDS: dict[str, Any] = {
    "joints": True,
    "workspace": {"min_x", "min_radius", "max_radius"},
    "hydraulics": True,
    "motion": True,
}
"""Parts of the machine file that a plan depends on and that planner and arm must have in common.

The setting of all chambers' relief valves (`circuit`) is left out, so that hashes in recordings and
estimates files stay valid. The arm's own supervision stops a motion that opens them.

The format is that of `include` in pydantic's `model_dump`."""

FIELDS_OUTSIDE_TABLE_HASH: dict[str, Any] = {
    "joints": {"__all__": {"kind": True, "actuator": {"friction", "relief_pressure"}}},
    "circuit": True,
    "servo": True,
    "simulation": True,
    "imperfections": True,
    "keep_out": True,
    "motion": {"max_piston_acceleration", "max_piston_jerk", "kept_joints"},
    "workspace": {"spacing"},
}
"""Parts of the machine file that a posture table does not depend on. A table stays valid if they
change.

The format is that of `exclude` in pydantic's `model_dump`."""


class FileRating(NamedTuple):
    """Values of a machine file that may be replaced for planning."""

    payload: float
    """Mass at the tip [kg]."""
    supply_pressure: float
    """Main pump's pressure P_S [Pa]."""


@dataclass(frozen=True, eq=False)
class Machine:
    """A manipulator with n joints, each driven by one actuator.

    Vectors over joints are float64 of shape (n,): angles [rad], torques [N m], forces [N], lengths
    [m]. For a sliding joint, q is in [m] and the torque is a force [N]. If joint 1 slews, (x, z)
    are positions in the plane that joint 1 turns, with the origin at joint 2 (`slewing`).
    """

    config: MachineConfig
    """Content of the machine file, validated."""
    arrays: MachineArrays = field(repr=False)
    """Numbers of the configuration as flat arrays for kernels."""
    shadows: Obstacles = field(repr=False, default=NO_OBSTACLES)
    """Shadows: obstacles in the arm's plane that stand for zones in space, beside the file's
    obstacles."""
    file_rating: FileRating | None = field(repr=False, default=None)
    """Payload and supply pressure of the original machine file if `changed` made this machine, else
    None."""

    @classmethod
    def from_config(cls, config: MachineConfig, source: str = "(in memory)") -> Machine:
        """Make a machine from a configuration and check all rules across its values.

        Args:
            config: Content of a machine file that the schema has accepted.
            source: Name of the file, for error messages.

        Returns:
            The machine, exactly as configured.

        Raises:
            MachineFileError: Rules are broken. There are three checks: rules across fields,
                linkages, and whether an obstacle is so near to joint 1 that no posture is clear of
                it. The error lists everything that the first failing check finds.
        """
        if problems := check_machine_rules(config) or list(check_linkages(config)):
            raise MachineFileError(source, problems)
        machine = cls(config, make_machine_arrays(config))
        if in_the_way := list(machine._describe_obstacles_at_joint_1()):
            raise MachineFileError(source, in_the_way)
        return machine

    @classmethod
    def from_content(
        cls, content: Any, source: str, schema: type[MachineConfig] = MachineConfig
    ) -> Machine:
        """Make a machine from nested content of a machine file, after a check by a schema.

        Args:
            content: Sections and values as read from YAML or dumped from a configuration.
            source: Name of the file, for error messages.
            schema: Schema of the content.

        Returns:
            The machine, with the obstacles of the content but without shadows (obstacles in the
            plane that stand for zones in space). Its `file_rating` is None.

        Raises:
            MachineFileError: The content breaks the schema or a rule across values.
        """
        try:
            config = schema.model_validate(content)
        except ValidationError as error:
            raise MachineFileError(source, describe_validation_errors(error, schema)) from error
        return cls.from_config(config, source)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the configuration instead of the arrays.

        Unpickling makes the machine again from the configuration. Unpickled arrays would be
        writable, but kernels are compiled for read-only arrays.
        """
        return _restored, (
            self.config,
            self.arrays.external_leakage,
            self.shadows,
            self.file_rating,
        )

    @property
    def name(self) -> str:
        """Name given in the machine file."""
        return self.config.name

    @property
    def joint_count(self) -> int:
        """Number of joints n, which is also the number of actuators."""
        return len(self.config.joints)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names `joint_1`, `joint_2`, … in the order of the machine file."""
        return tuple(f"joint_{i + 1}" for i in range(self.joint_count))

    @property
    def actuator_names(self) -> tuple[str, ...]:
        """Names `actuator_1`, `actuator_2`, … in the order of the machine file."""
        return tuple(f"actuator_{i + 1}" for i in range(self.joint_count))

    @property
    def joint_units(self) -> tuple[str, ...]:
        """Unit of each joint's q: "rad", or "m" for a sliding joint."""
        return tuple("m" if slides else "rad" for slides in self.arrays.slides)

    @cached_property
    def radian_equivalents(self) -> FloatArray:
        """Motion of each joint that counts as 1 rad when joints are compared, shape (n,).

        It is 1 rad for a joint that turns or slews. For a sliding joint it is its range divided by
        π [m].
        """
        return frozen(kinematics.compute_radian_equivalents(self.arrays))

    @property
    def slews(self) -> bool:
        """Return whether joint 1 turns the plane of all others about the vertical."""
        return self.arrays.slews

    @cached_property
    def planar_arm(self) -> Machine:
        """Planar part of a slewing arm, without joint 1.

        An arm that does not slew is its own planar part. Planners choose postures for the planar
        part. Its joint j is joint j + 1 of the slewing arm. Three values differ from the slewing
        arm's:

        - The main pump's largest flow is smaller by the leakage of the slew's valve.
        - `arrays.external_leakage` is the leakage of the slew's valve [m³/s], because it still
          costs energy.
        - The planar part has no keep-out zones; ground, base and self-collision stay.
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
        plane = self._make_similar_machine(content, f"{self.name} in its plane")
        return replace(plane, arrays=plane.arrays._replace(external_leakage=leakage))

    def make_planar_arm_with_shadows(self, first_slew: float, last_slew: float) -> Machine:
        """Return the planar part of a slewing arm, with the zones that its plane meets.

        Each zone in space becomes an obstacle in the plane, its shadow. The shadow contains all
        points of the plane that are in the zone at any slew angle between the two given angles. A
        posture clear of the shadows is clear of the zones at each of these angles.

        Args:
            first_slew: Slew angle at one end of the range [rad].
            last_slew: Slew angle at the other end [rad]; may be less than the first.

        Returns:
            `planar_arm` (the arm without joint 1) with these shadows as obstacles.
        """
        shadows = compute_shadows(self.obstacles, self.arrays.slew_offset, first_slew, last_slew)
        return replace(self.planar_arm, shadows=shadows)

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the coordinates of a position in `base_link`.

        They are x, y, z if joint 1 slews, otherwise x, z.
        """
        return ("x", "y", "z") if self.slews else ("x", "z")

    @property
    def chamber_reliefs(self) -> FloatArray:
        """Opening pressure of the relief valves of each actuator's chambers, shape (n,) [Pa]."""
        return collect_actuator_values(self.config, "relief_pressure")

    @property
    def friction_factors(self) -> FloatArray:
        """Factor of each actuator on the friction in section `circuit`, shape (n,) [-]."""
        return np.array([joint.actuator.friction for joint in self.config.joints])

    @property
    def has_telescope(self) -> bool:
        """Return whether any joint is prismatic."""
        return bool(self.arrays.slides.any())

    @property
    def is_3r(self) -> bool:
        """Return whether the arm has exactly three joints and all of them turn in the plane."""
        return self.joint_count == LEAST_JOINTS and bool(self.arrays.turns.all())

    @property
    def spacing(self) -> float:
        """Spacing of the workspace nodes of the posture table [m]."""
        return self.config.workspace.spacing

    @property
    def relative_size(self) -> float:
        """Size of the arm relative to the paper's, as the ratio of their node spacings [-].

        Step sizes of searches and drawings are scaled by it.
        """
        return self.spacing / PAPER_NODE_SPACING

    @cached_property
    def servo_preview(self) -> float:
        """Time by which the servo charges a line ahead of its boost [s].

        This is the longest `preview` of all controllers in the machine file, since a plan does not
        depend on the controller. If no controller in the file has this key, it is
        `DEFAULT_PREVIEW`.
        """
        parts = self.config.servo.model_dump().values()
        given = [part["preview"] for part in parts if isinstance(part, dict) and "preview" in part]
        return max(given, default=DEFAULT_PREVIEW)

    @cached_property
    def expected_delay(self) -> float:
        """Delay that a servo without pressure sensors assumes until it has learnt the delay [s].

        This is `servo.lag_compensated.expected_delay` of the machine file, or
        `DEFAULT_EXPECTED_DELAY` if the file does not have this key.
        """
        section = getattr(self.config.servo, "lag_compensated", None)
        return float(getattr(section, "expected_delay", DEFAULT_EXPECTED_DELAY))

    @cached_property
    def kept_joints(self) -> tuple[int, ...]:
        """Indices, from 0, of the joints that the planner `fixed` keeps still; two others move.

        They come from `motion.kept_joints` of the machine file, which counts from 1. If the list is
        empty, all joints from the third on are kept.
        """
        named = self.config.motion.kept_joints or range(3, self.joint_count + 1)
        return tuple(sorted(joint - 1 for joint in named))

    @cached_property
    def patterns(self) -> ModeArray:
        """All mode combinations that the machine's booster modules allow, one per row.

        The array is uint8 of shape (combinations, n), read-only. Row 0 is all N. The rows are in
        lexicographic order of the mode codes 0 N, 1 DB, 2 SB.
        """
        modules = self.config.hydraulics.modules
        return list_mode_patterns(self.joint_count, modules.count, modules.per_mode)

    @cached_property
    def table_hash(self) -> str:
        """SHA-256 of the parts of the machine file that a posture table depends on, in hexadecimal.

        A posture table has the best posture for each tip position; it is valid for machines with
        the same hash. `FIELDS_OUTSIDE_TABLE_HASH` lists the parts that do not change the hash.
        """
        content = self.config.model_dump(mode="json", exclude=FIELDS_OUTSIDE_TABLE_HASH)
        for joint in content["joints"]:  # values left out do not change the hash
            own = joint.pop("actuator")
            joint |= {name: value for name, value in own.items() if value is not None}
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    @cached_property
    def planning_hash(self) -> str:
        """Hash of all values that the planner's and the arm's machine file must share.

        It is a SHA-256 in hexadecimal. It covers joints, workspace radii, hydraulics and motion
        limits of the file. It does not depend on name, payload, gains, noise, comments or the order
        of keys.
        """
        content = self.config.model_dump(mode="json", include=PLANNING_HASH_FIELDS)
        return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()

    def describe_difference(self, name: str, planning_hash: str) -> str:
        """Describe why plans for this machine must not be sent to an arm with another machine.

        Plans fit the arm if both planning hashes are equal. Otherwise the sentence names both
        machines and the groups of values that may differ, but no single value.

        Args:
            name: Name of the arm's machine; the sentence shows at most 64 characters of it.
            planning_hash: `planning_hash` of the arm's machine, in hexadecimal.

        Returns:
            The sentence; empty if both hashes are equal, so that plans fit.
        """
        if planning_hash == self.planning_hash:
            return ""
        return (
            f"the arm has the machine file {name[:64]} ({planning_hash[:8]}), here it is "
            f"{self.name} ({self.planning_hash[:8]}): kinematics, limits, hydraulics or motion "
            "limits differ; use the same file for both"
        )

    def changed(
        self,
        *,
        payload: float | None = None,
        supply_pressure: float | None = None,
        max_piston_speed: float | None = None,
        zones: Zones | None = None,
        module_count: int | None = None,
    ) -> Machine:
        """Return a copy of the machine with some values replaced.

        None keeps a value. The copy of a machine from `planar_arm` or
        `make_planar_arm_with_shadows` loses two things: its `shadows` (obstacles in the plane that
        stand for zones in space) become empty, and `arrays.external_leakage` becomes 0.

        Args:
            payload: Mass at the tip [kg].
            supply_pressure: Main pump's pressure P_S [Pa].
            max_piston_speed: V_max common to all actuators [m/s]. An actuator with a lower limit in
                the machine file keeps it.
            zones: Keep-out zones that replace those of the file.
            module_count: Number of booster modules fitted.

        Returns:
            The copy. Its `file_rating` has payload and supply pressure of the original file.

        Raises:
            MachineFileError: A value is out of its range, or breaks a rule together with others.
        """
        content = self.config.model_dump()
        for path, value in (
            ("payload.mass", payload),
            ("hydraulics.main_pump.pressure", supply_pressure),
            ("motion.max_piston_speed", max_piston_speed),
            ("hydraulics.modules.count", module_count),
        ):
            if value is not None:
                set_value(content, path, value)
        if zones is not None:
            content["keep_out"] |= zones.content()
        return replace(
            self._make_similar_machine(content, f"{self.name} with changes"),
            file_rating=self._own_file_rating,
        )

    def with_values(self, values: Mapping[str, Any]) -> Machine:
        """Return a copy of the machine as if its machine file had other values.

        The copy has no `shadows`, and its `arrays.external_leakage` is 0. Only machines from
        `planar_arm` and `make_planar_arm_with_shadows` have shadows or external leakage.

        Args:
            values: New values by their paths, for instance `{"joints.0.link.mass": 5.0}`.

        Returns:
            The copy. Its `file_rating` (payload and supply pressure of an original file) is None:
            the copy counts as read from a file with the new values.

        Raises:
            ValuePathError: A path does not exist.
            MachineFileError: The changed file breaks a rule.
        """
        content = self.config.model_dump(mode="json")
        for path, value in values.items():
            set_value(content, path, value)
        return self._make_similar_machine(content, f"{self.name} with changes")

    def _make_similar_machine(self, content: Any, source: str) -> Machine:
        """Make a machine from other content, checked by the same schema as this machine's file.

        Args:
            content: Sections and values of a machine file as nested dicts and lists.
            source: Name for error messages.

        Returns:
            The machine. It has no shadows, no external leakage, and `file_rating` is None.

        Raises:
            MachineFileError: The content breaks the schema or a rule across values.
        """
        return Machine.from_content(content, source, type(self.config))

    def value(self, path: str) -> Any:
        """Return the value at a path in the machine file.

        Args:
            path: Keys and list indices, for instance `circuit.bulk_modulus` or
                `joints.0.link.mass`.

        Returns:
            A plain value, a list or a dict.

        Raises:
            ValuePathError: The path does not exist.
        """
        return get_value(self.config.model_dump(mode="json"), path)

    def list_overriding_paths(self, path: str) -> list[str]:
        """Return a path of the machine file, and the paths of all values that override its value.

        An actuator may have its own value in place of one that is common to all, such as
        `motion.max_piston_speed`.

        Args:
            path: Path of the common value.

        Returns:
            The path itself, then `joints.J.actuator.NAME` for each actuator that has its own value.
            J counts from 0.
        """
        return [path, *(
            f"joints.{j}.actuator.{own}"
            for own, common in COMMON_PATHS.items()
            for j, joint in enumerate(self.config.joints)
            if common == path and getattr(joint.actuator, own) is not None
        )]  # fmt: skip

    def without_obstacles(self) -> Machine:
        """Return a copy of the machine without any obstacles.

        Keep-out zones, ground, base, self-collision and shadows are removed. `file_rating` is kept,
        but `arrays.external_leakage` becomes 0.
        """
        bare = self._make_similar_machine(self.config.model_dump(exclude={"keep_out"}), self.name)
        return replace(bare, file_rating=self.file_rating)

    def tip_position(self, q: FloatArray) -> FloatArray:
        """Return the tip (x, z) in the arm's plane at the joint positions q, shape (2,) [m]."""
        return np.array(kinematics.tip_position(self.arrays, q))

    def tip_in_base(self, q: FloatArray) -> FloatArray:
        """Compute the position of the tip in `base_link`.

        Args:
            q: One posture of shape (n,), or k postures of shape (k, n) [rad or m].

        Returns:
            (x, z), or (x, y, z) if joint 1 slews [m]. The shape is (2 or 3,) for one posture, (k, 2
            or 3) for k postures.
        """
        tips = self.tip_positions(np.atleast_2d(q)).reshape(*np.shape(q)[:-1], 2)
        return slewing.convert_to_base(self.arrays, tips, np.asarray(q)[..., 0])

    def convert_to_plane(self, position: Position, preferred_slew: float) -> slewing.PlanarTarget:
        """Convert a position in `base_link` into the arm's plane, and find the slew angle for it.

        A slewing arm moves in a vertical plane that its joint 1 turns. Positions in the plane have
        their origin at joint 2.

        Args:
            position: (x, z), or (x, y, z) if joint 1 slews [m].
            preferred_slew: Preferred angle of the slew [rad]. If the arm can face the position at
                several angles within the limits, the nearest angle is taken. If the position is on
                the slew's axis, `preferred_slew` is returned.

        Returns:
            Position in the plane, and the slew's angle (None if the arm does not slew).

        Raises:
            OutOfWorkspaceError: No angle within the slew's limits points to the position.
        """
        return slewing.convert_to_plane(self.arrays, position, preferred_slew)

    def convert_to_base(self, tip: FloatArray, slew: FloatArray | float) -> FloatArray:
        """Convert positions in the arm's plane into `base_link`.

        A slewing arm moves in a vertical plane that its joint 1 turns. Positions in the plane have
        their origin at joint 2.

        Args:
            tip: Positions (x, z) in the plane, shape (…, 2) [m].
            slew: Angle of the slew for each position, shape (…) [rad]; ignored if the arm does not
                slew.

        Returns:
            (x, z), or (x, y, z) if joint 1 slews, shape (…, 2 or 3) [m].
        """
        return slewing.convert_to_base(self.arrays, tip, np.asarray(slew))

    def project_to_plane(self, position: Position | FloatArray) -> FloatArray:
        """Convert positions in `base_link` into the arm's plane.

        A slewing arm moves in a vertical plane that its joint 1 turns. The plane is turned towards
        each position; the slew's limits are not checked.

        Args:
            position: (x, z), or (x, y, z) if joint 1 slews, shape (…, 2 or 3) [m].

        Returns:
            Distance ahead of joint 2 and height in the plane, shape (…, 2) [m]. The positions
            themselves if the arm does not slew.
        """
        return slewing.project_to_plane(self.arrays, np.asarray(position))

    def tip_positions(self, postures: FloatArray) -> FloatArray:
        """Return the tip (x, z) in the arm's plane for each of several postures.

        Args:
            postures: Joint positions, shape (k, n) [rad or m].

        Returns:
            Tip positions, shape (k, 2) [m].
        """
        return np.asarray(kinematics.tip_positions(self.arrays, as_frozen(postures)))

    def joint_positions(self, q: FloatArray) -> FloatArray:
        """Return the positions of all joints and of the tip in the arm's plane.

        Args:
            q: Joint positions, shape (n,) [rad or m].

        Returns:
            (x, z), shape (n + 1, 2) [m]. Row j is the joint with index j; row 0 is the origin, row
            n the tip. If joint 1 slews, rows 0 and 1 are both the origin.
        """
        return np.asarray(kinematics.joint_positions(self.arrays, as_frozen(np.asarray(q))))

    def link_angles(self, q: FloatArray) -> FloatArray:
        """Return the angle of each link from the x axis in the plane [rad].

        Args:
            q: One posture of shape (n,), or k postures of shape (k, n) [rad or m].

        Returns:
            Angles of the shape of `q`, not wrapped.
        """
        return np.cumsum(np.where(self.arrays.turns, q, 0.0), axis=-1)

    def end_link_angle(self, q: FloatArray) -> float:
        """Return the end-link angle ψ in the plane, the sum of all revolute joint angles [rad]."""
        return float(kinematics.end_link_angle(self.arrays, q))

    def jacobian(self, q: FloatArray) -> FloatArray:
        """Return the Jacobian ∂(x, z)/∂q of the tip in the arm's plane, shape (2, n)."""
        return kinematics.tip_jacobian(self.arrays, q)

    def postures(self, x: float, z: float, psi: FloatArray) -> FloatArray:
        """Compute postures within the joint limits for a tip position and given end-link angles.

        The machine must not slew (`planar_arm`). For three revolute joints, or two and one
        telescope, the result is complete. For longer chains the result is a sample: the additional
        joints take evenly spaced positions.

        Args:
            x: Tip position in the arm's plane, forward [m].
            z: Tip position in the arm's plane, up [m].
            psi: End-link angles to try (sums of all revolute joint angles), shape (k,) [rad].

        Returns:
            Joint positions, shape (found, n) [rad or m]. Each end-link angle can have no posture,
            one or several.
        """
        if self.has_telescope:
            angles = np.asarray(psi, dtype=float)
            return find_telescope_postures(self.arrays, x, z, angles)
        return tip_postures.find_postures(self.arrays, x, z, np.asarray(psi, dtype=float))

    def gravity_torque(self, q: FloatArray) -> FloatArray:
        """Return the joint torques that hold the arm and its payload against gravity.

        Args:
            q: Joint positions, shape (n,) [rad or m].

        Returns:
            Torques, positive if the joint must lift, shape (n,) [N m], or [N] for a sliding joint.
        """
        torque = np.empty(self.joint_count)
        statics.gravity_torque(self.arrays, q, torque)
        return torque

    def piston_forces(self, q: FloatArray) -> FloatArray:
        """Return the piston forces that hold the arm and its payload against gravity.

        Args:
            q: Joint positions, shape (n,) [rad or m].

        Returns:
            Forces, shape (n,) [N]; positive if the load resists extension.
        """
        force = np.empty(self.joint_count)
        statics.piston_forces(self.arrays, np.array(q), force)  # writable copy: one kernel type
        return force

    def piston_forces_in(self, postures: FloatArray) -> FloatArray:
        """Return the piston forces that hold the arm and its payload in each of several postures.

        Args:
            postures: Joint positions, shape (k, n) [rad or m].

        Returns:
            Forces, shape (k, n) [N]; positive if the load resists extension.
        """
        force = np.empty(postures.shape)
        statics.piston_forces_in(self.arrays, postures, force)
        return force

    def mass_matrix(self, q: FloatArray) -> FloatArray:
        """Return the joint-space mass matrix of links and payload, shape (n, n) [kg m²].

        An element is in [kg m] if one of its two joints slides, in [kg] if both do.
        """
        return statics.mass_matrix(self.arrays, q)

    def moment_arms(self, q: FloatArray) -> FloatArray:
        """Return the signed moment arms r = dL/dq of all actuators.

        L is the length of a joint's cylinder. If r is positive, extension turns the joint in the
        positive direction.

        Args:
            q: Joint positions, shape (n,) [rad or m].

        Returns:
            Moment arms, shape (n,) [m]; 1 [-] for a sliding joint.
        """
        rows = self.arrays.linkage
        return np.array([linkage.moment_arm(rows[j], q[j]) for j in range(self.joint_count)])

    @property
    def max_joint_speeds(self) -> FloatArray:
        """Upper bound on joint speeds that the main pump's flow allows, shape (n,) [rad/s or m/s].

            q̇_max = Q_MP / (min(A, a) · min |r|)

        Q_MP is the main pump's largest flow, and A and a are the areas of the piston. min |r| is
        the smallest moment arm within the joint's limits.
        """
        a = self.arrays
        return a.main_pump_flow / (np.minimum(a.cap_area, a.rod_area) * self._moment_arm_ends[0])

    @property
    def _own_file_rating(self) -> FileRating:
        """Payload and supply pressure of the original file, even after a call of `changed`."""
        own = FileRating(self.arrays.payload, self.arrays.supply_pressure)
        return own if self.file_rating is None else self.file_rating

    @cached_property
    def curve_limits(self) -> CurveLimits:
        """Position, speed, acceleration and jerk limits of a received trajectory, for each joint.

        The limits are derived from payload, supply pressure and joint ranges of the machine file.
        The arm that receives the trajectory knows only its file. A copy with other values (made by
        `changed`) has the same limits.
        """
        arrays = make_machine_arrays(self.config)._replace(**self._own_file_rating._asdict())
        rated = Machine(self.config, arrays)
        return derive_curve_limits(
            rated.arrays, self.config.circuit, rated.longest_moment_arms, rated.max_joint_speeds
        )

    @property
    def longest_moment_arms(self) -> FloatArray:
        """Largest |r| of each joint within its limits, shape (n,) [m]."""
        return self._moment_arm_ends[1]

    @cached_property
    def _moment_arm_ends(self) -> tuple[FloatArray, FloatArray]:
        """Smallest and largest |r| of each joint within its limits, each of shape (n,) [m].

        r = dL/dq is the moment arm; a sliding joint has r = 1 [-].
        """
        a = self.arrays
        ranges = map(linkage.moment_arm_range, a.linkage, a.joint_min, a.joint_max)
        ends = np.abs(np.array(list(ranges)))
        return ends.min(axis=1), ends.max(axis=1)

    def cylinder_lengths(self, q: FloatArray) -> FloatArray:
        """Return the distance between the pins of each cylinder, shape (n,) [m].

        Args:
            q: Joint positions, shape (n,) [rad or m].
        """
        rows = self.arrays.linkage
        return np.array([linkage.cylinder_length(rows[j], q[j]) for j in range(self.joint_count)])

    @property
    def zones(self) -> Zones:
        """Keep-out zones of the machine file."""
        return Zones.from_keep_out(self.config.keep_out)

    @cached_property
    def obstacles(self) -> Obstacles:
        """Everything that the arm keeps clear of: obstacles of the file, then shadows of zones.

        Obstacles of the file are zones, ground, base and the arm itself. Shadows are obstacles in
        the arm's plane that stand for zones in space.
        """
        own = build_obstacles(self.config.keep_out, self.joint_count, int(self.slews))
        return own.combined_with(self.shadows) if self.shadows.names else own

    def clearance(self, q: FloatArray) -> tuple[float, str]:
        """Compute the distance between the arm and the nearest obstacle in a posture.

        The links count with their thickness.

        Args:
            q: Joint positions, shape (n,) [rad or m].

        Returns:
            Distance [m], and the name of the nearest obstacle. The distance is negative if the arm
            is inside the obstacle. It is inf, and the name is "", if there are no obstacles.
        """
        posture = np.asarray(q, dtype=np.float64)[None, :]
        distance, row = clearance.clearances(self.arrays, self.obstacles.rows, frozen(posture))
        return float(distance[0]), self.obstacles.name(row[0])

    def _describe_obstacles_at_joint_1(self) -> Iterator[str]:
        """Describe each obstacle that is too close to the beginning of the first link.

        The first link begins at joint 1 in every posture, so the arm could never keep clear of such
        an obstacle. An obstacle is too close if its distance from joint 1 is below the link's
        radius plus the margin of discrete paths. Only obstacles that the first link must avoid are
        checked, and not other links. For a slewing arm nothing is checked, since the link of its
        joint 1 is not in the plane.

        Yields:
            One sentence for each such obstacle, for error messages.
        """
        rows = self.obstacles.path_rows
        for k in range(len(rows)):
            if rows[k, KIND_COLUMN] == LINK_KIND or rows[k, LINK_COLUMN] != 0:
                continue
            beyond, needed = clearance.point_clearance(rows, k, 0.0, 0.0), rows[k, RADIUS_COLUMN]
            if beyond < 0.0:
                yield (
                    f"keep_out: {self.obstacles.name(k)} is {beyond + needed:.4g} m from joint 1, "
                    f"where link 1 always is; it must be at least {needed:.4g} m away, the link's "
                    "radius and the margin"
                )

    def check_in_workspace(self, position: Position) -> None:
        """Check that a position is in the workspace, as goals for the tip must be.

        Args:
            position: (x, z), or (x, y, z) if joint 1 slews, in `base_link` [m].

        Raises:
            OutOfWorkspaceError: x, the distance from the origin, or the slew's angle is outside its
                limits. The origin is joint 1, or joint 2 of a slewing arm. The error's sentence
                suggests another unit if the position is inside when read in this unit.
        """
        limit = self._describe_workspace_limit(position)
        if limit:
            hint = suggest_unit(position, "m", lambda p: not self._describe_workspace_limit(p))
            raise OutOfWorkspaceError(position, f"{limit}{hint}")

    def _describe_workspace_limit(self, position: Sequence[float]) -> str:
        """Return the first rule of the workspace that a position breaks, as a clause.

        The order of the rules is: angle of the slew, x (for a slewing arm the distance from the
        slew's axis), distance from the origin.

        Args:
            position: (x, z), or (x, y, z) if joint 1 slews, in `base_link` [m].

        Returns:
            Clause such as "x must be at least 0.2 m"; empty if the position breaks no rule.
        """
        area, rounding = self.config.workspace, 1e-9
        try:
            x, z = self.convert_to_plane(tuple(position), 0.0).tip
        except OutOfWorkspaceError as error:
            return error.limit
        radius, least = math.hypot(x, z), area.min_x + self.arrays.slew_offset
        if x < area.min_x - rounding:
            what = "its distance from the slew's axis" if self.slews else "x"
            return f"{what} must be at least {least:g} m"
        if radius < area.min_radius - rounding or radius > area.max_radius + rounding:
            return (
                f"its distance {radius:.4g} m from {'joint 2' if self.slews else 'the base'} must "
                f"be within {area.min_radius:g} … {area.max_radius:g} m"
            )
        return ""


def load_machine(
    path: str | Path | None = None, schema: type[MachineConfig] = MachineConfig
) -> Machine:
    """Load a machine from a YAML file and check that plans can be made for it.

    Args:
        path: The machine file, or the name of a machine of the suite such as `excavator`. None or
            an empty text loads the suite's own arm.
        schema: Schema of the file. `MachineConfig` does not check the gains of controllers; the
            schema of `mhsb_control.load_machine` does.

    Returns:
        The machine, exactly as in the file.

    Raises:
        MachineFileError: The file cannot be read or breaks a rule. Three further rules apply: at
            least three joints (four with a slew), no speed limit of an actuator above the common
            V_max, and a boost pressure above the main pump's pressure. The error lists all problems
            of the first check that fails.
    """
    file = find_machine_file(path)
    machine = Machine.from_content(read_machine_file(file), str(file), schema)
    least, tip = (LEAST_JOINTS + 1, "three") if machine.slews else (LEAST_JOINTS, "two")
    if machine.joint_count < least:
        problem = (
            f"joints: the machine has {machine.joint_count}, plans are made for {least} or "
            f"more: the tip takes {tip}, what is chosen is the rest"
        )
        raise MachineFileError(str(file), [problem])
    config = machine.config
    if problems := check_actuator_speed_limits(config) + check_boost_pressure(config):
        raise MachineFileError(str(file), problems)
    return machine


def _restored(
    config: MachineConfig, external_leakage: float, shadows: Obstacles, rating: FileRating | None
) -> Machine:
    """Restore a machine from its pickled values.

    Args:
        config: Content of the machine file.
        external_leakage: Leakage of valves that do not belong to the n joints [m³/s].
        shadows: `Machine.shadows`: obstacles in the plane that stand for zones in space.
        rating: `Machine.file_rating`: payload and supply pressure of the original machine file;
            None if the machine was not made by `changed`.

    Returns:
        A machine equal to the pickled one.
    """
    machine = Machine.from_config(config)
    arrays = machine.arrays._replace(external_leakage=external_leakage)
    return replace(machine, arrays=arrays, shadows=shadows, file_rating=rating)
