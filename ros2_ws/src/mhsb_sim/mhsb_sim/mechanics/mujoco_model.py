"""The machine as a MuJoCo model: links and payload, and a motor for each cylinder's torque.

Linkages have no mass: a cylinder acts on its joint alone, by τ = r(q) F with the moment arm of
`mhsb_model.linkages`, which holds for every kind and is exact. (Rocker and coupler as bodies of
50 g, closed by an equality constraint, are 4e-4 of the torque off and double the time of a step.)
The plane is x (forward), z (up); joints turn about −y, so that a positive angle raises the tip.
A telescope slides along its link's x axis, from the tip of the link before. A slew turns about z,
and joint 2 lies ahead of its axis, at its height.
"""

from __future__ import annotations

import math

import mujoco

from mhsb_model.machine import Machine
from mhsb_model.schema import AnyJoint, FourBar, Linkage, Pin, Platform, SliderCrank
from mhsb_sim.mechanics.linkage_shapes import BESIDE

RAISING_AXIS = (0.0, -1.0, 0.0)
ALONG_AXIS = (1.0, 0.0, 0.0)
UPRIGHT_AXIS = (0.0, 0.0, 1.0)
SLENDER = 1e-6
"""Inertia of a link about its own axis [kg m²]: of no effect in the plane, but not zero."""

STEEL = (0.30, 0.34, 0.40, 1.0)
LINK_PAINT = (0.93, 0.68, 0.14, 1.0)
LOAD = (0.55, 0.16, 0.14, 1.0)
FLOOR = (0.80, 0.82, 0.84, 1.0)
SKY = ((0.93, 0.95, 0.97), (0.72, 0.79, 0.87))
FLOOR_HEIGHT = -1.2
"""Of an arm of the paper's size, as all that is only drawn [m]."""

PLATFORM_HEIGHT = 0.1  # m


def build_model(machine: Machine) -> mujoco.MjModel:
    """MuJoCo model of a machine: n hinge or slide joints and n motors on them, in its order.

    Control k is the torque of cylinder k about joint k [N m], its force where that slides [N].
    MuJoCo's own reset after a bad state is off: a diverged state stays where it can be seen.
    """
    spec = mujoco.MjSpec()
    spec.modelname = machine.name
    spec.option.timestep = machine.config.simulation.step
    spec.option.gravity = (0.0, 0.0, -machine.config.gravity)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1600, 1200
    size = machine.scale
    _add_surroundings(spec, size)
    parent, offset = spec.worldbody, 0.0
    for index, joint in enumerate(machine.config.joints):
        body = _add_link(parent, offset, index, joint, size)
        _add_pins(parent, body, offset, index, joint.linkage)
        _add_motor(spec, index)
        parent, offset = body, joint.link.length
    _add_payload(parent, offset, machine.config.payload.mass, size)
    return spec.compile()


def set_payload(model: mujoco.MjModel, mass: float) -> None:
    """Hang another point mass [kg] on the tip of a model that may be running."""
    model.body("payload").mass[0] = mass
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _add_surroundings(spec: mujoco.MjSpec, scale: float) -> None:
    world = spec.worldbody
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=SKY[0],
        rgb2=SKY[1],
        width=256,
        height=256,
    )
    world.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=(0.0, 0.0, scale * FLOOR_HEIGHT),
        size=(6.0 * scale, 6.0 * scale, 0.1),
        rgba=FLOOR,
    )
    for name, size, bottom in (
        ("foot", (0.20, 0.16, 0.02), 0.0),
        ("column", (0.05, 0.03, 0.6), 0.04),
    ):
        world.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=(0.0, 0.03 * scale, scale * (FLOOR_HEIGHT + bottom + size[2])),
            size=[scale * each for each in size],
            rgba=STEEL,
        )
    light = (1.5 * scale, -2.5 * scale, 3.0 * scale)
    world.add_light(pos=light, dir=(-0.4, 0.7, -0.8), diffuse=(0.45, 0.45, 0.45))
    spec.visual.headlight.ambient = (0.45, 0.45, 0.45)
    spec.visual.headlight.diffuse = (0.35, 0.35, 0.35)


def _add_link(
    parent: mujoco.MjsBody, offset: float, index: int, joint: AnyJoint, size: float
) -> mujoco.MjsBody:
    link = joint.link
    along = link.inertia if joint.kind == "slew" else SLENDER
    body = parent.add_body(
        name=f"link_{index + 1}",
        pos=(offset, 0.0, 0.0),
        explicitinertial=True,
        mass=link.mass,
        ipos=(link.center_of_mass, 0.0, 0.0),
        inertia=(along, link.inertia, link.inertia),
    )
    slides, limits = joint.kind == "prismatic", (joint.limits.lower, joint.limits.upper)
    axes = {"revolute": RAISING_AXIS, "prismatic": ALONG_AXIS, "slew": UPRIGHT_AXIS}
    body.add_joint(
        name=f"joint_{index + 1}",
        type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
        axis=axes[joint.kind],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=limits if slides else tuple(map(math.degrees, limits)),
    )
    if isinstance(link, Platform):
        _draw_platform(body, link)
        return body
    if slides:
        _draw_extension(body, link.length, joint.limits.upper, size)
        return body
    width = 0.06 * link.length + 0.015 * size
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=(link.length / 2, 0.0, 0.0),
        size=(link.length / 2, 0.018 * size, width / 2),
        rgba=LINK_PAINT,
    )
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        fromto=(0.0, -0.03 * size, 0.0, 0.0, 0.03 * size, 0.0),
        size=(0.022 * size, 0.0, 0.0),
        rgba=STEEL,
    )
    return body


def _draw_platform(body: mujoco.MjsBody, platform: Platform) -> None:
    """A turntable about the axis, as wide as it reaches to joint 2."""
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        fromto=(0.0, 0.0, -PLATFORM_HEIGHT, 0.0, 0.0, 0.0),
        size=(max(platform.length, PLATFORM_HEIGHT), 0.0, 0.0),
        rgba=STEEL,
    )


def _draw_extension(body: mujoco.MjsBody, length: float, stroke: float, size: float) -> None:
    """The sliding part from its tip back, as long as it ever shows."""
    half = 0.5 * (length + stroke)
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=(length - half, 0.0, 0.0),
        size=(half, 0.012 * size, 0.015 * size),
        rgba=STEEL,
    )


def _add_pins(
    parent: mujoco.MjsBody, body: mujoco.MjsBody, offset: float, index: int, linkage: Linkage
) -> None:
    """Pins that are fixed in a link, as sites `actuator_k_…`; what needs no linkage shows none."""
    if not isinstance(linkage, SliderCrank | FourBar):
        return
    pins = [
        ("parent_pin", parent, offset, linkage.parent_pin),
        ("child_pin", body, 0.0, linkage.child_pin),
    ]
    if isinstance(linkage, FourBar):
        pins.append(("rocker_pivot", parent, offset, linkage.rocker_pivot))
    for name, frame, start, pin in pins:
        frame.add_site(
            name=f"actuator_{index + 1}_{name}",
            pos=_pin_position(start, pin),
            size=(0.012, 0.0, 0.0),
            rgba=STEEL,
        )


def _add_motor(spec: mujoco.MjSpec, index: int) -> None:
    motor = spec.add_actuator(
        name=f"actuator_{index + 1}",
        target=f"joint_{index + 1}",
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        ctrllimited=mujoco.mjtLimited.mjLIMITED_FALSE,
    )
    motor.set_to_motor()


def _pin_position(offset: float, pin: Pin) -> tuple[float, float, float]:
    x = offset + pin.radius * math.cos(pin.angle)
    return (x, BESIDE, pin.radius * math.sin(pin.angle))


def _add_payload(parent: mujoco.MjsBody, offset: float, mass: float, size: float) -> None:
    payload = parent.add_body(
        name="payload",
        pos=(offset, 0.0, 0.0),
        explicitinertial=True,
        mass=mass,
        ipos=(0.0, 0.0, 0.0),
        inertia=(0.0, 0.0, 0.0),
    )
    payload.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(0.05 * size, 0.0, 0.0), rgba=LOAD)
    payload.add_site(name="tip", size=(0.005, 0.0, 0.0))
