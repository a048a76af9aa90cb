"""Schema of a machine file: names, units, ranges and meaning of every parameter.

All values are SI. Unknown keys and non-finite numbers are refused. Rules that concern several
values are in `files.machine_rules`.
"""

import math
from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    SerializerFunctionWrapHandler,
    Tag,
    model_serializer,
    model_validator,
)

MAX_COORDINATE, MAX_MASS, MAX_FLOW, MAX_PRESSURE = 1e4, 1e6, 1.0, 1e9
"""Largest coordinate of a zone [m], mass [kg], flow [m³/s] and pressure [Pa].

The ranges leave two orders of magnitude around the values of machines from 0.1 kg to 1000 t. So a
mistyped number is noticed, and computations with accepted numbers neither overflow nor divide by 0.
"""

MAX_SUPPLY_PRESSURE = 5e7
"""Largest pressure of the main pump and of a boosted line [Pa]; more than common pumps give."""

NonNegative = Annotated[float, Field(ge=0)]
Angle = Annotated[float, Field(ge=-2 * math.pi, le=2 * math.pi)]
Coordinate = Annotated[float, Field(ge=-MAX_COORDINATE, le=MAX_COORDINATE)]
Length = Annotated[float, Field(ge=1e-4, le=20)]
LinkageLength = Annotated[float, Field(ge=1e-4, le=5)]
PistonDiameter = Annotated[float, Field(ge=1e-4, le=1)]
Mass = Annotated[float, Field(ge=0, le=MAX_MASS)]
Inertia = Annotated[float, Field(ge=0, le=1e9)]
Volume = Annotated[float, Field(ge=1e-10, le=1)]
Flow = Annotated[float, Field(ge=1e-10, le=MAX_FLOW)]
Pressure = Annotated[float, Field(ge=1, le=MAX_PRESSURE)]
Duration = Annotated[float, Field(ge=1e-5, le=1e4)]
Gain = Annotated[float, Field(ge=1e-4, le=1e4)]
ValveFlow = Annotated[float, Field(ge=1e-10, le=0.1)]
ValveDrop = Annotated[float, Field(ge=1, le=5e7)]
PistonSpeed = Annotated[float, Field(ge=1e-4, le=1)]
ValveShare = Annotated[float, Field(ge=0, le=1)]
ValveCurve = tuple[tuple[ValveShare, ValveShare], ...]
"""Curve of a valve: pairs (share of the stroke beyond the overlap, share of the full opening)."""
ValveName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,39}$")]
Weight = Annotated[float, Field(ge=0, le=1e6)]
"""Weight of energy [1/J], time [1/s] or mode switches [-] in the cost of a plan."""


class Section(BaseModel):
    """Base of all sections: frozen, without unknown keys and without NaN or infinite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Link(Section):
    """A rigid link, from its joint to the next joint (or to the tip)."""

    length: Length = Field(description="joint to next joint [m]")
    mass: Mass = Field(description="[kg]")
    center_of_mass: NonNegative = Field(le=20, description="distance from the link's joint [m]")
    inertia: Inertia = Field(description="about the centre of mass, in the plane [kg m²]")


class Extension(Section):
    """Sliding part of a telescope. Retracted, its tip is `length` beyond the link before."""

    length: NonNegative = Field(
        le=20, description="tip of the link before to the own tip at q = 0 [m]"
    )
    mass: Mass = Field(description="[kg]")
    center_of_mass: float = Field(
        ge=-20,
        le=20,
        description="at q = 0, beyond the tip of the link before; negative inside that link [m]",
    )
    inertia: Inertia = Field(description="about the centre of mass, in the plane [kg m²]")


class Platform(Section):
    """Platform that turns about the vertical and carries the arm; only its inertia matters."""

    length: NonNegative = Field(le=20, description="slew's axis to joint 2, forwards [m]")
    mass: float = Field(ge=1e-6, le=MAX_MASS, description="[kg]")
    center_of_mass: float = Field(
        ge=-20, le=20, description="ahead of the slew's axis, negative behind it [m]"
    )
    inertia: float = Field(
        ge=1e-9, le=1e9, description="about the vertical through the centre of mass [kg m²]"
    )

    @property
    def slew_inertia(self) -> float:
        """Moment of inertia about the slew's axis, I₀ = I + m x² (parallel axes) [kg m²]."""
        return self.inertia + self.mass * self.center_of_mass**2


class Pin(Section):
    """A pin of a linkage in polar coordinates about the joint's axis."""

    radius: LinkageLength = Field(description="distance from the joint's axis [m]")
    angle: Angle = Field(description="from the x axis of the frame the pin is fixed in [rad]")


class SliderCrank(Section):
    """A cylinder between a pin on the parent link and a pin on the joint's own link.

    Its length L follows from L² = u² + v² − 2 u v cos θ. Its moment arm is r = dL/dq = ±u v sin θ /
    L. u and v are the distances of the pins from the joint's axis, and θ is the angle between them.
    The parent pin is fixed in the frame of the parent link (x along it; the world's for joint 1).
    The child pin is fixed in the frame of the joint's own link. Extension turns the joint
    positively if the child pin is ahead of the parent pin.
    """

    kind: Literal["slider_crank"]
    parent_pin: Pin
    child_pin: Pin


class FourBar(Section):
    """A cylinder turns a rocker on the parent link; a coupler from its tip turns the child link.

    Rod and coupler are both pinned to the rocker's tip. Rocker pivot and parent pin are fixed in
    the parent link's frame, the child pin in the frame of the joint's own link. `rocker_side`
    chooses between the two ways to assemble the linkage. Seen from the rocker's pivot towards the
    child pin, it is the side on which the rocker's tip lies.
    """

    kind: Literal["four_bar"]
    rocker_pivot: Pin
    rocker_length: LinkageLength = Field(description="pivot to tip [m]")
    rocker_side: Literal["left", "right"] = Field(description="of pivot → child pin")
    coupler_length: LinkageLength = Field(description="rocker's tip to child pin [m]")
    child_pin: Pin = Field(description="of the coupler")
    parent_pin: Pin = Field(description="of the cylinder")


class Direct(Section):
    """A cylinder along a telescope: L = retracted length + q, r = dL/dq = 1."""

    kind: Literal["direct"]
    retracted_length: Length = Field(description="pin to pin at q = 0 [m]")


class RackAndPinion(Section):
    """Pistons on toothed racks turn a pinion: L = R q, r = R, with equal areas in both directions.

    Each rack has a piston at either end, one of which pushes.
    """

    kind: Literal["rack_and_pinion"]
    pitch_radius: LinkageLength = Field(description="R of the pinion [m]")
    bore: PistonDiameter = Field(description="piston diameter [m]")
    racks: int = Field(default=1, ge=1, le=8, description="that turn the pinion together [-]")

    @property
    def area(self) -> float:
        """Total area of the pistons that push [m²]."""
        return self.racks * math.pi / 4 * self.bore**2


class Motor(Section):
    """A hydraulic motor turns a ring gear through a gearbox.

    It is treated as a piston that moves along the ring gear's pitch circle: L = R q, r = R. The
    area is A = D i / R, with the displacement D and the gear ratio i. Then p A is the force at the
    teeth and A L̇ = D i q̇ is the flow.
    """

    kind: Literal["motor"]
    displacement: float = Field(ge=1e-10, le=0.01, description="D, of the motor's shaft [m³/rad]")
    gear_ratio: float = Field(
        ge=0.01, le=10_000, description="i, turns of the shaft for one slewed [-]"
    )
    pitch_radius: LinkageLength = Field(description="R of the ring gear [m]")

    @property
    def area(self) -> float:
        """Equivalent piston area D i / R [m²]."""
        return self.displacement * self.gear_ratio / self.pitch_radius

    @property
    def volume(self) -> float:
        """Oil on one side of the motor: half of the displacement per turn of its shaft [m³]."""
        return math.pi * self.displacement


TurningLinkage = Annotated[SliderCrank | FourBar, Field(discriminator="kind")]
SlewDrive = Annotated[RackAndPinion | Motor, Field(discriminator="kind")]
Linkage = SliderCrank | FourBar | Direct | RackAndPinion | Motor
JOINT_KINDS = ("revolute", "prismatic", "slew")
"""Kinds of joints that a machine file may name."""


class Cylinder(Section):
    """A single-rod cylinder."""

    bore: PistonDiameter = Field(description="piston diameter [m]")
    rod: PistonDiameter = Field(description="rod diameter [m]")

    @property
    def areas(self) -> tuple[float, float]:
        """Cap-side and rod-side area, A and a [m²]."""
        return math.pi / 4 * self.bore**2, math.pi / 4 * (self.bore**2 - self.rod**2)


class Actuator(Section):
    """Values of one actuator that differ from the common values of the file."""

    rated_flow: ValveFlow | None = Field(
        default=None,
        description="of its valve, through one edge at the rated drop [m³/s]; "
        "hydraulics.valve.rated_flow when left out",
    )
    rated_pressure_drop_per_land: ValveDrop | None = Field(
        default=None,
        description="of its valve, over one edge [Pa]; "
        "hydraulics.valve.rated_pressure_drop_per_land when left out",
    )
    max_piston_speed: PistonSpeed | None = Field(
        default=None,
        description="its V_max, at most motion.max_piston_speed [m/s]; that when left out",
    )
    friction: NonNegative = Field(
        default=1.0, le=100, description="its friction, over that of circuit [-]"
    )
    relief_pressure: Pressure | None = Field(
        default=None,
        description="of its chambers [Pa]; circuit.chamber_relief_pressure when left out",
    )


class Limits(Section):
    """Range of a joint that turns."""

    lower: Angle = Field(description="[rad]")
    upper: Angle = Field(description="[rad]")


class Stroke(Section):
    """Range of a prismatic joint, measured from the retracted position."""

    lower: NonNegative = Field(le=20, description="[m]")
    upper: Length = Field(description="[m]")


def _check_joint_kind(kind: Any) -> Any:
    """Refuse a joint kind that does not exist, with a message that lists the valid kinds.

    Args:
        kind: Value of the key `kind` of a joint that is neither prismatic nor a slew.

    Returns:
        "revolute".

    Raises:
        ValueError: The kind is anything but "revolute".
    """
    if kind != "revolute":
        raise ValueError(f"{kind!r} is not one of {', '.join(JOINT_KINDS)}")
    return kind


class RevoluteJoint(Section):
    """A joint in the plane, its link, its linkage and the cylinder that drives it."""

    kind: Annotated[Literal["revolute"], BeforeValidator(_check_joint_kind)] = Field(
        default="revolute", description="of the joint; schema version 2 needs it"
    )
    link: Link
    limits: Limits
    linkage: TurningLinkage
    cylinder: Cylinder
    actuator: Actuator = Actuator()

    @property
    def areas(self) -> tuple[float, float]:
        """Piston areas for extension and retraction [m²]."""
        return self.cylinder.areas


class PrismaticJoint(Section):
    """A telescope along the link before, and the cylinder that drives it directly.

    Its q is the extension [m]. It has a force [N] where other joints have a torque.
    """

    kind: Literal["prismatic"]
    link: Extension
    limits: Stroke
    linkage: Direct
    cylinder: Cylinder
    actuator: Actuator = Actuator()

    @property
    def areas(self) -> tuple[float, float]:
        """Piston areas for extension and retraction [m²]."""
        return self.cylinder.areas


class SlewJoint(Section):
    """A joint that turns the plane of all other joints about the vertical, positive to the left."""

    kind: Literal["slew"]
    link: Platform
    limits: Limits
    linkage: SlewDrive
    actuator: Actuator = Actuator()

    @property
    def areas(self) -> tuple[float, float]:
        """Equivalent piston areas of the drive for turning left and right, which are equal [m²]."""
        return self.linkage.area, self.linkage.area


def _choose_joint_kind(content: Any) -> str:
    """Choose the kind of joint whose schema pydantic applies to a joint's content.

    Args:
        content: A joint as read from the file, or a joint object.

    Returns:
        "prismatic" or "slew" if the content has this kind. Otherwise "revolute", whose schema then
        reports a wrong kind.
    """
    kind = content.get("kind") if isinstance(content, dict) else getattr(content, "kind", None)
    return kind if kind in ("prismatic", "slew") else "revolute"


AnyJoint = RevoluteJoint | PrismaticJoint | SlewJoint
Joint = Annotated[
    Annotated[RevoluteJoint, Tag("revolute")]
    | Annotated[PrismaticJoint, Tag("prismatic")]
    | Annotated[SlewJoint, Tag("slew")],
    Discriminator(_choose_joint_kind),
]


def unit_of(joint: AnyJoint) -> str:
    """Return the unit of the joint's position q: "m" if it is prismatic, otherwise "rad"."""
    return "m" if isinstance(joint, PrismaticJoint) else "rad"


class Payload(Section):
    """Point mass at the tip."""

    mass: NonNegative = Field(le=10_000, description="[kg]")


class Workspace(Section):
    """Region of allowed tip positions, with distances from joint 1, or joint 2 if joint 1 slews."""

    min_x: Coordinate = Field(description="least horizontal coordinate, in the arm's plane [m]")
    min_radius: NonNegative = Field(le=1000, description="[m]")
    max_radius: float = Field(ge=1e-4, le=1000, description="[m]")
    spacing: float = Field(
        default=0.05, ge=0.005, le=2, description="of the tip positions of its posture table [m]"
    )


class MainPump(Section):
    """Main pump (MP) at constant pressure that feeds all actuators."""

    pressure: float = Field(ge=1e5, le=MAX_SUPPLY_PRESSURE, description="supply pressure P_S [Pa]")
    max_flow: float = Field(ge=1e-10, le=0.1, description="[m³/s]")


class ServoPump(Section):
    """Servo pump (SP) of one booster module."""

    max_flow: float = Field(ge=1e-10, le=0.01, description="[m³/s]")
    efficiency: float = Field(
        ge=0.01, le=1, description="hydraulic power out over power in, slip apart [-]"
    )
    slip_flow: NonNegative = Field(
        default=0.0,
        le=0.01,
        exclude_if=lambda given: given == 0.0,
        description="from its outlet back to its inlet at 10 MPa, beside max_flow [m³/s]",
    )
    max_boost_pressure: float = Field(
        ge=1, le=MAX_SUPPLY_PRESSURE, description="highest boosted supply pressure [Pa]"
    )


ModulesUsed = Annotated[int, Field(ge=0, le=64)]


class Modules(Section):
    """Number of booster modules, and how many of them each mode occupies."""

    count: int = Field(ge=0, le=64, description="modules fitted [-]")
    per_mode: tuple[ModulesUsed, ModulesUsed, ModulesUsed] = Field(
        description="modules used by N, DB, SB [-]; above count, the mode is never used"
    )


class Valve(Section):
    """Servo valve with one metering edge per land; the drop over an edge determines its flow."""

    rated_flow: ValveFlow = Field(description="through one edge at the rated drop [m³/s]")
    rated_pressure_drop_per_land: ValveDrop = Field(description="over one edge [Pa]")
    leakage_flow: NonNegative = Field(le=0.01, description="supply to tank, per valve [m³/s]")
    land_leakage: float = Field(
        default=0.0,
        ge=0,
        le=1,
        exclude_if=lambda given: given == 0.0,
        description="share of leakage_flow that passes the work ports, over the lands of the "
        "spool; loads then sink through a closed valve [-]",
    )
    compensated_drop: ValveDrop | None = Field(
        default=None,
        exclude_if=lambda given: given is None,
        description="largest drop over one edge, which pressure compensators keep, so that the "
        "flow does not depend on the load [Pa]; without compensators when left out",
    )

    @property
    def largest_drop(self) -> float:
        """Largest pressure drop over one metering edge [Pa]; inf without compensators."""
        return math.inf if self.compensated_drop is None else self.compensated_drop


class Hydraulics(Section):
    """Hydraulics between the tank and the cylinders, as far as the planner needs them."""

    tank_pressure: NonNegative = Field(le=1e6, description="[Pa]")
    boost_margin: NonNegative = Field(
        le=5e6, description="pressure kept in reserve beyond the valve's own drop [Pa]"
    )
    main_pump: MainPump
    servo_pump: ServoPump
    modules: Modules
    valve: Valve


class Motion(Section):
    """Limits of planned motion."""

    max_piston_speed: PistonSpeed = Field(description="V_max of the quasi-static plan [m/s]")
    max_piston_acceleration: float = Field(
        default=0.2, ge=1e-3, le=100, description="of motions that follow their path [m/s²]"
    )
    max_piston_jerk: float = Field(
        default=4.0, ge=1e-2, le=1e4, description="of motions that follow their path [m/s³]"
    )
    kept_joints: tuple[Annotated[int, Field(ge=1, le=64)], ...] = Field(
        default=(), description="by the `fixed` planner, all but two; none: all from joint 3 on [-]"
    )


class CircuitDynamics(Section):
    """Dynamics of the hydraulic circuit: oil, volumes, valves, pumps, relief and friction."""

    bulk_modulus: float = Field(ge=1e5, le=1e12, description="effective, oil and hoses [Pa]")
    free_air: float = Field(
        default=0.0,
        ge=0,
        le=0.2,
        exclude_if=lambda given: given == 0.0,
        description="share of the oil's volume at atmospheric pressure that is free air [-]",
    )
    chamber_dead_volume: Volume = Field(description="each side of a cylinder, at its end [m³]")
    line_volume: Volume = Field(description="supply line of one actuator [m³]")
    rail_volume: Volume = Field(description="rail that shared boost uses [m³]")
    manifold_volume: Volume = Field(description="between the main pump and the modules [m³]")
    laminar_pressure: Pressure = Field(
        description="pressure drop below which orifices become laminar [Pa]"
    )
    main_pump_droop: Pressure = Field(
        description="how far the main pump's pressure sinks up to full flow [Pa]"
    )
    main_pump_time: float = Field(
        default=0.0,
        ge=0,
        le=10,
        exclude_if=lambda given: given == 0.0,
        description="time constant of the main pump's swash plate [s]; 0: follows at once",
    )
    check_valve_flow: Flow = Field(description="at its rated drop [m³/s]")
    check_valve_pressure_drop: Pressure = Field(description="rated drop [Pa]")
    switching_valve_flow: Flow = Field(description="at its rated drop [m³/s]")
    switching_valve_pressure_drop: Pressure = Field(description="rated drop [Pa]")
    switching_valve_time: Duration = Field(description="time constant of opening and closing [s]")
    valve_frequency: float = Field(ge=0.01, le=1e5, description="of the servo valve's spool [Hz]")
    valve_damping: Gain = Field(description="damping ratio of the spool [-]")
    land_length: float = Field(
        default=0.05,
        ge=1e-4,
        le=1,
        exclude_if=lambda given: given == 0.05,
        description="overlap that halves the leakage of a land, share of the spool's stroke [-]",
    )
    lock_valve_opening: float = Field(
        default=0.0,
        ge=0,
        le=0.5,
        exclude_if=lambda given: given == 0.0,
        description="opening of the servo valve below which lock valves, piloted by the line, shut "
        "off the cylinder [-]; 0 without them",
    )
    servo_pump_lag: Duration = Field(description="time constant of the servo pump's speed [s]")
    servo_pump_flow_reserve: NonNegative = Field(
        le=0.1,
        description="flow beyond max_flow that covers the valve's leakage and compression [m³/s]",
    )
    servo_pump_slew: float = Field(
        ge=1e-9, le=1e4, description="fastest change of a servo pump's flow [m³/s²]"
    )
    servo_pump_power: float = Field(
        ge=1e-3, le=1e8, description="most that a servo pump's motor gives [W]"
    )
    rail_bleed_flow: NonNegative = Field(le=0.1, description="rail to tank at 10 MPa [m³/s]")
    line_relief_pressure: Pressure = Field(description="[Pa]")
    chamber_relief_pressure: Pressure = Field(description="[Pa]")
    manifold_relief_margin: Pressure = Field(
        default=1e6, description="above P_S, at which the main pump's relief valve opens [Pa]"
    )
    relief_flow_gain: float = Field(
        ge=1e-18, le=1e-3, description="flow per excess pressure [m³/(s Pa)]"
    )
    anti_cavitation_flow: Flow = Field(description="tank to chamber at its rated drop [m³/s]")
    anti_cavitation_pressure_drop: Pressure = Field(description="rated drop [Pa]")
    vapour_pressure: NonNegative = Field(
        default=1e3, le=9e4, description="below which no oil gets [Pa]"
    )
    pump_filling_pressure: Pressure = Field(
        default=8e4, description="above vapour pressure, fills a servo pump wholly [Pa]"
    )
    main_pump_efficiency: float = Field(
        default=0.9, ge=0.01, le=1, description="torque of the main pump that makes pressure [-]"
    )
    main_pump_drag_power: NonNegative = Field(
        le=1e8, default=10.0, description="that turning the main pump takes beside it [W]"
    )
    servo_pump_drag_power: NonNegative = Field(
        le=1e8,
        default=0.0,
        description="that turning a servo pump at full speed takes beside it [W]",
    )
    coulomb_friction: NonNegative = Field(le=1e7, description="of a cylinder [N]")
    viscous_friction: NonNegative = Field(le=1e9, description="of a cylinder [N s/m]")
    friction_speed: float = Field(
        ge=1e-7, le=10, description="piston speed at which 3/4 of the Coulomb friction acts [m/s]"
    )
    valves: dict[ValveName, dict[ValveName, Any]] = Field(
        default={},
        exclude_if=lambda given: not given,
        description="further valves: a section for each kind, which may be empty",
    )


DEFAULT_PREVIEW = 0.08
"""Time by which lines are charged ahead of a boost, unless the machine file declares it [s]."""

Preview = Annotated[
    float, Field(ge=1e-5, le=1, description="how long before a boost its line is charged [s]")
]


DEFAULT_EXPECTED_DELAY = 0.2
"""Delay that is assumed until the real one is learnt, unless the machine file declares it [s]."""

ExpectedDelay = Annotated[
    float,
    Field(
        ge=0.0,
        le=0.6,
        description="of valve and computer with their lag, until it is learnt [s]",
    ),
]


class ControllerSection(Section):
    """Section of one controller; only the keys that plans depend on are declared here.

    The controller declares all keys of its section itself, and `mhsb_control.registry` checks them.
    """

    model_config = ConfigDict(extra="allow")

    preview: Preview = DEFAULT_PREVIEW
    expected_delay: ExpectedDelay = DEFAULT_EXPECTED_DELAY

    @model_serializer(mode="wrap")
    def _dump_given_keys(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return only the keys of the section that the file gives.

        Not every controller knows the keys `preview` and `expected_delay`.

        Args:
            dump: pydantic's own serializer of the section.
        """
        return {key: value for key, value in dump(self).items() if key in self.model_fields_set}


class Servo(Section):
    """Gains of the controllers and noise of the sensors."""

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, ControllerSection]

    force_bias_time: Duration = Field(
        description="time in which unknown forces are taken over into the force reference [s]"
    )
    pressure_noise: NonNegative = Field(le=1e9, description="standard deviation of a sensor [Pa]")
    length_noise: NonNegative = Field(le=1.0, description="standard deviation of a sensor [m]")


class Simulation(Section):
    """Time steps of the simulation and its initial posture."""

    step: Annotated[float, Field(ge=1e-5, le=5e-3)] = Field(description="of the control [s]")
    mechanics_substeps: int = Field(
        default=1, ge=1, le=100, description="of the mechanics in one step of the control [-]"
    )
    circuit_substeps: int = Field(
        ge=1, le=100, description="of the circuit in one of the mechanics [-]"
    )
    start_posture: tuple[Coordinate, ...] = Field(
        description="joint angles at the start [rad], extensions of telescopes [m]"
    )


class Stiction(Section):
    """Friction with memory (LuGre model): bristles that bend, stick and slip."""

    breakaway: float = Field(ge=1, le=10, description="static over Coulomb friction [-]")
    speed: float = Field(
        ge=1e-7, le=10, description="piston speed by which most of it is overcome [m/s]"
    )
    stiffness: float = Field(ge=1e-3, le=1e15, description="of the bristles [N/m]")
    damping: NonNegative = Field(le=1e12, description="of the bristles [N s/m]")


class Accumulator(Section):
    """Gas-loaded accumulator behind the main pump."""

    volume: float = Field(ge=1e-10, le=0.1, description="of the gas at its precharge [m³]")
    precharge: Pressure = Field(description="pressure at which the gas fills it [Pa]")
    exponent: float = Field(default=1.4, ge=1, le=2, description="polytropic [-]")


class SupplySag(Section):
    """Temporary fall of the main pump's pressure."""

    start: NonNegative = Field(le=1e6, description="after the start of the simulation [s]")
    fall: Duration = Field(default=0.05, description="time in which it falls, and rises [s]")
    duration: NonNegative = Field(le=1e6, description="at the lower pressure [s]")
    pressure: Pressure = Field(description="that it falls to [Pa]")


class Sensors(Section):
    """Classes of the fitted sensors. Class `file` has only the noise given in `servo`.

    With `pressure: none`, only controllers that read no pressures can run.
    """

    length: Literal["file", "encoder_16_bit", "encoder_13_bit", "imu"] = Field(
        default="file",
        description="encoders round joint angles; inertial sensors have 0.1° of noise and drift by "
        "0.5° a minute (standard deviations), which no servo corrects",
    )
    angle_noise: float | None = Field(
        default=None,
        ge=0,
        le=1,
        exclude_if=lambda given: given is None,
        description="of each reading of a joint, standard deviation, in m for telescopes; that of "
        "the class when left out [rad]",
    )
    angle_offset: float | None = Field(
        default=None,
        ge=0,
        le=1,
        exclude_if=lambda given: given is None,
        description="of joints' readings at the start, standard deviation among sensors, in m for "
        "telescopes; that of the class when left out [rad]",
    )
    angle_drift: float | None = Field(
        default=None,
        ge=0,
        le=0.1,
        exclude_if=lambda given: given is None,
        description="of joints' readings, standard deviation among sensors, in m/s for telescopes; "
        "that of the class when left out [rad/s]",
    )
    pressure: Literal["file", "laboratory", "industrial", "none"] = "file"
    pump_speed: Literal["exact", "resolver"] = "exact"
    rate: float | None = Field(
        default=None,
        ge=1,
        le=1e5,
        exclude_if=lambda given: given is None,
        description="of all readings [Hz]; that of the control when left out",
    )


class Imperfections(Section):
    """Imperfections of real machines. An imperfection that is left out is off."""

    valve_overlap: float = Field(
        default=0.0, ge=0, le=0.5, description="of a spool, share of its stroke [-]"
    )
    valve_overlap_retracting: float | None = Field(
        default=None,
        ge=0,
        le=0.5,
        exclude_if=lambda given: given is None,
        description="of a spool that retracts the piston [-]; valve_overlap when left out",
    )
    valve_exponent: float = Field(
        default=1.0,
        ge=0.5,
        le=3,
        exclude_if=lambda given: given == 1.0,
        description="of the opening over the stroke beyond the overlap [-]",
    )
    valve_curve: ValveCurve | None = Field(
        default=None,
        min_length=2,
        max_length=64,
        exclude_if=lambda given: given is None,
        description="pairs [share of the stroke beyond the overlap, share of the full opening] "
        "from [0, 0] to [1, 1], both rising; a straight line when left out [-]",
    )
    valve_curve_retracting: ValveCurve | None = Field(
        default=None,
        min_length=2,
        max_length=64,
        exclude_if=lambda given: given is None,
        description="of spools that retract the piston; valve_curve when left out [-]",
    )
    valve_hysteresis: float = Field(
        default=0.0, ge=0, le=0.5, description="of a spool, width as a share of its stroke [-]"
    )
    spool_rate: float | None = Field(
        default=None,
        ge=1e-3,
        le=1e6,
        description="fastest motion of a spool, strokes a second [1/s]",
    )
    computing_delay: float = Field(
        default=0.0, ge=0, le=0.5, description="from sensors to commands, whole steps [s]"
    )
    oil_temperature: float = Field(
        default=40.0, ge=-30, le=120, description="the file's oil is at 40 [°C]"
    )
    stiction: Stiction | None = None
    accumulator: Accumulator | None = None
    supply_sag: SupplySag | None = None
    sensors: Sensors = Sensors()

    @property
    def overlaps(self) -> tuple[float, float]:
        """Overlaps in extension and in retraction of the piston, shares of the spool's stroke."""
        retracting = self.valve_overlap_retracting
        return self.valve_overlap, self.valve_overlap if retracting is None else retracting

    @property
    def curves(self) -> tuple[ValveCurve | None, ValveCurve | None]:
        """Curves for extension and for retraction of the piston; None for a straight line."""
        return self.valve_curve, self.valve_curve_retracting or self.valve_curve


HoldsFor = Literal["arm", "tip"]


class Box(Section):
    """A rectangle along the axes."""

    x_min: Coordinate = Field(description="[m]")
    z_min: Coordinate = Field(description="[m]")
    x_max: Coordinate = Field(description="[m]")
    z_max: Coordinate = Field(description="[m]")


class BoxZone(Box):
    """A box that the whole arm, or only its tip, keeps out of; with y if joint 1 slews."""

    y_min: Coordinate | None = Field(default=None, description="of arms that slew [m]")
    y_max: Coordinate | None = Field(default=None, description="of arms that slew [m]")
    holds_for: HoldsFor = "arm"


class CircleZone(Section):
    """A circle that the whole arm, or only its tip, keeps out of."""

    x: Coordinate = Field(description="of the centre [m]")
    z: Coordinate = Field(description="of the centre [m]")
    radius: float = Field(ge=1e-4, le=100, description="[m]")
    holds_for: HoldsFor = "arm"


class CylinderZone(Section):
    """An upright cylinder that a slewing arm, or only its tip, keeps out of."""

    x: Coordinate = Field(description="of the axis [m]")
    y: Coordinate = Field(description="of the axis [m]")
    z_min: Coordinate = Field(description="[m]")
    z_max: Coordinate = Field(description="[m]")
    radius: float = Field(ge=1e-4, le=100, description="[m]")
    holds_for: HoldsFor = "arm"


class SphereZone(Section):
    """A sphere that a slewing arm, or only its tip, keeps out of."""

    x: Coordinate = Field(description="of the centre [m]")
    y: Coordinate = Field(description="of the centre [m]")
    z: Coordinate = Field(description="of the centre [m]")
    radius: float = Field(ge=1e-4, le=100, description="[m]")
    holds_for: HoldsFor = "arm"


class KeepOut(Section):
    """Obstacles that the arm keeps clear of. Each one may be left out."""

    margin: NonNegative = Field(
        default=0.005,
        le=0.1,
        description="that the discrete path keeps, for the trajectory to cut corners [m]",
    )
    link_radii: tuple[Annotated[float, Field(ge=0, le=5)], ...] = Field(
        default=(),
        description="half the thickness of each link in the plane [m]; none: links are lines",
    )
    ground: Coordinate | None = Field(
        default=None, description="height below which nothing gets [m]"
    )
    base: Box | None = Field(default=None, description="all links but the first keep out of it")
    self_collision: bool = Field(
        default=False, description="whether links that are not neighbours keep apart"
    )
    boxes: tuple[BoxZone, ...] = ()
    circles: tuple[CircleZone, ...] = ()
    cylinders: tuple[CylinderZone, ...] = ()
    spheres: tuple[SphereZone, ...] = ()


BOOSTER_VALUES: dict[str, dict[str, Any]] = {
    "modules": {"per_mode": (0, 1, 2)},
    "servo_pump": {"max_flow": 4e-6, "efficiency": 0.56},
    "circuit": {
        "rail_volume": 1e-5,
        "switching_valve_flow": 6e-5,
        "switching_valve_pressure_drop": 1e5,
        "switching_valve_time": 0.02,
        "servo_pump_lag": 0.02,
        "servo_pump_flow_reserve": 1e-6,
        "servo_pump_slew": 4e-4,
        "servo_pump_power": 100.0,
        "rail_bleed_flow": 1e-8,
    },
}
"""Values of keys that a file may leave out if no booster module is fitted, by section.

No oil flows through these parts; the values only keep the equations of the circuit regular."""


def _complete_booster_keys(content: Any) -> Any:
    """Return a machine file's content with values for the booster keys that it may leave out.

    Args:
        content: Content as read from the file, not yet validated.

    Returns:
        If `hydraulics.modules.count` is 0, a copy with `BOOSTER_VALUES` for the keys left out, and
        the main pump's pressure, limited to the valid range, for `max_boost_pressure`. Otherwise
        the content itself. An empty section `servo_pump` counts as left out. A section of a wrong
        type stays as it is, so that the validation reports it.
    """
    oil = _read_section(content, "hydraulics")
    modules, pump = _read_section(oil, "modules"), oil.get("servo_pump")
    if modules.get("count") != 0:
        return content
    changed = {"modules": BOOSTER_VALUES["modules"] | modules}
    if pump is None or isinstance(pump, dict):
        try:
            pressure = float(_read_section(oil, "main_pump")["pressure"])
        except (KeyError, TypeError, ValueError):  # is a problem of the file by itself
            pressure = MAX_SUPPLY_PRESSURE
        highest = {"max_boost_pressure": min(max(1.0, pressure), MAX_SUPPLY_PRESSURE)}
        changed["servo_pump"] = highest | BOOSTER_VALUES["servo_pump"] | (pump or {})
    completed = content | {"hydraulics": oil | changed}
    if isinstance(content.get("circuit"), dict):
        completed["circuit"] = BOOSTER_VALUES["circuit"] | content["circuit"]
    return completed


def _read_section(content: Any, key: str) -> dict[str, Any]:
    """Return a section of a mapping; empty if the section or the content is not a mapping."""
    section = content.get(key) if isinstance(content, dict) else None
    return section if isinstance(section, dict) else {}


class MachineConfig(Section):
    """Content of a whole machine file.

    With `hydraulics.modules.count: 0`, the file may leave out the keys of booster modules.
    """

    complete_booster_keys = model_validator(mode="before")(_complete_booster_keys)

    schema_version: Literal[1, 2] = Field(description="2 names the kind of each joint")
    name: str = Field(
        pattern=r"^[A-Za-z][A-Za-z0-9_]*$",
        max_length=64,
        description="letters A to Z and a to z, digits and '_' only, beginning with a letter",
    )
    gravity: NonNegative = Field(le=100, description="downwards [m/s²]")
    payload: Payload
    workspace: Workspace
    joints: tuple[Joint, ...] = Field(min_length=1)
    hydraulics: Hydraulics
    motion: Motion
    keep_out: KeepOut = KeepOut()
    circuit: CircuitDynamics
    servo: Servo
    simulation: Simulation
    imperfections: Imperfections = Imperfections()


COMMON_PATHS = {
    "rated_flow": "hydraulics.valve.rated_flow",
    "rated_pressure_drop_per_land": "hydraulics.valve.rated_pressure_drop_per_land",
    "max_piston_speed": "motion.max_piston_speed",
    "relief_pressure": "circuit.chamber_relief_pressure",
}
"""Quantities for which an actuator may have its own value; path of each common value."""
