"""The machine as a MuJoCo model: links, payload, and a motor for each cylinder's torque.

Linkages have no mass. A cylinder acts on its joint alone, by τ = r(q) F with the moment arm r of
`mhsb_model.linkages`. That is exact for every kind of linkage. (Rocker and coupler as bodies of 50
g, closed by an equality constraint, change the torque by 4e-4 and double the time of a step.)

The plane is x (forward), z (up). Joints turn about −y, so that a positive angle raises the tip. A
telescope slides along its link's x axis, from the tip of the link before. A slew turns about z;
joint 2 lies ahead of the slew axis, at its height.
"""

import math

import mujoco

from mhsb_model.machine import Machine
from mhsb_model.schema import AnyJoint, FourBar, Linkage, Platform, SliderCrank
from mhsb_sim.mechanics.linkage_shapes import LINKAGE_OFFSET

RAISING_AXIS = (0.0, -1.0, 0.0)
ALONG_AXIS = (1.0, 0.0, 0.0)
UPRIGHT_AXIS = (0.0, 0.0, 1.0)
AXIAL_INERTIA = 1e-6
"""Inertia of a link about its own axis [kg m²]: without effect in the plane, but not zero."""

STEEL_COLOR = (0.30, 0.34, 0.40, 1.0)
LINK_PAINT = (0.93, 0.68, 0.14, 1.0)
LOAD_COLOR = (0.55, 0.16, 0.14, 1.0)
FLOOR_COLOR = (0.80, 0.82, 0.84, 1.0)
SKY_COLORS = ((0.93, 0.95, 0.97), (0.72, 0.79, 0.87))
FLOOR_HEIGHT = -1.2
"""Height of the floor for an arm of the paper's size [m]; only drawn."""

PLATFORM_HEIGHT = 0.1
"""Height of a drawn slew platform [m]."""


def build_model(machine: Machine) -> mujoco.MjModel:
    """Build the MuJoCo model of a machine, with n joints and n motors in the machine's order.

    Joints are hinges or, for telescopes, slides. Control k is the torque of cylinder k about joint
    k [N m], or its force on a slide [N]. Contacts are off. MuJoCo's automatic reset of a bad state
    is off, too, so that a diverged state stays visible.

    Args:
        machine: The machine.

    Returns:
        The compiled model, with the time step of the machine's simulation.
    """
    spec = mujoco.MjSpec()
    spec.modelname = machine.name
    spec.option.timestep = machine.config.simulation.step
    spec.option.gravity = (0.0, 0.0, -machine.config.gravity)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1600, 1200
    size = machine.relative_size
    _add_surroundings(spec, size)
    parent, offset = spec.worldbody, 0.0
    for index, joint in enumerate(machine.config.joints):
        body = _add_link(parent, offset, index, joint, size)
        _add_pins(parent, body, offset, index, joint.linkage)
        motor = spec.add_actuator(
            name=f"actuator_{index + 1}",
            target=f"joint_{index + 1}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            ctrllimited=mujoco.mjtLimited.mjLIMITED_FALSE,
        )
        motor.set_to_motor()
        parent, offset = body, joint.link.length
    _add_payload(parent, offset, machine.config.payload.mass, size)
    return spec.compile()


def set_payload(model: mujoco.MjModel, mass: float) -> None:
    """Change the payload's mass at the tip of a model, also during a simulation.

    MuJoCo's constants that depend on the masses are computed again.

    Args:
        model: The model, changed in place.
        mass: Payload [kg].
    """
    model.body("payload").mass[0] = mass
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _add_surroundings(spec: mujoco.MjSpec, scale: float) -> None:
    """Add sky, floor, foot, column and lights, which are only drawn.

    Args:
        spec: Model specification, changed in place.
        scale: Size of the arm relative to the paper's.
    """
    world = spec.worldbody
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=SKY_COLORS[0],
        rgb2=SKY_COLORS[1],
        width=256,
        height=256,
    )
    world.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=(0.0, 0.0, scale * FLOOR_HEIGHT),
        size=(6.0 * scale, 6.0 * scale, 0.1),
        rgba=FLOOR_COLOR,
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
            rgba=STEEL_COLOR,
        )
    light = (1.5 * scale, -2.5 * scale, 3.0 * scale)
    world.add_light(pos=light, dir=(-0.4, 0.7, -0.8), diffuse=(0.45, 0.45, 0.45))
    spec.visual.headlight.ambient = (0.45, 0.45, 0.45)
    spec.visual.headlight.diffuse = (0.35, 0.35, 0.35)


def _add_link(
    parent: mujoco.MjsBody, offset: float, index: int, joint: AnyJoint, size: float
) -> mujoco.MjsBody:
    """Add a link with its joint, joint limits and drawn shape.

    Args:
        parent: Body of the link before, or the world.
        offset: Distance of the joint along the parent's x axis [m].
        index: Index k of the joint, from 0. The name of the body is `link_<k + 1>`, that of the
            joint `joint_<k + 1>`.
        joint: Joint and link of the machine file.
        size: Size of the arm relative to the paper's, for drawn shapes.

    Returns:
        The body of the link.
    """
    link = joint.link
    along = link.inertia if joint.kind == "slew" else AXIAL_INERTIA
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
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CYLINDER,
            fromto=(0.0, 0.0, -PLATFORM_HEIGHT, 0.0, 0.0, 0.0),
            size=(max(link.length, PLATFORM_HEIGHT), 0.0, 0.0),
            rgba=STEEL_COLOR,
        )
        return body
    if slides:
        half = 0.5 * (link.length + joint.limits.upper)  # back into the link before it
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=(link.length - half, 0.0, 0.0),
            size=(half, 0.012 * size, 0.015 * size),
            rgba=STEEL_COLOR,
        )
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
        rgba=STEEL_COLOR,
    )
    return body


def _add_pins(
    parent: mujoco.MjsBody, body: mujoco.MjsBody, offset: float, index: int, linkage: Linkage
) -> None:
    """Add the pins of a linkage as sites of the links in which they are fixed.

    A slider-crank has a parent pin and a child pin; a four-bar has a rocker pivot, too. Other
    linkages have no pins. The names of the sites are `actuator_<k>_parent_pin`,
    `actuator_<k>_child_pin` and `actuator_<k>_rocker_pivot`.

    Args:
        parent: Body of the link before the joint.
        body: Body of the link after the joint.
        offset: Distance of the joint along the parent's x axis [m].
        index: Index of the actuator, from 0. The number k in the names is one more.
        linkage: Linkage of the machine file.
    """
    if not isinstance(linkage, SliderCrank | FourBar):
        return
    pins = [
        ("parent_pin", parent, offset, linkage.parent_pin),
        ("child_pin", body, 0.0, linkage.child_pin),
    ]
    if isinstance(linkage, FourBar):
        pins.append(("rocker_pivot", parent, offset, linkage.rocker_pivot))
    for name, frame, start, pin in pins:
        x, z = pin.radius * math.cos(pin.angle), pin.radius * math.sin(pin.angle)
        frame.add_site(
            name=f"actuator_{index + 1}_{name}",
            pos=(start + x, LINKAGE_OFFSET, z),
            size=(0.012, 0.0, 0.0),
            rgba=STEEL_COLOR,
        )


def _add_payload(parent: mujoco.MjsBody, offset: float, mass: float, size: float) -> None:
    """Add the payload as a point mass, with a drawn sphere and the site `tip`.

    Args:
        parent: Body of the last link.
        offset: Length of that link [m].
        mass: Payload [kg].
        size: Size of the arm relative to the paper's, for the drawn sphere.
    """
    payload = parent.add_body(
        name="payload",
        pos=(offset, 0.0, 0.0),
        explicitinertial=True,
        mass=mass,
        ipos=(0.0, 0.0, 0.0),
        inertia=(0.0, 0.0, 0.0),
    )
    payload.add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(0.05 * size, 0.0, 0.0), rgba=LOAD_COLOR
    )
    payload.add_site(name="tip", size=(0.005, 0.0, 0.0))
