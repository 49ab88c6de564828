"""The bodies of MuJoCo's reality: table, pedestal, arm and blocks, and which of them can touch."""

from collections.abc import Sequence
from xml.etree import ElementTree

import mujoco
import numpy as np

from apf.panda.layout import Layout
from apf.panda.model import urdf
from apf.panda.reality.base import Mujoco
from apf.panda.scene import TABLE_THICKNESS
from apf.panda.vision.cameras import WristCamera
from apf.towers import BlockSet

ARM_JOINTS = [f"panda_joint{i}" for i in range(1, 8)]
FINGER_JOINTS = ["panda_finger_joint1", "panda_finger_joint2"]
FINGER_BODIES = ["panda_leftfinger", "panda_rightfinger"]
HAND, TARGET = "panda_hand", "panda_grasptarget"

STIFFNESS = [8000.0] * 4 + [4000.0] * 3
"""Torque of a motor for an error of its joint [Nm/rad],"""
DAMPING = [400.0] * 4 + [120.0] * 3
"""and of its velocity [Nm s/rad]."""
ROTOR = 0.1
"""Inertia that a motor adds to its joint [kg m^2]."""
FINGER_DAMPING = 1000.0
"""Force of a finger's motor for an error of the finger's velocity [N s/m]."""
FINGER_ROTOR = 1.0
"""Mass that a motor adds to its finger [kg]."""
HARDNESS = (0.95, 0.99, 0.001, 0.5, 2.0)
"""MuJoCo's solimp of contacts."""


def block_name(index: int) -> str:
    """Of the body and joint of a block."""
    return f"block_{index}"


def model_of(
    layout: Layout,
    wrist: WristCamera,
    physics: Mujoco,
    blocks: BlockSet,
    friction: np.ndarray,
    fingers: float,
    forces: Sequence[float],
) -> mujoco.MjModel:
    """All bodies. Actuators: the seven motors of the arm, then those of the fingers. Equalities: fingers, then blocks.

    Args:
        layout: Places on the table.
        wrist: The camera on the hand.
        physics: Settings of the simulation.
        blocks: The set as it really is.
        friction: [B] factors of the friction of the blocks.
        fingers: Coefficient of friction of the fingers' pads.
        forces: [7] largest torques of the arm's motors [Nm].
    """
    spec = _robot(wrist)
    option = spec.option
    option.timestep = 1 / physics.rate
    option.iterations = physics.iterations
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = physics.grip
    for body in spec.bodies[1:]:
        body.gravcomp = 1.0
    _add_motors(spec, forces)
    arm = {geom.name: _coefficient(geom, physics, fingers) for geom in _named(spec)}
    ground = {name: physics.friction for name in _add_ground(spec, layout)}
    cuboids = {_add_block(spec, blocks, i): float(physics.friction * friction[i]) for i in range(len(blocks))}
    names = list(cuboids)
    for i, block in enumerate(names):
        for others in (ground, arm, {name: cuboids[name] for name in names[:i]}):
            for other, coefficient in others.items():
                _add_pair(spec, block, other, cuboids[block] * coefficient, physics)
    for part, coefficient in arm.items():
        for other in ground:
            _add_pair(spec, part, other, coefficient * ground[other], physics)
    return spec.compile()


def _robot(wrist: WristCamera) -> mujoco.MjSpec:
    """The arm of the URDF, without what is only drawn. All its frames stay, and its fingers move together."""
    root = ElementTree.parse(urdf(wrist)).getroot()
    for link in root.iter("link"):
        for part in link.findall("visual"):
            link.remove(part)
    options = {"strippath": "false", "fusestatic": "false", "balanceinertia": "true"}
    ElementTree.SubElement(ElementTree.SubElement(root, "mujoco"), "compiler", options)
    return mujoco.MjSpec.from_string(ElementTree.tostring(root, encoding="unicode"))


def _add_motors(spec: mujoco.MjSpec, forces: Sequence[float]) -> None:
    """The arm's: PD control of place and velocity, for one number, place + velocity * damping / stiffness."""
    for name, stiffness, damping, force in zip(ARM_JOINTS, STIFFNESS, DAMPING, forces):
        spec.joint(name).armature = ROTOR
        _add_motor(spec, name, stiffness, (-stiffness, -damping), force)
    for name in FINGER_JOINTS:
        spec.joint(name).armature = FINGER_ROTOR
        _add_motor(spec, name, FINGER_DAMPING, (0.0, -FINGER_DAMPING), 1.0)


def _add_motor(spec: mujoco.MjSpec, joint: str, gain: float, bias: tuple[float, float], force: float) -> None:
    spec.add_actuator(
        name=joint,
        target=joint,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        gaintype=mujoco.mjtGain.mjGAIN_FIXED,
        gainprm=[gain] + [0.0] * 9,
        biastype=mujoco.mjtBias.mjBIAS_AFFINE,
        biasprm=[0.0, *bias] + [0.0] * 7,
        forcelimited=True,
        forcerange=[-force, force],
    )


def _named(spec: mujoco.MjSpec) -> list[mujoco.MjsGeom]:
    """The shapes of the arm but its base, which no block reaches; each with a name, none touching anything by itself."""
    found = []
    for number, geom in enumerate(spec.geoms):
        geom.contype = geom.conaffinity = 0
        if geom.parent.name != "panda_link0":
            geom.name = f"arm_{number}"
            found.append(geom)
    return found


def _coefficient(geom: mujoco.MjsGeom, physics: Mujoco, fingers: float) -> float:
    return fingers if geom.parent.name in FINGER_BODIES else physics.friction


def _add_ground(spec: mujoco.MjSpec, layout: Layout) -> tuple[str, str]:
    (x0, x1), (y0, y1) = layout.table_x, layout.table_y
    width, depth, height = layout.pedestal_size
    table = ((x1 - x0, y1 - y0, TABLE_THICKNESS), ((x0 + x1) / 2, (y0 + y1) / 2, -TABLE_THICKNESS / 2))
    pedestal = ((width, depth, height), (*layout.pedestal, height / 2))
    for name, (size, place) in {"table": table, "pedestal": pedestal}.items():
        _add_box(spec.worldbody, name, np.array(size), place)
    return "table", "pedestal"


def _add_block(spec: mujoco.MjSpec, blocks: BlockSet, index: int) -> str:
    """A block whose frame is at its centre of geometry; the name of its shape."""
    name, mass, dims = block_name(index), float(blocks.mass[index]), blocks.dims[index]
    body = spec.worldbody.add_body(name=name)
    body.add_freejoint(name=name)
    body.explicitinertial = True
    body.mass, body.ipos = mass, blocks.com[index]
    body.inertia = mass / 12 * (dims @ dims - dims**2)
    _add_box(body, name, dims, (0.0, 0.0, 0.0))
    weld = spec.add_equality(type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY, name1=HAND, name2=name)
    weld.active = False
    return name


def _add_box(body: mujoco.MjsBody, name: str, size: np.ndarray, place: tuple[float, ...]) -> None:
    box = mujoco.mjtGeom.mjGEOM_BOX
    body.add_geom(name=name, type=box, size=size / 2, pos=place, contype=0, conaffinity=0)


def _add_pair(spec: mujoco.MjSpec, one: str, other: str, friction: float, physics: Mujoco) -> None:
    """Two shapes that can touch. MuJoCo would take the larger coefficient of friction; here it is their product."""
    spec.add_pair(
        geomname1=one,
        geomname2=other,
        condim=3,
        friction=[friction, friction, 0.005, 0.0001, 0.0001],
        solref=[physics.contact, 1.0],
        solimp=HARDNESS,
    )
